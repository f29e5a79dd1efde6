"""The verdict in a run's first line, on short runs of every outcome."""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nsaid_mj import Mismatch
from nsaid_mj.lab.evaluation.figures import residual_floor
from nsaid_mj.lab.evaluation.run_evaluation import evaluate
from nsaid_mj.lab.evaluation.run_result import RunResult, verdict_of
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.setup import Setup

NEED_A_TRUTH = (
    "theta_perp_ratio",
    "theta_perp_ratio_initial",
    "actuator_ratio_error",
    "plant_direction_error",
)


@cache
def result(name: str, law: str, duration: float, delay: float = 0.0, **more: float) -> RunResult:
    scenario = load(name)
    scenario = replace(
        scenario,
        identifier=replace(scenario.identifier, law=law, **more),
        plant=replace(scenario.plant, mismatch=Mismatch(delay=delay)) if delay else scenario.plant,
        duration=duration,
        held_out=2.0,
    )
    with tempfile.TemporaryDirectory() as folder:
        done = run(scenario, Path(folder))
        return evaluate(done, Truth.of(done))


def without_truth(found: RunResult, **accuracy: Any) -> RunResult:
    unknown = dict.fromkeys(NEED_A_TRUTH) | accuracy
    return replace(found, accuracy=replace(found.accuracy, **unknown))


def with_misfit(found: RunResult, **changes: Any) -> RunResult:
    assert found.misfit is not None
    return replace(found, misfit=found.misfit._replace(**changes))


def test_a_memory_converges_in_seconds():
    found = result("scalar_rov", "memory", 10.0)
    assert found.verdict.startswith("converged: ") and found.explains == "yes"
    assert found.summary()["theta_perp_ratio"] < 1e-6
    assert "from the true set" in found.verdict


def test_the_verdict_on_a_slow_law_recommends_the_efficient_law():
    found = result("ur5", "paper", 10.0)
    assert found.verdict.startswith("still converging: ") and found.explains == "partly"
    assert "--law efficient does in seconds what this law does in hours" in found.verdict


def test_the_verdict_on_a_short_memory_run_recommends_no_law():
    found = result("ur5", "memory", 0.1)
    assert "converging: " in found.verdict and "--law" not in found.verdict


def test_an_unmodelled_delay_contradicts_the_structure():
    found = result("ur5", "memory", 6.0, delay=0.01)
    assert found.verdict.startswith("the motion contradicts this structure: ")
    assert found.explains == "no"
    numbers = found.summary()
    assert 0.01 < numbers["force_residual_floor"] <= numbers["force_residual_ratio"]
    assert numbers["misfit"] == "contradicts"  # from the measurements alone
    assert numbers["misfit_widening"] > 3 and numbers["confidence"]["covered"] >= 0.8
    assert numbers["confidence"]["forces_covered"] >= 0.9  # where no θ is true
    without_floor = replace(found.theory, force_residual_floor=None)
    blind = verdict_of(replace(without_truth(found), theory=without_floor))
    assert blind == (found.explains, found.verdict)


def test_without_the_delay_the_same_run_converges():
    found = result("ur5", "memory", 6.0)
    numbers = found.summary()
    assert found.verdict.startswith("converged: ") and numbers["misfit"] == "none"
    assert numbers["confidence"]["below_noise"] < numbers["confidence"]["directions"]
    assert numbers["confidence"]["forces_covered"] >= 0.9


def test_what_the_structure_leaves_over_is_told_with_the_widening_of_the_intervals():
    found = result("ur5", "memory", 6.0)
    _, said = verdict_of(with_misfit(found, level="some", widening=3.21))
    assert found.verdict in said and "3.2 times wider" in said


def test_an_adaptation_that_is_too_fast_ends_early():
    found = result("scalar_rov", "paper", 10.0, gain=1e6)
    assert found.verdict.startswith(f"ended early: {found.ending.status} at t = ")
    assert found.explains == "no"


def test_moving_away_from_the_true_set_is_not_converging():
    found = result("ur5", "paper", 10.0)
    farther = 1.1 * found.summary()["theta_perp_ratio_initial"]
    away = replace(found, accuracy=replace(found.accuracy, theta_perp_ratio=farther))
    explains, said = verdict_of(away)
    assert said.startswith("not converging: ") and explains == "no"


@pytest.mark.parametrize(
    "case", [("scalar_rov", "memory", 10.0), ("ur5", "memory", 6.0), ("ur5", "paper", 10.0)]
)
def test_without_a_truth_the_verdict_is_the_same(case):
    found = result(*case)
    explains, blind = verdict_of(without_truth(found))
    assert blind.partition(":")[0] == found.verdict.partition(":")[0]
    assert explains == found.explains
    assert "true set" not in blind


def test_a_residual_that_is_noise_is_told_as_noise_and_does_not_judge():
    found = without_truth(result("ur5", "memory", 6.0), force_residual_ratio=0.26)
    assert found.misfit is not None and found.misfit.level == "none"
    _, told = verdict_of(found)
    assert told.startswith("converged: ")
    assert told.endswith("force residual 26 % by noise of the measured accelerations")
    _, other = verdict_of(with_misfit(found, level="some", widening=2.0))
    assert other.startswith("still converging: ") and "noise" not in other


def test_no_theta_has_a_smaller_residual_than_the_floor():
    system = Setup.of(load("bluerov2")).system
    rng = np.random.default_rng(0)
    W = rng.standard_normal((40, system.n, system.p)) / system.space.scale
    floor, k = residual_floor(system, W), system.space.actuators

    def ratio(theta):
        return np.linalg.norm(W @ theta) / np.linalg.norm(W[..., k] @ theta[k])

    others = [ratio(rng.standard_normal(system.p) * system.space.scale) for _ in range(300)]
    assert floor is not None and 0 < floor <= min(others)
    rows, columns = W.reshape(-1, system.p) * system.space.scale, np.zeros(system.p, dtype=bool)
    columns[k] = True
    G, G_k = rows.T @ rows, np.diag(columns) @ rows.T @ rows @ np.diag(columns)
    best = np.linalg.eigvals(np.linalg.solve(G, G_k)).real.max()  # of ‖force‖²/‖residual‖²
    assert floor == pytest.approx(best**-0.5)


def test_a_motion_under_a_true_theta_leaves_no_floor():
    plant = Setup.of(load("scalar_rov")).plant
    system, rng = plant.system, np.random.default_rng(0)
    states = [system.random_state(rng) for _ in range(50)]
    q, v, u = (np.array(part) for part in zip(*states, strict=True))
    _, W = system.evaluate(np.zeros(50), np.hstack([q, v]), v, u, plant.truth)
    assert residual_floor(system, W) == pytest.approx(0.0, abs=1e-7)
    assert residual_floor(system, None) is None
