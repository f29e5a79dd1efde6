"""`--prior nominal`: θ̂(0) is the published θ, and the truth is drawn about it in all parameters."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.parameters import Array, ParameterSpace
from nsaid_mj.core.quotient.cone import Cone
from nsaid_mj.lab import loop as experiment
from nsaid_mj.lab.contacts import without_contacts
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.jointed import ArmPlant, FloatingBasePlant, RoverPlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.world.blueprint import sheet_of
from nsaid_mj.lab.plants.world.config import ParametricPlantConfig, PlantConfig
from nsaid_mj.lab.record import RECORD_FILE
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.lab.setup import Setup
from nsaid_mj.plans.studies.montecarlo import montecarlo_plan
from nsaid_mj.robots.assets import scenarios
from tests.support.plants import assert_engines_agree, name_of
from tests.support.strategies import seeds
from tests.support.studies import monte_carlo
from tests.support.vehicles import VEHICLES, coordinate_map

PARAMETRIC: list[PlantConfig] = [
    ScalarRovPlant(),
    ArmPlant("double_pendulum"),
    ArmPlant("panda"),
    ArmPlant("ur5", backend="pinocchio"),
    ArmPlant("xarm7", armature=0.0),
    FloatingBasePlant("solo12"),
    *VEHICLES.values(),
]
parametric = pytest.mark.parametrize("config", PARAMETRIC, ids=name_of)
NAMES = [name for name in scenarios() if name != "rover"]
every_scenario = pytest.mark.parametrize("name", NAMES)
DT = 1e-4


@cache
def published(config: PlantConfig) -> tuple[Array, ParameterSpace]:
    assert isinstance(config, ParametricPlantConfig)
    plant = config.simulating(DT)
    return plant.truth, plant.system.space


def nominal(name: str, **changes) -> Scenario:
    return replace(load(name), prior="nominal", **changes)


# -- plants with a given θ -------------------------------------------------------------------------


@parametric
@settings(deadline=None, max_examples=5)
@given(seed=seeds, error=st.sampled_from([0.1, 0.3, 1.0]))
def test_a_parametric_plant_moves_by_the_theta_it_is_given(config, seed, error):
    theta, space = published(config)
    drawn = Prior(space, theta, error).draw(np.random.default_rng(seed))
    plant = config.simulating(DT, drawn)
    assert (np.abs(plant.truth - drawn) <= 1e-14 * np.maximum(np.abs(drawn), space.scale)).all()
    assert_engines_agree(plant, seed, 1e-11)


@settings(deadline=None, max_examples=30)
@given(seed=seeds, error=st.sampled_from([0.1, 0.3, 1.0]))
def test_a_drawn_mass_in_water_is_a_rigid_body_and_an_added_mass_both_physical(seed, error):
    theta, space = published(VEHICLES["bluerov2"])
    blueprint = sheet_of("underwater").of("bluerov2").blueprint()
    drawn = Prior(space, theta, error).draw(np.random.default_rng(seed))
    body, acting = blueprint.split(drawn)
    rigid, added, M = body.matrix(), np.zeros((6, 6)), np.zeros((6, 6))
    upper = np.triu_indices(6)
    added[upper], M[upper] = acting[:21], drawn[:21]
    added, M = added + np.triu(added, 1).T, M + np.triu(M, 1).T
    assert rigid + added == pytest.approx(M, rel=1e-12, abs=1e-12)
    assert (acting[21:] == drawn[21:]).all()
    share = rigid[0, 0] / blueprint.rigid[0, 0]
    assert share > 0 and rigid == pytest.approx(share * blueprint.rigid, rel=1e-12, abs=1e-14)
    assert blueprint.added is not None
    beyond = np.linalg.eigvalsh(added - share * blueprint.added)
    assert beyond[0] == pytest.approx(0.0, abs=1e-10 * beyond[-1])  # the largest such share
    nominal = blueprint.split(theta)[1][:21]
    assert nominal == pytest.approx(blueprint.added[upper], abs=1e-10)


@parametric
def test_the_structure_does_not_depend_on_the_true_theta(config):
    theta, space = published(config)
    one = config.simulating(DT, Prior(space, theta, 0.5).draw(np.random.default_rng(1))).system
    for other in (config.simulating(DT).system, config.build(DT, 1).system):
        assert (one.space.scale == other.space.scale).all()
        for k in range(3):
            states = [s.random_state(np.random.default_rng(k)) for s in (one, other)]
            assert all((a == b).all() for a, b in zip(*states, strict=True))
            q, v, u = states[0]
            x, a = np.r_[q, v], v[::-1].copy()
            assert (one.regressor(0.0, x, v, a, u) == other.regressor(0.0, x, v, a, u)).all()


# -- a scenario ------------------------------------------------------------------------------------


@every_scenario
def test_the_prior_is_published_and_the_truth_differs_in_every_parameter(name):
    scenario = nominal(name, gain_error=None)
    setup, other = (Setup.of(replace(scenario, seed=seed)) for seed in (0, 1))
    assert isinstance(scenario.plant, ParametricPlantConfig)
    published = scenario.plant.simulating(scenario.dt).truth
    np.testing.assert_allclose(setup.prior, published, rtol=1e-9, atol=0)
    assert (setup.prior == other.prior).all()
    assert (setup.plant.truth != other.plant.truth).all()
    space, truth = setup.system.space, setup.plant.truth
    assert (np.abs(truth - setup.prior) > 1e-6 * space.scale).all()
    assert Cone.of(space).contains(truth)
    for block, place in space:
        if block.geometry == "positive":
            guess = np.maximum(setup.prior[place], 0.01 * block.scale)
            assert (np.abs(np.log(truth[place] / guess)) <= scenario.initial_error + 1e-12).all()


@every_scenario
def test_the_drawn_truth_satisfies_the_equation_along_its_motion(name):
    """W(t, x, v, v̇) θ = 0 with MuJoCo's own v̇, at the states of the run.

    On the ground, in the rows without the contacts' forces: MuJoCo's act half a depth below them.
    """
    setup = Setup.of(nominal(name, seed=3))
    plant, driver, system = setup.plant, setup.driver(), setup.system
    with plant.running():
        last = plant.begin(driver)
        for _ in range(5):
            last = plant.drive(driver, last, 20).at(-1)
            plant.data.ctrl[:] = last.u
            mujoco.mj_forward(plant.model, plant.data)
            at = coordinate_map(plant)
            a = plant.data.qacc.copy() if at is None else at.acceleration(plant.data)
            W = system.regressor(last.t, np.r_[last.q, last.v], last.v, a, last.u)
            size = (np.abs(W) @ np.abs(plant.truth)).max()
            W = without_contacts(system, last.q[None], W[None])[0]
            tolerance = 2e-3 if system.structure.contacts else 1e-11
            assert np.abs(W @ plant.truth).max() <= tolerance * size
            assert np.abs(W @ setup.prior).max() > 1e-4 * size  # and the published θ does not


def test_without_an_error_the_truth_is_the_published_theta():
    setup = Setup.of(nominal("ur5", initial_error=0.0))
    assert np.allclose(setup.plant.truth, setup.prior, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("error", [0.0, 0.2])
def test_a_gain_error_is_that_of_the_published_gains(error):
    setup = Setup.of(nominal("wrong_gains", gain_error=error))
    gains = setup.system.space.actuators
    ratio = setup.prior[gains] / setup.plant.truth[gains]
    assert ratio == pytest.approx([1 + error, 1 - error], rel=1e-12)


@pytest.mark.parametrize("name", ["bluerov2", "ur5", "double_pendulum"])
def test_a_published_theta_on_the_boundary_of_the_cone_is_moved_inside_where_a_law_needs_it(name):
    paper = nominal(name)
    cone = replace(paper, identifier=replace(paper.identifier, law="cone"))
    prior, moved = Setup.of(paper).prior, Setup.of(cone).prior
    of_space = Cone.of(Setup.of(cone).system.space)
    scale = Setup.of(cone).system.space.scale
    assert of_space.contains(moved)
    if of_space.contains(prior):
        assert (np.abs(moved - prior) <= 1e-9 * np.maximum(np.abs(prior), scale)).all()
    else:
        assert (prior[moved != prior] <= 0.02 * scale[moved != prior]).any()
    assert (Setup.of(paper).plant.truth == Setup.of(cone).plant.truth).all()


def test_a_plant_without_a_true_theta_is_refused_with_the_remedy():
    with pytest.raises(InvalidInput) as caught:
        Setup.of(nominal("rover"))
    assert caught.value.name == "prior" and "RoverPlant" in str(caught.value)
    assert caught.value.remedy
    assert not issubclass(RoverPlant, ParametricPlantConfig)


# -- runs ------------------------------------------------------------------------------------------


def test_a_run_from_published_numbers_comes_closer_to_the_truth_and_is_reproducible(tmp_path):
    scenario = nominal("scalar_rov", duration=20.0)
    run = experiment.run(scenario, tmp_path / "one")
    record, truth = run.record, run.plant.truth
    assert (record["theta_hat"][0] == run.prior).all()
    ratio = [row / np.linalg.norm(row) for row in record["theta_hat"][[0, -1]] / truth]
    spread = [np.ptp(row) for row in ratio]  # 0 where θ̂ is a multiple of θ
    assert spread[1] < 0.5 * spread[0]
    again = experiment.reopen(tmp_path / "one", record)
    assert again.scenario == scenario and (again.plant.truth == truth).all()
    experiment.run(again.scenario, tmp_path / "two")
    assert (tmp_path / "one" / RECORD_FILE).read_bytes() == (
        tmp_path / "two" / RECORD_FILE
    ).read_bytes()


def test_a_study_from_published_numbers_needs_a_plant_for_each_run():
    scenario = nominal("scalar_rov", duration=2.0, held_out=1.0)
    for refused in (
        lambda: monte_carlo(scenario, 2),
        lambda: montecarlo_plan("scalar_rov", scenario, 2, arguments=()),
    ):
        with pytest.raises(InvalidInput, match="--own-plants") as caught:
            refused()
        assert caught.value.name == "prior"
    one, two = monte_carlo(scenario, 2, jobs=1, shared=False)
    assert one["theta_perp_ratio_initial"] != two["theta_perp_ratio_initial"]
