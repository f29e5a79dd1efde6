"""The experiment with a robot of one's own: a URDF, an MJCF or a vehicle's TOML file, or a name.

A vehicle's file is of a known family, whose scenario says how it is driven.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..calibration.models import plant_of
from ..control import FourierTracking
from ..errors import UnknownName
from ..experiment.library import load
from ..experiment.scenario import Scenario
from ..plants import ArmPlant
from ..resources import path_of, scenarios, vehicle_files
from ..system import SecondOrderSystem
from .limits import Limit, Limits, source_of

_EXCITATION = FourierTracking(fundamental=0.2, harmonics=10)
_STEP = 1e-3  # of an arm's simulation [s]
_UNLIMITED = 1e6  # what some readers of URDFs put where there is no limit


def scenario_of_model(model: str) -> Scenario:
    """The experiment with a robot, before it has a motion.

    Args:
        model: path of a URDF, an MJCF (.xml or .mjb) or a vehicle's TOML file or folder; or the
            name of a robot.

    Raises:
        InvalidInput, UnknownName: a vehicle's file is wrong.
    """
    path = path_of(model)
    if path.suffix.lower() == ".toml" or (path.is_dir() and (path / "vehicle.toml").is_file()):
        return _vehicle(path)
    plant = ArmPlant(robot=str(path.resolve()) if path.is_file() else model)
    return replace(load("ur5"), plant=plant, excitation=_EXCITATION, dt=_STEP)


def _vehicle(path: Path) -> Scenario:
    """The scenario of a vehicle's family, with the vehicle.

    Raises:
        UnknownName: no scenario has a vehicle of the family.
    """
    sheet = vehicle_files(str(path)).sheet
    plant = plant_of(sheet.resolve())
    for name in scenarios():
        known = load(name)
        if type(known.plant) is type(plant):
            return replace(known, plant=plant)
    raise UnknownName("scenario with a vehicle like", type(plant).__name__, scenarios())


def own_limits(system: SecondOrderSystem, default: Limits) -> Limits:
    """The limits of an arm's model file: position, velocity and effort.

    Where the file has none, or 0, as for accelerations, the default holds; `sources` of the result
    say which joints these are.

    Args:
        system: a tree of joints on a fixed base.
        default: the limits of random motions.
    """
    model, names = system.model, system.joint_names  # type: ignore[attr-defined]  # a tree
    limits, sources = dict(default.limits), dict(default.sources)
    ranges = [model.joints[i].idx_q for i in range(1, model.njoints)]
    bounded = [
        model.joints[i].nq == 1 and bool(np.isfinite(model.upperPositionLimit[k]))
        for i, k in enumerate(ranges, 1)
    ]
    low, high = system.limits  # type: ignore[attr-defined]  # as above
    limits["position"] = Limit(low, high, default.limits["position"].unit)
    missing = [name for name, given in zip(names, bounded, strict=True) if not given]
    sources["position"] = source_of(names, missing, "±π")
    for name, values in (("speed", model.velocityLimit), ("torque", model.effortLimit)):
        if name not in limits:
            continue
        own, given = limits[name], (values > 0) & (values < _UNLIMITED)
        largest = np.where(given, values, own.high)
        limits[name] = Limit(-largest, largest, own.unit)
        missing = [joint for joint, there in zip(names, given, strict=True) if not there]
        sources[name] = source_of(names, missing, default.sources.get(name, ""))
    return replace(default, limits=limits, sources=sources)
