"""The recording of tracking laws on one plant: their errors together, one robot, the reference."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import Array, JointTree, SecondOrderSystem
from ...lab import Setup, Tracker
from ...report import (
    Page,
    Panel,
    Plots,
    Scene,
    spread,
    write_recording,
)
from .evaluation import ControlledMotion

_FRAMES = 2000  # of the robot, at most
_REFERENCE = f"{Scene.ROBOT}/reference"
_GHOST = (64, 214, 224)


def record(
    page: Page, setup: Setup, law: str, motion: ControlledMotion, tracker: Tracker, file: Path
) -> Path:
    """Writes a recording, atomically, and returns its path.

    Args:
        page: the page of a study.
        setup: the plant that all laws controlled.
        law: the law under which the robot is drawn.
        motion: its motion.
        tracker: has the reference, which is drawn in cyan.
        file: path of the recording, ending in .rrd.
    """
    system = setup.system
    curves = page.result.curves
    t = motion.t
    q = motion.q
    v = motion.v
    aims = [tracker.reference.desired(now)[0] for now in t.tolist()]
    desired = system.position(np.array(aims))
    frames = spread(len(t), _FRAMES)
    scene = Scene(system, setup.plant)
    camera = None if scene.empty else scene.camera(q[frames], v[frames])
    plots = Plots.of(curves, float(t[-1]))
    errors = [panel for panel in curves if isinstance(panel, Panel) and panel.page]
    story = [
        plots(
            Plots.entity(*panel.key, logarithm=True),
            f"{panel.title} as a power of ten",
            Plots.RIGHT,
        )
        for panel in errors
    ]
    left: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="/result", name="Result")]
    if camera:
        left.insert(0, camera.view(f"Robot under {law}; its reference (cyan)"))
    commands = [panel for panel in curves if isinstance(panel, Panel) and not panel.page]
    efforts = [plots(Plots.entity(*panel.key), panel.title) for panel in commands]
    pages = [
        Plots.beside(left, plots.column(story), "Tracking", [3, 2]),
        plots.grid(efforts, min(2, len(efforts)), "Commands"),
    ]

    def draw(rec: rr.RecordingStream) -> None:
        if camera is not None:
            scene.log_shapes(rec, camera, ghost=True)
            scene.log_poses(rec, t[frames], q[frames])
            _log_reference(rec, system, t[frames], desired[frames], camera.size)

    return write_recording(
        file, file.parent.name, pages, {"result": page.markdown()}, plots.curves, draw
    )


def _log_reference(
    rec: rr.RecordingStream, system: SecondOrderSystem, t: Array, q: Array, size: float
) -> None:
    """Logs the desired joints as a skeleton, or a body's desired axes."""
    time = rr.TimeColumn("sim_time", duration=t)
    radius = 0.008 * size
    if isinstance(system, JointTree):
        drawn = system.bones(q)
        strips = rr.LineStrips3D.columns(strips=list(drawn.reshape(-1, 2, 3)))
        strips = strips.partition([drawn.shape[1]] * len(t))
        style = rr.LineStrips3D.from_fields(colors=[_GHOST], radii=[radius])
        rec.log(_REFERENCE, style, static=True)
        rec.send_columns(_REFERENCE, [time], strips)
        return
    pose = rr.Transform3D.columns(translation=q[:, :3], quaternion=q[:, 3:7])
    rec.send_columns(_REFERENCE, [time], pose)
    axes = 0.5 * size * np.eye(3)
    arrows = rr.Arrows3D(vectors=axes, colors=[_GHOST] * 3, radii=[radius] * 3)
    rec.log(f"{_REFERENCE}/axes", arrows, static=True)
