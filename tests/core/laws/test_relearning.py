"""Learning again from a motion's beginning, where a far prior has led the filter astray."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nsaid_mj.core.laws.efficient.estimator import KalmanFilter
from nsaid_mj.core.laws.settings import EfficientConfig
from nsaid_mj.core.log import Log
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from nsaid_mj.watch.replay import learned, with_scales_of
from nsaid_mj.watch.state import kept_of
from tests.support.plants import plant


def far(name: str, seed: int) -> tuple[Setup, Log]:
    """A setup whose prior is off by up to a factor of e, and its log of five seconds."""
    scenario = load(name)
    law = replace(scenario.identifier, law="efficient")
    scenario = replace(
        scenario, identifier=law, sensors="noisy", duration=5.0, seed=seed, initial_error=1.0
    )
    setup = Setup.of(scenario)
    with setup.plant.running():
        return setup, setup.simulate()


def cautious(setup: Setup) -> KalmanFilter:
    """The filter with γ of a run's beginning."""
    return KalmanFilter(setup.system, setup.scenario.dt, EfficientConfig(prior=1.0)).cautious()


def error(setup: Setup, theta: Array) -> float:
    """Largest relative error of a gain over the mean of all."""
    k = setup.system.space.actuators
    ratio = theta[k] / setup.plant.truth[k]
    return float(np.abs(ratio / ratio.mean() - 1).max())


@pytest.mark.parametrize(("name", "seed"), [("bluerov2", 1), ("bluerov2", 2)])
def test_passes_along_a_log_converge_from_where_one_does_not(name: str, seed: int) -> None:
    setup, log = far(name, seed)
    alone = cautious(setup)
    prior = np.array(setup.prior)
    assert alone.replay(prior, alone.covariance(prior), log).contradictions
    found = learned(alone, prior, log)
    assert found is not None and error(setup, found.theta) < 1e-3


def test_rests_change_no_bit_of_a_replay() -> None:
    setup, log = far("bluerov2", 1)
    alone, prior = cautious(setup), np.array(setup.prior)
    whole = alone.replay(prior, alone.covariance(prior), log)
    rests = list[float]()
    P = alone.covariance(prior)
    pieces = alone.replay(prior, P, log, lambda: rests.append(0.0))
    assert whole.contradictions and pieces.contradictions == whole.contradictions
    assert len(rests) >= (len(log.t) - 1) / 25
    for one, other in zip(pieces.along, whole.along, strict=True):
        np.testing.assert_array_equal(one[1:], other[1:])


def test_the_law_learns_again_after_a_contradiction() -> None:
    setup, log = far("bluerov2", 1)
    identifier = setup.identifiers()[""]
    state, _ = identifier.follow(identifier.init(log.at(0)), log)
    own = state.own
    assert kept_of(own).learned > 0 and own.calm == pytest.approx(5.0) and not state.faults
    assert error(setup, state.theta_hat) < 2e-3


def test_what_the_structure_lacks_is_not_learned() -> None:
    setup, log = far("bluerov2", 2)
    alone = cautious(setup)
    late = log._replace(u=np.roll(log.u, 20, axis=0))
    assert learned(alone, setup.plant.truth, late) is None


def test_no_part_changes_its_scale_between_passes() -> None:
    system = plant("ur5").system
    scale = KalmanFilter(system, 0.01, EfficientConfig()).constants.scale
    parts = np.zeros((2, system.p))
    parts[0, : system.p // 2] = parts[1, system.p // 2 :] = 1.0
    theta = plant("ur5").truth
    moved = theta * np.where(parts[0] > 0, 3.0, 0.2)
    found = with_scales_of(theta, moved, parts, scale)
    np.testing.assert_allclose(found, theta)


@given(st.lists(st.integers(1, 20), min_size=1, max_size=40))
def test_few_logs_hold_all_samples_in_order(sizes: list[int]) -> None:
    ends = np.cumsum([0, *sizes])
    t = np.arange(ends[-1], dtype=float)
    whole, parts = Log(t, *(t[:, None],) * 3), tuple[Log, ...]()
    for start, end in itertools.pairwise(ends):
        parts = Log.extended(parts, whole.part(start, end))
    for one, other in zip(Log.joined(*parts), whole, strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(parts) <= 1 + np.log2(len(t))
