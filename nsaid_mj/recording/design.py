"""The recording of a design: the motion with the robot, and predicted and reached intervals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..design.designing import Design
from ..design.trial import Trial
from ..evaluation.confidence import INTERVAL
from ..structure.sensing import velocity_labels
from .layout import robot, whole
from .plots import plot
from .scene import Scene
from .series import Curves, path
from .stream import recording

FILE = "design.rrd"
_RATE = 30.0  # frames of the robot per second
_SHOWN = 12  # intervals that are drawn


def record(found: Design, trial: Trial | None, title: str, file: Path) -> Path:
    """Writes a design's recording atomically, and returns its path.

    Args:
        found: the design.
        trial: of the design on a draw of the prior; None leaves the intervals out.
        title: of the recording.
        file: path of the recording, ending in .rrd.
    """
    log, system = found.logs[0], found.experiment.system
    every = max(1, round(1 / (_RATE * found.experiment.scenario.dt)))
    t, q, v = (part[::every] for part in log[:3])
    scene = Scene(system, found.experiment.plant(0))
    camera = None if scene.empty else scene.camera(q, v)
    names = velocity_labels(system)
    curves = [Curves("motion/velocity", [f"{n}" for n in names], v)]
    commands = Curves("motion/command", [f"u {k + 1}" for k in range(system.n_u)], log.u[::every])
    views: list[rrb.View] = [plot("motion/velocity", "velocities"), plot("motion/command", "u")]

    def beside(*own: rrb.View, name: str) -> rrb.Container:
        """The robot, if it can be drawn, beside plots."""
        grid = rrb.Grid(*own, grid_columns=1 if len(own) < 4 else 2)
        if camera is None:
            return rrb.Horizontal(grid, name=name)
        return rrb.Horizontal(robot(camera, "Motion, under a draw of θ"), grid, name=name)

    pages = [beside(*views, name="Motion")]
    if trial is not None:
        own = _interval_views(trial, found)
        pages.insert(0, beside(*own, name="Predicted and reached intervals"))
    with recording(title, whole(*pages), file) as rec:
        if camera is not None:
            scene.log_shapes(rec, camera)
            scene.log_poses(rec, t, q)
        for each in (*curves, commands):
            each.log_style(rec)
            each.log_values(rec, t)
        if trial is not None:
            _log_intervals(rec, trial, found)
    return file


def _chosen(trial: Trial) -> list[int]:
    """The numbers that are asked for, the least known first."""
    return np.argsort(-trial.predicted[-1])[:_SHOWN].tolist()


def _interval_views(trial: Trial, found: Design) -> list[rrb.View]:
    space, names = found.experiment.system.space, found.asked.names
    until = float(trial.t[-1])
    labels = dict(zip(space.names, space.labels, strict=True))
    return [
        plot(path("interval", names[k]), labels[names[k]], k == _chosen(trial)[0], until)
        for k in _chosen(trial)
    ]


def _log_intervals(rec: rr.RecordingStream, trial: Trial, found: Design) -> None:
    """Half widths of 95 % intervals, as powers of ten, and the trial's own errors."""
    for k in _chosen(trial):
        sides = (
            ("predicted ±", INTERVAL * trial.predicted[:, k]),
            ("stated ±", INTERVAL * trial.stated[:, k]),
            ("error", trial.error[:, k]),
        )
        values = np.log10(np.maximum(np.column_stack([side for _, side in sides]), 1e-12))
        labels = [f"log₁₀ {name}" for name, _ in sides]
        curves = Curves(path("interval", found.asked.names[k]), labels, values)
        curves.log_style(rec)
        curves.log_values(rec, trial.t)
