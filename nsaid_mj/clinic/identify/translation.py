"""Logs of a vehicle's rotation without its translation: what is completed, and what is left out.

The equations of roll, pitch and yaw need the linear velocity where it turns the vehicle (Munk's
moment, inertia and lift off the centre of mass). It is taken from the sheet: its equations of
surge, sway and heave are integrated under the measured rotation and commands, along with the depth
where that is measured. What this assumes is told by further fits, with less of that velocity along
one axis each, and widens the intervals. Equations of translation are used only where their
acceleration is measured, and where the unmeasured velocity hardly matters to them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...base import Finding
from ...core import Array, SecondOrderSystem, number
from ...robots import RobotModel
from ..logs.recordings import LogSegment, Recordings
from ..logs.signals import low_pass

ALONE = "rotation_alone"
"""Code of the finding about a log without its translation."""

_UNSURE = 0.3  # least relative deviation of a velocity by the sheet, as of a sheet's drag
_LITTLE = 0.3  # share of an equation's forces that may depend on unmeasured velocities
_STEP = 0.02  # of the integration, at most [s]
_FORGETS = 60.0  # time after which the integration has forgotten its errors [s]
_CARRIED = 0.5  # weight over the actuators' usual force, from which they carry it
_LEAST = 1e-3  # of the largest force of its kind, to which shares are relative at least
_BAND = 5.0  # cut-off of accelerations, for the shares of forces [Hz]
_G = np.array([0.0, 0.0, -9.81])  # gravity along the world's axes [m/s²]


class Completed(NamedTuple):
    """A log of a rotation, completed by the sheet, and what that assumes."""

    recordings: Recordings  # with the linear velocities that the sheet implies
    plain: tuple[Array, ...]  # (N, n) velocities of every segment without what the sheet implies
    shares: Array  # (n,) of every velocity's forces that depend on unmeasured velocities
    used: np.ndarray  # (n,) whether a velocity's equation is used

    def otherwise(self, nrmse: Array) -> list[Recordings]:
        """With less of the unmeasured velocity along one of the body's axes each.

        As much as a sheet's drag may be wrong; or as the errors (n,) of a fit say, which are as
        large as what the velocities make where these are hardly right at all.
        """
        ratio = nrmse[self.used] / np.maximum(self.shares[self.used], 1e-9)
        unsure = float(np.clip(np.nanmax(ratio, initial=_UNSURE), _UNSURE, 1.0))
        found = []
        for axis in range(3):
            segments = []
            for segment, plain in zip(self.recordings.segments, self.plain, strict=True):
                v = segment.log.v.copy()
                v[:, axis] -= unsure * (v - plain)[:, axis]
                segments.append(segment._replace(log=segment.log._replace(v=v)))
            found.append(replace(self.recordings, segments=tuple(segments)))
        return found


def completed(
    system: SecondOrderSystem,
    theta: Array,
    recordings: Recordings,
    acting: Callable[[Array], Array] = lambda u: u,
) -> Completed:
    """A log of a rotation with linear velocities by the forces at θ (p,), and usable equations.

    `acting` gives the commands (N, k) as they act.
    """
    assert recordings.vehicle is not None
    vertical = recordings.vehicle.depth is not None
    whole = [
        _Filled(system, theta, segment, acting(segment.log.u), recordings.rate, vertical)
        for segment in recordings.segments
    ]
    shares = np.sqrt(np.mean([each.shares() ** 2 for each in whole], axis=0))
    used = np.array([k >= 3 for k in range(system.n)])
    felt = recordings.vehicle.acceleration is not None
    used[:3] = [(felt or (vertical and k == 2)) and shares[k] < _LITTLE for k in range(3)]
    segments = tuple(each.whole._replace(usable=each.whole.usable & used) for each in whole)
    plain = tuple(segment.log.v for segment in recordings.segments)
    return Completed(replace(recordings, segments=segments), plain, shares, used)


def acceleration(segment: LogSegment, q: Array, v: Array) -> Array:
    """(N, 3) derivative of the linear velocity along the body's axes, from the specific force."""
    assert segment.specific is not None
    weight = Rotation.from_quat(q[:, 3:]).inv().apply(_G)
    return segment.specific + weight - np.cross(v[:, 3:], v[:, :3])


class _Filled:
    """A segment with linear velocities from a vehicle's forces.

    Attributes:
        whole: the segment with these velocities.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        theta: Array,
        segment: LogSegment,
        u: Array,
        rate: float,
        vertical: bool,
    ):
        self._system = system
        self._segment = segment
        self._u = u
        self._rate = rate
        t, q, v, _ = segment.log
        self._turns = Rotation.from_quat(q[:, 3:]).as_matrix()
        self._theta = self._carrying(theta)
        self._spin = np.gradient(v, 1 / rate, axis=0)
        self._spin[:, :3] = 0.0
        inertia = self._inertia()
        every = max(1, int(rate * _STEP + 1e-9))
        substeps = int(np.ceil(every / (rate * _STEP) - 1e-9))
        h = every / (rate * substeps)
        some = np.arange(0, len(t), every)
        linear = np.zeros((len(some), 3))
        now = v[:1].copy()
        for row, k in enumerate(some.tolist()):
            now[0, 3:] = v[k, 3:]
            if vertical:  # what is measured replaces that part
                rise = self._turns[k, 2] @ (v[k, :3] - now[0, :3])
                now[0, :3] += rise * self._turns[k, 2]
            linear[row] = now[0, :3]
            for _ in range(substeps):
                middle = now.copy()
                middle[0, :3] += 0.5 * h * self._slope(k, now, inertia)
                now[0, :3] += h * self._slope(k, middle, inertia)
        filled = v.copy()
        for axis in range(3):
            filled[:, axis] = np.interp(t, t[some], linear[:, axis])
        self.whole = segment._replace(log=segment.log._replace(v=filled))

    def _carrying(self, theta: Array) -> Array:
        """(p,) θ with actuators that carry the vehicle's weight on average, if they must."""
        t, q, v, _ = self._segment.log
        system = self._system
        none = np.zeros_like(v)
        W = system.regressor(t, np.hstack([q, none]), none, none, self._u)[:, :3]
        at = system.space.actuators
        own = np.zeros(len(theta))
        own[at] = theta[at]
        up = self._turns[:, 2]
        lift = np.sum(W @ own * up, axis=1)
        weight = np.sum(W @ (theta - own) * up, axis=1)
        force = np.linalg.norm(W @ own, axis=1)
        if not abs(weight.mean()) > _CARRIED * np.median(force):
            return theta
        return theta + (max(-weight.mean() / lift.mean(), 0.1) - 1) * own

    def _inertia(self) -> Array:
        """(3, 3) of the mass matrix, by which linear accelerations alone enter W θ."""
        system = self._system
        none = np.zeros((1, system.n))
        x = np.hstack([self._segment.log.q[:1], none])
        u = 0 * self._u[:1]
        columns = [
            (system.regressor(np.zeros(1), x, none, a[None], u) @ self._theta)[0, :3]
            for a in np.vstack([none, np.eye(system.n)[:3]])
        ]
        return np.array(columns[1:]).T - columns[0][:, None]

    def _slope(self, k: int, v: Array, inertia: Array) -> Array:
        """(3,) derivative of the linear velocity at sample k and v (1, n)."""
        own = slice(k, k + 1)
        log = self._segment.log
        back = -v[0, :3] / _FORGETS
        x = np.hstack([log.q[own], v])
        W = self._system.regressor(log.t[own], x, v, self._spin[own], self._u[own])
        return np.asarray(back - np.linalg.solve(inertia, W[0, :3] @ self._theta))

    def shares(self) -> Array:
        """(n,) rms of the forces that unmeasured velocities make, over the actuators' deviation."""
        system = self._system
        at = system.space.actuators
        cut = min(_BAND, self._rate / 5) / (0.5 * self._rate)
        found = []
        for segment in (self.whole, self._segment):
            t, q, v, _ = segment.log
            slow = low_pass(v, cut)
            a = np.gradient(slow, 1 / self._rate, axis=0)
            if segment.specific is not None:
                a[:, :3] = low_pass(acceleration(segment, q, slow), cut)
            found.append(system.regressor(t, np.hstack([q, slow]), slow, a, self._u))
        force = low_pass(found[0][:, :, at] @ self._theta[at], cut)
        change = low_pass((found[0] - found[1]) @ self._theta, cut)
        size = np.std(force, axis=0)
        size = np.maximum(size, _LEAST * np.repeat([size[:3].max(), size[3:].max()], 3))
        return np.sqrt(np.mean(change**2, axis=0)) / np.maximum(size, 1e-300)


def stated(robot: RobotModel, found: Completed) -> list[Finding]:
    """What is identified of such a log, and what that costs."""
    names = robot.system.rate_labels
    used = [name for name, own in zip(names, found.used, strict=True) if own]
    rest = [name for name, own in zip(names, found.used, strict=True) if not own]
    largest = number(float(100 * found.shares[found.used].max()), significant=2)
    text = f"position and linear velocity are not measured: {', '.join(used)} are fitted; "
    text += f"{', '.join(rest)} are left out, with the parameters that act in them alone. What is "
    text += f"fitted depends on the linear velocity by {largest} % of its forces at most: that is "
    text += "computed from the sheet, and intervals allow for errors of 30 % or more"
    remedy = "Log the position or the linear velocity to identify the rest."
    if robot.weighed and not found.used[:3].any():
        text += ". The weighed mass does not act in a rotation, and does not fix its scale"
        remedy = "Give a moment of inertia or a thruster's gain by --known; or log the position or "
        remedy += "the linear velocity."
    shares = dict(zip(names, found.shares.tolist(), strict=True))
    data = {"used": used, "left_out": rest, "share": shares}
    return [Finding("warning", ALONE, "", text, remedy, data)]


def left_out(findings: Sequence[Finding]) -> str:
    """The sentence of a verdict that says of which equations it holds; "" if of all."""
    for finding in findings:
        if finding.code == ALONE:
            parts: Mapping[str, Any] = finding.data
            used, rest = (", ".join(parts[key]) for key in ("used", "left_out"))
            return f"This holds for {used}; {rest} are not measured and cannot be judged."
    return ""
