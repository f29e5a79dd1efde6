"""A tree's links: the columns of their inertia and weight along a motion, and their size."""

from __future__ import annotations

import numpy as np

from ..parameters import Array, Block, Indices
from ..plants.arm import extent
from ..structure.blocks import link_block
from ..structure.joints import body_names, positions
from ..structure.optional import pin
from .problem import size_weights

_POSES = 300  # at which weight is computed
_LIGHT = 0.1  # share of weight in the links' torques below which inertia reveals their size


def torque_rows(model: pin.Model, coordinates: Array, v: Array, a: Array) -> Array:
    """(N, n, 10 b) Pinocchio's joint torque regressor at coordinates, v and a (N, n)."""
    data = model.createData()
    found = np.empty((len(v), model.nv, 10 * (model.njoints - 1)))
    for k, q in enumerate(positions(model, coordinates)):
        found[k] = pin.computeJointTorqueRegressor(model, data, q, v[k], a[k])
    return found


def own_inertia(model: pin.Model, coordinates: Array) -> Array:
    """(n, 10 b) mean columns of M_jj of every joint j at up to 300 of the coordinates (N, n)."""
    some = coordinates[:: -(-len(coordinates) // _POSES) or 1]
    weightless, ones = pin.Model(model), np.ones((len(some), 1))
    weightless.gravity = pin.Motion.Zero()
    return np.array(
        [
            torque_rows(weightless, some, 0.0 * ones * unit, ones * unit)[:, j].mean(axis=0)
            for j, unit in enumerate(np.eye(model.nv))
        ]
    )


def weight_columns(model: pin.Model, coordinates: Array) -> Array:
    """(K n, 10 b) columns of the links' weight at up to 300 of the coordinates (N, n)."""
    some = coordinates[:: -(-len(coordinates) // _POSES) or 1]
    rest = np.zeros((len(some), model.nv))
    return torque_rows(model, some, rest, rest).reshape(-1, 10 * (model.njoints - 1))


def limbs_of(model: pin.Model) -> Indices:
    """(b,) for the bodies behind all b joints, the number of the limb, from the base on."""
    found: list[int] = []
    for joint in range(1, model.njoints):
        parent = int(model.parents[joint])
        found.append(found[parent - 1] if parent else max(found, default=-1) + 1)
    return np.array(found, dtype=np.intp)


def sizes_of_links(model: pin.Model, moving: Array, weight: Array) -> Array:
    """(s, 10 b) w_k with w_kᵀθ the weight of limb k along the log over that in the model file.

    The weight's torques are the part that a motion separates from rotors and friction. Where they
    are negligible, as with vertical axes, inertia replaces them, and mass if such a limb stands
    still. `moving` (N, 10 b) are columns of inertia and weight along the log, `weight` (K, 10 b)
    those of weight alone.
    """
    limbs, found = np.repeat(limbs_of(model), 10), []
    for limb in range(limbs.max() + 1):
        own = np.where(limbs == limb, file_links(model), 0.0)
        still, whole = (np.linalg.norm(c @ own) / max(len(c), 1) ** 0.5 for c in (weight, moving))
        if max(still, whole) > 0:
            found.append(size_weights(moving if still < _LIGHT * whole else weight, own))
        else:
            masses = 1.0 * ((limbs == limb) & (np.arange(len(limbs)) % 10 == 0))
            found.append(masses / (masses @ own))
    return np.array(found)


def file_links(model: pin.Model) -> Array:
    """(10 b,) parameters of all links of a model."""
    return np.concatenate(
        [model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]
    )


def weight_of(model: pin.Model, coordinates: Array) -> Array:
    """(N, n) torques of the links' weight at coordinates (N, n)."""
    data, found = model.createData(), np.empty((len(coordinates), model.nv))
    for k, q in enumerate(positions(model, coordinates)):
        found[k] = pin.computeGeneralizedGravity(model, data, q)
    return found


def link_blocks(model: pin.Model) -> list[Block]:
    """The links' blocks of θ."""
    names, blocks = body_names(model), []
    for i in range(1, model.njoints):
        inertia = model.inertias[i]
        length = max(extent(inertia), 1e-3)
        blocks.append(link_block(i, names[i - 1], float(inertia.mass), length))
    return blocks
