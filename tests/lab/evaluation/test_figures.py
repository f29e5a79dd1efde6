"""Figures mean what their names say: 95 % intervals, rms over the last tenth of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from nsaid_mj.lab.evaluation.confidence import INTERVAL, KnownDirections
from nsaid_mj.lab.evaluation.figures import last_tenth
from nsaid_mj.lab.evaluation.run_evaluation import evaluate
from nsaid_mj.lab.evaluation.statistics import (
    Correlations,
    Estimated,
    KnownParameter,
    StatedConfidence,
)
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import run
from tests.support.faulty import ROV
from tests.support.summaries import run_result


def test_an_interval_is_that_of_95_percent_of_a_normal_distribution():
    assert norm.cdf(INTERVAL) - norm.cdf(-INTERVAL) == pytest.approx(0.95, abs=1e-4)


def test_intervals_of_the_right_width_cover_95_percent():
    """Directions whose errors have the stated standard deviations; θ̂ and θ have norm 1."""
    rng, p = np.random.default_rng(0), 400
    deviation, covered = rng.uniform(3e-5, 1e-4, p), []
    for _ in range(100):
        theta = rng.standard_normal(p)
        theta /= np.linalg.norm(theta)
        estimate = theta + deviation * rng.standard_normal(p)
        estimate /= np.linalg.norm(estimate)
        found = KnownDirections(np.eye(p), deviation, np.zeros(p, bool), np.zeros(0), np.ones(1))
        covered.append(found.covered(estimate, 3.0 * theta))
    assert np.mean(covered) == pytest.approx(0.95, abs=0.005)


def test_the_plus_minus_of_a_gain_is_half_its_95_percent_interval():
    rows = tuple(
        Estimated(name=name, label=name, unit="N", scale=1.0, true=true, prior=1.0, estimate=value)
        for name, value, true in (("one", 2.0, 3.9), ("two", 8.0, 16.4))
    )
    known = KnownParameter(deviation=0.1, below_noise=False)
    stated = StatedConfidence(
        directions=1,
        below_noise=0,
        deviation_median=0.1,
        deviation_largest=0.1,
        independent_samples=(1.0,),
        actuators={"one": 0.01, "two": 0.03},
        parameters={"one": known, "two": known},
        correlations=Correlations(),
        worst_known=(),
    )
    found = run_result(confidence=stated, estimates=rows).gains
    assert [p.relative for p in found] == pytest.approx([0.0196, 0.0588], rel=1e-3)
    factor = found[0].value / 2.0
    assert found[1].value == pytest.approx(8.0 * factor)  # one factor for all: their mean is exact
    assert np.mean([p.value / (p.true or np.nan) for p in found]) == pytest.approx(1.0)
    assert [(p.high - p.low) / 2 for p in found] == pytest.approx([0.196 * factor] * 2, rel=1e-3)


@pytest.mark.parametrize("rows,expected", [(1, [0]), (9, [8]), (40, [36, 37, 38, 39])])
def test_the_last_tenth_has_a_tenth_of_the_rows_and_at_least_one(rows, expected):
    assert last_tenth(np.arange(rows)).tolist() == expected


def test_the_velocity_error_is_that_of_the_last_tenth_of_the_time(tmp_path):
    done = run(replace(ROV, duration=4.0, sensors="noisy"), tmp_path)
    accuracy, record = evaluate(done, Truth.of(done)).accuracy, done.record
    late = record["t"] > 0.9 * done.ending.time + 1e-9
    assert late.sum() == len(record) // 10 > 10
    dv = record["v_hat"] - record["v"]
    rms = np.sqrt(np.mean(dv[late] ** 2))
    assert accuracy.velocity_error_rms == pytest.approx(rms, rel=1e-12)
    for other in (dv, dv[-1:], dv[~late]):  # which differ, so that the test can fail
        assert rms != pytest.approx(np.sqrt(np.mean(other**2)), rel=1e-3)
