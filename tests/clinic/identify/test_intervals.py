"""What makes an interval: each part alone, on problems small enough to know the answer."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from nsaid_mj.clinic.identify import calibrate, joint_checks
from nsaid_mj.clinic.identify.calibrate import _change, _doubted, structure_checks
from nsaid_mj.clinic.identify.choose.joint_search import _vertex
from nsaid_mj.clinic.identify.choose.options import (
    COLUMN,
    NUMBER,
    OWN_DELAY,
    PROFILE,
    improves,
)
from nsaid_mj.clinic.identify.fit import Precision, inflation, minimise, precision, tempered
from nsaid_mj.clinic.identify.identifiability import parameters_in_words, with_known
from nsaid_mj.clinic.identify.result import JointStructure
from nsaid_mj.clinic.identify.smoothing import slope
from nsaid_mj.clinic.identify.verdict import verdict
from nsaid_mj.core.parameters import ParameterSpace
from tests.clinic.identify.test_fit import TRUE, absolute, problem_of

FIRST = np.eye(7)[0]


def exactly(**changes) -> Precision:
    """A precision of θ̂ = TRUE in which nothing is uncertain but what is named."""
    nothing = np.zeros((7, 7))
    own = Precision(TRUE, nothing, nothing, nothing[:1], nothing[:1], np.ones(7))
    return own._replace(**changes)


def only(value: float) -> np.ndarray:
    """(1, 7) a change of the first parameter."""
    return value * FIRST[None]


def test_no_deviation_is_below_half_a_percent():
    assert exactly().of(FIRST) == pytest.approx(0.005 * TRUE[0])


def test_a_deviation_is_the_parts_of_the_log_where_they_differ_most():
    assert exactly(covariance=0.01 * np.eye(7), parts=only(0.3)).of(FIRST) == pytest.approx(0.3)
    assert exactly(covariance=0.25 * np.eye(7), parts=only(0.3)).of(FIRST) == pytest.approx(0.5)


def test_structures_add_to_the_covariance():
    both = exactly(covariance=0.09 * np.eye(7), structure=only(0.4))
    assert both.of(FIRST) == pytest.approx(0.5)
    assert both.of(3 * FIRST) == pytest.approx(1.5)


def test_a_deviation_is_that_of_the_jackknife():
    """The mean of K estimates without one part each: variance (K − 1)/K Σ (θ_k − mean)²."""
    problem = with_known(problem_of(noise=0.5, rows=800), {"gain_1": 1.3, "gain_2": 0.8})
    fit, share = minimise(problem), np.ones(2)
    exact = precision(problem, fit, share)
    size = np.linalg.norm(exact.parts[:, :4], axis=0)
    assert len(exact.parts) == 8
    ratio = size / np.sqrt(np.diag(exact.covariance)[:4])
    assert 0.4 < np.median(ratio) < 2.5


def test_what_no_row_tells_has_the_deviation_of_the_prior():
    """Scale of joint 2: rotor and friction known to a factor e, its gain to e^.3."""
    problem = problem_of(noise=0.1, rows=2000)
    fit = minimise(problem)
    exact = precision(problem, fit, np.ones(2))
    deviation = np.sqrt(exact.covariance[6, 6]) / fit.theta[6]
    assert deviation == pytest.approx((1 + 1 + 1 / 0.3**2) ** -0.5, rel=0.1)


def test_correlated_rows_count_as_fewer():
    problem = with_known(problem_of(noise=0.3), {"gain_1": 1.3, "gain_2": 0.8})
    share = np.array([4.0, 1.0])
    few, all_ = tempered(problem, share), tempered(problem, np.ones(2))
    np.testing.assert_allclose(few.counts * share, all_.counts)
    np.testing.assert_allclose(few.sums[0] * 4, all_.sums[0])
    at = minimise(problem)
    wide = precision(problem, at, share).covariance[2, 2]
    assert wide > 2 * precision(problem, at, np.ones(2)).covariance[2, 2]


def test_residuals_that_last_are_inflated_by_how_long_they_last():
    """Blocks of 20 equal residuals that go with the columns are one row, not 20."""
    problem, rng = problem_of(rows=4000), np.random.default_rng(3)
    Y = problem.Y.copy()
    Y[:, 1, 1] = np.repeat(rng.standard_normal(200), 20)
    Y[:, 1, 6] = -(Y[:, 1, :5] @ TRUE[:5]) / TRUE[6] + np.repeat(rng.standard_normal(200), 20)
    found = inflation(replace(problem, Y=Y), TRUE)
    assert found[1] > 5


@pytest.mark.parametrize("kind,index", [("free", 4), ("positive", 0)])
def test_both_ends_of_an_interval_are_as_far(kind, index):
    problem = problem_of(noise=0.2)
    fit = minimise(problem)._replace(theta=TRUE)
    exact = exactly(covariance=np.diag([0.2**2] * 7), data=1e6 * np.eye(7))
    parameter = parameters_in_words(problem, fit, exact, np.full(2, 0.3), np.zeros(7))[index]
    value, low, high = parameter.value, parameter.low, parameter.high
    assert value == TRUE[index]
    if kind == "free":
        assert high - value == pytest.approx(1.96 * 0.2) and value - low == pytest.approx(
            high - value
        )
    else:
        factor = np.exp(1.96 * 0.2 / value)
        assert high / value == pytest.approx(factor) and value / low == pytest.approx(factor)


@pytest.mark.parametrize("deviation,status", [(0.03, "identified"), (0.3, "only in combination")])
def test_a_gain_is_identified_as_far_as_its_own_interval_is_narrow(deviation, status):
    problem = problem_of(noise=0.2)
    fit = minimise(problem)._replace(theta=TRUE)
    exact = exactly(covariance=np.diag((deviation * TRUE) ** 2), data=1e6 * np.eye(7))
    found = parameters_in_words(problem, fit, exact, np.full(2, 2.0), np.zeros(7))
    assert found[5].status == status


@pytest.mark.parametrize("deviation,status", [(0.1, "identified"), (0.3, "only in combination")])
def test_a_single_gain_is_identified_by_its_own_interval(deviation, status):
    problem = problem_of(noise=0.2)
    *blocks, gain = problem.space.blocks
    gain = replace(gain, names=("gain_1",), units=("N·m/A",), scale=np.ones(1), labels=())
    kept = [True] * 6 + [False]
    problem = replace(
        problem,
        space=ParameterSpace((*blocks, gain)),
        Y=problem.Y[:, :, :6],
        size=absolute(6),
        **{name: getattr(problem, name)[kept] for name in ("prior", "spread", "known")},
    )
    fit, eye = minimise(problem)._replace(theta=TRUE[:6]), np.eye(6)
    exact = Precision(
        TRUE[:6], np.diag((deviation * TRUE[:6]) ** 2), 1e6 * eye, 0 * eye, 0 * eye, np.ones(6)
    )
    found = parameters_in_words(problem, fit, exact, np.array([2.0]), np.zeros(6))[5]
    assert found.status == status and found.relative is None


@pytest.mark.parametrize("other,told", [(0.12, False), (0.08, True)])
def test_a_swap_helps_every_joint_that_it_moves(monkeypatch, other, told):
    errors = {(0, 0): 0.5, (0, 1): 0.05, (1, 1): 0.1, (1, 0): other}
    monkeypatch.setattr(
        joint_checks,
        "held_out_errors",
        lambda rows, choice, u, joint: np.full(5, errors[joint, u[0]]),
    )
    commands = np.array([[0, 1]])
    rows: Any = SimpleNamespace(driven=[0, 1])
    found = joint_checks._swapped(rows, rows, commands, ("a", "b"), [])
    assert bool(found) == told


def test_gains_that_are_known_relative_to_each_other_alone_are_not_identified():
    """Both move together by 40 %: their ratio is exact, neither value is."""
    problem = problem_of(noise=0.2)
    fit = minimise(problem)._replace(theta=TRUE)
    exact = exactly(structure=(0.4 * TRUE * (np.arange(7) > 4))[None], data=1e6 * np.eye(7))
    found = parameters_in_words(problem, fit, exact, np.full(2, 2.0), np.zeros(7))[5]
    assert found.status == "only in combination" and "over the other gains" in found.combination
    assert found.relative is not None and found.relative < 0.05


def test_a_joint_that_is_not_explained_has_its_own_parameters_doubted():
    problem = problem_of()
    np.testing.assert_array_equal(_doubted(problem, ["nothing"], arm=True), 0)
    np.testing.assert_array_equal(_doubted(problem, ["nothing"], arm=False), 1)
    labels = [label.replace("_2", " of elbow") for label in problem.space.names]
    blocks = tuple(replace(block, labels=tuple(labels[place])) for block, place in problem.space)
    space = type(problem.space)(blocks)
    own = _doubted(replace(problem, space=space), ["elbow"], arm=True)
    np.testing.assert_array_equal(own, [0, 1, 0, 1, 0, 0, 1])


@pytest.mark.parametrize(("held_out", "changes", "warned"), [(0.1, 0, 0), (0.3, 1, 0), (0.6, 1, 1)])
def test_a_balance_of_the_base_that_is_not_explained_is_left_out(held_out, changes, warned):
    problem = problem_of(noise=0.1)
    fit, share = minimise(problem), np.ones(2)
    exact = exactly(theta=fit.theta, structure=np.zeros((0, 7)))
    fitted: Any = SimpleNamespace(problem=problem, fit=fit, share=share, exact=exact)
    errors = {"base roll rate": held_out, "knee": 0.1}
    joints = [JointStructure(n, e, e, e, None, None, (), 0.05, 0.0) for n, e in errors.items()]
    found, wider = calibrate._judged(fitted, [], joints, arm=False)
    assert [f.where for f in found] == ["base roll rate"] * warned
    assert wider.structure.shape == (changes, 7)
    for change in wider.structure:
        expected = problem.prior[4] - fit.theta[4]  # which only that balance tells
        assert change[4] == pytest.approx(expected, rel=1e-3)
        np.testing.assert_allclose(change[[1, 3, 6]], 0, atol=1e-3)


def test_a_structure_as_good_counts_with_its_whole_change_and_a_worse_one_with_less():
    problem = problem_of(noise=0.1)
    fit, share = minimise(problem), np.ones(2)
    without = problem.Y.copy()
    without[:, 0, 4] = 0.0
    other = replace(problem, Y=without)
    alone = minimise(other)
    whole = alone.theta - fit.theta
    worse = np.exp(np.mean(np.log(fit.levels / alone.levels)))
    assert worse < 0.9
    np.testing.assert_allclose(
        _change(problem, fit, other, share)[:4], (worse * whole)[:4], rtol=0.05, atol=2e-3
    )
    swapped = replace(problem, prior=problem.prior * 1.5)
    expected = minimise(swapped).theta - fit.theta
    np.testing.assert_allclose(_change(problem, fit, swapped, share), expected, rtol=0.1, atol=5e-3)


def judged(*held_out: float):
    """What the verdict says of joints with such held-out errors."""
    return verdict(
        tuple(
            JointStructure(f"joint {j}", e, e, e, None, None, (), 0.05, 0.0)
            for j, e in enumerate(held_out)
        )
    )[0]


def test_the_verdict_at_its_thresholds():
    assert judged(0.01, 0.19) == "yes"
    assert judged(0.01, 0.21) == "partly"
    assert judged(0.3, 0.3, 0.3) == "partly"
    assert judged(0.1, 0.6) == "partly"
    assert judged(0.6, 0.6, 0.1) == "no"
    poor = structure_checks(("a", "b"), np.array([0.45, 0.55]))
    assert [f.where for f in poor] == ["b"]


def test_a_change_must_be_worth_it_and_beyond_chance():
    before = np.ones(5)
    assert improves(before, 0.9 * before, OWN_DELAY)
    assert not improves(before, 0.98 * before, OWN_DELAY)
    assert improves(before, 0.97 * before, COLUMN)
    assert not improves(before, 0.995 * before, COLUMN)
    lucky = np.array([0.5, 1.1, 1.1, 1.1, 1.0])
    assert np.log(lucky).mean() < -OWN_DELAY.worth
    assert not improves(before, lucky, OWN_DELAY)
    assert not improves(np.full(5, np.inf), before, COLUMN)


def test_a_cost_must_fall_by_its_worth_and_every_half_by_its_own():
    assert improves(100.0, 93.9, NUMBER) and not improves(100.0, 94.1, NUMBER)
    assert improves(np.inf, 100.0, NUMBER) and not improves(100.0, np.inf, NUMBER)
    assert improves(np.ones(2), np.array([0.89, 0.5]), PROFILE)
    assert not improves(np.ones(2), np.array([0.91, 0.5]), PROFILE)


def test_the_least_of_a_parabola_is_found():
    offsets = np.array([-1, 0, 1])
    assert _vertex((offsets - 0.3) ** 2) == pytest.approx(0.3)
    assert _vertex((offsets + 0.2) ** 2) == pytest.approx(-0.2)
    assert _vertex(-(offsets**2.0)) == 0.0


def test_slopes_are_right_up_to_a_third_of_nyquist():
    t = np.arange(200) / 50
    v = slope(t, np.sin(2 * np.pi * 6 * t)[:, None])[10:-10, 0]
    np.testing.assert_allclose(v, 2 * np.pi * 6 * np.cos(2 * np.pi * 6 * t)[10:-10], atol=0.4)


def test_what_an_alternative_changes_reaches_the_intervals(monkeypatch, tmp_path):
    """Every other plausible structure is asked, and its change is in the interval."""
    from nsaid_mj.clinic.identify.identify import identify_forces
    from tests.support.robot_logs import arm_log, two_joints, write_csv

    log = write_csv(tmp_path / "log.csv", arm_log(two_joints(), 0, duration=10.0)[0])
    plain = identify_forces(two_joints(), log, known={"gain_1": 1.0})
    monkeypatch.setattr(calibrate, "_change", lambda problem, *_: 0.5 * problem.prior)
    wide = identify_forces(two_joints(), log, known={"gain_1": 1.0})
    assert wide.of("motor gain")[1].high > 1.5 * plain.of("motor gain")[1].high


def test_an_interval_of_what_nobody_knows_ends():
    """It ended at 2·10¹⁵."""
    problem = problem_of(noise=0.2)
    fit = minimise(problem)._replace(theta=TRUE)
    exact = exactly(covariance=np.diag((40 * TRUE) ** 2), data=1e6 * np.eye(7))
    found = parameters_in_words(problem, fit, exact, np.full(2, 2.0), np.zeros(7))[0]
    assert (found.low, found.high) == (0.0, np.inf)  # printed as "not determined"
