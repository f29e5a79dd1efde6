"""Weighed loads fixed to a vehicle in some of its logs, which fix the scale of everything else.

A load is a mass at a point: its inertia and its weight are known. In water it also displaces some,
which lifts it where it hangs; of that, only the density of usual weights is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...base import InvalidInput, pin
from ...core import GRAVITY, Block, Column, Inertia, ParameterSpace, SecondOrderSystem
from ...robots import RobotModel
from .links import CarriedLoads, payloads
from .loads import Load

_DISPLACED = 0.15  # buoyancy of a load over its weight: .09 of lead, .13 of steel
BUOYANCY_SPREAD = 0.5
"""Standard deviation of its logarithm: that of aluminium is .37 of its weight."""

_LINK = "body"  # the one link of a vehicle


def carried_by(robot: RobotModel, loads: Sequence[Load]) -> list[CarriedLoads]:
    """The loads of any robot, one for each mass and place."""
    if robot.jointed or not loads:
        return payloads(robot.model, loads) if loads else []
    found = []
    places = dict.fromkeys(load._replace(source="") for load in loads)
    for number, load in enumerate(places, 1):
        name = "payload" if len(places) == 1 else f"payload_{number}"
        lift = _DISPLACED * load.mass * GRAVITY
        values = {f"mass of {name}": (name, "kg", load.mass)}
        if robot.dry_mass is not None and robot.system.n == 6:
            values[f"buoyancy of {name}"] = (f"{name}_buoyancy", "N", lift)
        names, units, scale = zip(*values.values(), strict=True)
        labels = tuple(values)
        block = Block(name, names, units, np.array(scale), "positive", labels=labels)
        sources = frozenset(x.source for x in loads if x._replace(source="") == load)
        known = {labels[0]: load.mass} if load.weighed else {}
        found.append(CarriedLoads(block, block.scale, slice(0, 0), sources, known, load))
    return found


def check_place(loads: Sequence[Load]) -> None:
    """Raises `InvalidInput` unless the place of every load on a vehicle is stated."""
    for load in loads:
        if load.link != _LINK or load.centre is None:
            expected = f"of a vehicle, FILE:MASSkg@{_LINK}:X,Y,Z"
            remedy = "X, Y, Z is its centre in the axes of the vehicle's sheet [m]."
            raise InvalidInput("--load", expected, load, remedy)


def pulled_by(system: SecondOrderSystem, carried: CarriedLoads) -> SecondOrderSystem:
    """What a load alone does to a vehicle: a system whose parameters are those of its block."""
    point = np.array(carried.load.centre)
    mass = pin.Inertia(1.0, point, np.zeros((3, 3))).matrix()
    columns = [
        Column(kind, k, body=0, point=point) for k, kind in enumerate(("payload", "buoyancy"))
    ]
    own = replace(
        system.structure,
        inertias=[Inertia(0, 0, mass[:, :, None])],
        columns=columns[: len(carried.block)],
        rotors=(),
        gravity=(0.0, 0.0, -GRAVITY),
        p=len(carried.block),
    )
    return system.rebuilt(own, ParameterSpace((carried.block,)))
