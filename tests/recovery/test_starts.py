"""The law `memory` from starts at e^{±1} on the cone's blocks; scripts/starts.py runs more."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from nsaid_mj.experiment.setup import prior_for
from nsaid_mj.identifiers import Status
from nsaid_mj.quotient.cone import cone_of, inside
from nsaid_mj.studies.montecarlo import Course, identify
from nsaid_mj.studies.sweep_results import Row
from scripts import starts


@cache
def course(name: str, seconds: float) -> Course:
    return starts.motion(name, 7, seconds)


def check(found: Row) -> None:
    assert found["status"] == Status.completed.words
    assert found["conserved_drift"] <= 1e-3


@pytest.mark.parametrize("index", range(3))
@pytest.mark.parametrize("name", ["remus100", "f1tenth"])
def test_a_start_far_off_stays_inside_and_comes_nearer(name, index):
    known = course(name, 5.0)
    (found,) = identify(known, [(index, starts.start(known.setup.scenario, index, 1.0))])
    check(found)
    assert found["status_time"] == pytest.approx(5.0)
    assert found["theta_perp_ratio"] < 0.1 * found["theta_perp_ratio_initial"]


def test_starts_are_inside_the_cone_distinct_and_reproducible():
    known = course("remus100", 5.0)
    cone = cone_of(known.setup.plant.system.space)

    def draw(index: int) -> np.ndarray:
        return prior_for(starts.start(known.setup.scenario, index, 1.0), known.setup.plant)

    drawn = [draw(index) for index in range(50)]
    assert all(inside(cone, theta) for theta in drawn)
    assert len({tuple(theta) for theta in drawn}) == 50
    np.testing.assert_array_equal(drawn[7], draw(7))
    off = np.abs(np.log(np.array(drawn)[:, cone.positive] / known.setup.plant.truth[cone.positive]))
    assert 0.9 < off.max() <= 1.0 + 1e-12


def test_the_study_counts_a_law_that_loses_definiteness(monkeypatch):
    """The paper's law with a gain far too large."""
    known = course("remus100", 5.0)
    base = known.setup.scenario
    broken = replace(base, identifier=replace(base.identifier, law="paper", gain=1e4))
    setup = replace(known.setup, scenario=broken)
    monkeypatch.setattr(starts, "motion", lambda *_: replace(known, setup=setup))
    found = starts.study("remus100", 7, 3, 5.0, 1.0)
    words = Status.estimate_not_positive_definite.words
    lost = [one for one in found if one["status"] == words]
    assert lost and all(one["status_time"] < 5.0 for one in lost)
    gone = sum(one["status"] != Status.completed.words for one in found)
    assert f"| 3 | {gone} | 3 |" in starts.line("remus100", found)
    assert len(list(starts.failures(found))) == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", starts.VEHICLES)
def test_vehicles_find_the_true_set_from_any_start(name):
    for found in starts.study(name, 7, 5, 20.0, 1.0):
        check(found)
        assert starts.near(found), found
