"""What a scenario is made of before its first step: plant, prior, identifiers.

The wall: an identifier gets the plant's structure, a prior, and measurements. The prior is drawn
here, once, as the truth plus a seeded error; no other part of this package reads the truth before
a run has ended.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ..control import Driver
from ..identifiers import Identifier
from ..identifiers.cone.barrier import drawn_inside
from ..log import EXACT, Log
from ..parameters import Array, ParameterSpace
from ..plants import Plant, Sensors
from ..plants.world.sensors import EXACT_SENSORS
from ..system import SecondOrderSystem
from .rehearsal import expected_gramian
from .scenario import Scenario

_REHEARSAL = 60.0  # how long the motion is simulated that designs a gain, at most [s]


class Seeds(NamedTuple):
    """Independent streams from one seed; adding one at the end changes none before it."""

    truth: np.random.SeedSequence
    prior: np.random.SeedSequence
    excitation: np.random.SeedSequence
    sensors: np.random.SeedSequence
    held_out: np.random.SeedSequence
    structure: np.random.SeedSequence
    rehearsal: np.random.SeedSequence

    @staticmethod
    def of(seed: int) -> Seeds:
        """The streams of a scenario's seed."""
        return Seeds(*np.random.SeedSequence(seed).spawn(len(Seeds._fields)))


def draw_prior(
    truth: Array,
    space: ParameterSpace,
    error: float,
    gain_error: float | None,
    rng: np.random.Generator,
    in_cone: bool = False,
) -> Array:
    """θ̂(0): every parameter off by up to ±error of its size.

    The size of a parameter near 0 (a product of inertia) is a tenth of its scale, so that no
    estimate starts out exact.

    Args:
        truth: (p,) the true θ.
        space: its names and scales.
        error: largest relative error.
        gain_error: if given, actuator parameters are off by just this share, up and down in turn.
        rng: source of the errors.
        in_cone: whether it must be physical: see `cone.drawn_inside`.
    """
    if in_cone:
        prior = drawn_inside(space, truth, error, rng)
        if gain_error is not None:
            prior[space.actuators] = _assumed(truth[space.actuators], gain_error)
        return prior
    size = np.maximum(np.abs(truth), 0.1 * space.scale)
    prior = truth + error * size * rng.uniform(-1, 1, len(truth))
    if gain_error is not None:
        prior[space.actuators] = _assumed(truth[space.actuators], gain_error)
    return prior


def _assumed(gains: Array, error: float) -> Array:
    """Gains off by a share, up and down in turn."""
    return gains * (1 + error * np.where(np.arange(len(gains)) % 2, -1, 1))


def trajectory(
    plant: Plant,
    driver: Driver,
    steps: int,
    sensors: Sensors = EXACT_SENSORS,
    as_at: float | None = None,
) -> Log:
    """steps + 1 measurements of a plant that is running, fewer where it diverges.

    With `as_at` [s] the plant's actuators stay as they are at that time of a run.
    """
    return plant.drive(driver, plant.begin(driver, sensors, as_at), steps, sensors)


def prepare(scenario: Scenario) -> tuple[Plant, Array, dict[str, Identifier]]:
    """The plant with its hidden truth, the prior (p,), and the identifiers by name."""
    plant = plant_for(scenario)
    prior = draw_for(scenario, plant)
    return plant, prior, laws_for(scenario, plant.system, prior)


def plant_for(scenario: Scenario) -> Plant:
    """The plant whose truth a scenario's seed draws."""
    seeds = Seeds.of(scenario.seed)
    return scenario.plant.build(scenario.dt, int(seeds.truth.generate_state(1)[0]))


def draw_for(scenario: Scenario, plant: Plant) -> Array:
    """(p,) the prior that a scenario's seed draws about a plant's truth."""
    return draw_prior(
        plant.truth,
        plant.system.space,
        scenario.initial_error,
        scenario.gain_error,
        np.random.default_rng(Seeds.of(scenario.seed).prior),
        any(law.in_cone for law in (scenario.identifier, *scenario.rivals.values())),
    )


def laws_for(scenario: Scenario, system: SecondOrderSystem, prior: Array) -> dict[str, Identifier]:
    """A scenario's identifiers by name, all from one prior (p,)."""
    noise = scenario.noise.levels if scenario.sensors == "noisy" else EXACT
    rng = np.random.default_rng(Seeds.of(scenario.seed).rehearsal)

    @cache
    def gramian() -> Array:
        driver = scenario.excitation.build(system, prior, rng)
        return expected_gramian(
            system, driver, prior, scenario.dt, min(scenario.duration, _REHEARSAL)
        )

    return {
        name: config.build(system, prior, scenario.dt, noise, gramian)
        for name, config in {"": scenario.identifier, **scenario.rivals}.items()
    }
