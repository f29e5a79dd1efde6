"""Small errors of what a walking robot's rows take for granted: the IMU's place, clock, the feet.

Each has a usual size, which is its prior X. Where x are the errors, e the residuals and C = ∂e/∂x,
x and θ are estimated together, to first order about θ̂:

    S = X⁻¹ + Cᵀ Λ C − Bᵀ A⁻¹ B,   x̂ = −S⁻¹ Cᵀ Λ e,   B = Yᵀ Λ C,   A = Yᵀ Λ Y + prior,

and −A⁻¹ B x is what an error x that remains does to θ̂: a doubt that no length of log removes.

At given contact forces λ̂ an error changes the residual by E (δ(W θ) − δJᵀ λ̂), as E Jᵀ = 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ....base import Finding, pin
from ....core import Array, ContactPoint
from ....lab import INTERVAL
from ...logs.imu import GRAVITY
from ..fit import ConePrior
from ..problem import FitProblem, mean_squares
from ..verdict import FOOT_ELSEWHERE
from .rows import Ground, GroundRows


class OffsetKind(NamedTuple):
    """A kind of error."""

    usual: float  # its standard deviation [SI]
    left: float  # that of what remains after it was estimated, as of an IMU on a soft mount
    step: float  # for differences
    words: str  # what is wrong
    factor: float  # from SI to the unit of messages
    unit: str


KINDS = {
    "clock": OffsetKind(5e-3, 1e-4, 1e-3, "readings are late against the joints'", 1e3, "ms"),
    "place": OffsetKind(0.02, 2e-3, 0.01, "sits elsewhere than the model file says", 1e3, "mm"),
    "turn": OffsetKind(0.02, 3e-3, 0.01, "is turned against the model file", 180 / np.pi, "°"),
    "force": OffsetKind(0.2, 0.05, 0.1, "accelerometer has a bias", 1.0, "m/s²"),
    "at_step": OffsetKind(
        0.5, 0.2, 0.5, "accelerometer is read at the steps of held targets", 1.0, "of a step"
    ),
    "foot": OffsetKind(
        3e-3, 1.5e-3, 1e-3, "touches the ground elsewhere than the model says", 1e3, "mm"
    ),
}
"""Kinds by name; a bias of the gyroscope changes nothing.

What is left of a foot's place is that of simulated robots whose feet were where the model has them.
`at_step` is the share of the base's answer to a step by which readings exceed the mean between two:
1/2 right after slow steps, −1/2 right before them, 0 of a filtered sensor. The answer is that at
the IMU, which a turning base moves, too. Shares of each axis differ by 0.02 to 0.2 of one robot,
and did not make gains truer than a common one.
"""

_ROUNDING = 1e-12  # of the information's largest eigenvalue
_NOTED = 4.0  # standard deviations from 0, and
_LARGE = {"clock": 2e-3, "place": 0.01, "turn": 0.015, "force": 0.2, "at_step": 0.1, "foot": 0.0}
# sizes beyond which an error is allowed for: smaller ones of the IMU are as likely friction's
_TOGETHER = 3e-4
_UNSEEN = 1.5e-3
# standard deviations of the mean error of all feet along an axis [m]: as it is estimated, since
# friction that differs from tanh(v/s) imitates it, and as it is allowed for
_FREE = 0.01  # the same where it is left free, to see how large it seems
_WEIGHT = 0.02
# standard deviation of the mean upward specific force [m/s²], from velocities at the log's ends
_UNMEASURED = 5.0  # times these sizes where no accelerometer tells the base's motion
_HELD = 5e-3
# what remains of the IMU's place where targets step [m]: of simulated robots it was 3 to 11 mm off
_TOLD = 6e-3  # of a foot, from which it is told [m]


class Entry(NamedTuple):
    """One unknown error."""

    kind: str
    axis: int  # of its vector
    foot: int = -1  # number of the foot


def entries_of(rows: GroundRows) -> list[Entry]:
    """All errors of a robot's rows."""
    found = [Entry("clock", 0)]
    kinds = ["place", "turn", "force"]
    if rows.recordings.imu is not None and rows.recordings.imu.accelerometer is None:
        kinds = []
    found += [Entry(kind, axis) for kind in kinds for axis in range(3)]
    if kinds and rows.ground.answer is not None:
        found.append(Entry("at_step", 0))
    for number, foot in enumerate(rows.ground.feet):
        if not foot.flat:  # of a flat foot any point of the link does
            found += [Entry("foot", axis, number) for axis in range(3)]
    return found


def displaced(ground: Ground, entries: list[Entry], x: Array) -> Ground:
    """The ground with errors x (a,) of some entries taken into account."""
    clock = ground.clock
    at_step = ground.at_step
    pose = pin.SE3(ground.imu)
    centres = [np.array(foot.centre, dtype=np.float64) for foot in ground.feet]
    force = ground.force.copy()
    turn = np.zeros(3)
    for entry, value in zip(entries, x.tolist(), strict=True):
        if entry.kind == "clock":
            clock += value
        elif entry.kind == "place":
            pose.translation = pose.translation + value * np.eye(3)[entry.axis]
        elif entry.kind == "turn":
            turn[entry.axis] += value
        elif entry.kind == "force":
            force[entry.axis] += value
        elif entry.kind == "at_step":
            at_step += value
        else:
            centres[entry.foot][entry.axis] += value
    pose.rotation = pose.rotation @ pin.exp3(turn)
    feet = [replace(foot, centre=c) for foot, c in zip(ground.feet, centres, strict=True)]
    return replace(ground, feet=feet, imu=pose, clock=clock, force=force, at_step=at_step)


class Offsets(NamedTuple):
    """Estimated errors."""

    entries: list[Entry]
    value: Array  # (a,) those that are certain and large, else 0
    # (a,) standard deviations of what remains of them, apart from legs of other lengths
    left: Array
    # (a + 1, p) of θ̂ by what remains of them, and by a length of all last links
    changes: Array

    @property
    def of_imu(self) -> Array:
        """(a,) the errors of the IMU alone."""
        return np.where([entry.foot < 0 for entry in self.entries], self.value, 0.0)

    @property
    def at_steps_alone(self) -> bool:
        """Whether of the IMU nothing is wrong but that it is read at the steps of held targets."""
        wrong = np.flatnonzero(self.of_imu)
        return all(self.entries[k].kind == "at_step" for k in wrong)

    def findings(self, feet: Sequence[str]) -> Iterator[Finding]:
        """Large ones that are allowed for, in words; `feet` are names."""
        groups: dict[tuple[str, int], list[int]] = {}
        for k, entry in enumerate(self.entries):
            groups.setdefault((entry.kind, entry.foot), []).append(k)
        for (name, foot), at in groups.items():
            kind = KINDS[name]
            x = self.value[at]
            if not x.any() or (foot >= 0 and np.abs(x).max() < _TOLD):
                continue
            half = np.maximum(INTERVAL * self.left[at] * kind.factor, 0.1)
            pairs = zip(x * kind.factor, half, strict=True)
            numbers = ", ".join(f"{value:.2g} ± {own:.2g}" for value, own in pairs)
            along = " along x, y, z of its link" if len(at) > 1 else ""
            subject = "it" if name in ("place", "turn", "foot") else "its"
            text = f"{subject} {kind.words}, by {numbers} {kind.unit}{along}; the fit allows for it"
            remedy = "Correct the model file or [base] in map.toml, if you know better."
            if foot >= 0:
                remedy = "Measure the legs from the knees to the feet, and correct the model file."
            if name == "at_step":
                remedy = "Log faster than the targets change, or the mean between two steps."
            data = {"value": x.tolist(), "deviation": self.left[at].tolist()}
            where = feet[foot] if foot >= 0 else "IMU"
            code = FOOT_ELSEWHERE if foot >= 0 else f"offset_{name}"
            yield Finding("warning", code, where, text, remedy, data)


def estimated(
    rows: GroundRows, problem: FitProblem, theta: Array, delay: Array, share: Array
) -> Offsets:
    """The errors that the rows show about θ̂ (p,), at share (n,) of `inflation`."""
    entries = entries_of(rows)
    C = _columns(rows, entries, theta, delay)
    residual = problem.residual(theta)
    variance = mean_squares(residual, problem.usable)
    weight = problem.usable / np.maximum(variance * share, 1e-300)
    weight[:, variance == 0] = 0.0
    rooted = (problem.Y * np.sqrt(weight)[:, :, None]).reshape(-1, len(theta))
    A = rooted.T @ rooted + ConePrior(problem).derivatives(theta)[1]
    B = np.einsum("nip,nia->pa", problem.Y, weight[:, :, None] * C)
    scale = 1 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    size, axes = np.linalg.eigh(A * np.outer(scale, scale))
    axes = axes[:, size > _ROUNDING * size[-1]]
    own = axes / size[size > _ROUNDING * size[-1]]
    followed = scale[:, None] * (own @ (axes.T @ (scale[:, None] * B)))
    kinds = [KINDS[entry.kind] for entry in entries]
    usual = np.array([kind.usual for kind in kinds])
    S = np.einsum("nia,nib->ab", C, weight[:, :, None] * C)
    S -= B.T @ followed
    slope = np.einsum("nia,ni->a", C, weight * residual)
    at = [k for k, entry in enumerate(entries) if entry.kind == "force"]
    if at:
        up, excess = at_rest(rows)
        S[np.ix_(at, at)] += np.outer(up, up) / _WEIGHT**2
        slope[at] -= up * excess / _WEIGHT**2
    S = 0.5 * (S + S.T)
    covariance = np.linalg.inv(S + np.linalg.inv(_covariance(entries, usual, _TOGETHER)))
    found = -covariance @ slope
    deviation = np.sqrt(np.diag(covariance))
    value = np.zeros(len(entries))
    measured = any(entry.kind == "force" for entry in entries)
    for name, size in _LARGE.items():
        at = np.array([entry.kind == name for entry in entries])
        least = size if measured else _UNMEASURED * size  # feet that slip imitate a late clock
        if (np.abs(found[at]) > np.maximum(_NOTED * deviation[at], least)).any():
            value[at] = found[at]
    left = np.array([kind.left for kind in kinds])
    if rows.ground.answer is not None:
        left[[entry.kind == "place" for entry in entries]] = _HELD
    feet = value[[entry.kind == "foot" for entry in entries]].reshape(-1, 3)
    off = np.linalg.norm(feet[(np.abs(feet) > _TOLD).any(axis=1)], axis=1)
    # feet that are far off hint at legs of other lengths, which feet together do not tell
    together = max(_UNSEEN, float(np.median(off))) if len(off) else _UNSEEN
    noise = np.diag(deviation**2)
    own = _covariance(entries, left, _UNSEEN) + noise
    remaining = _covariance(entries, left, together) + noise
    length = _lengths(rows, entries, S, slope)
    changes = -np.column_stack([followed @ np.linalg.cholesky(remaining), followed @ length]).T
    return Offsets(entries, value, np.sqrt(np.diag(own)), changes)


def _lengths(rows: GroundRows, entries: Sequence[Entry], S: Array, slope: Array) -> Array:
    """(a,) errors of feet if what they share is a length of all last links, as large as it seems.

    `S` (a, a) is the information of the rows, `slope` (a,) that of the cost. Dry friction that is
    not as modelled imitates such a length by millimetres, so it is no correction, but a doubt.
    """
    usual = np.array([KINDS[entry.kind].usual for entry in entries])
    free = -np.linalg.solve(S + np.linalg.inv(_covariance(entries, usual, _FREE)), slope)
    along = np.zeros(len(entries))
    for k, entry in enumerate(entries):
        if entry.foot >= 0:
            centre = np.asarray(rows.ground.feet[entry.foot].centre, dtype=np.float64)
            along[k] = centre[entry.axis] / max(float(np.linalg.norm(centre)), 1e-9)
    count = sum(entry.foot >= 0 and entry.axis == 0 for entry in entries)
    return along * (along @ free) / max(count, 1)


def at_rest(rows: GroundRows) -> tuple[Array, float]:
    """(3,) the mean upward direction in the IMU's axes, and the bias along it [m/s²].

    A robot that neither falls nor flies away has no mean acceleration, so that its mean upward
    specific force is gravity, whatever its masses are.
    """
    readings = np.concatenate([s.imu for s in rows.segments if s.imu is not None])
    up = Rotation.from_quat(readings[:, :4]).as_matrix()[:, 2]
    force = readings[:, 7:10] - rows.ground.force
    return up.mean(axis=0), float(np.mean(np.sum(up * force, axis=1))) - GRAVITY


def _covariance(entries: Sequence[Entry], deviation: Array, together: float) -> Array:
    """(a, a) prior of errors of deviations (a,); `together` is that of all feet's mean [m]."""
    found = np.diag(deviation**2)
    for axis in range(3):
        at = [k for k, e in enumerate(entries) if e.kind == "foot" and e.axis == axis]
        if at:
            mean = np.full((len(at), len(at)), 1 / len(at))
            own = found[np.ix_(at, at)]
            apart = np.eye(len(at)) - mean
            found[np.ix_(at, at)] = apart @ own @ apart + together**2 * len(at) * mean
    return found


def _columns(rows: GroundRows, entries: list[Entry], theta: Array, delay: Array) -> Array:
    """(N, n, a) derivatives of the filtered residuals by the errors."""
    found = []
    for number, motion in enumerate(rows.motions):
        E = rows.eliminated[number].E
        torque = rows.required(number, theta, delay)
        force = np.einsum("nij,nj->ni", rows.eliminated[number].to_force, torque)
        columns = np.empty((*motion.v.shape, len(entries)))
        moments = _moments(rows, number, force) if any(e.kind == "foot" for e in entries) else {}
        for a, entry in enumerate(entries):
            if entry.kind == "foot":
                change = -moments[entry.foot, entry.axis]
            else:
                step = KINDS[entry.kind].step
                moved = rows.smoothed(number, displaced(rows.ground, [entry], np.array([step])))
                change = (rows.required(number, theta, delay, moved) - torque) / step
            columns[:, :, a] = np.einsum("nij,nj->ni", E, change)
        found.append(rows.chosen.rows(columns))
    return np.concatenate(found)


def _moments(rows: GroundRows, number: int, force: Array) -> dict[tuple[int, int], Array]:
    """(M, n) forces per metre of each foot's force if it acts off along its link's axes."""
    feet = rows.ground.feet
    q = rows.motions[number].q
    flat = [replace(foot, flat=True, radius=0.0) for foot in feet]
    J, places = rows.system.contact_jacobians(flat, q)
    found = {}
    starts = np.cumsum([0, *(foot.rows for foot in feet)])
    for axis in range(3):
        beside: list[ContactPoint] = []
        for foot in flat:
            beside.append(replace(foot, centre=np.asarray(foot.centre) + np.eye(3)[axis]))
        along = rows.system.contact_jacobians(beside, q)[1] - places
        for f in range(len(feet)):
            moment = np.cross(along[:, f], force[:, starts[f] : starts[f] + 3])
            turning = J[:, 6 * f + 3 : 6 * f + 6]
            found[f, axis] = np.einsum("nij,ni->nj", turning, moment)
    return found
