"""The recording of a design: the motion with the robot, and predicted and reached intervals."""

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from ...report import (
    Page,
    Panel,
    Plots,
    Scene,
    write_recording,
)
from .designing import Design

DESIGN_RECORDING = "design.rrd"
_RATE = 30.0  # frames of the robot per second


def record_design(page: Page, found: Design, file: Path) -> Path:
    """Writes a design's recording atomically, and returns its path, which ends in .rrd.

    Args:
        page: the page of the design; without a trial on it, intervals are left out.
        found: the design.
        file: path of the recording.
    """
    log = found.logs[0]
    system = found.experiment.system
    every = max(1, round(1 / (_RATE * found.experiment.scenario.dt)))
    t, q, v = (part[::every] for part in log[:3])
    scene = Scene(system, found.experiment.plant(0))
    camera = None if scene.empty else scene.camera(q, v)

    def tab(name: str, plots: Plots, views: list[rrb.View]) -> rrb.Container:
        # every tab has a view of its own: the viewer drops one that is in two
        left = [camera.view("Robot's motion, under a draw of θ")] if camera else []
        return Plots.beside(left, plots.grid(views, 1 if len(views) < 4 else 2), name, [1])

    curves = page.result.curves
    own = [p for p in curves if isinstance(p, Panel) and not p.page]
    motion = [panel for panel in own if not panel.logarithmic]
    moved = Plots.of(curves, float(t[-1]))
    shown: list[rrb.View] = [
        moved(Plots.entity(*panel.key), panel.title, Plots.RIGHT) for panel in motion
    ]
    pages = [tab("Motion", moved, shown)]
    intervals = [panel for panel in own if panel.logarithmic]
    if intervals:
        plots = Plots.of(curves, float(intervals[0].curves[0].t[-1]))
        words = "log₁₀ of the relative error"
        views: list[rrb.View] = [
            plots(
                Plots.entity(*panel.key, logarithm=True), f"{panel.title}: {words}", Plots.RIGHT / 2
            )
            for panel in intervals
        ]
        pages.insert(0, tab("Predicted and reached intervals", plots, views))

    def draw(rec: rr.RecordingStream) -> None:
        if camera is not None:
            scene.log_shapes(rec, camera)
            scene.log_poses(rec, t, q)

    return write_recording(file, page.heading, pages, {}, moved.curves, draw)
