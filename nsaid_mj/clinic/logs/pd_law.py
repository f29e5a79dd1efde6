"""Motors under a PD law of known gains: their torques, from logs of targets and measured motion.

    τ_j = kp_j (q_des − q) + kd_j (q̇_des − q̇) + τ_ff

with the target, the target velocity and the feed-forward torque of the log, which hold from row to
row, and the measured position and velocity. `nsaid identify` takes τ as the motor's command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...base import Finding, InvalidInput, UnknownName
from ...core import Array, Log
from ...robots import RobotModel
from .mapping import ChannelSource, Gains, Pd
from .recordings import Recordings
from .signals import Signal


class PdLaw(NamedTuple):
    """Known gains of n joints, and where the log has what the law adds to the targets."""

    kp: Array  # (n,) stiffness [command's unit per rad or m]: N·m/rad over the file's gain
    kd: Array  # (n,) damping [the same, s per rad or m]
    velocities: tuple[ChannelSource | None, ...]  # (n,) target velocities; None for 0
    forward: tuple[ChannelSource | None, ...]  # (n,) feed-forward torques; None for 0
    gain: Array  # (n,) torque per unit of the motor's command, of the model file

    @property
    def sources(self) -> tuple[ChannelSource, ...]:
        """The channels of target velocities and feed-forward torques."""
        return tuple(filter(None, (*self.velocities, *self.forward)))

    @property
    def feedback(self) -> Array:
        """(2, n) gains of the measured position and velocity in the motors' commands."""
        return np.array([self.kp, self.kd])

    def stated(self, joints: Sequence[str]) -> Finding:
        """How the commands were made, in words and numbers."""
        each = []
        for name, values in (("kp", self.kp * self.gain), ("kd", self.kd * self.gain)):
            alike = float(np.ptp(values)) == 0.0
            shown = [f"{x:g}" for x in (values[:1] if alike else values)]
            each.append(f"{name} = {', '.join(shown)}")
        parts = ["kp (target − position)", "kd (target velocity − velocity)"]
        if not any(self.velocities):
            parts[1] = "− kd · velocity (no target velocities)"
        parts += ["feed-forward"] if any(self.forward) else []
        text = "the commands are torques of the motors' PD law at the measured motion: "
        text += f"{' + '.join(parts).replace('+ −', '−')}, {'; '.join(each)}"
        data = {"joints": list(joints), "kp": self.kp.tolist(), "kd": self.kd.tolist()}
        return Finding("note", "pd_law", "", text, data=data)

    def commands(self, targets: Array, rates: Array, forward: Array, q: Array, v: Array) -> Array:
        """(N, n) commands of the motors, of (N, n) each: targets, their velocities and torques."""
        return self.kp * (targets - q) + self.kd * (rates - v) + forward / self.gain


def known_gains(pd: Pd, robot: RobotModel) -> tuple[Array, Array]:
    """(n,) kp and (n,) kd of a robot's joints, of the map or else of the file's position servos.

    Raises:
        InvalidInput: neither of them states kp, or a list has another length.
        UnknownName: the map names a joint that the robot lacks.
    """
    servos = robot.servos
    driven = [joint for joint in robot.leaders if joint not in robot.passive]
    kp = _in_order("kp", pd.kp, robot.leaders)
    kd = _in_order("kd", pd.kd, robot.leaders)
    if kp is None and servos is None:
        remedy = "Write lines such as `kp = 20` and `kd = 1.5` below `[pd]`: your controller's "
        remedy += "stiffness [N·m/rad] and damping [N·m·s/rad]; one number, a list in the order of "
        remedy += "the joints, or a table by joint."
        raise InvalidInput("map: pd.kp", "the gains of the motors' PD law", "none", remedy)
    of_file = np.zeros((2, len(robot.leaders)))
    if servos is not None:
        of_file[:, [robot.leaders.index(joint) for joint in driven]] = servos.kp, servos.kv
    if kp is not None and kd is None:
        of_file[1] = 0.0  # a law that is stated is stated whole
    return of_file[0] if kp is None else kp, of_file[1] if kd is None else kd


def _in_order(name: str, given: Gains | None, joints: Sequence[str]) -> Array | None:
    """(n,) numbers of all joints; None if none are given."""
    if given is None:
        return None
    if isinstance(given, Mapping):
        for joint in given:
            if joint not in joints:
                raise UnknownName(f"joint in map: pd.{name}", joint, joints)
        lacking = [joint for joint in joints if joint not in given]
        if lacking:
            remedy = f"The robot's joints are {', '.join(joints)}."
            raise InvalidInput(f"map: pd.{name}", "every joint", f"no {lacking[0]}", remedy)
        return np.array([given[joint] for joint in joints], dtype=np.float64)
    numbers = np.atleast_1d(np.asarray(given, dtype=np.float64))
    if len(numbers) not in (1, len(joints)):
        remedy = f"The robot's joints are {', '.join(joints)}."
        expected = f"one number, or one for each of {len(joints)} joints"
        raise InvalidInput(f"map: pd.{name}", expected, f"{len(numbers)} of them", remedy)
    return np.broadcast_to(numbers, (len(joints),)).copy()


def feedback_in(recordings: Recordings) -> Array | None:
    """(2, n) gains kp and kd of a PD law by which measured torques were made; None without one.

    While a target holds, such a torque changes by −kp Δq − kd Δv from row to row; rows in which the
    target steps have little weight. The gains are per unit of the commands, and 0 for joints whose
    commands these changes do not explain.
    """
    law = np.zeros((2, recordings.segments[0].log.u.shape[1]))
    for joint in range(law.shape[1]):
        best = _EVIDENT
        for apart in _APART:
            changes = [_changes(segment.log, joint, apart) for segment in recordings.segments]
            gains, explained = _robust_fit(np.concatenate(changes))
            if explained > best and (gains > 0).all():
                best = explained
                law[:, joint] = gains
    return law if law.any() else None


_EVIDENT = 0.8  # share of a torque's changes that is feedback: .83 to 1 with 14 bits and .02 rad/s
_APART = (1, 2, 3, 4)  # rows: over more of them noise counts less, but more targets step
_FEW = 100  # changes below which no law is told


def _changes(log: Log, joint: int, apart: int) -> Array:
    """(N, 3) changes of −q, −v and u over some rows."""
    each = np.column_stack([-log.q[:, joint], -log.v[:, joint], log.u[:, joint]])
    return np.asarray(each[apart:] - each[:-apart], dtype=np.float64)


def _robust_fit(rows: Array) -> tuple[Array, float]:
    """(k,) coefficients of the last column of (N, k + 1) by the others, with Cauchy weights.

    Also the weighted share of its squares that they explain; 0 for few rows, or constant columns.
    """
    X = rows[:, :-1]
    y = rows[:, -1]
    if len(y) < _FEW or not rows.any(axis=0).all():
        return np.zeros(X.shape[1]), 0.0
    weights = np.ones(len(y))
    found = np.zeros(X.shape[1])
    left = y
    for _ in range(20):
        normal = X.T @ (weights[:, None] * X)
        found = np.asarray(np.linalg.lstsq(normal, X.T @ (weights * y), rcond=None)[0], float)
        left = y - X @ found
        spread = max(1.5 * float(np.median(np.abs(left))), 1e-12)
        weights = 1 / (1 + (left / spread) ** 2)
    return found, 1 - float(weights @ left**2) / float(weights @ y**2)


def held_mean(signal: Signal, t: Array) -> Array:
    """(N,) mean of a signal that holds from row to row, over a step around times t (N,) of a grid.

    It is the held signal without its steps: what a smooth curve through the samples may follow, at
    the same time. A value of the row alone would be half a step early.
    """
    step = (t[-1] - t[0]) / max(len(t) - 1, 1)
    area = np.append(0.0, np.cumsum(signal.x[:-1] * np.diff(signal.t)))

    def integral(at: Array) -> Array:
        row = np.clip(np.searchsorted(signal.t, at + 1e-9, side="right") - 1, 0, None)
        return area[row] + signal.x[row] * (at - signal.t[row])

    return (integral(t + 0.5 * step) - integral(t - 0.5 * step)) / step if step > 0 else signal.x
