"""Converts Pinocchio's models, and the inertias of their bodies, to `dynamics.structures`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..dynamics import tree as recursion
from ..dynamics.structures import Linkage, LoadedTree
from ..parameters import Array, Indices
from .optional import pin


def linkage_of(model: pin.Model, friction_speed: Array, columns: Indices) -> Linkage:
    """The tree of a Pinocchio model of 1-DOF joints, whose root may be a free flyer.

    Args:
        model: the tree; inertias are not read.
        friction_speed: (k,) joint speeds at which Coulomb friction saturates [rad/s or m/s].
        columns: (4,) first indices in θ, as in `Linkage`.
    """
    data, moving = model.createData(), list(model.joints)[1:]
    pin.computeJointJacobians(model, data, pin.neutral(model))
    placements = list(model.jointPlacements)[1:]
    joints = np.zeros((len(moving), recursion.WIDTH))
    numbers = np.array(
        [
            [parent - 1, joint.idx_q, recursion.BASE]
            for parent, joint in zip(list(model.parents)[1:], moving, strict=True)
        ]
    )
    first = len(joints) - len(friction_speed)
    for b in range(first, len(joints)):
        joint, R = moving[b], placements[b].rotation
        jacobian = pin.getJointJacobian(model, data, joint.id, pin.ReferenceFrame.LOCAL)
        axis = jacobian.reshape(6, -1)[:, joint.idx_v]  # of one joint it is (6,)
        slide, turn = axis[:3], axis[3:]
        along = np.outer(turn, turn)
        turns = np.linalg.norm(turn) > 0.5
        held = along if turns else np.eye(3)
        across = np.array([np.cross(turn, e) for e in np.eye(3)]).T
        for start, part in (
            (recursion.FIXED, held),
            (recursion.COSINE, np.eye(3) - held),
            (recursion.SINE, across),
        ):
            joints[b, start : start + 9] = (R @ part).ravel()
        joints[b, recursion.PLACE : recursion.PLACE + 3] = placements[b].translation
        joints[b, recursion.TRAVEL : recursion.TRAVEL + 3] = R @ slide
        joints[b, recursion.AXIS : recursion.AXIS + 6] = axis
        joints[b, recursion.FRICTION_SPEED] = friction_speed[b - first]
        turning = recursion.CIRCLE if joint.nq == 2 else recursion.TURN
        numbers[b, 2] = turning if turns else recursion.SLIDE
    return Linkage(joints, numbers, model.gravity.linear.copy(), columns)


class Carried(NamedTuple):
    """A 6×6 inertia attached to a body.

    Attributes:
        body: index of the body.
        tensor: (6, 6, s) with I = tensor · (the next s parameters), in the body's axes.
        weighs: whether the inertia also has weight.
    """

    body: int
    tensor: Array
    weighs: bool


def loaded(linkage: Linkage, inertias: list[Carried]) -> LoadedTree:
    """A tree with inertias, whose parameters are consecutive in θ, from index 0 on."""
    places, parameters, values, start = [], [], [], 0
    for body, tensor, weighs in inertias:
        i, j, k = at = np.nonzero(tensor)
        places.append(72 * body + 36 * weighs + 6 * i + j)
        parameters.append(start + k)
        values.append(tensor[at])
        start += tensor.shape[2]
    return LoadedTree(linkage, *map(np.concatenate, (places, parameters, values)))
