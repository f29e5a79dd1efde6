"""run.rrd: a whole run for the Rerun viewer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from ..evaluation import true_nullspace, true_theta
from ..experiment.loop import Run
from ..experiment.record import Record
from .forces import COMMANDED, ESTIMATED, Arrows, Rows
from .layout import blueprint
from .scene import Scene
from .series import Indices, along, curves, shared
from .text import drawable, result

FILE = "run.rrd"
_POINTS = 4000  # of a curve: more than a screen is wide
_LOOKS = 500  # at what there will be to see, to set up the scene
_FRAMES, _RATE = 12000, 40.0  # of the robot's motion, and at most so many a second


def write(run: Run, summary: dict[str, Any]) -> Path:
    """Writes a run's recording, whole or not at all.

    Args:
        run: a run that has ended, however it did.
        summary: its summary.json.

    Returns:
        The file.
    """
    record, plant = run.record, run.plant
    space = plant.system.space
    t = record["t"]
    nullspace, truth = true_nullspace(run), true_theta(run)
    rows = spread(len(t), _POINTS)
    frames = spread(len(t), min(_FRAMES, max(2, int((t[-1] - t[0]) * _RATE))))
    scene = Scene(plant)
    some = _rows(record, spread(len(t), _LOOKS))
    told = shared(space, nullspace.r, truth)
    kinds = [b for b, place in space if place.start in told]
    kind = kinds[0].name if kinds else ""
    if len(kinds) > 1:
        kind = "actuator parameter" if all(b.actuator for b in kinds) else "parameter"
    shown = curves(run, nullspace, rows)
    distances = [c.values.max() for c in shown if c.path.startswith("distance/")]
    camera = None if scene.empty else scene.camera(some.q, some.v)
    arrows = None
    if camera and scene.vehicle:
        arrows = Arrows.of(plant.system, camera.size, some, truth)
    layout = blueprint(
        space,
        camera,
        survey=scene.survey(some.q) if camera and scene.vehicle else None,
        magnified=arrows.magnified if arrows else None,
        farthest=max(*distances, 1e-12),
        shared=kind,
        rivals=bool(record.rivals),
        conserves=run.identifiers[""].conserves,
    )
    file = run.folder / FILE
    partial = file.with_name(f".{FILE}.part")
    rec = rr.RecordingStream(drawable(f"nsaid_mj {run.folder.resolve().name}"))
    rec.save(partial, default_blueprint=layout)
    words = rr.TextDocument(result(run, summary), media_type=rr.MediaType.MARKDOWN)
    rec.log("result", words, static=True)
    scene.log_shapes(rec, camera, ghost=arrows is not None)
    scene.log_poses(rec, t[frames], record["q"][frames])
    if arrows:
        drawn, theta_hat = _rows(record, frames), record["theta_hat"][frames]
        truth = plant.truth_at(t[frames])
        factor = along(theta_hat / space.scale, truth / space.scale)  # nobody can know it
        arrows.log_style(rec, COMMANDED, ESTIMATED)
        arrows.log(rec, COMMANDED, drawn, truth)
        arrows.log(rec, ESTIMATED, drawn, theta_hat / factor[:, None])
    for curve in shown:
        curve.log_style(rec)
        curve.log_values(rec, t[rows])
    rec.flush()
    rec.disconnect()  # writes the file's end
    with partial.open("rb") as stream:
        os.fsync(stream.fileno())
    return partial.replace(file)


def _rows(record: Record, rows: Indices) -> Rows:
    return Rows(*(record[column][rows] for column in Rows._fields))


def spread(length: int, most: int) -> Indices:
    """At most about `most` of `length` rows, evenly, the first and the last among them."""
    stride = max(1, -(-length // most))
    return np.unique(np.append(np.arange(0, length, stride), length - 1))
