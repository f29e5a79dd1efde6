"""Assembles a scenario's plant, prior, driver, sensors and identifiers.

A `Setup` holds the simulated plant and the prior θ̂(0), and builds driver, sensors and identifiers,
each from its own stream of the scenario's seed. Runs, held-out trajectories, comparisons of methods
and Monte Carlo studies all use it.

No true value reaches an identifier: it gets the plant's structure, a prior, and measurements. The
prior is the truth plus a seeded error, or the published values, about which the truth is then
drawn; nothing else in this package reads the truth before the end of a run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from ..core import (
    Array,
    Identifier,
    IdentifierConfig,
    Log,
    NullspaceAID,
    ParameterSpace,
    Prior,
    SecondOrderSystem,
    SensorLevels,
)
from ..watch import supervised
from .control.computed_torque import Tracking
from .control.driver import CompiledDriver, Driver, DriverConfig
from .library import BadScript, place_of
from .plants.world.plant import Plant
from .plants.world.sensors import Sensors
from .scenario import Scenario

_LONGEST = 60.0  # longest simulation for the design of a gain [s]


class Seeds(NamedTuple):
    """Independent random streams of one seed; appending a stream leaves the others unchanged."""

    truth: np.random.SeedSequence
    prior: np.random.SeedSequence
    excitation: np.random.SeedSequence
    sensors: np.random.SeedSequence
    held_out: np.random.SeedSequence
    structure: np.random.SeedSequence
    gramian: np.random.SeedSequence

    @staticmethod
    def of(seed: int) -> Seeds:
        """Spawns the streams of a scenario's seed."""
        return Seeds(*np.random.SeedSequence(seed).spawn(len(Seeds._fields)))


@dataclass(frozen=True, eq=False)
class Setup:
    """A scenario's plant and prior, and builders of its driver, sensors and identifiers."""

    scenario: Scenario
    plant: Plant  # the simulated plant, which holds the truth
    prior: Array  # (p,) θ̂(0)

    @staticmethod
    def of(scenario: Scenario) -> Setup:
        """Builds the plant, with a truth drawn from the scenario's seed, and the prior.

        Raises:
            InvalidInput: the prior is `nominal`, and the plant cannot be made with a given θ.
        """
        if scenario.prior == "nominal":
            plant = plant_about_published(scenario)
        else:
            seeds = Seeds.of(scenario.seed)
            plant = scenario.plant.build(scenario.dt, int(seeds.truth.generate_state(1)[0]))
        return Setup(scenario, plant.refined(scenario.substeps), prior_for(scenario, plant))

    def with_prior_of(self, scenario: Scenario) -> Setup:
        """This plant with the prior and the identifier of another scenario."""
        return Setup(scenario, self.plant, prior_for(scenario, self.plant))

    @property
    def system(self) -> SecondOrderSystem:
        """The structure, which identifiers may know."""
        return self.plant.system

    @property
    def seeds(self) -> Seeds:
        """The streams of the scenario's seed."""
        return Seeds.of(self.scenario.seed)

    def driver(self) -> Driver:
        """Builds the driver of the run."""
        return self._driver(self.seeds.excitation)

    def sensors(self) -> Sensors:
        """Builds the sensors of the run, exact or noisy."""
        noise = self.scenario.noise if self.scenario.sensors == "noisy" else None
        return Sensors(noise, np.random.default_rng(self.seeds.sensors))

    def identifiers(self) -> dict[str, Identifier]:
        """Builds the scenario's own identifier, named "", and its rivals, from the same prior."""
        scenario = self.scenario
        system = self.system
        prior = self.prior
        levels = scenario.noise.levels if scenario.sensors == "noisy" else SensorLevels()

        @cache
        def gramian() -> Array:
            from .expected_gramian import expected_gramian

            driver = self._driver(self.seeds.gramian)
            duration = scenario.duration
            return expected_gramian(system, driver, prior, scenario.dt, min(duration, _LONGEST))

        configs = {"": scenario.identifier, **scenario.rivals}
        return {
            name: identifier_of(config, scenario, system, prior, levels, gramian)
            for name, config in configs.items()
        }

    def simulate(self, check: Callable[[], object] = lambda: None) -> Log:
        """Drives the plant for the run's duration; see `Plant.trajectory`."""
        steps = self.scenario.steps
        sensors = self.sensors()
        return self.plant.trajectory(self.driver(), steps, sensors, check=check)

    def held_out(self, as_at: float) -> Log | None:
        """Drives the plant along a trajectory that no identifier has seen, with exact sensors.

        Actuators are in their state, faulty or not, at a time of the run [s]. None if the plant
        diverges.
        """
        driver = self._driver(self.seeds.held_out)
        steps = max(2, round(self.scenario.held_out / self.scenario.dt))
        with self.plant.running():
            log = self.plant.trajectory(driver, steps, as_at=as_at)
        return log if self.plant.is_sound(log) else None

    def _driver(self, seed: np.random.SeedSequence) -> Driver:
        rng = np.random.default_rng(seed)
        return driver_of(self.scenario.excitation, self.system, self.prior, rng)


def with_prior_error(config: IdentifierConfig, scenario: Scenario) -> IdentifierConfig:
    """An identifier's configuration, with the scenario's error of the prior if it states none."""
    if not isinstance(config, NullspaceAID) or config.efficient.prior is not None:
        return config
    error = scenario.initial_error or None
    return replace(config, efficient=replace(config.efficient, prior=error))


def identifier_of(
    config: IdentifierConfig,
    scenario: Scenario,
    system: SecondOrderSystem,
    prior: Array,
    levels: SensorLevels,
    gramian: Callable[[], Array] | None = None,
) -> Identifier:
    """The identifier of a configuration, with its supervisor if its law has one.

    The arguments after the scenario are those of `IdentifierConfig.build`.
    """
    config = with_prior_error(config, scenario)
    return supervised(config.build(system, prior, scenario.dt, levels, gramian))


def plant_about_published(scenario: Scenario) -> Plant:
    """The plant with a physical θ drawn about its published values in all parameters."""
    plant, nominal = scenario.plant.published(scenario.dt)
    space = plant.system.space
    seeds = Seeds.of(scenario.seed)
    rng = np.random.default_rng(seeds.truth)
    truth = Prior(space, nominal, scenario.initial_error).draw(rng)
    if scenario.gain_error is not None:
        truth[space.actuators] = nominal[space.actuators] / _gain_errors(space, scenario.gain_error)
    return scenario.plant.simulating(scenario.dt, truth)


def prior_for(scenario: Scenario, plant: Plant) -> Array:
    """(p,) a scenario's prior: drawn about a plant's truth from its seed, or the published values.

    Published values on the boundary of the cone of physical parameters are moved inside for
    identifiers that need this; see `Prior`.
    """
    in_cone = any(law.in_cone for law in (scenario.identifier, *scenario.rivals.values()))
    rng = np.random.default_rng(Seeds.of(scenario.seed).prior)
    if scenario.prior == "nominal":
        known, nominal = scenario.plant.published(scenario.dt)
        return Prior(known.system.space, nominal, 0.0).draw(rng) if in_cone else nominal
    return draw_prior(
        plant.truth, plant.system.space, scenario.initial_error, scenario.gain_error, rng, in_cone
    )


def draw_prior(
    truth: Array,
    space: ParameterSpace,
    error: float,
    gain_error: float | None,
    rng: np.random.Generator,
    in_cone: bool = False,
) -> Array:
    """(p,) a prior θ̂(0) with uniform relative errors of up to ±error on every parameter.

    Errors are relative to the parameter's magnitude, or to a tenth of its scale if that is larger,
    so that a product of inertia near 0 is not exact from the start. `gain_error` is that of
    actuator parameters, alternately positive and negative; with `in_cone`, θ̂(0) is physically
    consistent, see `Prior`.
    """
    if in_cone:
        prior = Prior(space, truth, error).draw(rng)
    else:
        size = np.maximum(np.abs(truth), 0.1 * space.scale)
        prior = truth + error * size * rng.uniform(-1, 1, len(truth))
    if gain_error is not None:
        prior[space.actuators] = truth[space.actuators] * _gain_errors(space, gain_error)
    return prior


def _gain_errors(space: ParameterSpace, error: float) -> Array:
    """(a,) ratios of prior to truth of the actuator parameters, 1 + error and 1 − error in turn."""
    return 1 + error * np.where(np.arange(len(space.actuators)) % 2, -1, 1)


def driver_of(
    config: DriverConfig, system: SecondOrderSystem, prior: Array, rng: np.random.Generator
) -> Driver:
    """Builds a driver; one that this package does not define is checked at every call.

    Raises:
        BadScript: `build` does not return a driver.
        NsaidError: the driver cannot be built.
    """
    driver = config.build(system, prior, rng)
    if not isinstance(driver, Driver):
        raise _wrong(type(config).build, "a Driver", type(driver).__name__)
    packed = type(driver).__module__.startswith("nsaid_mj.")
    return driver if packed else CheckedDriver(driver, system)


def _wrong(function: object, expected: str, got: object) -> BadScript:
    file, line, code = place_of(function)
    return BadScript(file, line, f"expected {expected}, got {got}", code)


class CheckedDriver(CompiledDriver):
    """A user's driver, whose results are checked for their shape."""

    def __init__(self, driver: Driver, system: SecondOrderSystem):
        self._driver = driver
        self._n = system.n
        self._n_u = system.n_u

    def start(self) -> tuple[Array, Array]:
        """Position and velocity from which the driver starts; `BadScript` unless (n,) arrays."""
        found = self._driver.start()
        if not isinstance(found, tuple | list) or len(found) != 2:
            function = type(self._driver).start
            raise _wrong(function, "positions and velocities to start from", type(found).__name__)
        position, velocity = (self._array("start", part, self._n) for part in found)
        return position, velocity

    def command(self, t: float, q: Array, v: Array) -> Array:
        """The command (n_u,) at a time and measured state; `BadScript` unless numbers."""
        return self._array("command", self._driver.command(t, q, v), self._n_u)

    def compiled(self, t: Array) -> Array | Tracking | None:
        """The driver's form for compiled loops at times t (k,), checked.

        Raises:
            BadScript: it is neither None, nor a `Tracking`, nor a (k, n_u) array of numbers.
        """
        found = self._driver.compiled(t) if isinstance(self._driver, CompiledDriver) else None
        if found is None or isinstance(found, Tracking):
            return found
        return self._array("compiled", found, len(t), self._n_u)

    def _array(self, method: str, found: Any, *shape: int) -> Array:
        """A result of a method as an array of floats, checked for its shape."""
        expected = f"an array of shape {shape}"
        try:
            array = np.array(found, dtype=np.float64)
            if np.iscomplexobj(found):
                raise TypeError("complex numbers")
        except (TypeError, ValueError) as error:
            function = getattr(type(self._driver), method)
            raise _wrong(function, expected, f"{type(found).__name__} ({error})") from error
        if array.shape != shape:
            raise _wrong(getattr(type(self._driver), method), expected, f"shape {array.shape}")
        return array
