"""The recording of an identification holds log, prediction and estimates."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import BlueROV2Plant
from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify.page import identification_page as page
from nsaid_mj.clinic.identify.recording import record
from nsaid_mj.clinic.identify.result import Identification, shifts
from nsaid_mj.core.log import Log
from nsaid_mj.lab.recording import viewer
from nsaid_mj.report.page import plain
from nsaid_mj.report.recording.text import drawable
from tests.support.identification import identification
from tests.support.recordings import entities_of


@pytest.fixture(scope="module")
def result() -> Identification:
    return identification(validated=True, law=True)


def recorded_in(result: Identification, folder: Path) -> Path:
    """A recording of a result, with the text of its page."""
    return record(page(result), folder / "identification.rrd")


@pytest.fixture(scope="module")
def file(result: Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_in(result, tmp_path_factory.mktemp("recording"))


def test_the_recording_has_every_entity(file: Path) -> None:
    entities = entities_of(file)
    wanted = {"/result", "/parameters", "/robot/links", "/robot/joints"}
    for name in ("base", "shoulder", "elbow"):
        for prefix in ("", "/validation"):
            wanted |= {f"{prefix}/command/{name}/{side}" for side in ("measured", "predicted")}
            wanted |= {f"{prefix}/residual/{name}"}
        wanted |= {f"/estimate/motor_gain/gain_of_{name}/{side}" for side in ("value", "interval")}
        wanted |= {f"/estimate/viscous_friction/viscous_friction_of_{name}/value"}
    assert wanted <= set(entities)


def test_rerun_accepts_the_file_and_nothing_else_is_left(file: Path) -> None:
    assert (
        subprocess.run([*viewer.program(), "rrd", "verify", str(file)], check=False).returncode == 0
    )
    assert {path.name for path in file.parent.iterdir()} == {file.name, ".nsaid-mj.json"}


def test_recorded_commands_are_those_of_the_result(file: Path, result: Identification) -> None:
    columns = entities_of(file)["/command/elbow/predicted"]
    values = np.array([row for row in columns["Scalars:scalars"] if row is not None]).ravel()
    shown = values[np.isfinite(values)]
    assert np.array_equal(shown, result.predictions.predicted[:, 2])
    assert np.isnan(values).sum() == 1  # the line is interrupted between the two logs


def test_time_never_runs_backwards(file: Path) -> None:
    for columns in entities_of(file).values():
        if "sim_time" in columns:
            t = [value.total_seconds() for value in columns["sim_time"]]
            assert (np.diff(t) > -1e-9).all()


def test_the_verdict_is_the_first_thing_in_the_text(file: Path, result: Identification) -> None:
    texts = [
        entities_of(file)[f"/{name}"]["TextDocument:text"][0][0]
        for name in ("result", "parameters")
    ]
    lines = [line for line in texts[0].splitlines() if line]
    assert lines[0] == "## test arm"
    assert lines[1].startswith("**The structure explains the log")
    for parameter in result.parameters:
        assert drawable(plain(parameter.label)) in texts[1]


def evil() -> Identification:
    name = "<script>|`x`"
    return identification((name, "two"), findings=(Finding("warning", "x", name, name),))


@pytest.mark.parametrize(
    "result",
    [
        identification(("only",), segments=1),
        identification(tuple(f"joint_{k}" for k in range(8)), law=True, explains="no"),
        identification(vehicle=True, explains="partly"),
        identification(held_out=np.nan),
        evil(),
        replace(identification(), parameters=(), combinations=(), suggestion=""),
    ],
    ids=["one joint", "8 joints", "vehicle", "nan", "evil names", "no parameters"],
)
def test_unusual_identifications_are_recorded(result: Identification, tmp_path: Path) -> None:
    entities = entities_of(recorded_in(result, tmp_path))
    assert "/result" in entities
    assert ("/robot/links" in entities) == (result.robot.model is not None)


def test_a_vehicle_is_drawn_by_its_meshes(tmp_path: Path) -> None:
    plant = BlueROV2Plant().build(dt=0.01, seed=0)
    result = identification(tuple(f"thruster {k}" for k in range(8)), vehicle=True, segments=1)
    segment = result.recordings.segments[0]
    t, n = segment.log.t, len(segment.log.t)
    q = np.zeros((n, plant.system.m))
    q[:, 0], q[:, 6] = np.sin(t), 1.0
    log = Log(t, q, np.full((n, plant.system.n), 0.3), segment.log.u)
    moving = replace(result.recordings, segments=(segment._replace(log=log),))
    robot = replace(result.robot, system=plant.system, visuals=plant)
    file = recorded_in(replace(result, robot=robot, recordings=moving), tmp_path)
    entities = entities_of(file)
    places = np.array([p for p in entities["/robot/body"]["Transform3D:translation"] if p]).reshape(
        -1, 3
    )
    assert np.isclose(np.ptp(places[:, 0]), np.ptp(np.sin(t)), atol=1e-3)
    assert any(entity.startswith("/robot/body/00_") for entity in entities)


def test_logs_follow_one_another() -> None:
    spans = [("a", 5.0, 9.0), ("a", 12.0, 20.0), ("b", 0.0, 4.0), ("b", 6.0, 7.0)]
    assert shifts(spans).tolist() == [0.0, 0.0, 21.0, 21.0]


def test_a_log_that_continues_another_keeps_its_times() -> None:
    assert shifts([("a", 5.0, 9.0), ("b", 9.5, 12.0)]).tolist() == [0.0, 0.0]
    assert shifts([("a", 5.0, 9.0), ("b", 900.0, 912.0)]).tolist() == [0.0, -890.0]
