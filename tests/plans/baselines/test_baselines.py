"""The baselines: what each method must recover, and where it must fail."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput, NoEstimate
from nsaid_mj.core.log import Log, SensorLevels
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.plants import sysid as toolbox_module
from nsaid_mj.lab.plants.sysid import Toolbox
from nsaid_mj.plans.baselines import BATCH, least_squares
from nsaid_mj.plans.baselines.base import MethodEstimate, follow
from nsaid_mj.plans.baselines.least_squares import (
    Gauge,
    candidates,
    central_rows,
    condense,
    filtered,
    low_passed,
    weighted,
    window,
)
from nsaid_mj.plans.studies.compare import ComparedPlant, comparison_plan


@cache
def world(name, duration, noise=0.0, **changes):
    scenario = replace(load(name), duration=duration, **changes)
    return ComparedPlant(
        comparison_plan(name, scenario, durations=(duration,), noises=(noise,)), 0, noise
    )


@pytest.fixture(scope="module")
def pendulum():
    return world("double_pendulum", 6.0)


@pytest.fixture(scope="module")
def noisy_pendulum():
    return world("double_pendulum", 6.0, 1.0)


@cache
def estimated(name, scenario, duration):
    """A method's estimate on a scenario's exact data, which it leaves unchanged."""
    problem = world(scenario, duration)._problem
    log = Log(*(part.copy() for part in problem.log))
    found = BATCH[name](problem)
    assert all(np.array_equal(a, b) for a, b in zip(log, problem.log, strict=True))
    return found


def figures(world, estimate) -> dict[str, Any]:
    return world._judge(1.0)(estimate.theta)


# -- the regression --------------------------------------------------------------------------


def residual(world, log=None):
    """rms of W θ under the truth, over the rms of its largest term."""
    problem, truth = world._problem, world._setup.plant.truth
    W = central_rows(problem.system, log or problem.log)
    theta_s = truth / problem.system.space.scale
    return np.sqrt(np.mean((W @ theta_s) ** 2)) / np.abs(W * theta_s).max()


def test_rows_vanish_under_the_truth_with_the_square_of_the_step():
    coarse, fine = (residual(world("double_pendulum", 2.0, dt=dt)) for dt in (2e-3, 1e-3))
    assert 3.0 < coarse / fine < 5.0
    assert fine < 1e-3


def test_half_a_step_of_misalignment_raises_the_residual_tenfold(pendulum):
    log = pendulum._problem.log
    late = log._replace(u=np.vstack([log.u[1:], log.u[-1:]]))
    assert residual(pendulum, late) > 10 * residual(pendulum)


def test_condensed_rows_have_the_same_length(pendulum):
    W = central_rows(pendulum._problem.system, pendulum._problem.log)
    theta_s = np.random.default_rng(0).standard_normal(W.shape[2])
    for rows in (W, W[:5]):  # more rows than parameters, and fewer
        long = np.linalg.norm(rows @ theta_s, axis=0)
        np.testing.assert_allclose(np.linalg.norm(condense(rows) @ theta_s, axis=1), long)


def test_a_log_too_short_is_refused(pendulum):
    short = pendulum._problem.log.until(0.001)
    with pytest.raises(InvalidInput, match="at least 3"):
        central_rows(pendulum._problem.system, short)


def test_the_scale_and_what_no_row_sees_stay_at_the_prior(pendulum):
    problem = pendulum._problem
    gauge = Gauge(problem.system, problem.prior)
    estimate = BATCH["ols"](problem)
    theta_s = estimate.theta / problem.system.space.scale
    assert theta_s @ gauge.normal == pytest.approx(gauge.start @ gauge.normal, rel=1e-12)
    unseen = np.linalg.svd(
        condense(central_rows(problem.system, problem.log)).reshape(-1, problem.system.p)
    )
    blind = unseen.Vh[1e-10 * unseen.S[0] > unseen.S]
    assert len(blind) >= 10
    np.testing.assert_allclose(blind @ theta_s, blind @ gauge.start, atol=1e-9)


def test_least_squares_is_at_a_minimum(pendulum):
    problem = pendulum._problem
    gauge = Gauge(problem.system, problem.prior)
    rows = condense(central_rows(problem.system, problem.log)).reshape(-1, problem.system.p)
    theta_s = gauge.solve(rows)
    gradient = gauge.tangent.T @ rows.T @ (rows @ theta_s)
    size = np.linalg.norm(rows, 2) * np.linalg.norm(rows @ gauge.start)
    assert np.linalg.norm(gradient) < 1e-7 * size


# -- filters ---------------------------------------------------------------------------------


def test_the_low_pass_has_no_phase_and_one_gain_for_all_columns():
    rate, t = 500.0, np.arange(4000) / 500.0
    slow, fast = np.sin(2 * np.pi * 0.5 * t), np.sin(2 * np.pi * 40.0 * t)
    W = np.stack([np.ones_like(t), slow, fast, slow + fast], axis=1)[:, None, :]
    rows = low_passed(W, rate, 4.0)[:, 0]
    half, every = int(np.ceil(1.5 * rate / 4.0)), int(rate / 16.0)
    at = half + every * np.arange(len(rows))
    np.testing.assert_allclose(rows[:, 0], 1.0, rtol=1e-12)
    np.testing.assert_allclose(rows[:, 1], slow[at], atol=0.01)
    assert np.abs(rows[:, 2]).max() < 5e-3
    np.testing.assert_allclose(rows[:, 3], rows[:, 1] + rows[:, 2], atol=1e-12)


@pytest.mark.parametrize("name", ["bluerov2", "double_pendulum", "kinova"])
def test_smoothing_removes_noise_and_leaves_a_position(name):
    """Plain numbers, a pose, and (cos, sin) of continuous joints."""
    duration = 8.0 if name == "bluerov2" else 2.0
    exact, noisy = (world(name, duration, noise)._problem for noise in (0.0, 1.0))
    system, rng = exact.system, np.random.default_rng(1)
    steps = 1e-2 * rng.standard_normal((len(exact.log.t), system.n))
    rough = np.array([system.integrate(q, d) for q, d in zip(exact.log.q, steps, strict=True)])
    if system.group == 6:
        rough[1::2, 3:7] *= -1.0  # the same attitudes
    log = system.smoothed(noisy.log._replace(q=rough, v=exact.log.v), 10.0)
    error = np.array([system.difference(a, b) for a, b in zip(exact.log.q, log.q, strict=True)])
    assert np.sqrt(np.mean(error**2)) < 6e-3
    back = np.array([system.integrate(q, np.zeros(system.n)) for q in log.q])
    np.testing.assert_allclose(back, log.q, atol=1e-6)
    assert log.u is noisy.log.u


def test_the_window_is_the_time_in_which_velocity_changes():
    t = np.arange(5000) / 500.0
    for hertz in (0.5, 2.0):
        v = np.sin(2 * np.pi * hertz * t)[:, None]
        width = window(Log(t, v, v, v)) / 500.0
        assert 0.05 / hertz < width < 0.25 / hertz


def test_an_unevenly_sampled_log_is_refused(pendulum):
    log = pendulum._problem.log
    uneven = log._replace(t=log.t + 1e-3 * np.sin(np.arange(len(log.t))))
    with pytest.raises(InvalidInput, match="constant rate"):
        _ = uneven.step


# -- the methods -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "name"),
    [
        pytest.param(scenario, name, marks=pytest.mark.slow)
        if (scenario, name) == ("f1tenth", "ekf")
        else (scenario, name)
        for scenario in ("double_pendulum", "scalar_rov", "f1tenth")
        for name in BATCH
    ],
)
def test_every_method_approaches_the_truth_on_exact_data(name, scenario):
    seconds = 6.0 if scenario == "double_pendulum" else 40.0
    here, found = world(scenario, seconds), estimated(name, scenario, seconds)
    before, after = (figures(here, e) for e in (MethodEstimate(here._problem.prior), found))
    assert after["theta_perp_ratio"] < 0.2 * before["theta_perp_ratio"]
    assert after["force_residual_ratio"] < 0.05 * before["force_residual_ratio"]
    assert after["actuator_ratio_error"] <= 0.1 * before["actuator_ratio_error"]


@pytest.mark.parametrize("name", BATCH)
def test_methods_are_deterministic_and_leave_the_log_unchanged(name, pendulum):
    first, second = estimated(name, "double_pendulum", 6.0), BATCH[name](pendulum._problem)
    assert np.array_equal(first.theta, second.theta)


@pytest.mark.parametrize("name", BATCH)
def test_scaling_the_prior_scales_the_estimate(name, pendulum):
    """No log determines the common scale: every method keeps that of the prior."""
    problem, one = pendulum._problem, estimated(name, "double_pendulum", 6.0)
    two = BATCH[name](problem._replace(prior=2 * problem.prior))
    if name in ("ekf", "rls"):  # whose start has a spread in θ/scale
        ratios = [figures(pendulum, e)["theta_perp_ratio"] for e in (one, two)]
        assert max(ratios) < 0.01
    else:
        np.testing.assert_allclose(
            two.theta, 2 * one.theta, rtol=1e-5, atol=1e-6 * np.abs(one.theta).max()
        )


def test_noise_ruins_raw_differences_but_not_filtered_least_squares(noisy_pendulum):
    problem = noisy_pendulum._problem
    raw, filtered_ = (figures(noisy_pendulum, BATCH[n](problem)) for n in ("ols", "wls"))
    assert filtered_["force_residual_ratio"] < 0.1 * raw["force_residual_ratio"]
    assert filtered_["actuator_ratio_error"] < 0.1 * raw["actuator_ratio_error"]


def test_the_cut_off_comes_from_the_log_and_is_nearly_the_best():
    """Prediction within the log comes near the best of all candidates, which only we can know."""
    here = world("ur5", 10.0, 3.0)
    problem = here._problem
    gauge = Gauge(problem.system, problem.prior)
    W, rate, _ = filtered(problem)
    residuals = [
        figures(here, MethodEstimate(gauge.scale * weighted(gauge, low_passed(W, rate, cutoff))))
        for cutoff in candidates(rate, len(W), problem.system)
    ]
    forces = [f["force_residual_ratio"] for f in residuals]
    found = figures(here, BATCH["wls"](problem))["force_residual_ratio"]
    assert found < 2 * min(forces)
    assert found < 0.5 * max(forces)


def test_no_cut_off_is_judged_by_the_rows_that_it_was_fitted_to(pendulum, monkeypatch):
    """Column k of W marks the k-th quarter: it is all zero where that quarter is predicted."""
    problem = pendulum._problem
    W, rate, _ = filtered(problem)
    quarters = np.linspace(0, len(W), 5).astype(int)
    W = W.copy()
    W[..., :4] = 0.0
    for k in range(4):
        W[quarters[k] : quarters[k + 1], :, k] = 1.0
    predicted = []

    def fitted(gauge, rows):
        predicted.append(np.flatnonzero(~rows[..., :4].any(axis=(0, 1))).tolist())
        return gauge.start

    def errors(windows, theta_s, first, last):
        assert predicted[-1] == [k for k in range(4) if first < quarters[k + 1] - 1 < last]
        return np.ones((1, problem.system.n))

    monkeypatch.setattr(least_squares, "weighted", fitted)
    monkeypatch.setattr(least_squares._Windows, "errors", errors)
    least_squares.choose_cutoff(problem, problem.log, W, rate)
    assert predicted[:4] == [[0], [1], [2], [3]]


def test_a_log_too_short_to_be_filtered_is_refused(pendulum):
    short = pendulum._problem._replace(log=pendulum._problem.log.until(0.05))
    for name in ("wls", "tls"):
        with pytest.raises(InvalidInput, match="long enough"):
            BATCH[name](short)


def test_a_filter_whose_mass_matrix_turns_indefinite_says_when(pendulum):
    problem = pendulum._problem
    with pytest.raises(NoEstimate, match="not positive definite at t = 0 s"):
        BATCH["ekf"](problem._replace(prior=-problem.prior))


def test_recursive_least_squares_keeps_its_known_gain(pendulum):
    problem = pendulum._problem
    known = problem.system.space.actuators[0]
    assert BATCH["rls"](problem).theta[known] == problem.prior[known]


def test_an_identifier_gives_the_same_estimate_from_a_log_as_in_a_run(tmp_path):
    scenario = replace(load("scalar_rov"), duration=2.0)
    study = comparison_plan("scalar_rov", scenario, methods=("paper",), durations=(2.0,))
    here = ComparedPlant(study, 0, 0.0)
    done = run(here._setup.scenario, tmp_path)
    followed = here._methods["paper"](here._problem)
    assert np.array_equal(followed.theta, done.record["theta_hat_paper"][-1])


def test_an_identifier_that_ends_early_says_how(pendulum):
    here = world("double_pendulum", 1.0)
    identifier = here._methods["paper"].args[0]  # type: ignore[attr-defined]
    broken = here._problem.log._replace(v=here._problem.log.v.copy())
    broken.v[20] = np.nan
    with pytest.raises(NoEstimate, match="measurement not finite at t ="):
        follow(identifier, here._problem._replace(log=broken))


# -- mujoco.sysid ----------------------------------------------------------------------------


def installed():
    import mujoco.sysid

    return hasattr(mujoco.sysid, "optimize")


def by_toolbox(problem, budget=1.0):
    system, log, prior, noise = problem
    return Toolbox().fitted(system, [log], prior, noise, budget)


needs_toolbox = pytest.mark.skipif(not installed(), reason="needs mujoco[sysid]")


def test_sysid_without_its_dependencies_says_how_to_install_them(pendulum, monkeypatch):
    import mujoco.sysid

    monkeypatch.delattr(mujoco.sysid, "optimize", raising=False)
    with pytest.raises(NoEstimate, match=r"mujoco\[sysid\]"):
        by_toolbox(pendulum._problem)


@needs_toolbox
def test_sysid_refuses_systems_other_than_arms():
    with pytest.raises(NoEstimate, match="arms"):
        by_toolbox(world("scalar_rov", 1.0)._problem)


@needs_toolbox
@pytest.mark.parametrize("robot", ["double_pendulum", "kinova"])
def test_sysids_model_accelerates_as_the_structure(robot):
    """Its model under a θ accelerates as (29) under the same θ, friction included."""
    import mujoco

    problem = world(robot, 0.1)._problem
    system, theta, rng = problem.system, problem.prior, np.random.default_rng(2)
    assert isinstance(system, JointTree)
    model = toolbox_module._SysidModel(Toolbox().module, system, theta, 1e-3)
    np.testing.assert_allclose(
        model.theta(model.parameters.as_vector()), theta, rtol=1e-6, atol=1e-9
    )
    compiled = model.build(model.parameters)
    data = mujoco.MjData(compiled)
    with toolbox_module.installed(toolbox_module._friction().ctypes):
        for _ in range(5):
            q, v, u = system.random_state(rng)
            data.qpos[:], data.qvel[:], data.ctrl[:] = model._angles(q[None])[0], v, u
            mujoco.mj_forward(compiled, data)
            expected = system.acceleration(0.0, np.r_[q, v], v, u, theta)
            np.testing.assert_allclose(data.qacc, expected, rtol=1e-6, atol=1e-6)


@needs_toolbox
@pytest.mark.slow  # that its fit runs and helps is in tests/clinic/servos/test_comparison.py, too
def test_sysid_identifies_an_arm_within_its_time_budget():
    import time

    here, begin = world("double_pendulum", 3.0), time.process_time()
    theta, note = by_toolbox(here._problem, 15.0)
    assert time.process_time() - begin < 25.0
    assert "6 chunks" in note
    before, after = (figures(here, MethodEstimate(t)) for t in (here._problem.prior, theta))
    assert after["force_residual_ratio"] < 0.1 * before["force_residual_ratio"]


def test_a_method_filters_only_the_noise_that_is_stated(noisy_pendulum):
    """What is stated as exact is not filtered before the recursion."""
    problem = noisy_pendulum._problem
    stated, denied = (
        BATCH["rls"](problem._replace(noise=n)) for n in (problem.noise, SensorLevels())
    )
    assert stated.note.startswith("cut-off") and denied.note == ""
    better, worse = (figures(noisy_pendulum, e) for e in (stated, denied))
    assert better["force_residual_ratio"] < worse["force_residual_ratio"]
