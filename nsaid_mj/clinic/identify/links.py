"""A tree's links: the columns of their inertia and weight along a motion, their size, payloads.

No motion distinguishes masses, frictions and gains from twice as large ones. A payload of known
mass in some of the logs, but not in others, does: the log determines the ratio of all forces to
those of the payload.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base import InvalidInput, UnknownName, pin
from ...core import (
    Array,
    Block,
    Indices,
    SecondOrderSystem,
)
from ...robots import RobotModel
from .loads import Load
from .problem import size_weights

_POSES = 300  # at which weight is computed
_NOTHING = 1e-9  # torque per mass [N·m/kg] that is rounding
_LIGHT = 0.1  # share of weight in the links' torques below which inertia reveals their size


def own_inertia(system: SecondOrderSystem, coordinates: Array) -> Array:
    """(n, 10 b) mean columns of M_jj of every joint j at up to 300 of the coordinates (N, n).

    They are the positions of the system, which is one of links alone.
    """
    some = coordinates[:: -(-len(coordinates) // _POSES) or 1]
    x = np.hstack([some, np.zeros(some.shape)])
    return np.array([system.W_M(x, e)[:, j].mean(axis=0) for j, e in enumerate(np.eye(system.n))])


def weight_columns(system: SecondOrderSystem, coordinates: Array) -> Array:
    """(K n, 10 b) columns of the links' weight at up to 300 of the coordinates (N, n).

    They are the positions of the system, which is one of links alone.
    """
    some = coordinates[:: -(-len(coordinates) // _POSES) or 1]
    still = np.zeros(some.shape)
    x = np.hstack([some, still])
    u = np.zeros(system.n_u)
    return system.regressor(0.0, x, still, still, u).reshape(-1, system.p)


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
    limbs = np.repeat(limbs_of(model), 10)
    found = []
    for limb in range(limbs.max() + 1):
        own = np.where(limbs == limb, file_links(model), 0.0)
        still, whole = (np.linalg.norm(c @ own) / max(len(c), 1) ** 0.5 for c in (weight, moving))
        masses = 1.0 * ((limbs == limb) & (np.arange(len(limbs)) % 10 == 0))
        if max(still, whole) > _NOTHING * (masses @ own):
            found.append(size_weights(moving if still < _LIGHT * whole else weight, own))
        else:
            found.append(masses / (masses @ own))
    return np.array(found)


def file_links(model: pin.Model) -> Array:
    """(10 b,) parameters of all links of a model."""
    return np.concatenate(
        [model.inertias[i].toDynamicParameters() for i in range(1, model.njoints)]
    )


def weight_of(model: pin.Model, positions: Array) -> Array:
    """(N, n) torques of the links' weight at Pinocchio's positions (N, m)."""
    data = model.createData()
    found = np.empty((len(positions), model.nv))
    for k, q in enumerate(positions):
        found[k] = pin.computeGeneralizedGravity(model, data, q)
    return found


def link_blocks(robot: RobotModel) -> list[Block]:
    """The links' blocks of θ, of a floating base number 0."""
    from ...lab import extent

    links = list(robot.model.inertias)[1:]
    lengths = [max(extent(inertia), 1e-3) for inertia in links]
    return robot.system.link_blocks([float(inertia.mass) for inertia in links], lengths)


_GRIPPERS = {"gripper", "jaw", "finger", "hand"}
_SMALL = 0.05  # radius of a load, and of the region in which an unknown one is [m]
_ANYWHERE = 0.15


def check_loads(loads: Sequence[Load], sources: Sequence[str]) -> None:
    """Checks that every load belongs to one of the files `sources`, and that one carries none.

    Raises:
        InvalidInput: a log is missing, or all of them carry a load.
    """
    for load in loads:
        if load.source not in sources:
            raise InvalidInput("--load", "the name of a log", load.source, "Give it with --log.")
    if loads and {load.source for load in loads} >= set(sources):
        remedy = "Record the same robot without the load too."
        raise InvalidInput("--load", "a log that carries no load", "a load on all logs", remedy)


def carrier(model: pin.Model, load: Load) -> tuple[int, Array, bool]:
    """The joint that moves a load, the centre in its frame (3,) [m], and whether that is known.

    Raises:
        UnknownName: the model has no such link.
    """
    joint = model.njoints - 1
    if load.link:
        bodies = {f.name: f for f in model.frames if f.type == pin.FrameType.BODY and f.parentJoint}
        others = {f.name: f for f in model.frames if f.parentJoint}
        frame = bodies.get(load.link) or others.get(load.link)
        if frame is None:
            raise UnknownName("link", load.link, list(bodies))
        if load.centre is not None:
            return frame.parentJoint, frame.placement.act(np.array(load.centre)), True
        joint = frame.parentJoint
    else:
        while joint > 1 and _GRIPPERS & set(re.split(r"[^a-z]+", model.names[joint].lower())):
            joint = int(model.parents[joint])
    return joint, np.array(model.inertias[joint].lever), False


def with_mass(model: pin.Model, joint: int, mass: float, centre: Array) -> pin.Model:
    """A copy of the model with a small ball of a mass [kg] at a centre (3,) in a joint's frame."""
    found = pin.Model(model)
    ball = pin.Inertia.FromSphere(mass, _SMALL)
    found.inertias[joint] += pin.Inertia(mass, np.asarray(centre), ball.inertia)
    return found


class CarriedLoads(NamedTuple):
    """All loads of one mass and place, as parameters of a fit."""

    block: Block  # the ten inertial parameters, in the frame of the joint that moves the load
    prior: Array  # (10,) a ball of its mass, large if its place is unknown
    place: slice  # place of the carrying link's ten parameters in θ
    sources: frozenset[str]  # names of the files that carry it
    # its parameters by label: the mass if it is weighed, and its moments if its place is known
    known: dict[str, float]
    load: Load  # it, without a file


def payloads(model: pin.Model, loads: Sequence[Load]) -> list[CarriedLoads]:
    """The loads of a tree of joints, one for each mass and place."""
    found = []
    grouped = {}
    for load in loads:
        grouped.setdefault(load._replace(source=""), set()).add(load.source)
    for number, (load, sources) in enumerate(grouped.items(), 1):
        joint, centre, known = carrier(model, load)
        name = "payload" if len(grouped) == 1 else f"payload_{number}"
        block = Block.of_link(number, name, load.mass, _ANYWHERE)
        block = replace(block, name=name, names=tuple(f"payload_{x}" for x in block.names))
        prior = ball_at(model, joint, load.mass)
        if known:
            ball = pin.Inertia.FromSphere(load.mass, _SMALL)
            prior = pin.Inertia(load.mass, centre, ball.inertia).toDynamicParameters()
        fixed = range(4) if known else range(1)
        values = {block.labels[k]: float(prior[k]) for k in fixed if load.weighed}
        place = slice(10 * joint - 10, 10 * joint)
        found.append(CarriedLoads(block, prior, place, frozenset(sources), values, load))
    return found


def ball_at(model: pin.Model, joint: int, mass: float) -> Array:
    """(10,) parameters of a load of a mass [kg] anywhere near the link behind a joint."""
    ball = pin.Inertia.FromSphere(mass, _ANYWHERE)
    own = pin.Inertia(mass, np.array(model.inertias[joint].lever), ball.inertia)
    return np.array(own.toDynamicParameters())
