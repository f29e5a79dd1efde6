"""Actuator faults act in MuJoCo and in the truth alike, and every figure accounts for them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.cli.commands import command
from nsaid_mj.cli.grammar import RunOptions
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.evaluation.figures import held_out_rows, residual_ratio
from nsaid_mj.lab.evaluation.lyapunov import energy
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import SimulatedRun, run
from nsaid_mj.lab.options import parse_flags
from nsaid_mj.lab.plants.jointed import ArmPlant, FloatingBasePlant
from nsaid_mj.lab.plants.scalar_rov import ScalarRovPlant
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant, BMW320iPlant
from nsaid_mj.lab.plants.world.config import PlantConfig
from nsaid_mj.lab.plants.world.faults.kinds import Fault, Loss, gains_of
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.report import ExitCode
from tests.support.plants import name_of, path, random_commands, start_of
from tests.support.summaries import summarize
from tests.support.vehicles import INEXACT, VEHICLES, acceleration, draw_numbers

EXACT = [
    ScalarRovPlant(),
    ArmPlant("double_pendulum"),
    ArmPlant("kinova"),
    FloatingBasePlant("bolt"),
    *VEHICLES.values(),
]
exact_plants = pytest.mark.parametrize("config", EXACT, ids=name_of)
every_plant = pytest.mark.parametrize("config", [*EXACT, *INEXACT.values()], ids=name_of)
DT = 2e-3
STEP = 20  # at which the actuator weakens


def made(config: PlantConfig, *faults: Fault, dt: float = DT) -> Plant:
    return replace(config, faults=faults).build(dt, 4)


def actuators(p: Plant) -> Iterator[int]:
    """Those that have a gain in θ, counted from 1."""
    for k in range(1, p.system.n_u + 1):
        try:
            gains_of(p.system, k)
        except InvalidInput:
            continue
        yield k


# -- the plant ---------------------------------------------------------------------------------


@exact_plants
def test_mujoco_accelerates_as_the_structure_does_under_the_changed_truth(config):
    """Two engines against each other, for every actuator there is."""
    sound, rng = made(config), np.random.default_rng(5)
    which = list(actuators(sound))
    gains = [i for k in which for i in gains_of(sound.system, k)]
    assert sorted(gains) == sorted(sound.system.space.actuators)  # each of them has its actuator
    for k in which:
        p = sound.failing([Loss(0.4, actuator=k, time=1.0)])
        own = gains_of(p.system, k)
        before, after = p.truth_at([0.0, 1.0])
        assert (before == sound.truth).all()
        assert (after[own] == 0.6 * before[own]).all()
        assert np.count_nonzero(after != before) == len(own)
        _, v, u = p.system.random_state(rng)
        u[k - 1] = p.system.random_state(np.random.default_rng(0))[2][k - 1]  # not 0
        numbers = draw_numbers(p.system, rng)
        x = np.concatenate([p.position(numbers), v])
        found = [acceleration(p, numbers, v, u, as_at) for as_at in (0.0, 1.0)]
        expected = [p.system.acceleration(0.0, x, v, u, theta) for theta in (before, after)]
        near = {"rtol": 1e-9, "atol": 1e-9 * np.abs(expected[0]).max()}
        np.testing.assert_allclose(found[0], expected[0], **near)
        np.testing.assert_allclose(found[1], expected[1], **near)
        assert np.abs(found[1] - found[0]).max() > 1e-6 * np.abs(found[0]).max()


@every_plant
def test_before_the_fault_the_motion_is_the_sound_plants_to_the_bit(config):
    sound = made(config)
    u, at = random_commands(sound), start_of(sound)
    expected = path(sound, u, *at)
    for k in list(actuators(sound))[:: max(1, sound.system.n_u - 1)]:
        p = made(config, Loss(0.4, actuator=k, time=STEP * DT))
        found = path(p, u, *at)
        assert (found[: STEP + 1] == expected[: STEP + 1]).all()
        assert (found[STEP + 1 :] != expected[STEP + 1 :]).any(axis=1).all()
        assert (path(p, u, *at) == found).all()  # a reset mends it
        for faults in ([Loss(0.4, actuator=k, time=1e3)], []):  # later, and none
            assert (path(p.failing(faults), u, *at) == expected).all()


@exact_plants
def test_a_fault_strikes_at_the_step_nearest_to_its_time(config):
    dt = 1e-5
    sound = made(config, dt=dt)
    k, (numbers, v), u = next(actuators(sound)), start_of(sound), random_commands(sound)[0]
    for time in (2.6 * dt, 3.4 * dt):
        p = made(config, Loss(0.5, actuator=k, time=time), dt=dt)
        rows = path(p, np.tile(u, (6, 1)), numbers, v)
        rate = np.diff(rows[:, p.system.n :], axis=0) / dt
        t = dt * np.arange(6)
        assert p.epoch(t).tolist() == [0] * 3 + [1] * 3
        q = p.position(rows[:-1, : p.system.n])
        for theta, other, row in zip(p.truth_at(t), p.truth_at(t[::-1]), range(6), strict=True):
            x, w = np.concatenate([q[row], rows[row, p.system.n :]]), rows[row, p.system.n :]
            right, wrong = (p.system.acceleration(0.0, x, w, u, th) for th in (theta, other))
            assert np.abs(rate[row] - right).max() < 0.1 * np.abs(wrong - right).max()


def test_a_fault_leaves_lag_and_delay_acting():
    config = BlueROV2Plant(mismatch=Mismatch(lag=0.05, delay=5 * DT))
    sound, p = made(config), made(config, Loss(0.4, actuator=3, time=STEP * DT))
    u, at = random_commands(sound), start_of(sound)
    one, other = path(sound, u, *at), path(p, u, *at)
    assert (one[: STEP + 1] == other[: STEP + 1]).all()
    assert (one[STEP + 1 :] != other[STEP + 1 :]).any(axis=1).all()
    assert p.mismatches == sound.mismatches and len(p.mismatches) == 2  # a fault is none


def test_a_rotor_fault_weakens_thrust_and_torque_and_is_reported():
    p = made(VEHICLES["hummingbird"], Loss(0.4, actuator=3, time=60.0))
    assert p.faults[0].in_words(p.system) == "thrust_3 and torque_3 lose 40 % at 60 s"
    p = made(BlueROV2Plant(), Loss(0.125, actuator=3, time=2.5))
    assert p.faults[0].in_words(p.system) == "thrust_3 loses 12.5 % at 2.5 s"


@pytest.mark.parametrize(
    ("config", "actuator"),
    [
        (BlueROV2Plant(), 9),
        (ArmPlant("double_pendulum"), 3),
        (ScalarRovPlant(), 2),
        (BMW320iPlant(), 2),
        (INEXACT["rover"], 2),
        (VEHICLES["uvms"], 13),
    ],
)
def test_an_actuator_that_is_not_there_or_has_no_gain_is_refused(config, actuator):
    with pytest.raises(InvalidInput) as caught:
        made(config, Loss(0.4, actuator=actuator))
    assert caught.value.name == "faults.actuator" and "1" in caught.value.expected
    made(config, Loss(0.4, actuator=1))


# -- a run -------------------------------------------------------------------------------------

BASE = replace(
    load("bluerov2"),
    identifier=NullspaceAID(K=6.0, gain=0.6),
    duration=24.0,
    pe_window=4.0,
    held_out=5.0,
)
FAULT = Loss(0.4, actuator=3, time=12.0)


@pytest.fixture(scope="module")
def failed(tmp_path_factory) -> SimulatedRun:
    return run(
        replace(BASE, plant=BlueROV2Plant(faults=(FAULT,))), tmp_path_factory.mktemp("failed")
    )


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> SimulatedRun:
    return run(BASE, tmp_path_factory.mktemp("sound"))


def test_before_the_fault_the_record_is_the_sound_runs(failed: SimulatedRun, sound: SimulatedRun):
    assert (failed.prior == sound.prior).all()
    strike = 1 + round(FAULT.time / BASE.dt)
    for column in ("q", "v", "u", "v_hat", "theta_hat"):
        one, other = failed.record[column], sound.record[column]
        assert (one[:strike] == other[:strike]).all(), column
    assert (failed.record["v"][strike:] != sound.record["v"][strike:]).any(axis=1).all()


def test_the_estimate_is_judged_against_the_truth_at_the_end(
    failed: SimulatedRun, sound: SimulatedRun
):
    summary, plain = summarize(failed, Truth.of(failed)), summarize(sound, Truth.of(sound))
    assert summary["fault"] == "thrust_3 loses 40 % at 12 s" and summary["mismatch"] == []
    assert plain["fault"] == ""
    after = Truth.of(failed).theta
    assert (after == failed.plant.truth_at(24.0)).all() and (after != failed.plant.truth).any()
    assert [row["true"] for row in summary["parameters"]] == after.tolist()
    initial = plain["theta_perp_ratio_initial"]  # of the same prior, rounded along another path
    assert summary["theta_perp_ratio_initial"] == pytest.approx(initial, rel=1e-12)
    k = failed.plant.system.space.actuators
    ratio = failed.record["theta_hat"][-1][k] / after[k]
    error = np.abs(ratio / ratio.mean() - 1).max()
    assert summary["actuator_ratio_error"] == pytest.approx(error, rel=1e-12)
    assert (summary["r"], summary["r_excited"]) == (1, 1)
    one, other = (s["excited_error_rms_initial"] for s in (summary, plain))
    assert one == pytest.approx(other, rel=1e-9)  # under the truth of its time
    assert summary["pe_level_perp"] > 0.1 * plain["pe_level_perp"] > 0


def test_the_held_out_trajectory_has_the_fault_from_its_start(failed: SimulatedRun):
    later, system = Truth.of(failed).held_out, failed.plant.system
    weak, sound = (
        residual_ratio(system, held_out_rows(system, later, None), theta)
        for theta in (Truth.of(failed).theta, failed.plant.truth)
    )
    assert weak is not None and sound is not None
    assert weak < 1e-3  # v̇ is a difference here
    assert sound > 0.05


def test_a_jump_of_v_at_the_fault_is_no_violation(failed: SimulatedRun):
    V, t = energy(failed, Truth.of(failed)), failed.record["t"]
    assert (np.flatnonzero(np.diff(V) > 0) == [np.searchsorted(t, 12.0 - 1e-9) - 1]).all()
    assert summarize(failed, Truth.of(failed))["lyapunov_violations"] == 0
    far = Truth.of(failed).distance(t, failed.record["theta_hat"])
    strike = np.searchsorted(t, 12.0 - 1e-9)
    assert far[strike] > 1.2 * far[strike - 1] and far[-1] < far[strike]


@pytest.mark.parametrize(
    "law,seed",
    [
        ("paper", 0),
        *(pytest.param("paper", k, marks=pytest.mark.slow) for k in (1, 2)),
        pytest.param("cone", 0, marks=pytest.mark.slow),
    ],
)
def test_a_gain_lost_in_mid_run_is_followed_and_the_others_come_back(law, seed, tmp_path):
    """To 5 % within 30 s, and the others to 3 %: shares, as no scale is known.

    In between these laws put a part of the loss on the others: seen, up to 13 %.
    """
    base = load("bluerov2")
    lost = BlueROV2Plant(faults=(Loss(0.4, actuator=3, time=60.0),))
    identifier = replace(base.identifier, law=law)
    done = run(replace(base, plant=lost, identifier=identifier, duration=90.0, seed=seed), tmp_path)
    k, since = done.plant.system.space.actuators, done.plant.epoch(done.record["t"]) > 0
    ratio = done.record["theta_hat"][since][:, k] / Truth.of(done).theta[k]
    own, others = ratio[:, 2], np.delete(ratio, 2, axis=1)
    own, others = (part / others.mean(axis=1, keepdims=True) for part in (own[:, None], others))
    assert own[0] > 1.6  # the estimate has not seen it yet
    assert abs(own[-1] - 1) <= 0.05
    assert np.abs(others[-1] - 1).max() <= 0.03
    assert np.abs(others - 1).max() <= 0.25


def test_recording_report_and_rebuild_include_the_fault(failed: SimulatedRun):
    summary = postprocessing.finish(failed).summary()
    assert "thrust_3 loses 40\N{NO-BREAK SPACE}% at 12 s" in (
        failed.folder / "report.html"
    ).read_text("utf-8")
    again = postprocessing.rebuild(failed.folder).summary()
    rounded = {"identifier_us_per_step", "plant_us_per_step"}  # times over steps, times steps
    assert {k: again[k] for k in again.keys() - rounded} == {
        k: summary[k] for k in summary.keys() - rounded
    }


def test_a_run_that_ends_before_the_fault_is_judged_as_sound(tmp_path):
    early = replace(BASE, duration=4.0, plant=BlueROV2Plant(faults=(FAULT,)))
    done = run(early, tmp_path)
    assert (Truth.of(done).theta == done.plant.truth).all()
    later = Truth.of(done).held_out
    rows = held_out_rows(done.plant.system, later, None)
    residual = residual_ratio(done.plant.system, rows, done.plant.truth)
    assert residual is not None and residual < 1e-3


# -- as data -----------------------------------------------------------------------------------


def test_a_fault_survives_json_and_changes_the_hash():
    scenario = Scenario(plant=BlueROV2Plant(faults=(FAULT,)))
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario and again.hash == scenario.hash
    assert scenario.hash != Scenario(plant=BlueROV2Plant()).hash
    tree = json.loads(scenario.to_json())
    tree["plant"]["faults"][0]["share"] = 1.0
    with pytest.raises(InvalidInput, match=r"faults\.0\.share"):
        Scenario.from_json(json.dumps(tree))
    del tree["plant"]["faults"]  # of an older version
    assert Scenario.from_json(json.dumps(tree)).plant == BlueROV2Plant()


@pytest.mark.parametrize("flag", ["--plant.faults", "--faults"])
def test_faults_are_a_flag(flag):
    words = [flag, "loss 0.4 of 3 at 12 s"]
    scenario, _ = parse_flags("bluerov2", load("bluerov2"), words, "run", RunOptions)
    assert scenario.plant.faults == (FAULT,)
    assert replace(scenario, plant=BlueROV2Plant()) == load("bluerov2")
    assert parse_flags("bluerov2", scenario, [], "run", RunOptions)[0] == scenario


def test_a_fault_from_the_command_line(tmp_path: Path, capsys):
    words = "--duration 2 --held-out 1 --pe-window 0.5 --out"
    fault = ["--faults", "loss 0.4 of 3 at 1 s"]
    code = command(["run", "bluerov2", *fault, *words.split(), str(tmp_path / "out")])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert code == ExitCode.of(result_from(summary))
    assert "fault in the plant: thrust_3 loses 40 % at 1 s" in capsys.readouterr().out
    with pytest.raises(InvalidInput, match=r"faults\.actuator"):
        command(["run", "bluerov2", "--faults", "loss 0.4 of 9", "--out", f"{tmp_path}/no"])
    assert not (tmp_path / "no").exists()
