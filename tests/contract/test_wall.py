"""The wall: what identifiers are designed from holds no true number, not even before a run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from nsaid_mj.core.laws.base import Identifier
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier
from nsaid_mj.core.parameters import Array, ParameterSpace
from nsaid_mj.lab import loop as experiment
from nsaid_mj.lab import setup as wiring
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.record import RECORD_FILE
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.assets import scenarios

NOMINAL = [name for name in scenarios() if name != "rover"]
SHORT = {"duration": 0.5, "held_out": 0.2, "pe_window": 0.2, "record_every": 1}


@cache
def drawn(name: str, seed: int = 0, law: str = "paper") -> Setup:
    scenario = load(name)
    return Setup.of(replace(scenario, seed=seed, identifier=replace(scenario.identifier, law=law)))


# -- before anything is designed -------------------------------------------------------------------


class ReachedError(Exception):
    """Somebody has read the truth."""


def poison(plant: Plant) -> Plant:
    """A plant whose true numbers nobody but MuJoCo can read any more."""

    class Poisoned(type(plant)):
        @property
        def truth(self):
            raise ReachedError

    plant.__dict__["_truth"][:] = np.nan
    plant.__class__ = Poisoned
    return plant


@pytest.mark.parametrize("gamma", ["scale", "simulated"])
@pytest.mark.parametrize("law", ["paper", "memory"])
@pytest.mark.parametrize("name", ["scalar_rov", "double_pendulum", "bluerov2", "f1tenth"])
def test_poisoning_the_truth_before_the_prior_is_made_leaves_the_record_as_it_is(
    name, law, gamma, tmp_path, monkeypatch
):
    """Prior, driver, K, Γ and its rehearsal are all made after the poison is laid."""
    scenario = replace(load(name), prior="nominal", sensors="noisy", **SHORT)
    assert isinstance(scenario.identifier, NullspaceAID)
    scenario = replace(scenario, identifier=replace(scenario.identifier, law=law, gamma=gamma))
    experiment.run(scenario, tmp_path / "clean")
    honest, poisoned = wiring.plant_about_published, []

    def plant_about_published(scenario):
        poisoned.append(poison(honest(scenario)))
        return poisoned[-1]

    monkeypatch.setattr(wiring, "plant_about_published", plant_about_published)
    experiment.run(scenario, tmp_path / "poisoned")
    clean, other = ((tmp_path / part / RECORD_FILE).read_bytes() for part in ("clean", "poisoned"))
    assert clean == other
    with pytest.raises(ReachedError):
        _ = poisoned[0].truth


# -- the design ------------------------------------------------------------------------------------


def design(identifier: Identifier) -> list[Any]:
    """K, Γ or its inverse, μ and whatever else the law's compiled code is given."""
    assert isinstance(identifier, NullspaceIdentifier)
    flat = [identifier.K, *identifier.metric.numbers]
    parts = [*(part for part in flat if not isinstance(part, tuple))]
    return parts + [item for part in flat if isinstance(part, tuple) for item in part]


@pytest.mark.parametrize("gamma", ["scale", "simulated"])
@pytest.mark.parametrize("law", ["paper", "cone", "memory"])
@pytest.mark.parametrize(
    "name",
    # a design looks at the prior of a family, of which there are three: links, bodies, one number
    ["scalar_rov", "ur5", "bluerov2"]
    + [pytest.param(name, marks=pytest.mark.slow) for name in ("crazyflie", "remus100")],
)
def test_one_prior_gives_one_design_whatever_the_truth(name, law, gamma):
    """K, Γ, μ and the scale are the same to the bit on two plants of one structure."""
    scenario = replace(load(name), **SHORT)
    assert isinstance(scenario.identifier, NullspaceAID)
    scenario = replace(scenario, identifier=replace(scenario.identifier, law=law, gamma=gamma))
    one, other = (Setup.of(replace(scenario, prior="nominal", seed=seed)) for seed in (0, 1))
    other = Setup(one.scenario, other.plant, one.prior)
    assert (one.plant.truth != other.plant.truth).all()
    assert (one.system.space.scale == other.system.space.scale).all()
    designs = [design(setup.identifiers()[""]) for setup in (one, other)]
    assert len(designs[0]) == len(designs[1]) >= 2
    for a, b in zip(*designs, strict=True):
        assert np.array_equal(np.asarray(a), np.asarray(b))
    prior = replace(scenario, seed=1)  # and the comparison can tell two designs apart
    if gamma == "simulated":
        changed = design(Setup.of(prior).identifiers()[""])
        assert any(
            not np.array_equal(np.asarray(a), np.asarray(b))
            for a, b in zip(designs[0], changed, strict=True)
        )


# -- the scale -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NOMINAL)
def test_the_scale_is_the_same_whatever_the_truth(name):
    nominal: list[Scenario] = [replace(load(name), prior="nominal", seed=seed) for seed in (0, 1)]
    scales = [Setup.of(scenario).system.space.scale for scenario in nominal]
    scales += [drawn(name, seed).system.space.scale for seed in (0, 1)]
    assert all((scale == scales[0]).all() for scale in scales)


def guessed_products(space: ParameterSpace) -> np.ndarray:
    """(p,) whether a scale is a quarter of the geometric mean of two moments' own."""
    found = np.zeros(len(space), bool)
    for block, place in space:
        if block.geometry == "pseudo_inertia":
            xx, xy, yy, xz, yz, zz = block.scale[4:]
            means = 0.25 * np.sqrt([xx * yy, xx * zz, yy * zz])
            found[place.start + np.array([5, 7, 8])] = np.isclose([xy, xz, yz], means, 1e-12, 0)
    return found


@pytest.mark.parametrize("name", scenarios())
def test_the_scale_of_an_exact_parameter_is_a_guess_of_its_order_of_magnitude(name):
    """A power of two (of √2 for a geometric mean), or a round number of a data sheet, or of both.

    With `--prior drawn` most masses and inertias are the published ones: a scale computed from
    these without rounding would hand them out. Parameters that the seed changes do not matter here,
    since the scale does not depend on the seed.
    """
    one, other = drawn(name, 0), drawn(name, 1)
    space, exact = one.system.space, one.plant.truth == other.plant.truth
    halves = 2 * np.log2(space.scale)
    power = np.abs(halves - np.round(halves)) < 1e-12
    round_number = [abs(float(f"{value:.2g}") / value - 1) < 1e-12 for value in space.scale]
    strange = exact & ~(power | np.array(round_number) | guessed_products(space))
    assert not strange.any(), np.array(space.names)[strange]


# -- the prior's floor -----------------------------------------------------------------------------


def starts(name: str, law: str) -> tuple[Array, Array, Array]:
    """(k, z) priors of the parameters whose truth is 0, by seed, their scale and initial errors."""
    setups = [drawn(name, seed, law) for seed in range(8)]
    zero = np.all([setup.plant.truth == 0 for setup in setups], axis=0)
    scale = setups[0].system.space.scale[zero]
    return np.array([setup.prior[zero] for setup in setups]), scale, zero


@pytest.mark.parametrize("in_cone", [False, True])
def test_a_friction_or_gain_that_is_truly_0_does_not_start_at_0(in_cone):
    space = drawn("ur5").system.space
    truth, rng = drawn("ur5").plant.truth.copy(), np.random.default_rng(0)
    positive = np.zeros(len(space), bool)
    for block, place in space:
        positive[place] = block.geometry == "positive"
    truth[positive] = 0.0
    prior = wiring.draw_prior(truth, space, 0.3, None, rng, in_cone)[positive]
    assert (prior != 0).all() and (np.abs(prior) <= 0.03 * space.scale[positive]).all()
    if in_cone:
        assert (prior >= 0.01 * np.exp(-0.3) * space.scale[positive]).all()


@pytest.mark.parametrize("law", ["paper", "cone"])
@pytest.mark.parametrize("name", ["bluerov2", "ur5", "kinova", "borinot"])
def test_a_parameter_that_is_truly_0_does_not_start_at_0(name, law):
    priors, scale, zero = starts(name, law)
    error = load(name).initial_error
    assert zero.any() and (priors != 0).all()
    largest = np.abs(priors).max(axis=0) / scale
    floor = 0.1 * error if law == "paper" else 1e-3 * error
    assert (largest > 0.3 * floor).all()
    if law == "paper":  # uniform within ± a tenth of the scale, times the error
        assert (largest <= floor * (1 + 1e-12)).all()
