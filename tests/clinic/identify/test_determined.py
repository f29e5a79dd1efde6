"""What is not determined is called that: no interval ends at a power of ten that says nothing."""

from __future__ import annotations

import re

import numpy as np
import pytest

from nsaid_mj.base import Finding
from nsaid_mj.clinic.identify.export import with_trial
from nsaid_mj.clinic.identify.identifiability import interval
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.residuals import _bounded
from nsaid_mj.report import estimate
from tests.clinic.identify.test_fit import TRUE, problem_of
from tests.court.field_findings import Twin
from tests.support.robot_logs import two_joints


def test_an_interval_of_a_factor_of_a_thousand_says_nothing():
    low, high = interval(2.0, 0.5, True, 1.0)
    assert low * high == pytest.approx(4.0) and high / low < 3
    low, high = interval(2.0, 20.0, True, 1.0)
    assert (low, high) == (0.0, np.inf)
    assert estimate(2.0, low, high) == ("2", "not determined")
    low, high = interval(2.0, 20.0, False, 1.0)
    assert low < 0 < high < np.inf
    assert interval(2.0, 1e15, False, 1.0) == (-np.inf, np.inf)


def test_a_suspect_that_the_columns_make_up_shifts_them_by_their_own_size():
    space = problem_of(0.1, 200).space
    shift = _bounded(1e6 * np.ones(len(TRUE)), TRUE, space)
    positive = space.geometries == "positive"
    np.testing.assert_allclose(shift[positive], np.abs(TRUE[positive]))
    np.testing.assert_array_equal(_bounded(0.1 * TRUE, TRUE, space), 0.1 * TRUE)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_spring_beside_weight_in_gentle_motion_ends_in_no_power_of_ten(tmp_path, seed):
    twin = Twin(two_joints(), seed, speed=0.1, step=2e-5, noise=0.02, coloured=0.02)
    log = twin.write(tmp_path / "log.csv")
    known = {"gain_1": twin.true["gain_1"]}
    found = identify_forces(twin.robot, log, columns=["spring"], known=known)
    ends = np.array([(p.low, p.high) for p in found.parameters if p.high < np.inf])
    assert np.abs(ends).max() < 1e6 and "e+" not in found.verdict
    assert "give one motor's gain" not in found.verdict
    said = " ".join(f.remedy for f in found.findings)
    assert "Give one motor's gain" not in said


@pytest.mark.parametrize(
    ("seed", "coloured"),
    [(1, 0.02), pytest.param(2, 0.1, marks=pytest.mark.slow)],  # the same with more noise
)
def test_a_suggestion_that_is_followed_comes_true(tmp_path, seed, coloured):
    twin = Twin(two_joints(("a", "b", "c")), seed, speed=0.3, coloured=coloured)
    log = twin.write(tmp_path / "log.csv")
    before = identify_forces(twin.robot, log)
    words = r"--known (gain_\d)=….*from about ±(\S+) % to ±(\S+) %"
    said = re.search(words, before.suggestion)
    assert said is not None
    after = identify_forces(twin.robot, log, known={said[1]: twin.true[said[1]]})
    for found, promised in ((before, said[2]), (after, said[3])):
        others = [p for p in found.of("motor gain") if p.name != said[1]]
        half = np.median([np.log(p.high / p.value) for p in others])
        assert 100 * half == pytest.approx(float(promised), rel=0.15)


def test_an_exported_model_that_diverges_never_explains(tmp_path):
    twin = Twin(two_joints(), 0)
    log = twin.write(tmp_path / "log.csv", duration=10.0)
    found = identify_forces(twin.robot, log, known={"gain_1": twin.true["gain_1"]})
    assert found.explains == "yes"
    for error, explains in ((1e-3, "yes"), (np.inf, "no")):
        tried = Finding("note", "replay", "", "it was tried", "", {"exported": [1e-3, error]})
        judged = with_trial(found, [tried])
        assert judged.explains == explains and tried in judged.findings
        assert ("diverges" in judged.verdict) == (explains == "no")
