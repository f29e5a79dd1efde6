"""Adaptive tracking: the statements of docs/theory.md, section 7, and what the driver promises."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsaid_mj.base.errors import FolderInUse, InvalidInput, NsaidError
from nsaid_mj.base.files import OutputFolder
from nsaid_mj.core.laws.cone.law import ConeMetric
from nsaid_mj.core.laws.cone.prior import Prior
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.metric import ConstantMetric
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.control.adaptive.actuation import Actuation
from nsaid_mj.lab.control.adaptive.laws import ControllerEstimate
from nsaid_mj.lab.control.adaptive.tracker import AdaptiveTracking, Tracker, command_range
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import Observer, run
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.lab.setup import Setup
from nsaid_mj.plans.track.evaluation import lyapunov, rise_bounds
from nsaid_mj.plans.track.run import run_tracking as run_study
from nsaid_mj.plans.track.tracking import courses, drive
from nsaid_mj.plans.track.tracking import tracking_plan as plan_of
from nsaid_mj.report.recording.scene import ROBOT
from nsaid_mj.robots.assets import scenarios
from tests.support.plants import config_of, plant
from tests.support.recordings import entities_of

ACTUATED = ["double_pendulum", "ur5", "bluerov2", "astrobee", "uvms"]
UNDERACTUATED = ["crazyflie", "remus100", "f1tenth", "solo12 free"]
SLOW = AdaptiveTracking(rate=1.0, damping=4.0, adaptation=8.0, fundamental=0.04, travel=0.3)


def tracker(name: str, law: Any = "nullspace", seed: int = 0) -> tuple[Any, Array, Tracker]:
    """System, true θ and a controller with a prior that is 30 % off, inside the cone."""
    made = plant(name)
    rng = np.random.default_rng(seed)
    prior = Prior(made.system.space, made.truth, 0.3).draw(rng)
    return made.system, made.truth, replace(SLOW, law=law).build(made.system, prior, rng)


def inner(system: Any, theta: Array) -> Array:
    """θ moved off the cone's boundary, on which D_ψ is infinite."""
    return Prior(system.space, theta, 0.0).draw(np.random.default_rng(0))


@pytest.mark.parametrize("name", ACTUATED)
def test_the_rate_of_v_by_finite_differences(name: str):
    """V̇ = −sᵀ W θ̂ (T3), which is −sᵀ K_d s within the limits (T2), at random states."""
    system, truth, control = tracker(name)
    truth, metric, rng = inner(system, truth), control.metric, np.random.default_rng(5)
    assert isinstance(metric, ConeMetric)
    actuation, exact = Actuation(system, truth, *command_range(system)), 0
    for _ in range(8):
        t, theta_hat = float(rng.uniform(0, 20)), Prior(system.space, truth, 0.5).draw(rng)
        numbers, v = control.reference.desired(t)
        q = system.integrate(system.position(numbers), 0.02 * rng.standard_normal(system.n))
        v = v + 0.02 * rng.standard_normal(system.n)
        v_r, a_r = control.reference(t, q, v)
        s, damping = v - v_r, rng.uniform(0.5, 2.0, system.n)
        idle = system._W(t, q, v, v_r, a_r, np.zeros(system.n_u)) @ theta_hat
        u = actuation.command(theta_hat, idle - damping * s)
        W = system._W(t, q, v, v_r, a_r, u)
        a = system.acceleration(t, np.r_[q, v], v, u, truth)
        rate = -np.linalg.solve(metric.mu * metric.mirror(theta_hat)[1], W.T @ s)

        def V(h: float, q=q, v=v, a=a, t=t, theta_hat=theta_hat, rate=rate) -> float:
            q_h, v_h = system.integrate(q, h * v), v + h * a
            s_h = v_h - control.reference(t + h, q_h, v_h)[0]
            M = system.mass_matrix(np.r_[q_h, v_h], truth)
            return float(0.5 * s_h @ M @ s_h + metric.divergence(truth, theta_hat + h * rate))

        h = 1e-5 / max(1.0, float(np.abs(a).max()), float(np.abs(rate / system.space.scale).max()))
        slope = (8 * (V(h) - V(-h)) - (V(2 * h) - V(-2 * h))) / (12 * h)
        size = float(np.abs(s) @ np.abs(W) @ np.abs(theta_hat))
        assert slope == pytest.approx(-s @ W @ theta_hat, abs=1e-5 * size)
        if np.all(u > actuation.low + 1e-12) and np.all(u < actuation.high - 1e-12):
            exact += 1
            assert W @ theta_hat == pytest.approx(damping * s, abs=1e-4 * np.abs(idle).max())
    assert exact or name == "astrobee"  # whose nozzles are too weak for these accelerations


@cache
def study(name: str, seconds: float, dt: float) -> tuple[Setup, Tracker, Any]:
    """A run with exact sensors under the law `nullspace`, gains 40 % wrong."""
    excitation = AdaptiveTracking(fundamental=0.2, harmonics=8, speed=2.5)
    if name != "ur5":
        excitation = replace(SLOW, rate=1.5, damping=6.0, adaptation=15.0)
    scenario = Scenario(
        plant=config_of(name),
        excitation=excitation,
        identifier=NullspaceAID(law="cone"),
        initial_error=0.4,
        gain_error=0.4,
        duration=seconds,
        dt=dt,
    )
    setup = Setup.of(scenario)
    control = setup.driver()
    assert isinstance(control, Tracker)
    return setup, control, drive(setup, control)


@pytest.mark.parametrize(("name", "seconds", "dt"), [("ur5", 1.0, 1e-3), ("bluerov2", 8.0, 0.01)])
def test_v_never_rises_beyond_what_discretisation_explains(name: str, seconds: float, dt: float):
    setup, control, motion = study(name, seconds, dt)
    theta, metric = inner(setup.system, setup.plant.truth), control.metric
    assert isinstance(metric, ConeMetric)
    V = lyapunov(motion, setup.system, control, metric, theta)
    bounds = rise_bounds(motion, setup.system, control, metric, theta)
    assert np.all(np.diff(V) <= bounds)
    assert np.median(bounds) < 1e-6 * V[0]
    assert V[-1] < 0.9 * V[0]
    assert np.all(motion.theta_hat[:, setup.system.space.actuators] > 0)


def test_the_defect_of_a_step_is_of_third_order():
    """V's change minus the integral of −sᵀ W θ̂ over a step, at two sampling intervals."""
    worst = []
    for dt in (1e-3, 5e-4):
        setup, control, motion = study("ur5", 0.4, dt)
        theta = inner(setup.system, setup.plant.truth)
        metric = control.metric
        assert isinstance(metric, ConeMetric)
        V = lyapunov(motion, setup.system, control, metric, theta)
        power = []
        for k in range(len(V) - 1):
            ends = []
            for j in (k, k + 1):
                t, q, v = float(motion.t[j]), motion.q[j], motion.v[j]
                v_r, a_r = control.reference(t, q, v)
                W = setup.system._W(t, q, v, v_r, a_r, motion.u[k])
                ends.append(float((v - v_r) @ W @ motion.theta_hat[j]))
            power.append(0.5 * dt * sum(ends))
        worst.append(np.abs(np.diff(V) + power)[10:].max())
    assert worst[0] / worst[1] > 5  # 8 for third order


def test_gains_stay_positive_whatever_the_errors_and_cross_zero_with_constant_gamma():
    system, _, control = tracker("ur5")
    metric, prior, gains = control.metric, control.theta_hat, system.space.actuators
    assert isinstance(metric, ConeMetric)
    rng = np.random.default_rng(0)
    curved = ControllerEstimate(prior, metric)
    flat = ControllerEstimate(prior, ConstantMetric(metric.Gamma))
    lowest = np.inf
    for _ in range(200):
        slope = 10 ** rng.uniform(-2, 3) * rng.standard_normal(system.p) / system.space.scale
        curved.learn(slope, 1e-3)
        flat.learn(slope, 1e-3)
        assert np.all(curved.theta[gains] > 0)
        lowest = min(lowest, float(flat.theta[gains].min()))
    assert lowest < 0


def test_the_law_with_known_gains_never_changes_them():
    system, _, control = tracker("ur5", "conventional")
    before = control.theta_hat.copy()
    rng = np.random.default_rng(0)
    numbers, v = control.start()
    for k in range(20):
        q = system.position(numbers + 0.01 * rng.standard_normal(system.n))
        control.command(1e-3 * k, q, v)
    moved = control.theta_hat != before
    assert moved.any()
    assert not moved[system.space.actuators].any()


@pytest.mark.parametrize("name", ["bluerov2", "astrobee", "uvms"])
def test_redundant_actuators_exert_the_force_or_its_direction(name: str):
    system, truth, _ = tracker(name)
    actuation, rng = Actuation(system, truth, *command_range(system)), np.random.default_rng(1)
    q, v, _ = system.random_state(rng)
    zero = system._F(0.0, q, v, np.zeros(system.n_u)) @ truth
    weak = 1e-3 * actuation.matrix(truth) @ rng.standard_normal(system.n_u)
    for size in (1.0, 1e4):
        u = actuation.command(truth, size * weak)
        assert np.all(u >= actuation.low - 1e-12)
        assert np.all(u <= actuation.high + 1e-12)
        force = system._F(0.0, q, v, u) @ truth - zero
        for group in actuation.groups:
            wanted, got = weak[group.rows], force[group.rows]
            along = got @ wanted / (wanted @ wanted)
            assert got == pytest.approx(along * wanted, abs=1e-3 * np.abs(got).max())
            assert along > 0
            if size == 1:
                assert along == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("name", UNDERACTUATED)
def test_an_under_actuated_system_is_refused(name: str):
    made = plant(name)
    with pytest.raises(InvalidInput, match=r"under-actuated|their own commands"):
        AdaptiveTracking().build(made.system, made.truth, np.random.default_rng(0))


@pytest.mark.parametrize("name", ACTUATED)
def test_the_reference_velocity_is_that_of_the_reference_where_there_is_no_error(name: str):
    system, _, control = tracker(name)
    for t in (0.0, 3.0):
        numbers, v = control.reference.desired(t)
        q, h = system.position(numbers), 1e-4
        later = system.position(control.reference.desired(t + h)[0])
        sooner = system.position(control.reference.desired(t - h)[0])
        assert system.difference(sooner, later) / (2 * h) == pytest.approx(v, abs=1e-6)
        v_r, a_r = control.reference(t, q, v)
        assert v_r == pytest.approx(v, abs=1e-12)
        slope = (control.reference.desired(t + h)[1] - control.reference.desired(t - h)[1]) / 2 / h
        assert a_r == pytest.approx(slope, abs=1e-5)


class _Often(Observer):
    """An observer that divides the run into short segments."""

    period = 0.03

    def start(self, scenario: Any, robot: Any, first: Any) -> None:
        pass

    def see(self, log: Any, states: Any, levels: Any) -> None:
        pass

    def stop(self) -> None:
        pass


def test_an_informed_driver_uses_the_estimate_and_observers_do_not_change_it(tmp_path: Path):
    excitation = AdaptiveTracking(law="composite", period=0.1, fundamental=0.3)
    scenario = Scenario(
        plant=config_of("double_pendulum"),
        excitation=excitation,
        identifier=NullspaceAID(K=20.0, gain=8.0, law="cone"),
        duration=0.5,
        gain_error=0.4,
    )
    alone = run(scenario, tmp_path / "alone").record
    watched = run(scenario, tmp_path / "watched", _Often()).record
    assert np.array_equal(alone["u"], watched["u"])
    deaf = replace(scenario, excitation=replace(excitation, period=10.0))
    without = run(deaf, tmp_path / "deaf").record
    first = alone["t"] < 0.1
    assert np.array_equal(alone["u"][first], without["u"][first])
    assert not np.array_equal(alone["u"][-1], without["u"][-1])


def test_a_study_needs_a_scenario_that_tracks_and_known_laws():
    with pytest.raises(InvalidInput, match="AdaptiveTracking"):
        plan_of("ur5", Scenario())
    tracking = Scenario(excitation=AdaptiveTracking())
    with pytest.raises(NsaidError, match="nullspace"):
        plan_of("track_ur5", tracking, laws=("sliding",))


def test_a_study_writes_table_page_and_recording(tmp_path: Path, capsys: Any):
    scenario = Scenario(
        plant=config_of("double_pendulum"),
        excitation=AdaptiveTracking(fundamental=0.3),
        identifier=NullspaceAID(K=20.0, gain=8.0, law="cone"),
        duration=0.3,
    )
    laws = ("nullspace", "conventional")
    plan = plan_of("double_pendulum", scenario, laws=laws, seeds=(0, 1))
    with (
        OutputFolder(tmp_path).locked(),
        ThreadPoolExecutor(1) as other,
        pytest.raises(FolderInUse),
    ):
        other.submit(run_study, plan, tmp_path).result()
    result, done = run_study(plan, tmp_path)
    assert len(done) == 4 and result.complete and result.explains in {"yes", "partly"}
    errors = next(f for f in result.statistics if (f.name, f.unit) == ("rms", "rad")).values
    assert set(errors) == set(laws) and [c.name for c in result.curves[0].curves] == list(laws)
    rows = json.loads((tmp_path / "tracking.json").read_text())["rows"]
    assert [(row["law"], row["seed"]) for row in rows] == [(k, i) for i in (0, 1) for k in laws]
    assert all(row["v_rises"] == 0 for row in rows if row["law"] == "nullspace")
    assert "conventional" in (tmp_path / "report.html").read_text(encoding="utf-8")
    drawn = entities_of(tmp_path / "tracking.rrd")
    view = f"/{ROBOT}/"  # what the 3D view shows
    assert f"{view}reference" in drawn
    assert {f"/error/rad/{law}" for law in laws} | {f"/command/{law}" for law in laws} <= set(drawn)
    assert "[mrad]" in capsys.readouterr().out


TRACKING = ["track_astrobee", "track_bluerov2", "track_payload", "track_ur5", "track_uvms"]


def test_these_are_the_scenarios_that_track():
    found = [n for n in scenarios() if isinstance(load(n).excitation, AdaptiveTracking)]
    assert sorted(found) == TRACKING


@pytest.mark.parametrize("name", TRACKING)
def test_a_scenario_that_tracks_stays_near_its_reference(name: str):
    """100 steps from a start on the reference, under a prior and gains that are wrong."""
    scenario = load(name)
    setup = Setup.of(replace(scenario, duration=100 * scenario.dt))
    control = setup.driver()
    assert isinstance(control, Tracker)
    motion = drive(setup, control)
    assert motion.status == ""
    assert len(motion.t) == 101
    assert np.all(np.isfinite(motion.theta_hat))
    assert np.all(motion.theta_hat[:, setup.system.space.actuators] > 0)
    assert np.linalg.norm(motion.error[0]) < 1e-9
    assert np.linalg.norm(motion.error, axis=1).max() < 0.1  # [m, rad]


def test_adaptation_of_the_gains_beats_gains_taken_as_known():
    scenario = Scenario(
        plant=config_of("ur5"),
        excitation=AdaptiveTracking(fundamental=0.2, harmonics=8, speed=2.5),
        identifier=NullspaceAID(K=20.0, gain=0.3, law="memory"),
        initial_error=0.4,
        gain_error=0.4,
        duration=3.0,
    )
    rms = {
        c.law: float(c.figures["rms_rad"])
        for c in courses(plan_of("track_ur5", scenario, seeds=(3,)))
    }
    assert rms["nullspace"] < 0.7 * rms["conventional"] < 0.1 * rms["computed_torque"]
    assert rms["composite"] < 0.01 * rms["conventional"]
