"""run.rrd: the recording of a finished run for the Rerun viewer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from ..evaluation import Truth, nullspace_of
from ..experiment.loop import Run
from ..experiment.record import Record
from ..parameters import Array, ParameterSpace
from . import FILE
from .forces import COMMANDED, ESTIMATED, Arrows, Rows
from .layout import blueprint, measured_blueprint
from .scene import Scene
from .series import Indices, along, curves, shared
from .stream import recording
from .text import result

_POINTS = 4000  # of a curve, at most; more than the width of a screen
_LOOKS = 500  # rows of the record from which camera and arrows are set up
_FRAMES, _RATE = 12000, 40.0  # largest number of frames of the robot, and frames per second


def write(run: Run, summary: dict[str, Any], truth: Truth | None) -> Path:
    """Writes a run's recording, atomically.

    Args:
        run: a finished run with at least one row, completed or not.
        summary: the content of its summary.json.
        truth: of its plant; None leaves out everything that needs it.

    Returns:
        The path of the file.
    """
    record, system = run.record, run.system
    space, t, theta_hat = system.space, record["t"], record["theta_hat"]
    nullspace = nullspace_of(run, truth)
    rows = spread(len(t), _POINTS)
    frames = spread(len(t), min(_FRAMES, max(2, int((t[-1] - t[0]) * _RATE))))
    scene = Scene(system, run.looks)
    some = _rows(record, spread(len(t), _LOOKS))
    shown = curves(run, nullspace, rows, truth)
    camera = None if scene.empty else scene.camera(some.q, some.v)
    arrows = None
    if camera and scene.vehicle:
        theta = theta_hat[-1] if truth is None else truth.theta
        arrows = Arrows.of(system, camera.size, some, theta)
    survey = scene.survey(some.q) if camera and scene.vehicle else None
    magnified = arrows.magnified if arrows else None
    conserves = run.identifiers[""].conserves
    if truth is None:
        layout = measured_blueprint(
            space,
            camera,
            survey=survey,
            magnified=magnified,
            forces=any(c.path.startswith("force/") for c in shown),
            conserves=conserves,
        )
    else:
        distances = [c.values.max() for c in shown if c.path.startswith("distance/")]
        layout = blueprint(
            space,
            camera,
            survey=survey,
            magnified=magnified,
            farthest=max(*distances, 1e-12),
            shared=_kind(space, shared(space, nullspace.r, truth.theta)),
            rivals=bool(record.rivals),
            conserves=conserves,
        )
    file = run.folder / FILE
    with recording(run.folder.resolve().name, layout, file) as rec:
        words = rr.TextDocument(result(run, summary), media_type=rr.MediaType.MARKDOWN)
        rec.log("result", words, static=True)
        scene.log_shapes(rec, camera, ghost=arrows is not None)
        scene.log_poses(rec, t[frames], record["q"][frames])
        if arrows:
            _log_forces(rec, arrows, _rows(record, frames), theta_hat[frames], truth)
        for curve in shown:
            curve.log_style(rec)
            curve.log_values(rec, t[rows])
    return file


def _log_forces(
    rec: rr.RecordingStream, arrows: Arrows, rows: Rows, theta_hat: Array, truth: Truth | None
) -> None:
    """Logs the forces under θ̂ and, if the truth is known, the commanded ones next to them.

    For the comparison θ̂ is divided by the common factor that brings it closest to the truth, since
    that factor is unobservable.
    """
    if truth is None:
        arrows.log_style(rec, ESTIMATED)
        arrows.log(rec, ESTIMATED, rows, theta_hat)
        return
    true, scale = truth.theta_at(rows.t), truth.system.space.scale
    factor = along(theta_hat / scale, true / scale)
    arrows.log_style(rec, COMMANDED, ESTIMATED)
    arrows.log(rec, COMMANDED, rows, true)
    arrows.log(rec, ESTIMATED, rows, theta_hat / factor[:, None])


def _kind(space: ParameterSpace, chosen: Indices) -> str:
    """A common noun for the chosen parameters; empty if there are none."""
    kinds = [block for block, place in space if place.start in chosen]
    if len(kinds) > 1:
        return "actuator parameter" if all(b.actuator for b in kinds) else "parameter"
    return kinds[0].name if kinds else ""


def _rows(record: Record, rows: Indices) -> Rows:
    return Rows(*(record[column][rows] for column in Rows._fields))


def spread(length: int, most: int) -> Indices:
    """Indices of at most about `most` of `length` rows, evenly spaced, including first and last."""
    stride = max(1, -(-length // most))
    return np.unique(np.append(np.arange(0, length, stride), length - 1))
