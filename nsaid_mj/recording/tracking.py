"""The recording of tracking laws on one plant: their errors together, one robot, the reference."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..experiment.loop import Looks
from ..pages.panels import LAWS
from ..parameters import Array
from ..structure.joints import JointTree, bones
from ..structure.system import SecondOrderSystem
from .layout import RIGHT, beside, result, robot, whole
from .plots import Plots
from .scene import ROBOT, Camera, Scene
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
    motion: tuple[Array, Array, Array],
    desired: Array,
    errors: Mapping[str, Mapping[str, Array]],
    commands: Mapping[str, Array],
    result: str,
) -> Path:
    """Writes a recording, atomically, and returns its path.

    Args:
        file: path of the recording, ending in .rrd.
        system: the structure.
        looks: meshes of the robot.
        motion: (N,) times [s], (N, m) positions and (N, n) velocities of the robot drawn, under the
            first law.
        desired: (N, m) the reference's positions, drawn in cyan.
        errors: (N,) norms of the tracking error, by unit and law: plotted as log₁₀.
        commands: (N, n_u) commands as shares of their limits, by law.
        result: the result in Markdown.
    """
    t, q, v = motion
    frames, rows = spread(len(t), _FRAMES), spread(len(t), _POINTS)
    scene = Scene(system, looks)
    camera = None if scene.empty else scene.camera(q[frames], v[frames])
    curves = [
        Curves(path("error", unit, law), [law], np.log10(size)[rows, None], color=LAWS[law])
        for unit, of in errors.items()
        for law, size in ((law, np.maximum(error, _LEAST)) for law, error in of.items())
    ]
    names = command_names(system)
    curves += [Curves(path("command", law), names, u[rows]) for law, u in commands.items()]
    layout = _layout(Plots(curves, float(t[-1])), camera, list(errors), list(commands))

    def draw(rec: rr.RecordingStream) -> None:
        if camera is not None:
            scene.log_shapes(rec, camera, ghost=True)
            scene.log_poses(rec, t[frames], q[frames])
            _log_reference(rec, system, t[frames], desired[frames], camera.size)

    return write(file, file.parent.name, layout, {"result": result}, [(t[rows], curves)], draw)


def _layout(
    plots: Plots, camera: Camera | None, units: Sequence[str], laws: Sequence[str]
) -> rrb.Blueprint:
    story = [plots(path("error", u), f"Tracking error [log₁₀ of {u}]", RIGHT) for u in units]
    left = [robot(camera, f"Robot under {laws[0]}; its reference (cyan)")] if camera else []
    first = beside([*left, result()], rrb.Vertical(*story), "Tracking", [3, 2])
    efforts = [plots(path("command", law), f"{law}: commands over their limits") for law in laws]
    return whole(first, plots.grid(efforts, min(2, len(laws)), "Commands"))


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
