"""A hand, a pause or a table in an arm's log is found by residuals and left out; misfit is not."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.clinic.identify.foreign_phases import (
    ForeignPhase,
    foreign_phases,
    unfiltered,
    without,
)
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.clinic.logs.mapping import Map
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import Channel, LogTable
from tests.support.robot_logs import two_joints

T = np.arange(2000) / 100


def logged() -> dict[str, np.ndarray]:
    """Twenty seconds of an arm of two joints with viscous friction, and its torques with noise."""
    model = two_joints().model
    rate = np.array([[0.7, 1.9, 3.1], [0.9, 2.3, 3.7]])
    phase = T[:, None, None] * rate + np.arange(6).reshape(2, 3)
    size = np.array([0.9, 0.5, 0.25])
    q = (size * np.sin(phase)).sum(axis=2)
    v = (size * rate * np.cos(phase)).sum(axis=2)
    a = -(size * rate**2 * np.sin(phase)).sum(axis=2)
    data = model.createData()
    u = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)]) + 0.5 * v
    u += 0.01 * np.random.default_rng(0).standard_normal(u.shape)
    return {"t": T, "q1": q[:, 0], "q2": q[:, 1], "tau1": u[:, 0], "tau2": u[:, 1]}


def written(path: Path, values: dict[str, np.ndarray]) -> Path:
    table = np.column_stack(list(values.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(values), comments="")
    return path


def file(folder: Path, change: Callable[[np.ndarray], np.ndarray]) -> Path:
    """A log whose torques are changed between 10 and 13 s."""
    values = logged()
    inside = (T > 10) & (T < 13)
    for name in ("tau1", "tau2"):
        values[name] = values[name].copy()
        values[name][inside] = change(values[name][inside])
    return written(folder / "log.csv", values)


def identified(log: Path) -> Identification:
    """The fit of a structure that need not be searched for."""
    return identify_forces(two_joints(), log, columns=[], delay=0.0, cutoff=10.0)


def left_out(found: Identification) -> list[tuple[str, float, float]]:
    parts = [phase for phase in found.recordings.phases if not phase.used]
    return [(p.kind, float(p.log.t[0]), float(p.log.t[-1])) for p in parts]


@pytest.mark.parametrize(
    ("kind", "change"),
    [
        ("moved by hand", lambda u: 0.0 * u),
        ("paused controller", lambda u: 0.0 * u + u[0]),
        ("contact", lambda u: u + 3 * np.std(u)),
    ],
)
def test_a_phase_that_the_rest_contradicts_is_left_out_and_said(kind, change, tmp_path):
    found = identified(file(tmp_path, change))
    ((name, start, end),) = left_out(found)
    assert name == kind
    assert start == pytest.approx(10, abs=0.4) and end == pytest.approx(13, abs=0.4)
    assert max(joint.held_out for joint in found.joints) < 0.05
    assert f"left out: {kind}" in found.verdict
    (finding,) = [f for f in found.findings if f.code == "phases"]
    assert finding.level == "warning"


def test_a_log_of_one_phase_is_used_whole(tmp_path):
    found = identified(file(tmp_path, lambda u: u))
    assert left_out(found) == [] and "left out" not in found.verdict
    assert unfiltered(found) == []


def test_a_structure_that_is_wrong_where_it_is_fast_is_not_hidden(tmp_path):
    """The drag above some speed has no column; the fast stretches are contiguous, and stay."""
    values = logged()
    for k in "12":
        v = np.gradient(values[f"q{k}"], T)
        values[f"tau{k}"] = values[f"tau{k}"] + 4 * np.sign(v) * np.maximum(np.abs(v) - 1.5, 0)
    found = identified(written(tmp_path / "log.csv", values))
    assert left_out(found) == []
    assert max(joint.held_out for joint in found.joints) > 0.05


def test_recordings_are_cut_and_every_sample_is_accounted_for():
    values = logged()
    channels = {name: Channel(T, x) for name, x in values.items() if name != "t"}
    recordings = prepare([LogTable("log.csv", channels, 0)], Map(drop_rest=False), two_joints())
    found = without(recordings, [ForeignPhase(0, 10.0, 13.0, "contact")])
    first, second = found.segments
    assert first.log.t[-1] < 10.0 and second.log.t[0] > 13.0
    assert [phase.kind for phase in found.phases] == ["moving", "contact", "moving"]
    assert sum(len(phase.log.t) for phase in found.phases) == len(T)
    assert second.rows[0] == pytest.approx(13.0 * 100 + 2, abs=2)
    assert without(recordings, []) is recordings


def test_stretches_shorter_than_the_filter_are_counted(tmp_path):
    kept = (T < 16) | ((T > 17) & (T < 17.4)) | ((T > 18) & (T < 18.4))
    short = {name: x[kept] for name, x in logged().items()}
    log = written(tmp_path / "log.csv", short)
    found = identify_forces(two_joints(), log, columns=[], delay=0.0, cutoff=6.0)
    texts = [f.text for f in found.findings if f.code == "short_stretch"]
    assert len(texts) == 1 and "2 of 3 stretches" in texts[0]


def test_a_good_fit_is_not_searched(tmp_path, monkeypatch):
    found = identified(file(tmp_path, lambda u: u))
    good = replace(found, joints=tuple(replace(j, held_out=0.01) for j in found.joints))
    monkeypatch.setattr("nsaid_mj.clinic.identify.foreign_phases._LogWindows", None)
    assert foreign_phases(good) == []
