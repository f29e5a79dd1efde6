"""A case's plant, its effect, its driver and its sensors, and the log of its run."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj import ArmPlant, NullspaceAID, Scenario
from nsaid_mj.core.log import Log
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.sensors import Sensors
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.errors import BadRobot

from .cases import Case
from .effects import (
    EFFECTS,
    Stepper,
    Transmission,
    change_command,
    errors_of,
    faults_of,
    friction_force,
    mismatch_of,
    tilt_gravity,
)
from .motions import Planned, Shaped, planned
from .robots import random_tree
from .sensors import WrongSensors, stale, stated_noise

_TRIES = 8  # random trees, at most, until one's friction suits the time step
_TYPICAL = 2.0  # length of the run from which the rms commands are taken [s]


class NotRun(Exception):
    """The plant could not be simulated: it says nothing of the identifier."""


@dataclass
class Simulated:
    """A simulated run.

    Attributes:
        case: what it is.
        setup: its plant and prior.
        log: what the identifier sees.
        urdf: text of the robot's URDF; "" for packed robots.
    """

    case: Case
    setup: Setup
    log: Log
    urdf: str


def simulated(case: Case) -> Simulated:
    """Simulates a case.

    Raises:
        NotRun: the plant diverges.
    """
    with tempfile.TemporaryDirectory() as folder:  # a payload loads the robot again
        return _simulated(case, Path(folder))


def _simulated(case: Case, folder: Path) -> Simulated:
    setup, urdf = _setup(case, folder)
    plant = setup.plant
    rng = case.stream(3, case.number)
    noise = setup.scenario.noise
    plant.failing(faults_of(case.effect, case.size, plant, case.duration, rng), _config(setup))
    errors = errors_of(case.effect, case.size, setup.system.n, rng)
    stepper = Stepper(plant)
    if case.effect in ("dead zone", "curve", "reverse gain"):
        u = _log(setup, _driver(case, setup), WrongSensors(noise, rng, errors), _TYPICAL).u
        typical = np.maximum(np.sqrt(np.mean(u**2, axis=0)), 1e-9)
        stepper.change = change_command(case.effect, case.size, typical)
    if case.effect in ("stribeck", "asymmetric friction"):
        stepper.force = friction_force(plant, case.effect, case.size)
    if case.effect in ("elastic", "backlash"):
        elastic = case.effect == "elastic"
        resonance, gap = (case.size, 0.0) if elastic else (80.0, case.size)
        if setup.system.scales.rotor is None:
            raise NotRun("no rotor inertia to put behind a spring")
        stepper.force = Transmission(plant, errors, resonance, gap)
    if case.effect == "mount":
        tilt_gravity(plant, case.size, rng)
    if stepper.change or stepper.force:
        plant.step = stepper  # type: ignore[method-assign]  # in place of this one plant's
    sensors = WrongSensors(noise, np.random.default_rng(setup.seeds.sensors), errors)
    log = _log(setup, _driver(case, setup), sensors, case.duration, stepper)
    return Simulated(case, setup, stale(log, errors.held), urdf)


def joint_names(setup: Setup) -> list[str]:
    """The names of an arm's joints."""
    return list(setup.system.joint_names)  # type: ignore[attr-defined]


def _config(setup: Setup) -> Any:
    return replace(setup.scenario.plant, faults=())


def _setup(case: Case, folder: Path) -> tuple[Setup, str]:
    """The plant with the effects that its configuration can have, and the robot's URDF.

    A random tree whose friction is too fast for the time step is drawn again.
    """
    if case.kind != "arm":
        return Setup.of(_scenario(case, load(case.robot))), ""
    stock = load("arm")
    for attempt in range(_TRIES):
        rng = case.stream(1, attempt)
        armature = 0.0 if rng.random() < 0.2 else None
        robot, urdf = case.robot, ""
        if robot.startswith("tree"):
            urdf = random_tree(rng, int(robot.rsplit(" ", 1)[1]))
            robot = str(folder / "random_tree.urdf")
            Path(robot).write_text(urdf, encoding="utf-8")
        arm = replace(stock, plant=ArmPlant(robot=robot, armature=armature), dt=case.dt)
        try:
            return Setup.of(_scenario(case, arm)), urdf
        except BadRobot as error:
            if "too fast for steps" not in str(error) or not urdf:
                raise
    raise NotRun("the friction of all trees drawn is too fast for the time step")


def _scenario(case: Case, scenario: Scenario) -> Scenario:
    rng = case.stream(2)
    length, speed = (2 * np.pi, 1.0) if case.kind == "arm" else (1.0, 1.0)
    noise = stated_noise(case.sensor, rng, length, speed)
    effect = EFFECTS.get(case.effect)
    substeps = effect.substeps if effect else 1
    mismatch = mismatch_of(case.effect, case.size, scenario.dt, case.stream(4, case.number))
    law = "efficient" if case.law == "identify" else case.law
    assert isinstance(scenario.identifier, NullspaceAID)
    return replace(
        scenario,
        plant=replace(scenario.plant, mismatch=mismatch),
        identifier=replace(scenario.identifier, law=law, gamma="scale"),
        prior=case.prior,
        gain_error=case.gain_error,
        initial_error=0.3,
        duration=case.duration,
        substeps=max(1, round(substeps * scenario.dt / 2e-3)) if substeps > 1 else 1,
        sensors="noisy",
        noise=noise,
        record_every=1,
        seed=int(case.stream(5).integers(2**31)),
    )


def _driver(case: Case, setup: Setup) -> Driver:
    rng, scenario, system = case.stream(6), setup.scenario, setup.system
    if case.kind != "arm" or case.motion == "own":  # shaped, as compiled code knows no effects
        return Shaped(setup.driver(), case.motion, scenario.dt, rng)
    positions = planned(case.motion, system, scenario.dt, scenario.steps, rng)  # type: ignore[arg-type]
    still = [k for k, name in enumerate(joint_names(setup)) if "finger" in name]
    positions[:, still] = positions[0, still]
    return Planned(system, setup.prior, positions, scenario.dt)  # type: ignore[arg-type]


def _log(
    setup: Setup, driver: Driver, sensors: Sensors, duration: float, stepper: Stepper | None = None
) -> Log:
    """Drives the plant.

    Raises:
        NotRun: it diverges.
    """
    plant = setup.plant
    with plant.running():
        first = plant.begin(driver, sensors)
        if stepper and isinstance(stepper.force, Transmission):
            stepper.force.reset()
        log = plant.drive(driver, first, round(duration / setup.scenario.dt), sensors)
    if not plant.is_sound(log):
        raise NotRun(f"the plant diverged at {log.t[-1]:.3g} s")
    return log
