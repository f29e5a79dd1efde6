"""The robot's drawing in 3D: its shape, forces or torques, and link inertias."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ..evaluation import Truth
from ..experiment.loop import Run
from ..experiment.record import Record
from ..parameters import Array, Indices
from . import inertia, torques
from .faults import failed_parts, log_faults
from .forces import COMMANDED, ESTIMATED, Arrows, Rows
from .layout import words
from .scene import Scene
from .series import along, spread

_LOOKS = 500  # rows of the record from which camera, arrows and arcs are set up
_FRAMES, _RATE = 12000, 30.0  # largest number of frames of the robot, and frames per second
_ARCS, _ARC_RATE = 4000, 15.0  # the same of torques
_ELLIPSOIDS = 300  # estimates of the links' inertias along a run, at most


class Robot:
    """Draws the robot of a finished run.

    Args:
        run: a finished run with at least one row.
        truth: of its plant; None leaves out everything that needs it.

    Attributes:
        camera: of the 3D view; None if there is nothing to draw.
        survey: camera on a vehicle's whole path; None for an arm.
    """

    def __init__(self, run: Run, truth: Truth | None):
        record, system = run.record, run.system
        self._run, self._truth = run, truth
        self._scene = scene = Scene(system, run.looks)
        some = _rows(record, spread(len(record), _LOOKS))
        theta = record.rows("theta_hat", -1) if truth is None else truth.theta
        self.camera = camera = None if scene.empty else scene.camera(some.q, some.v)
        self.survey = scene.survey(some.q) if camera and scene.vehicle else None
        self._arrows = self._arcs = self._links = None
        if camera:
            self._links = inertia.Inertias.of(system)
            if scene.vehicle:
                self._arrows = Arrows.of(system, camera.size, some, theta)
            elif torques.drawn(system):
                self._arcs = torques.Arcs(system, camera.size, some, theta)

    @property
    def words(self) -> str:
        """Title of the view: what is drawn, in which colour."""
        kinds = ["forces"] * bool(self._arrows) + ["torques"] * bool(self._arcs)
        kinds += ["inertia"] * bool(self._links)
        if not kinds:
            return words("")
        white = "nominal (white), " if self._truth is None else "true (white), "
        white = white if self._truth is not None or self._links else ""
        drawn = f"{' and '.join(kinds).capitalize()}: {white}estimated (orange)"
        return words(drawn, self._arrows.magnified if self._arrows else None)

    def log(self, rec: rr.RecordingStream) -> None:
        """Logs everything."""
        record, truth = self._run.record, self._truth
        t, frames = record["t"], _at_rate(record["t"], _RATE, _FRAMES)
        inside = self._arrows is not None or self._links is not None
        failed = failed_parts(self._run.faults, self._run.system, self._scene)
        changing = dict.fromkeys(failed, float(t[0]))
        self._scene.log_shapes(rec, self.camera, ghost=inside, changing=changing)
        self._scene.log_poses(rec, t[frames], record["q"][frames])
        log_faults(rec, self._run.faults, self._run.system, self._scene, self.camera)
        if self._arrows:
            theta_hat = record.rows("theta_hat", frames)
            _log_forces(rec, self._arrows, _rows(record, frames), theta_hat, truth)
        if self._arcs:
            some = _at_rate(t, _ARC_RATE, _ARCS)
            theta_hat = record.rows("theta_hat", some)
            _log_torques(rec, self._arcs, _rows(record, some), theta_hat, truth)
        if self._links and self.camera:
            few, size = spread(len(t), _ELLIPSOIDS), self.camera.size
            self._links.log_frames(rec, t[frames], record["q"][frames])
            theta_hat = record.rows("theta_hat", few)
            self._links.log(rec, inertia.ESTIMATED, t[few], theta_hat, size)
            reference = self._run.prior[None] if truth is None else truth.theta_at(t[few])
            self._links.log(rec, inertia.REFERENCE, t[few][: len(reference)], reference, size)


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
    failed = changed(truth, rows.t)
    arrows.log(rec, COMMANDED, rows, true, failed)
    arrows.log(rec, ESTIMATED, rows, theta_hat / factor[:, None], failed)


def _log_torques(
    rec: rr.RecordingStream, arcs: torques.Arcs, rows: Rows, theta_hat: Array, truth: Truth | None
) -> None:
    """Logs the torques under θ̂ and, if the truth is known, the commanded ones, as forces are."""
    n = rows.v.shape[1]
    if truth is None:
        arcs.log(rec, torques.ESTIMATED, rows, theta_hat, np.zeros((len(rows.t), n), bool))
        return
    true, system = truth.theta_at(rows.t), truth.system
    factor = along(theta_hat / system.space.scale, true / system.space.scale)
    F = system.F(rows.t, np.hstack([rows.q, rows.v]), rows.u)
    moves = np.any(F != 0, axis=0)  # (n, p) whether a parameter has a force along a velocity
    joints = changed(truth, rows.t).astype(float) @ moves.T > 0
    arcs.log(rec, torques.COMMANDED, rows, true, joints)
    arcs.log(rec, torques.ESTIMATED, rows, theta_hat / factor[:, None], joints)


def changed(truth: Truth, t: Array) -> NDArray[np.bool_]:
    """(k, p) whether an actuator's parameter differs at times t (k,) from before any fault."""
    actuators = np.zeros(len(truth.initial), bool)
    actuators[truth.system.space.actuators] = True
    return (truth.theta_at(t) != truth.initial) & actuators


def _rows(record: Record, rows: Indices) -> Rows:
    return Rows(*(record[column][rows] for column in Rows._fields))


def _at_rate(t: Array, rate: float, most: int) -> Indices:
    """Indices of rows at about a rate [1/s], at most `most`, with the first and the last."""
    return spread(len(t), min(most, max(2, int((t[-1] - t[0]) * rate))))
