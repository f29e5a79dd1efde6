"""Gains that drift: followed by a filter under which they alone walk, and no fault of a part."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.laws.efficient.filter import filter_at
from nsaid_mj.core.parameters import Block, ParameterSpace
from nsaid_mj.lab.evaluation.statistics import Accuracy, LawUsed
from nsaid_mj.lab.plants.world.faults.text import parse_faults
from nsaid_mj.watch import Misfit, drift_of
from nsaid_mj.watch.drift import DriftHypothesis, Rivals, walks
from tests.support.summaries import run_result

from .test_never_wrong import known_of, misfit, ran, system_of


@pytest.mark.parametrize(
    ("rate", "seed", "bar"), [(1, 951, 0.01), pytest.param(10, 952, 0.05, marks=pytest.mark.slow)]
)
def test_gains_that_drift_are_followed_within_their_intervals(
    rate: int, seed: int, bar: float
) -> None:
    """Three thrusters by 1 or 10 % a minute: had been 0.9 and 8.5 % after two minutes."""
    each = "; ".join(f"loss 0.9 of {k} rate {rate / 60} %/s at 0 s" for k in (2, 3, 7))
    found = ran("bluerov2", seed, 40.0, faults=parse_faults(each))
    plant, k = found.setup.plant, found.setup.system.space.actuators
    assert found.state.faults == () and drift_of(found.state)[0] > 0 and found.own.handed
    for at in (0.6, 1.0):  # of the run
        row = int(at * (len(found.log.t) - 1))
        ratio = found.theta_hat[row][k] / plant.truth_at(found.log.t[row])[k]
        assert np.abs(ratio / ratio.mean() - 1).max() < bar / 2
    judged, error = misfit(found), ratio / ratio.mean() - 1
    assert np.abs(error / known_of(found).actuators).max() < 4
    assert np.median(known_of(found, judged.widening).actuators) < bar
    assert judged.level != "none" and judged.drift == pytest.approx(rate / 100, rel=0.4)


# -- models of how θ changes -----------------------------------------------------------------------


def rivals(*evidence: float) -> Rivals:
    """Rivals of θ constant, all of it a walk at two variances, gains at four, that began at 0 s."""
    system, truth = system_of("bluerov2")
    covariance = Prior(system.space, truth, 0.3).covariance()
    kalman = filter_at(np.zeros(7), np.zeros(6), truth, covariance)
    made = Rivals.at(kalman, covariance, 0.0)
    assert len(made.each) == len(evidence)
    return made._replace(each=tuple(map(with_evidence, made.each, evidence)))


def with_evidence(rival: DriftHypothesis, evidence: float) -> DriftHypothesis:
    tally = np.array([1.0, 0.0, -2 * evidence, 0.0])
    return rival._replace(filter=rival.filter._replace(tally=tally))


def test_a_model_is_chosen_by_its_likelihood_and_the_next_wider_walk_is_followed() -> None:
    each = rivals(-90, -70, -80, -60, 0, -9, -50)
    assert each.preferred(4.9, 0.0) is None  # too early
    best = each.preferred(6.0, 0.0)
    assert best is not None and (best.all_of, best.gains) == (0.0, each.each[5].gains)
    assert each.preferred(6.0, best.gains) is None  # that is followed already
    assert each.preferred(6.0, each.each[6].gains) is best  # by more than three
    near = rivals(-90, -70, -80, -60, 0, -2, -50)
    assert near.preferred(6.0, each.each[6].gains) is None


def test_gains_drift_only_if_that_is_much_more_likely_than_any_other_model() -> None:
    for evidence in ((-14, -50, -50), (-50, -14, -50), (-50, -50, -14)):
        assert rivals(*evidence, -60, 0, -9, -50).preferred(6.0, 0.0) is None
    gone = rivals(0, -40, -50, -16, -50, -50, -50)
    assert gone.preferred(6.0, 1e-6) is gone.each[0]
    assert rivals(0, -40, -50, -14, -50, -50, -50).preferred(6.0, 1e-7) is None


def test_gains_that_walk_fast_or_explain_nothing_do_not_drift() -> None:
    fast = rivals(-40, -60, -80, -60, -50, -20, 0)
    assert fast.preferred(6.0, 0.0) is None and fast.preferred(6.0, 1e-5) is fast.each[0]
    each = rivals(-90, -70, -80, -60, 0, -9, -50)
    each.each[4].filter.totals[:2] = 120.0, 100.0  # all have the same
    assert each.preferred(6.0, 0.0) is None and each.preferred(6.0, 1e-6) is each.each[1]
    each.each[4].filter.totals[:2] = 105.0, 100.0
    assert each.preferred(6.0, 0.0) is each.each[5]


def test_gains_walk_in_addition_to_all_of_theta() -> None:
    blocks = (
        Block(name, (name,), ("1",), np.ones(1), actuator=name.startswith("gain"))
        for name in ("mass", "gain 1", "drag", "gain 2")
    )
    space = ParameterSpace(tuple(blocks))
    np.testing.assert_array_equal(walks(space, 0.1, 0.5), [0.1, 0.6, 0.1, 0.6])


def test_a_verdict_names_the_drift() -> None:
    drifting = Misfit("some", (), innovations=1.0, seconds=1.0, chance=0.0, drift=0.098)
    result = run_result(
        law=LawUsed(law="efficient"), accuracy=Accuracy(theta_perp_ratio=1e-3), misfit=drifting
    )
    assert result.verdict.endswith("gains drift by up to 9.8 % a minute")
    constant = run_result(accuracy=result.accuracy, misfit=drifting._replace(drift=0.0))
    assert "drift" not in constant.verdict
