"""Any robot to identify: a tree of joints from its file, or a vehicle from its sheet."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base import Finding, InputFile, InvalidInput, NsaidError, UnknownName
from ...lab import load
from ...robots import (
    BadRobot,
    RobotModel,
    VehicleFiles,
    is_vehicle,
    load_tree,
    packed_vehicles,
    scenarios,
)

if TYPE_CHECKING:
    from ...core import SecondOrderSystem
    from ...lab import PlantConfig

_STEP = 1e-3  # any time step: a structure has none [s]


def load_robot_model(
    model: str, lock: Sequence[str] = (), joints: Sequence[str] | None = None
) -> RobotModel:
    """Reads a robot's model from a URDF, MJCF or TOML file, or finds it by name.

    Args:
        model: path of a URDF file, of an MJCF file (.xml or .mjb), or of a vehicle's TOML file or
            its folder; or the name of a packed robot or vehicle, or one of example-robot-data.
        lock: joints to fix, at 0 or at the nearest limit.
        joints: joints to keep, all others being locked; None keeps all that are not in `lock`.

    Returns:
        The model, reduced to the joints that move, with physically consistent inertias; of a
        vehicle, the published values, moved inside the cone of physical parameters, are the prior.
        Its findings say what was changed or left out.

    Raises:
        BadRobot: the file cannot be read, or describes a robot that is not a tree of revolute and
            prismatic joints, or a vehicle whose structure is not known exactly.
        InvalidInput: a value in a vehicle's file is missing or wrong, a joint is to be both locked
            and kept, or joints of a vehicle are to be locked.
        UnknownName: there is no such robot or joint; the message lists similar names.
    """
    if not is_vehicle(model):
        return load_tree(model, lock, joints, packed_vehicles())
    if lock or joints is not None:
        expected = "no joints, for a vehicle"
        raise InvalidInput("lock", expected, [*lock, *(joints or ())], "Leave it out.")
    from ...core import Prior
    from ...lab import ParametricPlantConfig

    packed = model in scenarios()
    config = load(model).plant if packed else plant_of(VehicleFiles.of(model).sheet)
    if not isinstance(config, ParametricPlantConfig):
        reason = "its equations of motion are not linear in known parameters"
        raise BadRobot(model, "", reason, "It can only be simulated: `nsaid run`.")
    plant, nominal = config.published(_STEP)
    system = plant.system
    count = plant.system.n_u
    return RobotModel(
        name=model if packed else Path(model).stem,
        source=None if packed else VehicleFiles.of(model).sheet,
        kind="vehicle",
        model=None,
        joints=command_names(system),
        damping=np.zeros(count),
        friction=np.zeros(count),
        rotor=np.zeros(count),
        gain=np.ones(count),
        limits=np.full(count, np.inf),
        system=system,
        prior=Prior(system.space, nominal, 0.0).draw(np.random.default_rng(0)),
        findings=_guesses(config),
        visuals=plant,
        top_speed=_top_speed(config),
        dry_mass=_dry_mass(config),
    )


def floating(robot: RobotModel) -> RobotModel:
    """A robot of joints on a fixed base, with a base that floats.

    Raises:
        BadRobot: its base is fixed to the world in its file.
    """
    if robot.floating:
        return robot
    assert robot.file is not None
    found = load_tree(str(robot.file), (), robot.joints, floating=True)
    findings = tuple(f for f in found.findings if f.code != "servo" or f in robot.findings)
    return replace(found, name=robot.name, source=robot.source, findings=findings)


def _guesses(config: PlantConfig) -> tuple[Finding, ...]:
    """What is guessed of a vehicle whose sheet states its frame, mass and arm alone."""
    from ...lab import VehiclePlant

    left = config.sheet.guessed(config.vehicle) if isinstance(config, VehiclePlant) else []
    if not left:
        return ()
    text = f"of the vehicle's frame, mass and arm alone, all else is guessed: {'; '.join(left)}"
    remedy = "State in the sheet what you know better."
    return (Finding("note", "guessed_sheet", "", text, remedy),)


def _top_speed(config: PlantConfig) -> float:
    """The speed of a multicopter's rotors at full command [rad/s]; inf if its sheet has none."""
    from ...lab import VehiclePlant

    sheet = config.sheet.of(config.vehicle) if isinstance(config, VehiclePlant) else None
    return getattr(getattr(sheet, "rotors", None), "top_speed", np.inf)


def _dry_mass(config: PlantConfig) -> float | None:
    """The mass of a vehicle whose sheet has added mass [kg]; None of another one."""
    from ...lab import VehiclePlant

    sheet = config.sheet.of(config.vehicle) if isinstance(config, VehiclePlant) else None
    if sheet is None or getattr(sheet, "added_mass", None) is None:
        return None
    return float(sheet.mass)


def command_names(system: SecondOrderSystem) -> tuple[str, ...]:
    """(n_u,) names of a vehicle's actuators, in the order of its commands.

    They come from the labels of its actuator parameters, such as "thrust of rotor 1", or are u_1,
    u_2, … if these do not match the commands one to one.
    """
    labels = [label for b in system.space.blocks if b.actuator for label in b.labels]
    parts = dict.fromkeys(label.partition(" of ")[2] for label in labels)
    if len(parts) == system.n_u and "" not in parts:
        return tuple(parts)
    return tuple(f"u_{i + 1}" for i in range(system.n_u))


def plant_of(sheet: Path) -> PlantConfig:
    """The plant of the family to which a vehicle's TOML file belongs.

    Raises:
        InvalidInput: a value is missing or wrong.
        UnknownName: a key is unknown.
    """
    from ...lab import vehicle_families

    try:
        content = tomllib.loads(InputFile(sheet).read().decode())
    except (OSError, ValueError, RecursionError):
        content = {}  # every family reports it alike
    families = {family.sheet.family: family for family in vehicle_families()}
    if (kind := content.get("kind")) is not None:
        if not isinstance(kind, str) or kind not in families:
            raise UnknownName(f"kind of vehicle in {sheet}", str(kind), families)
        families = {kind: families[kind]}
    errors: list[NsaidError] = []
    for family in families.values():
        try:
            config = family(vehicle=str(sheet))
            config.simulating(_STEP)
        except (InvalidInput, UnknownName) as error:
            errors.append(error)
        else:
            return config
    keys = set(_keys(content))
    raise max(errors, key=lambda error: _likeness(error, keys))


def _likeness(error: NsaidError, keys: set[str]) -> float:
    """A score of how likely an error comes from the right family: few families accept all keys."""
    return len(keys & set(error.choices)) if isinstance(error, UnknownName) else np.inf


def _keys(table: dict[str, Any]) -> Iterator[str]:
    for key, value in table.items():
        yield key
        if isinstance(value, dict):
            yield from _keys(value)
