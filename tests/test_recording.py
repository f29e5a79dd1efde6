"""Recordings: what is written is what was recorded, and no viewer can end a run."""

from __future__ import annotations

import functools
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from nsaid_mj import (
    ArmPlant,
    ConventionalAID,
    FourierTracking,
    MultisineCommand,
    NullspaceAID,
    ScalarRovPlant,
    Scenario,
    metrics,
    recording,
)
from nsaid_mj.errors import BadRun
from nsaid_mj.experiment import Run, run
from nsaid_mj.identifiers import Status
from nsaid_mj.recording import live, scene, viewer
from nsaid_mj.recording.file import spread
from nsaid_mj.recording.text import drawable

ARM = Scenario(
    plant=ArmPlant(robot="ur5", damping=2.0, friction=1.0, armature=0.1),
    excitation=FourierTracking(fundamental=0.1, harmonics=5),
    identifier=NullspaceAID(K=20.0, gain=1.0),
    duration=0.3,
    pe_window=0.1,
    held_out=0.1,
)
ROV = Scenario(
    plant=ScalarRovPlant(),
    excitation=MultisineCommand(low=0.05, high=0.5, tones=8, amplitude=0.8),
    identifier=NullspaceAID(K=5.0, gain=0.01),
    rivals={"conventional": ConventionalAID(K=5.0, gain=0.01)},
    duration=2.0,
    dt=0.01,
    pe_window=0.5,
    held_out=1.0,
)


def recorded(scenario: Scenario, folder: Path) -> Run:
    result = run(scenario, folder)
    recording.write(result, metrics.summarize(result))
    return result


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return recorded(ARM, tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def rov(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return recorded(ROV, tmp_path_factory.mktemp("rov"))


@functools.cache
def entities_of(file: Path) -> dict[str, dict[str, list]]:
    entities: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(file).stream():
        columns = entities.setdefault(str(chunk.entity_path), {})
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.startswith("Mesh3D:vertex_"):
                columns[name] = [None]  # large, and not looked into
                continue
            columns.setdefault(name, []).extend(batch.column(name).to_pylist())
    return entities


def read(result: Run) -> dict[str, dict[str, list]]:
    """Column name to values, by entity, over all of a recording's chunks."""
    return entities_of(result.folder / recording.FILE)


def seconds(time: object) -> float:
    return time.total_seconds() if hasattr(time, "total_seconds") else float(time) * 1e-9  # type: ignore


def test_an_arm_is_all_there(arm: Run) -> None:
    entities = read(arm)
    for name in ("velocity_error", "distance/NS-AID", "theta_perp", "share", "lyapunov",
                 "conserved", "excitation/all", "excitation/perpendicular", "result",
                 "estimate/motor_gain/estimated", "estimate/motor_gain/true_direction",
                 "estimate/link_6/estimated"):  # fmt: skip
        assert f"/{name}" in entities
    meshes = [
        e for e in entities if e.startswith("/robot/") and "Mesh3D:vertex_positions" in entities[e]
    ]
    assert len(meshes) == len(arm.plant.visuals()) > 0
    assert all("Transform3D:translation" in entities[mesh] for mesh in meshes)


@pytest.mark.parametrize("which", ["arm", "rov"])
def test_the_last_estimate_is_bit_exact_and_the_timeline_ends_with_the_run(
    which: str, request: pytest.FixtureRequest
) -> None:
    result: Run = request.getfixturevalue(which)
    entities, space = read(result), result.plant.system.space
    for block, place in space:
        name = "".join(c if c.isalnum() else "_" for c in block.name)
        columns = entities[f"/estimate/{name}/estimated"]
        values = [v for v in columns["Scalars:scalars"] if v]
        expected = result.record["theta_hat"][-1, place] / space.scale[place]
        assert values[-1] == expected.tolist()
        times = [seconds(time) for time in columns["sim_time"] if time is not None]
        assert times[-1] == pytest.approx(result.record["t"][-1], abs=1e-9)
        assert times[-1] == pytest.approx(result.scenario.duration, abs=1e-9)


def test_the_distance_is_the_summarys_and_rivals_have_theirs(rov: Run) -> None:
    entities, summary = read(rov), metrics.summarize(rov)
    for name, numbers in (("NS-AID", summary), ("conventional", summary["rivals"]["conventional"])):
        values = [v for v in entities[f"/distance/{name}"]["Scalars:scalars"] if v]
        assert values[0][0] == numbers["theta_perp_ratio_initial"]
        assert values[-1][0] == numbers["theta_perp_ratio"]
        assert f"/velocity_rms/{name}" in entities


def test_the_true_direction_is_the_projection_of_the_estimate(rov: Run) -> None:
    entities, space = read(rov), rov.plant.system.space
    estimate, truth = rov.record["theta_hat"][-1] / space.scale, rov.plant.truth / space.scale
    paths = [f"/estimate/{b.name.replace(' ', '_')}/true_direction" for b, _ in space]
    shown = np.array([entities[path]["Scalars:scalars"][-1] for path in paths]).ravel()
    assert shown @ (estimate - shown) == pytest.approx(0, abs=1e-12)
    assert np.linalg.matrix_rank(np.stack([shown, truth])) == 1


@pytest.mark.parametrize("which", ["arm", "rov"])
def test_rerun_verifies_the_file_and_nothing_else_is_left(
    which: str, request: pytest.FixtureRequest
) -> None:
    result: Run = request.getfixturevalue(which)
    file = result.folder / recording.FILE
    assert subprocess.call([*viewer.program(), "rrd", "verify", str(file)]) == 0
    assert not list(result.folder.glob(".*"))


def test_series_have_names_with_units_that_the_viewer_can_draw(arm: Run) -> None:
    for entity, columns in read(arm).items():
        for names in columns.get("SeriesLines:names", []):
            assert all(name == drawable(name) for name in names)
            assert all(name.endswith("]") for name in names if name != "true direction"), entity


def test_the_text_says_what_came_out(arm: Run) -> None:
    text = read(arm)["/result"]["TextDocument:text"][0][0]
    assert "completed" in text and "57 of 84" in text and "gain_6" in text
    assert text == drawable(text)


def test_a_robot_without_meshes_is_drawn_by_its_joints(tmp_path: Path) -> None:
    scenario = Scenario(plant=ArmPlant(robot="double_pendulum_simple"), duration=0.1, held_out=0.1)
    result = run(scenario, tmp_path)
    drawn = scene.Scene(result.plant)
    if result.plant.visuals():
        pytest.skip("it has meshes now")
    assert not drawn.empty
    recording.write(result, metrics.summarize(result))
    assert "LineStrips3D:strips" in read(result)["/robot/links"]


def test_a_sharp_edge_stays_sharp_and_a_flat_face_flat() -> None:
    corners = np.array(np.meshgrid([0.0, 1], [0.0, 1], [0.0])).reshape(3, 4).T
    vertices = np.vstack([corners, [[0, 0, 1], [1, 0, 1]]])
    triangles = np.array([[0, 2, 1], [1, 2, 3], [0, 1, 4]])
    _, faces, normals = scene.shaded(vertices, triangles)
    assert faces.shape == (3, 3)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)
    np.testing.assert_allclose(np.abs(normals[:6, 2]), 1)
    np.testing.assert_allclose(normals[6:, 2], 0, atol=1e-12)


@pytest.mark.parametrize(("length", "most"), [(2, 4000), (4000, 4000), (4001, 4000), (60001, 4000)])
def test_decimation_keeps_both_ends(length: int, most: int) -> None:
    rows = spread(length, most)
    assert rows[0] == 0 and rows[-1] == length - 1 and len(rows) <= most + 1
    assert np.all(np.diff(rows) > 0)


def test_reruns_warnings_are_errors() -> None:
    rec = rr.RecordingStream("nsaid_mj test")
    with pytest.raises(RerunWarning):
        rec.log("x", rr.Scalars("no number"))  # type: ignore[arg-type]


# -- live ----------------------------------------------------------------------------------------


def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def no_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording.Live, "_serve", lambda self: "")
    monkeypatch.setattr(rr.RecordingStream, "connect_grpc", lambda *_, **__: None)


def test_live_without_a_display_serves_this_machine_and_ends_its_server(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    no_display(monkeypatch)
    started: list[list[str]] = []
    servers: list[subprocess.Popen[bytes]] = []

    def launch(flags: list[str], **rest: bool) -> subprocess.Popen[bytes]:
        started.append(flags)
        servers.append(real(flags, **rest))
        return servers[-1]

    real = live._launch
    monkeypatch.setattr(live, "_launch", launch)
    result = run(ROV, tmp_path, recording.Live("rov"))
    assert result.ending.status is Status.completed
    assert "http://127.0.0.1:" in capfd.readouterr().err
    assert started[0][:3] == ["--serve-web", "--bind", "127.0.0.1"]
    assert servers[0].poll() is not None


@pytest.mark.parametrize("where", ["start", "see"])
def test_a_viewer_that_fails_ends_no_run(
    where: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    no_display(monkeypatch)
    monkeypatch.setattr(live, "program", lambda: [sys.executable, "-c", "raise SystemExit(3)"])
    if where == "see":
        no_connection(monkeypatch)
        monkeypatch.setattr(recording.Live, "_see", lambda *_: 1 / 0)
    result = run(ROV, tmp_path, recording.Live("rov"))
    assert result.ending.status is Status.completed
    told = [x for x in capfd.readouterr().err.splitlines() if x.startswith("nsaid:")]
    assert len(told) == 1 and "goes on without a viewer" in told[0]


def test_live_sees_no_true_value(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    no_display(monkeypatch)
    no_connection(monkeypatch)
    plant = ROV.plant.build(ROV.dt, 0)
    monkeypatch.setattr(type(plant), "truth", property(lambda self: 1 / 0))
    observer = recording.Live("rov")
    observer._start(plant)
    observer._rec = None
    observer.stop()


# -- viewer --------------------------------------------------------------------------------------


def test_the_viewers_command_without_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    no_display(monkeypatch)
    with pytest.raises(BadRun, match="--web"):
        viewer.viewer_command(Path("run.rrd"), web=False)
    command = viewer.viewer_command(Path("run.rrd"), web=True)
    assert "--serve-web" in command
    assert command[command.index("--bind") + 1] == "127.0.0.1"


def test_the_viewers_command_with_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    command = viewer.viewer_command(Path("run.rrd"), web=False)
    assert "--serve-web" not in command
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert Path(command[0]).is_file() and os.access(command[0], os.X_OK)
    assert Path(command[0]).parent.name != "bin"  # the program itself, not the console script
