"""The recording of tracking laws on one plant: their errors together, one robot, the reference."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..experiment.loop import Looks
from ..parameters import Array
from ..system import SecondOrderSystem
from ..systems.joints import JointTree, bones
from .layout import plot, robot
from .scene import Scene
from .series import Curves, path
from .stream import recording

_FRAMES, _POINTS = 2000, 4000  # at most
_REFERENCE = "reference"
_GHOST = (64, 214, 224)
_LEAST = 1e-9  # an error of 0 has no logarithm


def record(
    file: Path,
    system: SecondOrderSystem,
    looks: Looks,
    motion: tuple[Array, Array, Array],
    desired: Array,
    errors: Mapping[str, Array],
    commands: Mapping[str, Array],
) -> Path:
    """Writes a recording, atomically, and returns its path.

    Args:
        file: path of the recording, ending in .rrd.
        system: the structure.
        looks: meshes of the robot.
        motion: (N,) times [s], (N, m) positions and (N, n) velocities of the robot that is drawn.
        desired: (N, m) the reference's positions, drawn as a ghost.
        errors: (N,) norms of the tracking error, by law and unit: plotted as log10.
        commands: (N, n_u) commands as shares of their limits, by law.
    """
    t, q, v = motion
    frames, rows = _spread(len(t), _FRAMES), _spread(len(t), _POINTS)
    scene = Scene(system, looks)
    camera = None if scene.empty else scene.camera(q[frames], v[frames])
    views: list[rrb.View | rrb.Container] = [plot("error", "log10 of the tracking error")]
    if camera is not None:
        views.insert(0, robot(camera, "Robot, and its reference (cyan)"))
    tabs = [
        rrb.Horizontal(*views, name="Tracking"),
        rrb.Grid(*(plot(path("command", law), law) for law in commands), name="Commands"),
    ]
    layout = rrb.Blueprint(rrb.Tabs(*tabs, active_tab=0))
    with recording(file.parent.name, layout, file) as rec:
        if camera is not None:
            scene.log_shapes(rec, camera)
            scene.log_poses(rec, t[frames], q[frames])
            _log_reference(rec, system, t[frames], desired[frames], camera.size)
        for colour, (name, error) in enumerate(errors.items()):
            values = np.log10(np.maximum(error[rows], _LEAST))[:, None]
            _log(rec, Curves(path("error", name), [name], values, color=colour), t[rows])
        for law, share in commands.items():
            names = [f"command {i + 1} / limit" for i in range(share.shape[1])]
            _log(rec, Curves(path("command", law), names, share[rows]), t[rows])
    return file


def _log(rec: rr.RecordingStream, curves: Curves, t: Array) -> None:
    curves.log_style(rec)
    curves.log_values(rec, t)


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


def _spread(length: int, most: int) -> np.ndarray:
    """Indices of at most about `most` of `length` rows, evenly spaced."""
    return np.arange(0, length, max(1, -(-length // most)))
