"""The law `memory` on a robot that walks: contact forces are unknown, and do no harm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.base import InvalidInput
from nsaid_mj.core import KalmanFilter, Log, NullspaceAID
from nsaid_mj.core.laws.base import Confidence, Status
from nsaid_mj.core.laws.memory.statistics import Recorder
from nsaid_mj.core.laws.settings import EfficientConfig, MemoryConfig
from nsaid_mj.core.log import EXACT
from nsaid_mj.core.quotient.cost import Remembered
from tests.support.walkers import GAINS, quadruped, walk


def followed(system, log, law="memory"):
    prior = quadruped(0.02)[1]
    identifier = NullspaceAID(law=law).build(system, prior, 1e-3)
    state, estimates = identifier.follow(identifier.init(log.at(0)), log)
    return identifier, state, estimates


def ratio_error(theta):
    ratios = theta[-len(GAINS) :] / GAINS
    return np.abs(ratios / ratios.mean() - 1).max()


@pytest.fixture(scope="module")
def run():
    return followed(quadruped(0.02)[0], walk()[0])


def test_ratios_of_the_gains_are_found_while_it_walks(run):
    system, prior = quadruped(0.02)
    identifier, state, _ = run
    assert state.status is Status.completed
    assert ratio_error(prior) > 0.3
    assert ratio_error(state.theta_hat) < 0.01
    stated = Confidence.of_gains(identifier.confidence(state), state.theta_hat, system.space)
    ratios = state.theta_hat[-len(GAINS) :] / GAINS
    assert (np.abs(ratios / ratios.mean() - 1) < 3 * stated).all()
    assert (stated < 0.3).all()


def levels(system, theta):
    """Squared residual over squared effort of the base's six rows at θ."""
    log = walk()[0].first(1000)
    recorder = Recorder(system, MemoryConfig(), 1e-3, EXACT)
    means = recorder.follow(recorder.begin(log.at(0)), log).means
    return Remembered.of(means, system.space).levels(theta)[:6]


def test_its_motion_contradicts_the_truth_only_if_it_is_taken_as_one_in_the_air():
    system, _ = quadruped(0.02)
    flying = system.rebuilt(replace(system.structure, contacts=()), system.space)
    truth = walk()[1]
    assert levels(system, truth).max() < 1e-4
    assert levels(flying, truth).max() > 0.1


def test_the_memory_expects_what_feet_that_sink_in_do_to_its_rows():
    system, _ = quadruped(0.02)
    whole, truth = walk()
    log = whole.part(2000, 4001)
    feet = system.structure.contacts
    sinking = 5e-4

    def recorded(contacts):
        other = system.rebuilt(replace(system.structure, contacts=contacts), system.space)
        recorder = Recorder(other, MemoryConfig(), 1e-3, EXACT)
        return recorder, recorder.follow(recorder.begin(log.at(0)), log).means

    recorder, means = recorded(tuple(replace(foot, sinking=sinking) for foot in feet))
    assert not recorder.exact
    expected = (means.noise @ truth @ truth)[:6]
    found = np.zeros(6)
    for k, foot in enumerate(feet):
        wrong = replace(foot, radius=foot.radius - sinking)
        recorder, means = recorded((*feet[:k], wrong, *feet[k + 1 :]))
        assert recorder.exact
        assert not means.noise.any()
        found += (means.gramian @ truth @ truth)[:6]
    for part in (slice(0, 3), slice(3, 6)):  # forces, torques
        assert 0.5 < np.sqrt(expected[part].sum() / found[part].sum()) < 2


def test_v_falls_and_the_conserved_quantity_stays(run):
    identifier, state, estimates = run
    _, truth = walk()
    np.testing.assert_array_equal(estimates.v_hat[1:], walk()[0].v[1:])  # Δv = 0
    start, end = estimates.theta_hat[0], state.theta_hat
    assert identifier.divergence(truth, end) < identifier.divergence(truth, start)
    spent = estimates.spent + identifier.conserved(estimates.theta_hat)
    np.testing.assert_allclose(spent, spent[0], rtol=1e-4)


def test_pieces_of_a_log_lead_to_the_same_estimate(run):
    identifier, end, _ = run
    log, _ = walk()
    state = identifier.init(log.at(0))
    for first in range(0, len(log.t) - 1, 700):
        state, _ = identifier.follow(state, log.part(first, first + 701))
    np.testing.assert_allclose(state.theta_hat, end.theta_hat, rtol=1e-9)


def test_a_sample_that_is_not_finite_ends_the_run():
    log, _ = walk()
    v = np.where(np.arange(50)[:, None] == 30, np.nan, log.v[:50])
    broken = Log.unchecked(log.t[:50], log.q[:50], v, log.u[:50])
    _, state, estimates = followed(quadruped(0.02)[0], broken)
    assert state.status is Status.measurement_not_finite
    assert len(estimates.pivot) == 30


@pytest.mark.parametrize("law", ("paper", "cone"))
def test_a_law_that_predicts_the_acceleration_is_refused(law):
    system, prior = quadruped(0.02)
    with pytest.raises(InvalidInput, match="--law memory"):
        NullspaceAID(law=law).build(system, prior, 1e-3)


def noisy_walk(first, last):
    """Samples of the walk with noise, and the true θ."""
    whole, truth = walk()
    log = whole.part(first, last)
    system, _ = quadruped(0.02)
    rng = np.random.default_rng(0)
    moved = 1e-4 * rng.standard_normal((len(log.t), system.n))
    q = np.array([system.integrate(*pair) for pair in zip(log.q, moved, strict=True)])
    return Log(log.t, q, log.v + 5e-3 * rng.standard_normal(log.v.shape), log.u), truth


def test_the_filter_expects_what_feet_that_sink_in_do():
    """From the truth, linearised there: errors of the size that P states."""
    system, _ = quadruped(0.02)
    log, truth = noisy_walk(1500, 3000)
    errors = []
    for sinking in (0.0, 5e-4):
        feet = tuple(replace(foot, sinking=sinking) for foot in system.structure.contacts)
        known = system.rebuilt(replace(system.structure, contacts=feet))
        kalman = KalmanFilter(known, 1e-3, EfficientConfig(linearisation=0.0)).cautious()
        state = kalman.at(log.q[0], log.v[0], truth, kalman.covariance(truth))
        assert kalman.follow(state, log).completed
        values, vectors = np.linalg.eigh(state.Ptt)
        off = vectors.T @ ((state.theta - truth) / np.array(system.space.scale))
        errors.append(np.mean(off[:100] ** 2 / values[:100]))
    assert errors[0] > 100
    assert errors[1] < 1


def test_only_with_contacts_the_filter_expects_what_it_sees():
    """At the truth: innovations of size 1 where no contact force reaches, of 36 those of 24."""
    noisy, truth = noisy_walk(0, 400)
    system, _ = quadruped(0.02)
    sizes = []
    for known in (system, system.rebuilt(replace(system.structure, contacts=()), system.space)):
        kalman = KalmanFilter(known, 1e-3, EfficientConfig())
        state = kalman.at(noisy.q[0], noisy.v[0], truth, 1e-6 * np.eye(system.p))
        found = kalman.innovations(state, noisy)[100:]
        sizes.append(np.mean(found**2))
    assert sizes[0] == pytest.approx(24 / 36, abs=0.03)
    assert not sizes[1] < 10
