"""The batch fit: its cost, its derivatives, its minimum, and what it says about precision."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.base.errors import InvalidInput, NoEstimate, UnknownName
from nsaid_mj.clinic.identify.calibrate import _held_out
from nsaid_mj.clinic.identify.fit import (
    combinations,
    gramians,
    inflation,
    minimise,
    posterior,
    precision,
    tempered,
)
from nsaid_mj.clinic.identify.identifiability import parameters_in_words, suggest, with_known
from nsaid_mj.clinic.identify.problem import FitProblem, Size, folds, least_squares
from nsaid_mj.core.parameters import Block, ParameterSpace


def space_of(gains: int = 2) -> ParameterSpace:
    """Two joints with rotor inertia, friction and gain, and a free offset."""
    two = ("1", "2")
    return ParameterSpace(
        (
            Block(
                "rotor inertia",
                tuple(f"rotor_{i}" for i in two),
                ("kg·m²",) * 2,
                np.ones(2),
                "positive",
            ),
            Block(
                "viscous friction",
                tuple(f"viscous_{i}" for i in two),
                ("N·m·s/rad",) * 2,
                np.ones(2),
                "positive",
            ),
            Block("offset", ("offset_1",), ("N·m",), np.ones(1), "free"),
            Block(
                "motor gain",
                tuple(f"gain_{i}" for i in two),
                ("N·m/A",) * gains,
                np.ones(2),
                "positive",
                True,
            ),
        )
    )


TRUE = np.array([2.0, 0.5, 1.5, 0.7, 0.2, 1.3, 0.8])


def absolute(p: int) -> Size:
    """All p prior values are absolute."""
    return Size(np.ones((1, p)), np.zeros(p, dtype=np.intp), np.inf, np.ones(p, dtype=bool))


def problem_of(noise: float = 0.0, rows: int = 400, seed: int = 0) -> FitProblem:
    """Rows of two independent joints whose commands make Y θ = 0 under TRUE, plus noise."""
    rng = np.random.default_rng(seed)
    a, v = rng.standard_normal((2, rows, 2))
    Y = np.zeros((rows, 2, 7))
    for j in range(2):
        Y[:, j, j], Y[:, j, 2 + j] = a[:, j], v[:, j]
    Y[:, 0, 4] = 1.0
    force = Y[:, :, :5] @ TRUE[:5]
    u = force / TRUE[5:] + noise * rng.standard_normal((rows, 2))
    for j in range(2):
        Y[:, j, 5 + j] = -u[:, j]
    space = space_of()
    return FitProblem(
        space,
        Y,
        np.ones((rows, 2), dtype=bool),
        np.arange(rows, dtype=np.float64) * 0.05,
        np.zeros(rows, dtype=np.intp),
        np.array([1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0]),
        np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.3, 0.3]),
        np.zeros(7, dtype=bool),
        absolute(7),
    )


def cost(problem: FitProblem, theta: np.ndarray) -> float:
    return posterior(problem, gramians(problem)).value(theta)


def by_gain(problem: FitProblem) -> FitProblem:
    """The problem whose prior values of joint 1, but its gain, were guessed from its command."""
    return replace(problem, size=problem.size._replace(gain=np.array([5, -1, 5, -1, 5, -1, -1])))


@pytest.mark.parametrize("guessed", [False, True])
def test_the_gradient_of_the_cost_is_its_finite_difference(guessed):
    problem = problem_of(noise=0.1)
    problem = by_gain(problem) if guessed else problem
    theta = problem.prior * np.linspace(0.8, 1.3, 7) + np.eye(7)[4] * 0.1
    gradient, hessian = posterior(problem, gramians(problem)).derivatives(theta)
    h = 1e-6
    for i, unit in enumerate(np.eye(7)):
        slope = (cost(problem, theta + h * unit) - cost(problem, theta - h * unit)) / (2 * h)
        assert slope == pytest.approx(gradient[i], rel=1e-5, abs=1e-4)
    assert (np.linalg.eigvalsh(hessian) > 0).all()


def test_joints_without_noise_are_recovered_up_to_their_own_scale():
    problem = problem_of()
    theta = minimise(problem).theta
    for joint in ([0, 2, 4, 5], [1, 3, 6]):
        ratio = theta[joint] / TRUE[joint]
        assert np.ptp(ratio) < 1e-5 * ratio.mean()


def test_the_scale_stays_where_the_prior_puts_it():
    """Scaling θ changes no residual, so that only the prior decides."""
    problem = problem_of(noise=0.05)
    theta = minimise(problem).theta
    for joint in ([0, 2, 4, 5], [1, 3, 6]):
        step = np.zeros(7)
        step[joint] = theta[joint]
        assert cost(problem, theta) <= cost(problem, theta + 0.01 * step)
        assert cost(problem, theta) <= cost(problem, theta - 0.01 * step)


def test_friction_guessed_from_a_command_is_no_evidence_of_its_gain():
    """A joint's common scale has the width of the gain's own prior, with a known gain none."""
    problem = replace(problem_of(noise=0.01), spread=np.ones(7))
    joint = [0, 2, 4, 5]
    own = []
    for each in (problem, by_gain(problem)):
        fit = minimise(each)
        exact = precision(each, fit, np.ones(2))
        own.append(np.sqrt(exact.covariance[5, 5]) / fit.theta[5])
        assert np.ptp(fit.theta[joint] / TRUE[joint]) < 0.05 * fit.theta[5] / TRUE[5]
    plain, guessed = own
    assert guessed == pytest.approx(1.0, rel=0.05) and plain < 0.7 * guessed
    told = with_known(by_gain(problem), {"gain_1": 5.0})
    assert told.prior.tolist() == [5.0, 1.0, 5.0, 1.0, 0.0, 5.0, 1.0]
    fit = minimise(told)
    assert np.isfinite(precision(told, fit, np.ones(2)).prior).all()
    np.testing.assert_allclose(fit.theta[joint] / TRUE[joint], 5.0 / 1.3, rtol=0.05)


def test_a_known_gain_fixes_the_scale_of_its_joint():
    problem = with_known(problem_of(noise=0.01), {"gain_1": 1.3})
    fit = minimise(problem)
    assert fit.theta[5] == 1.3
    np.testing.assert_allclose(fit.theta[[0, 2, 4]], TRUE[[0, 2, 4]], rtol=0.02)


@pytest.mark.parametrize(
    "known,error",
    [
        ({"gain_9": 1.0}, UnknownName),
        ({"gain_1": -1.0}, InvalidInput),
        ({"gain_1": float("nan")}, InvalidInput),
    ],
)
def test_known_values_that_cannot_be_are_refused(known, error):
    with pytest.raises(error):
        with_known(problem_of(), known)


def test_a_problem_without_usable_rows_has_no_estimate():
    problem = problem_of()
    with pytest.raises(NoEstimate):
        minimise(replace(problem, usable=np.zeros_like(problem.usable)))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6), noise=st.floats(0.01, 0.5))
def test_estimates_stay_positive_and_the_gradient_vanishes(seed, noise):
    problem = problem_of(noise, rows=100, seed=seed)
    fit = minimise(problem)
    assert (fit.theta[[0, 1, 2, 3, 5, 6]] > 0).all()
    gradient, hessian = posterior(problem, gramians(problem)).derivatives(fit.theta)
    assert 0.5 * gradient @ np.linalg.solve(hessian, gradient) < 1e-2


def test_gramians_of_parts_add_up():
    problem = problem_of(noise=0.1)
    whole = gramians(problem)
    rest, own = map(gramians, folds(problem, 5)[2])
    np.testing.assert_allclose(rest.sums + own.sums, whole.sums, rtol=1e-12)
    np.testing.assert_array_equal(rest.counts + own.counts, whole.counts)


def test_every_part_has_its_share_of_a_joint_that_moves_only_once():
    """Else it would be predicted from rows in which it never moves."""
    problem = problem_of(noise=0.1)
    problem.usable[:, 1] = (np.arange(400) >= 100) & (np.arange(400) < 160)
    parts = folds(problem, 5)
    for rest, own in parts:
        np.testing.assert_array_equal((rest.usable.sum(axis=0) + own.usable.sum(axis=0)), [400, 60])
        assert (abs(own.usable.sum(axis=0) / [80, 12] - 1) < 0.5).all()
        assert (np.diff(own.t[own.usable[:, 1]]) < 0.06).all()
    held_out, _ = _held_out(problem, np.ones(2), problem.prior)
    assert (held_out < 0.2).all()


def test_a_joint_at_rest_throughout_takes_nothing_from_the_others():
    problem = problem_of(noise=0.2)
    usable = problem.usable.copy()
    usable[:, 1] = False
    problem, share = replace(problem, usable=usable), np.ones(2)
    fit = minimise(problem, tempered(problem, share))
    assert (np.abs(precision(problem, fit, share).parts[:, 0]) > 0).all()  # the jackknife's


def test_the_rotor_of_a_sliding_joint_is_not_suggested_to_be_weighed():
    problem = problem_of(noise=0.2)
    rotor, *others = problem.space.blocks
    space = ParameterSpace((replace(rotor, units=("kg", "kg")), *others))
    problem, share = replace(problem, space=space), np.ones(2)
    fit = minimise(problem)
    exact = precision(problem, fit, share)
    parameters = parameters_in_words(problem, fit, exact, np.full(2, 0.3), np.zeros(7))
    assert "rotor" not in suggest(problem, exact, parameters)


def test_white_residuals_are_not_inflated_and_correlated_ones_are():
    problem = problem_of(noise=0.2, rows=4000)
    assert (inflation(problem, TRUE) < 1.5).all()
    rng = np.random.default_rng(1)
    slow = np.repeat(rng.standard_normal((400, 2)), 10, axis=0)
    drifting = problem.Y.copy()
    drifting[:, 0, 5] += slow[:, 0]
    drifting[:, 0, 4] = 1.0
    assert inflation(replace(problem, Y=drifting), TRUE)[0] > 1.1


@pytest.mark.parametrize("seed", range(3))
def test_stated_deviations_are_those_of_repeated_logs(seed):
    """Over logs with new noise, the error over its stated deviation has mean square near 1."""
    scores = []
    for trial in range(20):
        problem = problem_of(noise=0.3, rows=300, seed=100 * seed + trial)
        problem = with_known(problem, {"gain_1": 1.3, "gain_2": 0.8})
        fit = minimise(problem)
        exact = precision(problem, fit, np.ones(2))
        scores.append((fit.theta - TRUE)[:4] / exact.deviation[:4])
    assert 0.4 < np.mean(np.square(scores)) < 1.6


def test_least_squares_with_known_gains_recovers_exact_rows():
    np.testing.assert_allclose(least_squares(problem_of(), TRUE[5:]), TRUE, rtol=1e-6)


def test_combinations_say_which_columns_depend_on_which():
    problem = problem_of(noise=0.1)
    Y = problem.Y.copy()
    Y[:, :, 3] = 0.0  # silent
    Y[:, :, 2] = 2.0 * Y[:, :, 0]  # dependent
    found = combinations(replace(problem, Y=Y))
    assert found.independent == [0, 1, 4] and not found.weights[:, 3].any()
    assert found.expression(0) == pytest.approx({0: 1.0, 2: 2.0})
    assert found.members(2) == [0] and found.members(3) == []


def test_nrmse_of_the_mean_is_one():
    problem = problem_of(noise=0.1)
    nothing = np.zeros(7)
    nothing[4], nothing[5:] = 0.0, 1.0
    centred = problem.Y.copy()
    centred[:, :, 5:] -= centred[:, :, 5:].mean(axis=0)
    np.testing.assert_allclose(replace(problem, Y=centred).nrmse(nothing), 1.0, rtol=1e-12)
