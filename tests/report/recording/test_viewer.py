"""The viewer: its command, and a run streamed into it, which it cannot end."""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from nsaid_mj.base.errors import BadRun, InvalidInput
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.log import Measurement
from nsaid_mj.lab.loop import RobotDescription, run
from nsaid_mj.lab.recording import forces, live, viewer
from nsaid_mj.lab.recording.live import LiveRecording
from nsaid_mj.report.recording import scene
from tests.support.faulty import WITH_RIVAL as ROV
from tests.support.recordings import VEHICLE, column, drawn_rows, entities_of


@pytest.mark.parametrize(("speed", "waits"), [(10.0, [0.05, 0.05]), (0.0, [])])
def test_a_live_run_waits_until_its_time_is_due(
    speed: float, waits: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    now, slept = [100.0], []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        now[0] += seconds

    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(time, "sleep", sleep)
    observer = LiveRecording("x", speed)
    for t in (0.0, 0.5, 1.0):
        observer._wait(t)
    assert slept == pytest.approx(waits)


@pytest.mark.parametrize("speed", [-1.0, np.inf, np.nan])
def test_a_live_speed_that_is_none_is_told(speed: float) -> None:
    with pytest.raises(InvalidInput, match="live_speed"):
        LiveRecording("x", speed)


def no_connection(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    """Sends live data to a file; without a sink, Rerun would warn of them in a later test."""
    file = folder / "live.rrd"
    monkeypatch.setattr(LiveRecording, "_serve", lambda self: "")
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda rec, *_, **__: rec.save(file))


@pytest.mark.usefixtures("no_display")
def test_live_without_a_display_serves_this_machine_and_ends_its_server(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    started: list[list[str]] = []
    servers: list[subprocess.Popen[bytes]] = []

    def launch(flags: list[str], **rest: bool) -> subprocess.Popen[bytes]:
        started.append(flags)
        servers.append(real(flags, **rest))
        return servers[-1]

    real = live._launch
    monkeypatch.setattr(live, "_launch", launch)
    result = run(ROV, tmp_path, LiveRecording("rov"))
    assert result.ending.status is Status.completed
    assert "http://127.0.0.1:" in capfd.readouterr().err
    assert started[0][:3] == ["--serve-web", "--bind", "127.0.0.1"]
    assert servers[0].poll() is not None


@pytest.mark.usefixtures("no_display")
@pytest.mark.parametrize("where", ["start", "see"])
def test_a_failing_viewer_does_not_end_the_run(
    where: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(live, "program", lambda: [sys.executable, "-c", "raise SystemExit(3)"])
    if where == "see":
        no_connection(monkeypatch, tmp_path)
        monkeypatch.setattr(LiveRecording, "_see", lambda *_: 1 / 0)
    result = run(ROV, tmp_path, LiveRecording("rov"))
    assert result.ending.status is Status.completed
    told = [x for x in capfd.readouterr().err.splitlines() if x.startswith("nsaid:")]
    assert len(told) == 1 and "continuing without the viewer" in told[0]


@pytest.mark.usefixtures("no_display")
def test_live_sees_no_true_value(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    no_connection(monkeypatch, tmp_path)
    plant = ROV.plant.build(ROV.dt, 0)
    monkeypatch.setattr(type(plant), "truth", property(lambda self: 1 / 0))
    observer = LiveRecording("rov")
    first = Measurement(0.0, *plant.system.random_state(np.random.default_rng(0)))
    observer._start(RobotDescription(plant.system, plant.system.space.scale, plant), first)
    observer._rec = None
    observer.stop()


@pytest.mark.usefixtures("no_display")
def test_live_shows_a_vehicle_its_path_and_the_estimated_forces(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    no_connection(monkeypatch, tmp_path)
    monkeypatch.setattr(live, "_PERIOD", 0.0)
    monkeypatch.setattr(live, "_SHARE", 0)
    result = run(VEHICLE, tmp_path / "run", LiveRecording("vehicle"))
    entities = entities_of(tmp_path / "live.rrd")
    rows = drawn_rows(result, entities, forces.ESTIMATED)
    assert len(rows) > 20 and f"/{forces.COMMANDED}" not in entities
    assert column(entities, forces.ESTIMATED, "Arrows3D:vectors").shape == (len(rows), 8, 3)
    steps = column(entities, scene.TRAIL, "LineStrips3D:strips")[:, 0]
    places = result.record["q"][rows, :3]
    np.testing.assert_allclose(steps, np.stack([places[:-1], places[1:]], axis=1), atol=1e-6)


# -- viewer --------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_display")
def test_without_a_display_the_viewer_needs_web() -> None:
    with pytest.raises(BadRun, match="--web"):
        viewer.viewer_command(Path("run.rrd"), web=False)
    command = viewer.viewer_command(Path("run.rrd"), web=True)
    assert "--serve-web" in command
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_with_a_display_the_viewer_opens_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    command = viewer.viewer_command(Path("run.rrd"), web=False)
    assert "--serve-web" not in command
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert Path(command[0]).is_file() and os.access(command[0], os.X_OK)
    assert Path(command[0]).parent.name != "bin"  # the program itself, not the console script
