"""The experiment with a robot of one's own: a URDF, an MJCF or a vehicle's TOML file, or a name.

The plants read URDF files. An MJCF file is read as `nsaid identify` reads it and written as a URDF
into the folder of the design, which the experiment then needs alone. Nominal frictions and rotor
inertia, of which a plant has one value for all joints, are the medians of the file's. A vehicle's
file is of a known family, whose scenario says how it is driven.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..calibration.models import load_robot_model
from ..calibration.sheets import plant_of
from ..control import FourierTracking
from ..errors import UnknownName
from ..experiment.library import load
from ..experiment.scenario import Scenario
from ..plants import ArmPlant
from ..resources import scenarios, vehicle_files
from ..robot.text import root_tag
from ..robot.urdf_tree import write_tree_urdf
from ..system import SecondOrderSystem
from .limits import Limit, Limits, source_of

URDF = "robot.urdf"
_EXCITATION = FourierTracking(fundamental=0.2, harmonics=10)
_STEP = 1e-3  # of an arm's simulation [s]
_OF_LOGS = ("command", "no_actuator", "servo", "actuator_lag")  # findings of what u in a log means
_UNLIMITED = 1e6  # what some readers of URDFs put where there is no limit


def scenario_of_model(model: str, folder: Path) -> tuple[Scenario, list[str]]:
    """The experiment with a robot, before it has a motion.

    Args:
        model: path of a URDF, an MJCF (.xml or .mjb) or a vehicle's TOML file or folder; or the
            name of a robot.
        folder: an existing folder for the URDF that is made of an MJCF.

    Returns:
        The scenario, and what was noticed about the file, in words.

    Raises:
        BadRobot, InvalidInput, UnknownName: as `load_robot_model` does.
    """
    path = Path(model).expanduser()
    if path.suffix.lower() == ".toml" or (path.is_dir() and (path / "vehicle.toml").is_file()):
        return _vehicle(path), []
    noticed: list[str] = []
    joints: dict[str, float] = {}
    if _is_mjcf(path):
        own = load_robot_model(str(path))  # tells if there is no such file
        write_tree_urdf(own, folder / URDF)
        noticed = [str(each) for each in own.findings if each.code not in _OF_LOGS]
        path = folder / URDF
        values = {"damping": own.damping, "friction": own.friction, "armature": own.rotor}
        joints = {name: float(np.median(x)) for name, x in values.items() if np.median(x) > 0}
    robot = str(path.resolve()) if path.is_file() else model
    plant = ArmPlant(robot=robot, **joints)  # type: ignore[arg-type]  # three numbers
    return replace(load("ur5"), plant=plant, excitation=_EXCITATION, dt=_STEP), noticed


def _is_mjcf(path: Path) -> bool:
    """Whether a file is an MJCF, by its content: a URDF may also be called .xml."""
    suffix = path.suffix.lower()
    if suffix == ".xml" and path.is_file():
        return root_tag(path) == "mujoco"
    return suffix in (".xml", ".mjb")


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
