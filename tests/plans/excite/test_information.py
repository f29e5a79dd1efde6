"""The predicted information against least squares, the noise density, and gradients."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.core.log import Log
from nsaid_mj.lab.library import load
from nsaid_mj.plans.excite.experiment import Experiment
from nsaid_mj.plans.excite.information import PRIOR, gramian, predicted
from tests.support.batch import batch_bound


@pytest.fixture(scope="module", params=["double_pendulum", "bluerov2"])
def experiment(request) -> Experiment:
    return Experiment.of(replace(load(request.param), duration=4.0))


def motion(experiment: Experiment, every: int = 1) -> Log:
    log = experiment.simulate(experiment.scenario.excitation, 0, 4.0)
    assert log is not None
    return Log.unchecked(*(np.ascontiguousarray(part[::every]) for part in log))


def test_the_information_is_that_of_least_squares(experiment):
    system, log = experiment.system, motion(experiment)
    R = np.repeat(np.array(experiment.levels) ** 2, system.n)
    G, theta = PRIOR * experiment.bases[0], np.array(experiment.draws[0])
    root = G @ np.linalg.inv(batch_bound(system, theta, R, G, log))
    P = predicted(experiment, log, 0)
    np.testing.assert_allclose(P, root @ root.T, atol=1e-9 * np.abs(P).max())
    np.testing.assert_allclose(np.diag(P), np.diag(root @ root.T), rtol=1e-6)


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
