"""What would help: other experiments are computed, and the best is named for each direction."""

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.core.structure.payload import PointMasses
from nsaid_mj.lab.library import load
from nsaid_mj.plans.excite.designing import Design, design
from nsaid_mj.plans.excite.experiment import Experiment
from nsaid_mj.plans.excite.information import PRIOR, bound
from nsaid_mj.plans.excite.prediction import Remedy, helped, predict, remedies, weak_directions


@pytest.fixture(scope="module")
def found() -> Design:
    return design(Experiment.of(replace(load("double_pendulum"), duration=4.0)), effort=0.004)


def test_without_a_payload_the_whole_space_tells_what_P_perp_does(found):
    whole = np.eye(found.experiment.system.p)
    P = bound(found.information(found.logs[0], 0, whole), whole)
    Z = found.experiment.bases[0]
    np.testing.assert_allclose(Z @ (Z.T @ P @ Z) @ Z.T, found.covariances[0], atol=1e-6)


def test_only_a_known_payload_tells_of_the_common_scale(found):
    experiment = found.experiment
    space, whole = experiment.system.space, np.eye(experiment.system.p)
    added = PointMasses(space).change(0.3, np.array([0.1, 0.0, 0.0]))
    loaded = replace(experiment, prior=experiment.prior + added, draws=experiment.draws + added)
    log = loaded.simulate(found.driver, 0, 4.0)
    assert log is not None
    scale = experiment.draws[0] / space.scale
    own = found.information(found.logs[0], 0, whole)
    more = found.information(log, 0, whole, loaded)
    assert scale @ own @ scale < 1e-6 * (scale @ more @ scale)
    assert np.sqrt(1 / (scale @ more @ scale)) < PRIOR


def test_every_remedy_tells_at_least_what_the_design_does(found):
    made = {remedy.words: remedy for remedy in remedies(found)}
    assert sum("payload" in words for words in made) == 1
    assert sum("another pose" in words for words in made) == 1
    before = found.covariances[0]
    for words, remedy in made.items():
        assert np.linalg.eigvalsh(before - remedy.covariance).min() > -1e-7, words


def test_the_best_remedy_is_named_for_each_weak_direction(found):
    weak = PRIOR**2 * found.experiment.bases[0] @ found.experiment.bases[0].T
    vague = replace(found, covariances=np.array([weak] * len(found.covariances)))
    told = predict(vague)
    assert told.weak_count == found.experiment.bases[0].shape[1]
    for direction in told.weak:
        assert direction.left == pytest.approx(1, rel=1e-6)
        assert direction.after < direction.left
        assert direction.remedy in {remedy.words for remedy in told.remedies}


def test_nothing_is_named_where_nothing_helps(found):
    same = Remedy("the same", 1.0, 0, found.covariances[0])
    direction = found.experiment.bases[0][:, 0]
    assert helped(found, direction, [same]).remedy == ""


def test_weak_directions_are_unit_vectors_in_P_perp(found):
    Z = found.experiment.bases[0]
    weak = weak_directions(found, PRIOR**2 * Z @ Z.T)
    np.testing.assert_allclose(weak.T @ weak, np.eye(weak.shape[1]), atol=1e-9)
    np.testing.assert_allclose(Z @ (Z.T @ weak), weak, atol=1e-9)
