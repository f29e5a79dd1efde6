"""The recording of tracking laws on one plant: their errors together, one robot, the reference."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..control.adaptive import Tracker
from ..evaluation.panels import LAWS
from ..evaluation.tracking import Motion
from ..experiment.loop import Looks
from ..parameters import Array
from ..structure.joints import JointTree, bones
from ..structure.system import SecondOrderSystem
from .layout import RIGHT, beside, result, robot, whole
from .plots import Plots
from .scene import ROBOT, Scene
from .series import Curves, command_names, path, spread
from .stream import write

_FRAMES, _POINTS = 2000, 4000  # at most
_REFERENCE = f"{ROBOT}/reference"
_GHOST = (64, 214, 224)
_LEAST = 1e-9  # an error of 0 has no logarithm


def record(
    file: Path,
    system: SecondOrderSystem,
    looks: Looks,
    motions: Mapping[str, Motion],
    tracker: Tracker,
    document: str,
) -> Path:
    """Writes a recording, atomically, and returns its path.

    Args:
        file: path of the recording, ending in .rrd.
        system: the structure.
        looks: meshes of the robot.
        motions: the motions by law; the robot is drawn under the first one.
        tracker: has the limits of commands, and the reference, which is drawn in cyan.
        document: the result in Markdown.
    """
    first, (low, high) = next(iter(motions.values())), tracker.limits
    t, q, v = first.t, first.q, first.v
    aims = [tracker.reference.desired(now)[0] for now in t.tolist()]
    desired = system.position(np.array(aims))
    units = [unit for unit in ("rad", "m") if f"{unit}/s" in system.velocity_units]
    frames, rows = spread(len(t), _FRAMES), spread(len(t), _POINTS)
    scene = Scene(system, looks)
    camera = None if scene.empty else scene.camera(q[frames], v[frames])
    curves, names = [], command_names(system)
    for law, of in motions.items():
        for unit in units:
            size = np.sqrt(np.mean(of.error_of(system, unit) ** 2, axis=1))
            values = np.log10(np.maximum(size, _LEAST))[rows, None]
            curves.append(Curves(path("error", unit, law), [law], values, color=LAWS[law]))
        shares = of.u / np.where(of.u < 0, -low, high)
        curves.append(Curves(path("command", law), names, shares[rows]))
    plots = Plots(curves, float(t[-1]))
    story = [plots(path("error", u), f"Tracking error [log₁₀ of {u}]", RIGHT) for u in units]
    left: list[rrb.View | rrb.Container] = [result()]
    if camera:
        left.insert(0, robot(camera, f"Robot under {next(iter(motions))}; its reference (cyan)"))
    efforts = [plots(path("command", law), f"{law}: commands over their limits") for law in motions]
    layout = whole(
        beside(left, rrb.Vertical(*story), "Tracking", [3, 2]),
        plots.grid(efforts, min(2, len(efforts)), "Commands"),
    )

    def draw(rec: rr.RecordingStream) -> None:
        if camera is not None:
            scene.log_shapes(rec, camera, ghost=True)
            scene.log_poses(rec, t[frames], q[frames])
            _log_reference(rec, system, t[frames], desired[frames], camera.size)

    return write(file, file.parent.name, layout, {"result": document}, [(t[rows], curves)], draw)


def _log_reference(
    rec: rr.RecordingStream, system: SecondOrderSystem, t: Array, q: Array, size: float
) -> None:
    """Logs the desired joints as a skeleton, or a body's desired axes."""
    time, radius = rr.TimeColumn("sim_time", duration=t), 0.008 * size
    if isinstance(system, JointTree):
        drawn = bones(system.model, q)
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
