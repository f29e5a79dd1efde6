"""The experiment under design: structure, prior, sensors and time, none of them the truth.

The prior is the plant's published values. A design must suit robots that differ from them, so it is
evaluated under the published values and under several random draws about them. Published values
alone would be too special, and draws alone too generic: a last link with its centre of mass on its
axis, as most are built, gives far less information about its motor than a randomly drawn one. The
truth of a scenario's plant is neither drawn nor read.

`scenario_of_model` is the experiment with a user's own robot. A vehicle's file belongs to a known
family, whose scenario says how it is driven.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from ...base import InvalidInput, UnknownName, path_of
from ...clinic import plant_of
from ...core import Array, Log, Nullspace, Prior, SecondOrderSystem, SensorLevels
from ...lab import (
    ArmPlant,
    Contacts,
    DriverConfig,
    FourierTracking,
    ParametricPlantConfig,
    Plant,
    Scenario,
    Sensors,
    load,
)
from ...robots import VehicleFiles, load_robot, scenarios
from .limits import Limit, Limits, source_of

DRAWS = 4
"""Number of values of θ under which a design is judged, the prior itself first; the search uses the
first two."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """Everything known before an experiment."""

    # the plant's published description, sensors, time step and duration; its own excitation is the
    # reference for comparison, and for the limits
    scenario: Scenario
    system: SecondOrderSystem
    prior: Array  # (p,) θ̂(0), the published values
    draws: Array  # (DRAWS, p) values that θ may have: the prior, and others drawn about it
    bases: tuple[Array, ...]  # an orthonormal basis (p, p−r) of P_⊥ for each draw
    nullspace: Nullspace  # P_s of the prior
    levels: SensorLevels  # standard deviations of the sensors' noise

    @staticmethod
    def of(scenario: Scenario, seed: int = 0) -> Experiment:
        """The experiment of a scenario, from its plant's published values alone.

        Raises:
            InvalidInput: the plant cannot be made with a given θ, its structure has no compiled
                forward dynamics, or the scenario's noise is zero.
        """
        healthy = replace(scenario.plant, faults=())
        scenario = replace(scenario, plant=healthy, prior="nominal")
        plant, known = scenario.plant.published(scenario.dt)
        system = plant.system
        if system.forward is None:
            expected = "a structure with compiled forward dynamics"
            remedy = "Use the compiled backend, or another plant."
            raise InvalidInput("design", expected, type(system).__name__, remedy)
        levels = scenario.noise.levels
        if not (levels.position > 0 and levels.velocity > 0):
            remedy = "State the sensors' noise, such as --noise.position 1e-4."
            raise InvalidInput("noise", "levels > 0", levels, remedy)
        rng = np.random.default_rng(seed)
        prior = Prior(system.space, known, 0.0).draw(rng)
        error = scenario.initial_error
        others = [Prior(system.space, known, error).draw(rng) for _ in range(DRAWS - 1)]
        draws = np.array([prior, *others])
        spaces = [
            Nullspace.structural(system, theta, np.random.default_rng(seed)) for theta in draws
        ]
        bases = tuple(np.ascontiguousarray(space.P_perp) for space in spaces)
        return Experiment(scenario, system, prior, draws, bases, spaces[0], levels)

    def simulate(
        self,
        driver: DriverConfig,
        draw: int,
        duration: float,
        seed: int = 0,
        sensors: Sensors | None = None,
    ) -> Log | None:
        """The motion of a plant with a draw of the prior, under a driver based on the prior.

        `duration` is in seconds, `seed` that of the driver; sensors are exact if none are given.
        None if the plant diverges.
        """
        plant = self.plant(draw)
        dt = self.scenario.dt
        made = driver.build(self.system, self.prior, np.random.default_rng(seed))
        with plant.running():
            log = plant.trajectory(made, max(2, round(duration / dt)), sensors)
        return log if plant.is_sound(log) else None

    def plant(self, draw: int) -> Plant:
        """The plant with a draw of the prior as its θ, made on first use."""
        config = self.scenario.plant
        assert isinstance(config, ParametricPlantConfig)  # else there were no published values
        if draw not in self._plants:
            self._plants[draw] = config.simulating(self.scenario.dt, self.draws[draw])
        return self._plants[draw]

    @cached_property
    def contacts(self) -> Contacts | None:
        """Collision detection of an arm; None if its shape is unknown."""
        config = self.scenario.plant
        if not isinstance(config, ArmPlant) or self.system.group:
            return None
        found = Contacts(load_robot(config.robot), self.system.limits)  # type: ignore[attr-defined]
        return found if found.known else None

    @cached_property
    def _plants(self) -> dict[int, Plant]:
        return {}


_EXCITATION = FourierTracking(fundamental=0.2, harmonics=10)
_STEP = 1e-3  # of an arm's simulation [s]
_UNLIMITED = 1e6  # some readers' value for URDF limits that are not there


def scenario_of_model(model: str) -> Scenario:
    """The experiment with a robot, before it has a motion.

    `model` is the path of a URDF, an MJCF (.xml or .mjb) or a vehicle's TOML file or folder; or the
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
    """The scenario of a vehicle's family, with the vehicle; `UnknownName` if there is none."""
    sheet = VehicleFiles.of(str(path)).sheet
    plant = plant_of(sheet.resolve())
    for name in scenarios():
        known = load(name)
        if type(known.plant) is type(plant):
            return replace(known, plant=plant)
    raise UnknownName("scenario with a vehicle like", type(plant).__name__, scenarios())


def own_limits(system: SecondOrderSystem, default: Limits) -> Limits:
    """The limits of an arm's model file, on a fixed base: position, velocity and effort.

    Where the file has none, or 0, as for accelerations, the default applies; `sources` of the
    result say which joints these are.
    """
    model = system.model  # type: ignore[attr-defined]  # a tree
    names = system.joint_names  # type: ignore[attr-defined]  # a tree
    limits = dict(default.limits)
    sources = dict(default.sources)
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
        own = limits[name]
        given = (values > 0) & (values < _UNLIMITED)
        largest = np.where(given, values, own.high)
        limits[name] = Limit(-largest, largest, own.unit)
        missing = [joint for joint, there in zip(names, given, strict=True) if not there]
        sources[name] = source_of(names, missing, default.sources.get(name, ""))
    return replace(default, limits=limits, sources=sources)
