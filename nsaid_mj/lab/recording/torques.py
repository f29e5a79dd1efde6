"""Torques of an arm's motors, drawn as arcs about the joints' axes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ...base import pin
from ...core import Array, Indices, JointTree, Log, SecondOrderSystem
from ...report import Scene, rotated
from .forces import FAILED
from .inertia import frames

COMMANDED = f"{Scene.ROBOT}/torque/commanded"
ESTIMATED = f"{Scene.ROBOT}/torque/estimated"
_COLOURS = {COMMANDED: (226, 230, 240), ESTIMATED: (255, 138, 30)}
_RADIUS = {COMMANDED: 0.085, ESTIMATED: 0.1}  # of an arc, over the robot's size
_TURN = np.radians(200.0)  # angle of an arc at twice the rms torque, and at most
_POINTS = 14  # points of an arc, and angle of its tip [rad]
_TIP = 0.35


def drawn(system: SecondOrderSystem) -> bool:
    """Whether a system is an arm on a fixed base, whose joints turn."""
    return isinstance(system, JointTree) and system.group == 0 and system.n == len(system.joints)


class Arcs:
    """The arcs of an arm, one for each joint that turns.

    Args:
        system: an arm's structure; see `drawn`.
        size: the arm's size [m].
        rows: samples of the motion, which set the largest arc.
        theta: (p,) parameters.
    """

    kind = "torques"
    paths = (COMMANDED, ESTIMATED)
    rate = 15.0  # arcs that are drawn per second, and at most
    frames = 4000
    magnified: Mapping[str, float] = {}

    def __init__(self, system: SecondOrderSystem, size: float, rows: Log, theta: Array):
        assert isinstance(system, JointTree)
        self._system = system
        self._size = size
        rms = np.sqrt(np.mean(joint_torques(system, rows, theta) ** 2, axis=0))
        self._full = 2 * np.where(rms > 0, rms, np.inf)  # each joint has its own scale
        self._axes = axes(system, rows.q[0])
        self._turning = np.flatnonzero(np.linalg.norm(self._axes, axis=1) > 0)

    def log_style(self, rec: rr.RecordingStream, *paths: str) -> None:
        """Logs the width of commanded or estimated arcs."""
        for path in paths:
            rec.log(path, rr.LineStrips3D.from_fields(radii=[0.006 * self._size]), static=True)

    def log(
        self,
        rec: rr.RecordingStream,
        path: str,
        rows: Log,
        theta: Array,
        failed: NDArray[np.bool_],
    ) -> None:
        """Logs the arcs of k samples in one batch.

        `path` is COMMANDED or ESTIMATED, theta (p,) or (k, p); `failed` (k, p) marks parameters
        that a fault has changed, whose joints' arcs are red.
        """
        actuators = self._system.space.actuators
        F = _per_gain(self._system, rows)
        joints = failed[:, actuators].astype(float) @ np.any(F != 0, axis=0).T > 0
        angle = _TURN * np.clip(_torques(F, theta, actuators) / self._full, -1, 1)
        poses = frames(self._system, rows.q)
        radius = _RADIUS[path] * self._size
        strips = np.stack(
            [
                rotated(turn, _arcs(angle[:, j], radius, self._axes[j])) + place[:, None]
                for j, (place, turn) in ((j, poses[j]) for j in self._turning)
            ],
            axis=1,
        )
        colours = np.where(joints[:, self._turning, None], FAILED, _COLOURS[path])
        k, count, *shape = strips.shape
        arcs = rr.LineStrips3D.columns(
            strips=list(strips.reshape(k * count, *shape)),
            colors=colours.reshape(-1, 3).astype(np.uint8),
        )
        time = rr.TimeColumn("sim_time", duration=rows.t)
        rec.send_columns(path, [time], arcs.partition([count] * k))


def axes(system: JointTree, q: Array) -> Array:
    """(n, 3) axis of every joint in its own frame; 0 for joints that slide."""
    data = system.model.createData()
    pin.computeJointJacobians(system.model, data, q)
    return np.array(
        [
            # pinocchio gives the only column of a single joint's Jacobian as (6,)
            pin.getJointJacobian(system.model, data, j + 1, pin.LOCAL).reshape(6, -1)[
                3:, joint.idx_v
            ]
            for j, joint in enumerate(system.joints)
        ]
    )


def joint_torques(system: SecondOrderSystem, rows: Log, theta: Array) -> Array:
    """(k, n) forces of the actuators along the velocities, under θ (p,) or (k, p)."""
    return _torques(_per_gain(system, rows), theta, system.space.actuators)


def _per_gain(system: SecondOrderSystem, rows: Log) -> Array:
    """(k, n, a) force along every velocity per unit of every actuator parameter."""
    F = system.F(rows.t, np.hstack([rows.q, rows.v]), rows.u)
    return F[..., system.space.actuators]


def _torques(F: Array, theta: Array, actuators: Indices) -> Array:
    theta = np.broadcast_to(theta, (len(F), np.shape(theta)[-1]))
    return np.asarray(np.einsum("kia,ka->ki", F, theta[:, actuators]))


def _arcs(angle: Array, radius: float, axis: Array) -> Array:
    """(k, points, 3) arcs of angles (k,) about an axis, with a tip that shows their direction."""
    aside = np.eye(3)[np.argmin(np.abs(axis))]
    first = np.cross(axis, aside) / np.linalg.norm(np.cross(axis, aside))
    second = np.cross(axis, first)

    def at(turn: Array, length: Array | float) -> Array:
        flat = np.cos(turn)[..., None] * first + np.sin(turn)[..., None] * second
        return np.asarray(np.asarray(length)[..., None] * flat, dtype=np.float64)

    curve = at(angle[:, None] * np.linspace(0.0, 1.0, _POINTS), radius)
    back = np.clip(angle, -_TIP, _TIP)  # angle from the arc's end to the foot of its tip
    feet = [at(angle - back, radius * (1 + 0.5 * side * np.abs(back))) for side in (1, -1)]
    tip = np.stack([feet[0], curve[:, -1], feet[1]], axis=1)
    return np.concatenate([curve, tip], axis=1)
