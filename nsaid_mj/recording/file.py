"""run.rrd: a whole run for the Rerun viewer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from ..experiment import Run
from ..metrics import true_nullspace
from .forces import COMMANDED, ESTIMATED, Arrows
from .layout import blueprint
from .scene import Scene
from .series import Indices, along, curves, shared
from .text import drawable, result

FILE = "run.rrd"
_POINTS = 4000  # of a curve: more than a screen is wide
_FRAMES, _RATE = 6000, 30.0  # of the robot's motion, and at most so many a second


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
    nullspace = true_nullspace(run)
    rows = spread(len(t), _POINTS)
    frames = spread(len(t), min(_FRAMES, max(2, int((t[-1] - t[0]) * _RATE))))
    scene = Scene(plant)
    some = spread(len(t), 100)
    q, v, u = record["q"], record["v"], record["u"]
    told = shared(space, nullspace.r, plant.truth)
    kinds = [b.name for b, place in space if len(told) and place.start in told]
    shown = curves(run, nullspace, rows)
    distances = [c.values.max() for c in shown if c.path.startswith("distance/")]
    camera = None if scene.empty else scene.camera(q[some], v[some])
    arrows = None
    if camera and scene.vehicle:
        arrows = Arrows.of(plant.system, camera.size, q[some], v[some], u[some], plant.truth)
    layout = blueprint(
        space,
        camera,
        survey=scene.survey(q[some]) if camera and scene.vehicle else None,
        arrows=arrows is not None,
        farthest=max(*distances, 1e-12),
        shared=(kinds[0] if len(kinds) == 1 else "parameter") if kinds else "",
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
    scene.log_poses(rec, t[frames], q[frames])
    if arrows:
        arrows.log_style(rec, COMMANDED, ESTIMATED)
        at = (t[frames], q[frames], v[frames], u[frames])
        theta_hat = record["theta_hat"][frames]
        factor = along(theta_hat / space.scale, plant.truth / space.scale)
        arrows.log(rec, COMMANDED, *at, plant.truth)
        arrows.log(rec, ESTIMATED, *at, theta_hat / factor[:, None])  # nobody knows the scale
    for curve in shown:
        curve.log_style(rec)
        curve.log_values(rec, t[rows])
    rec.flush()
    rec.disconnect()  # writes the file's end
    with partial.open("rb") as stream:
        os.fsync(stream.fileno())
    return partial.replace(file)


def spread(length: int, most: int) -> Indices:
    """At most about `most` of `length` rows, evenly, the first and the last among them."""
    stride = max(1, -(-length // most))
    return np.unique(np.append(np.arange(0, length, stride), length - 1))
