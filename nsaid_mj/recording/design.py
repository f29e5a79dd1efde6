"""The recording of a design: the motion with the robot, and predicted and reached intervals."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..design.designing import Design
from ..design.prediction import Trial
from ..evaluation.confidence import INTERVAL
from .layout import RIGHT, beside, robot, whole
from .plots import Plots
from .scene import Scene
from .series import Curves, command_names, path, velocity_names
from .stream import write

FILE = "design.rrd"
_RATE = 30.0  # frames of the robot per second
_SHOWN = 12  # intervals that are drawn


def record(found: Design, trial: Trial | None, title: str, file: Path) -> Path:
    """Writes a design's recording atomically, and returns its path, which ends in .rrd.

    Without a `trial` of the design on a draw of the prior, the intervals are left out.
    """
    log, system = found.logs[0], found.experiment.system
    every = max(1, round(1 / (_RATE * found.experiment.scenario.dt)))
    t, q, v = (part[::every] for part in log[:3])
    scene = Scene(system, found.experiment.plant(0))
    camera = None if scene.empty else scene.camera(q, v)
    motion = [
        Curves("motion/velocity", velocity_names(system, ""), v),
        Curves("motion/command", command_names(system), log.u[::every]),
    ]
    moved = Plots(motion, float(t[-1]))
    left = [robot(camera, "Motion, under a draw of θ")] if camera else []

    def page(name: str, *plots: rrb.View) -> rrb.Container:
        return beside(left, rrb.Grid(*plots, grid_columns=1 if len(plots) < 4 else 2), name, [1])

    entities = {"motion/velocity": "Velocities", "motion/command": "Commands"}
    pages = [page("Motion", *(moved(entity, name, RIGHT) for entity, name in entities.items()))]
    series = [(t, motion)]
    if trial is not None:
        names, intervals = _intervals(trial, found)
        plots = Plots(intervals, float(trial.t[-1]))
        words = "relative error as a power of ten, −2 is 1 %"
        titled = zip(names, intervals, strict=True)
        views = [plots(of.path, f"{name}: {words}", RIGHT / 2) for name, of in titled]
        pages.insert(0, page("Predicted and reached intervals", *views))
        series.append((trial.t, intervals))

    def draw(rec: rr.RecordingStream) -> None:
        if camera is not None:
            scene.log_shapes(rec, camera)
            scene.log_poses(rec, t, q)

    return write(file, title, whole(*pages), {}, series, draw)


def _intervals(trial: Trial, found: Design) -> tuple[list[str], list[Curves]]:
    """The requested numbers, the least known first, and their curves.

    These are half widths of 95 % intervals, and the trial's own errors, as powers of ten.
    """
    space, names = found.experiment.system.space, found.asked.names
    sides = INTERVAL * trial.predicted, INTERVAL * trial.stated, trial.error
    labels = ["predicted 95 %", "stated by the law, 95 %", "error in the trial"]  # as on the page
    curves, chosen = [], np.argsort(-trial.predicted[-1])[:_SHOWN].tolist()
    for k in chosen:
        values = np.log10(np.maximum(np.column_stack([side[:, k] for side in sides]), 1e-12))
        curves.append(Curves(path("interval", names[k]), labels, values))
    return [space.labels[space.index(names[k])] for k in chosen], curves
