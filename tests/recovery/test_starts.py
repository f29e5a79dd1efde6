"""The law `memory` from starts at e^{±1} on the cone's blocks; scripts/results.py runs more."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nsaid_mj import Scenario
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.quotient.cone import Cone
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import prior_for
from nsaid_mj.plans.studies.montecarlo import DrawnMotion, identify
from nsaid_mj.plans.studies.study import Row
from scripts.results import ENOUGH, VEHICLES, course, start


@cache
def known(name: str, seconds: float) -> DrawnMotion:
    scenario = load(name)
    law = replace(scenario.identifier, law="memory", gamma="scale")
    return course(replace(scenario, identifier=law, rivals={}, seed=7, duration=seconds))


def begun(motion: DrawnMotion, index: int) -> tuple[int, Scenario]:
    return index, start(motion.setup.scenario, index)


def check(found: Row) -> None:
    assert found["status"] == Status.completed.words
    assert found["conserved_drift"] <= 1e-3


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("name", ["remus100", "f1tenth"])
def test_a_start_far_off_stays_inside_and_comes_nearer(name, index):
    motion = known(name, 5.0)
    (found,) = identify(motion, [begun(motion, index)])
    check(found)
    assert found["status_time"] == pytest.approx(5.0)
    assert found["theta_perp_ratio"] < 0.1 * found["theta_perp_ratio_initial"]


def test_starts_are_inside_the_cone_distinct_and_reproducible():
    motion = known("remus100", 5.0)
    cone = Cone.of(motion.setup.plant.system.space)

    def draw(index: int) -> np.ndarray:
        return prior_for(begun(motion, index)[1], motion.setup.plant)

    drawn = [draw(index) for index in range(50)]
    assert all(cone.contains(theta) for theta in drawn)
    assert len({tuple(theta) for theta in drawn}) == 50
    np.testing.assert_array_equal(drawn[7], draw(7))
    off = np.abs(
        np.log(np.array(drawn)[:, cone.positive] / motion.setup.plant.truth[cone.positive])
    )
    assert 0.9 < off.max() <= 1.0 + 1e-12


def test_a_law_that_loses_definiteness_is_told():
    """The paper's law with a gain far too large."""
    motion = known("remus100", 5.0)
    base = motion.setup.scenario
    broken = replace(base, identifier=replace(base.identifier, law="paper", gain=1e4))
    other = replace(motion, setup=replace(motion.setup, scenario=broken))
    found = identify(other, [begun(other, index) for index in range(3)])
    words = Status.estimate_not_positive_definite.words
    lost = [one for one in found if one["status"] == words]
    assert lost and all(one["status_time"] < 5.0 for one in lost)


@pytest.mark.slow
@pytest.mark.parametrize("name", VEHICLES)
def test_vehicles_find_the_true_set_from_any_start(name):
    motion = known(name, 20.0)
    for found in identify(motion, [begun(motion, index) for index in range(5)]):
        check(found)
        assert found["theta_perp_ratio"] <= ENOUGH, found
