"""The predicted information against the filter's covariance, the noise density, and gradients."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.design import Experiment
from nsaid_mj.design.information import PRIOR, gramian, predicted
from nsaid_mj.experiment.library import load
from nsaid_mj.laws.efficient.filter import Law, filter_at
from nsaid_mj.laws.efficient.kalman import covariance_along
from nsaid_mj.laws.efficient.steps import margin_of
from nsaid_mj.log import Log
from nsaid_mj.nullspace import parts_of
from nsaid_mj.quotient.cone import cone_of


@pytest.fixture(scope="module", params=["double_pendulum", "bluerov2"])
def experiment(request) -> Experiment:
    return Experiment.of(replace(load(request.param), duration=4.0))


def motion(experiment: Experiment, every: int = 1) -> Log:
    log = experiment.simulate(experiment.scenario.excitation, 0, 4.0)
    assert log is not None
    return Log.unchecked(*(np.ascontiguousarray(part[::every]) for part in log))


def test_the_information_equals_the_covariance_of_the_filter(experiment):
    system, log = experiment.system, motion(experiment)
    scale = np.array(system.space.scale)
    cone, rest = cone_of(system.space), (np.zeros(system.p), np.zeros(0), parts_of(system))
    law = Law(system.forward, cone, scale, margin_of(cone, scale), 0.0, 1, *rest)
    R = np.repeat(np.array(experiment.levels) ** 2, system.n)
    basis = experiment.bases[0]
    prior = PRIOR**2 * basis @ basis.T
    filter = filter_at(log.q[0], log.v[0], experiment.draws[0], prior)
    filter.Pxx[:] = np.diag(R)
    assert covariance_along(law, filter, R, *log) == len(log.t) - 1
    P = predicted(experiment, log, 0)
    np.testing.assert_allclose(P, filter.Ptt, atol=1e-5 * np.abs(P).max())
    np.testing.assert_allclose(np.diag(P), np.diag(filter.Ptt), rtol=2e-3, atol=1e-12)


def test_coarser_steps_with_the_same_noise_density_have_nearly_the_same_bound(experiment):
    fine, coarse = (predicted(experiment, motion(experiment, k), 0) for k in (1, 4))
    known = (np.diag(fine) > 1e-12) & (np.diag(fine) < (0.5 * PRIOR) ** 2)
    assert known.any()
    ratio = np.sqrt(np.diag(coarse)[known] / np.diag(fine)[known])
    assert (np.abs(ratio - 1) < 0.15).all()


def test_the_gramian_is_that_of_the_regressor(experiment):
    log, system, theta = motion(experiment, 40), experiment.system, experiment.draws[0]
    x = np.hstack([log.q, log.v])
    a = system.acceleration(log.t, x, log.v, log.u, theta)
    W = system.regressor(log.t, x, log.v, a, log.u) * system.space.scale
    M = system.mass_matrix(x, theta)
    expected = np.mean(W.transpose(0, 2, 1) @ np.linalg.solve(M, W), axis=0)
    found = gramian(experiment, log, theta)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_the_gramian_of_a_motion_vanishes_along_the_nullspace_of_its_plant(experiment):
    log, theta = motion(experiment, 40), experiment.draws[0]
    own = gramian(experiment, log, theta)
    basis = experiment.bases[0]
    outside = np.eye(len(own)) - basis @ basis.T
    assert np.abs(outside @ own @ outside).max() < 1e-9 * np.abs(own).max()


def test_more_time_never_predicts_more_error(experiment):
    log = motion(experiment)
    half, whole = (predicted(experiment, log.first(k), 0) for k in (len(log.t) // 2, len(log.t)))
    assert np.linalg.eigvalsh(half - whole).min() > -1e-9
