"""A run that cannot continue ends with its own status and a readable record."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import re
import signal
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import ConventionalAID, NullspaceAID, Scenario
from nsaid_mj.core.laws.base import Status
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.control import multisine, series
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.lab.loop import Observer, run
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.record import BATCH_SECONDS, Record
from nsaid_mj.report import ExitCode
from tests.support.faulty import FILES, PENDULUM, ROV, Heard, heard, script, strict
from tests.support.recordings import entities_of

Patch = Callable[[pytest.MonkeyPatch], None]


@dataclass(frozen=True)
class Fault:
    """What goes wrong, and how the run must end.

    Attributes:
        scenario: what is run.
        status: how it must end.
        patch: what breaks on the way.
        time: when it must end [s]; None: some time before it would have.
        signal: what must have shown it.
        code: what the command must exit with.
    """

    scenario: Scenario
    status: Status
    patch: Patch = lambda patch: None
    time: float | None = None
    signal: str = ""
    code: int = 1


def asked_at_every_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drivers and sensors are called from Python at every sample, not from compiled code."""
    for driver in (SINE, TORQUE):
        monkeypatch.setattr(driver, "compiled", lambda self, t: None)


def commanded(driver: type, when: float, command: Callable[[], float]) -> Patch:
    """A driver that from `when` on commands something else."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        real = driver.command

        def broken(self, t, q, v):
            u = real(self, t, q, v)
            return np.full_like(u, command()) if t > when - 1e-9 else u

        monkeypatch.setattr(driver, "command", broken)
        asked_at_every_step(monkeypatch)

    return patch


def ctrl_c() -> float:
    raise KeyboardInterrupt


def sensed(signal: str, sample: int, value: float) -> Patch:
    """A sensor that says `value` at one sample."""

    def patch(monkeypatch: pytest.MonkeyPatch) -> None:
        real, count = SensorNoise.corrupt, iter(range(10**9))

        def broken(self, q, v, rng):
            q, v = real(self, q, v, rng)
            if next(count) == sample:
                (q if signal == "q" else v)[-1] = value
            return q, v

        monkeypatch.setattr(SensorNoise, "corrupt", broken)
        asked_at_every_step(monkeypatch)

    return patch


def gained(gain: float) -> Scenario:
    return replace(ROV, identifier=NullspaceAID(K=10.0, gain=gain))


BLIND_ROV, BLIND_ARM = replace(ROV, sensors="noisy"), replace(PENDULUM, sensors="noisy")
SINE, TORQUE = multisine._MultisineDriver, series.ComputedTorque

FAULTS = {
    "vehicle diverges": Fault(
        ROV, Status.plant_diverged, commanded(SINE, 1.0, lambda: 5e9), 1.01, "qacc"
    ),
    "arm diverges": Fault(
        PENDULUM, Status.plant_diverged, commanded(TORQUE, 0.3, lambda: -5e9), 0.301, "qacc"
    ),
    "command beyond what MuJoCo takes": Fault(
        ROV, Status.plant_diverged, commanded(SINE, 1.0, lambda: 1e12), 1.01, "ctrl"
    ),
    "gain too large": Fault(gained(300.0), Status.estimate_not_positive_definite, signal="pivot -"),
    "prior too wrong": Fault(
        replace(PENDULUM, initial_error=3.0, identifier=NullspaceAID(K=20.0, gain=30.0)),
        Status.estimate_not_positive_definite,
        signal="pivot -",
    ),
    "adaptation too fast": Fault(gained(1000.0), Status.adaptation_too_fast, signal="theta_hat"),
    "position NaN": Fault(
        BLIND_ROV, Status.measurement_not_finite, sensed("q", 120, math.nan), 1.2, "q"
    ),
    "velocity infinite": Fault(
        BLIND_ROV, Status.measurement_not_finite, sensed("v", 120, -math.inf), 1.2, "v"
    ),
    "arm's position NaN": Fault(
        BLIND_ARM, Status.measurement_not_finite, sensed("q", 250, math.nan), 0.25, "q"
    ),
    "arm's velocity NaN": Fault(
        BLIND_ARM, Status.measurement_not_finite, sensed("v", 250, math.nan), 0.25, "v"
    ),
    "command NaN": Fault(
        ROV, Status.command_not_finite, commanded(SINE, 1.0, lambda: math.nan), 1.0, "u"
    ),
    "Ctrl-C": Fault(ROV, Status.interrupted, commanded(SINE, 1.5, ctrl_c), code=130),
}
AT_ONCE = {
    "lost in the first step": Fault(
        gained(1e8), Status.estimate_not_positive_definite, time=0.01, signal="pivot -"
    ),
    "diverges in the first step": Fault(
        ROV, Status.plant_diverged, commanded(SINE, 0.0, lambda: 5e9), 0.01, "qacc"
    ),
    "NaN at first": Fault(
        BLIND_ROV, Status.measurement_not_finite, sensed("q", 0, math.nan), 0.0, "q"
    ),
    "Ctrl-C at first": Fault(ROV, Status.interrupted, commanded(SINE, 0.0, ctrl_c), 0.0, code=130),
}


@dataclass(frozen=True)
class Ended:
    """A fault that has been run by its script, with --json."""

    fault: Fault
    folder: Path
    desk: Path
    code: int
    said: Heard

    @property
    def summary(self) -> dict:
        return strict((self.folder / postprocessing.SUMMARY).read_text(encoding="utf-8"))


@pytest.fixture(scope="module", autouse=True)
def few_objects() -> Iterator[None]:
    """What earlier tests keep is not collected again and again: .2 s each time."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def provoke(fault: Fault, desk: Path) -> Ended:
    folder, before = desk / "out", Path.cwd()
    gc.collect()  # what earlier tests of this process left would warn here
    os.chdir(desk)
    try:
        with pytest.MonkeyPatch.context() as patch:
            fault.patch(patch)
            code, said = script(fault.scenario, "--out", folder, "--json")
    finally:
        os.chdir(before)
    return Ended(fault, folder, desk, code, said)


@pytest.fixture(scope="module", params=FAULTS)
def ended(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Ended:
    return provoke(FAULTS[request.param], tmp_path_factory.mktemp("fault"))


def assert_reported(ended: Ended) -> None:
    fault, summary = ended.fault, ended.summary
    assert ended.code == fault.code
    assert summary["status"] == fault.status.words
    assert summary["status_remedy"] == fault.status.remedy != ""
    assert summary["status_signal"].startswith(fault.signal)
    assert bool(summary["status_signal"]) == bool(fault.signal)
    if fault.time is not None:
        assert summary["status_time"] == pytest.approx(fault.time, abs=1e-9)


def assert_quiet(ended: Ended) -> None:
    assert ended.said.err == ""
    assert ended.said.warned == []
    assert not (ended.desk / "MUJOCO_LOG.TXT").exists()
    assert [path.name for path in ended.desk.iterdir()] == ["out"]


def test_a_faulty_run_ends_with_its_status_time_and_signal(ended: Ended) -> None:
    assert_reported(ended)
    dt, time = ended.fault.scenario.dt, ended.summary["status_time"]
    assert dt < time < ended.fault.scenario.duration
    assert time / dt == pytest.approx(round(time / dt), abs=1e-6)


def test_the_record_of_a_faulty_run_is_complete_up_to_its_end(ended: Ended) -> None:
    record, scenario = Record.read(ended.folder), ended.fault.scenario
    last = ended.summary["status_time"]
    if ended.fault.status not in (Status.adaptation_too_fast, Status.interrupted):  # a bad row
        last -= scenario.dt
    assert record.complete
    assert record["t"] == pytest.approx(scenario.dt * np.arange(round(last / scenario.dt) + 1))
    assert all(np.isfinite(values).all() for values in record.columns.values())
    assert ended.summary["sim_s"] == record["t"][-1]


def test_json_output_is_the_summary_of_the_faulty_run(ended: Ended) -> None:
    assert strict(ended.said.out) == ended.summary


def test_a_faulty_run_prints_nothing_else_and_leaves_no_mujoco_log(ended: Ended) -> None:
    assert_quiet(ended)


def test_a_faulty_run_writes_all_its_files(ended: Ended) -> None:
    assert sorted(path.name for path in ended.folder.iterdir()) == sorted(FILES)
    stored = Scenario.from_json(
        (ended.folder / postprocessing.SCENARIO).read_text(encoding="utf-8")
    )
    assert stored.hash == ended.fault.scenario.hash == ended.summary["scenario_hash"]
    page = (ended.folder / "report.html").read_text(encoding="utf-8")
    text = re.sub(r"<[^>]*>", "", page)
    assert ended.fault.status.words in text and ended.fault.status.remedy in text
    entities = entities_of(ended.folder / "run.rrd").keys()
    assert "/result" in entities and "/velocity_error" in {"/" + e.split("/")[1] for e in entities}


def test_a_rebuilt_faulty_run_keeps_its_status(ended: Ended, capfd: object) -> None:
    before = ended.summary
    with pytest.MonkeyPatch.context() as patch:
        ended.fault.patch(patch)
        if ended.fault.status is Status.interrupted:
            patch.undo()  # it would interrupt the held-out trajectory too
        patch.setattr("nsaid_mj.report.drawings.draw", lambda panel: "<svg></svg>")  # as before
        after = postprocessing.rebuild(ended.folder).summary()
    keys = (
        "status",
        "status_time",
        "status_signal",
        "status_remedy",
        "sim_s",
        "wall_s",
        "rivals",
        "theta_perp_ratio",
        "scenario_hash",
    )
    assert {key: after[key] for key in keys} == {key: before[key] for key in keys}


@pytest.mark.parametrize("which", AT_ONCE)
def test_a_run_that_ends_at_once_is_reported(which: str, tmp_path: Path) -> None:
    ended = provoke(AT_ONCE[which], tmp_path)
    assert_reported(ended)
    assert_quiet(ended)
    record = Record.read(ended.folder)
    assert record.complete and len(record) == round(ended.summary["status_time"] / ROV.dt)
    assert strict(ended.said.out) == ended.summary


def test_the_terminal_says_when_and_why_a_run_ended_and_the_remedy(tmp_path: Path) -> None:
    code, said = script(gained(300.0), "--out", tmp_path / "out")
    text = " ".join(said.out.split())
    status = Status.estimate_not_positive_definite
    assert code == 1
    assert status.words in text and status.remedy in text
    assert ": ended early: " in text and " at t = " in text and "(pivot -" in text


def test_too_fast_an_adaptation_is_reported_even_at_the_last_step(tmp_path: Path) -> None:
    scenario = replace(gained(1000.0), duration=0.45)
    result = run(scenario, tmp_path)
    assert result.ending.status is Status.adaptation_too_fast
    kept = result.identifiers[""].conserved(result.record["theta_hat"])
    assert np.abs(kept / kept[0] - 1).max() > 1e-3


def test_a_failing_rival_does_not_end_the_run(tmp_path: Path) -> None:
    rivals = {"fast": NullspaceAID(K=10.0, gain=300.0), "known": ConventionalAID(K=10.0, gain=1.0)}
    result = run(replace(ROV, rivals=rivals), tmp_path)
    summary = postprocessing.finish(result).summary()
    assert summary["status"] == "completed" and len(result.record) == ROV.steps + 1
    assert summary["rivals"]["fast"]["status"] == Status.estimate_not_positive_definite.words
    assert summary["rivals"]["known"]["status"] == "completed"
    still = result.record["theta_hat_fast"]
    assert np.array_equal(still[-1], still[-10]) and not np.array_equal(still[0], still[-1])


class CtrlC(Observer):
    """Somebody who watches until `when`, and then stops it."""

    period = 0.5

    def __init__(self, when: float):
        self.when, self.stopped = when, False

    def start(self, scenario, robot, first) -> None:
        pass

    def see(self, log, states, levels) -> None:
        if log.t[-1] > self.when - 1e-9:
            raise KeyboardInterrupt

    def stop(self) -> None:
        self.stopped = True


def test_ctrl_c_from_an_observer_ends_at_that_row(tmp_path: Path) -> None:
    watcher = CtrlC(1.5)
    result = run(ROV, tmp_path, watcher)
    assert watcher.stopped
    assert result.ending.status is Status.interrupted
    assert result.ending.time == result.record["t"][-1] == pytest.approx(1.5)
    assert len(result.record) == 151 and result.record.complete
    assert postprocessing.finish(result).ending.status == "interrupted"


def test_ctrl_c_in_the_middle_of_compiled_code_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception cannot pass through C: numba makes it a SystemError, ctypes drops it."""
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    callback = ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))
    real = SINE.command

    def command(self, t, q, v):
        if abs(t - 1.5) < 1e-9:
            callback()
        return real(self, t, q, v)

    monkeypatch.setattr(SINE, "command", command)
    asked_at_every_step(monkeypatch)
    try:
        with heard() as said, pytest.MonkeyPatch.context() as unraisable:
            unraisable.setattr("sys.unraisablehook", lambda *_: None)
            result = run(ROV, tmp_path)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, handler)
    assert result.ending.status is Status.interrupted
    assert result.ending.time == pytest.approx(result.record["t"][-1])
    assert 1.5 <= result.ending.time < 1.5 + BATCH_SECONDS  # the stretch it is in is finished
    assert said.err == ""


def test_no_ending_affects_the_next_run(tmp_path: Path) -> None:
    clean = run(PENDULUM, tmp_path / "first").record
    for which in ("arm diverges", "arm's velocity NaN"):
        with pytest.MonkeyPatch.context() as patch, heard():
            FAULTS[which].patch(patch)
            run(FAULTS[which].scenario, tmp_path / "broken", force=True)
    with pytest.raises(KeyboardInterrupt), pytest.MonkeyPatch.context() as patch:
        patch.setattr(TORQUE, "start", lambda self: ctrl_c())
        result = run(PENDULUM, tmp_path / "stopped")
        raise KeyboardInterrupt if result.ending.status is Status.interrupted else AssertionError
    run(PENDULUM, tmp_path / "second")
    first, second = ((tmp_path / x / "record.arrow").read_bytes() for x in ("first", "second"))
    assert first == second and len(clean) == PENDULUM.steps + 1


@pytest.mark.parametrize(
    "scenario",
    [
        replace(ROV, record_every=500),
        replace(ROV, pe_window=0.001),
        replace(ROV, held_out=0.001),
        replace(ROV, initial_error=0.0),
        replace(ROV, plant=replace(ROV.plant, spread=0.0)),
        replace(ROV, duration=0.02),
    ],
    ids=[
        "one row",
        "window of no row",
        "held out for a step",
        "prior exact",
        "as in the data sheet",
        "two steps",
    ],
)
def test_an_unusual_but_valid_scenario_completes_with_all_its_files(
    scenario: Scenario, tmp_path: Path
) -> None:
    code, said = script(scenario, "--out", tmp_path / "out", "--json")
    summary = strict(said.out)
    assert summary["status"] == "completed"
    assert code == ExitCode.of(result_from(summary)) and said.err == ""
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(FILES)
