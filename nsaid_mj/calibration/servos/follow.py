"""The law `efficient` of a servo: an extended filter of T, f and g from targets and positions.

It needs no velocity. Predictions are those of `simulation`, with exact stick–slip, differentiated
numerically. Unmodelled effects are treated as noise of the command, with the size and the number of
independent samples of the batch fit's residual. Armature and delay are taken from the fit, and so
are kp where gravity does not determine it, and the other joints' motion.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from ...numerics import cache  # noqa: F401 (sets the folder of compiled kernels)
from ...parameters import Array
from .estimate import JointEstimate
from .fit import EFFECTIVE, GRAVITY
from .joint_fits import LEAST, start
from .simulation import NONE, STEP, JointLog, move

_BEGIN = 10.0  # of the first log, whose regression is the filter's start [s]
_SPREAD = np.array([1.0, 2.0, 2.0])  # standard deviations of ln T, ln f, ln g there
_CHANGES = np.array([1e-4, 1e-3, 0.02, 0.02, 0.02])  # of numerical derivatives: q, v, ln θ


class Followed(NamedTuple):
    """A filter at the end of all logs of a joint, in a row."""

    x: Array  # (3,) ln T, ln f, ln g
    deviation: Array  # (3,) their standard deviations; 0 of what is the batch fit's


def follow(
    logs: Sequence[Sequence[JointLog]], fits: Sequence[JointEstimate], used: Array
) -> tuple[Followed, ...]:
    """The filters of all joints, from logs and batch fit of each; used (N,) marks what counts."""
    starts = np.empty((len(logs), 3))
    for j, (first, *_) in enumerate(logs):
        count = int(np.searchsorted(first.t, first.t[0] + _BEGIN))
        rows = {name: getattr(first, name)[:count] for name in first._fields[:5]}
        starts[j] = np.log(start([first._replace(**rows)])[:3])
    determined = starts[:, GRAVITY] > np.log(2 * LEAST[GRAVITY])
    if determined.any():  # servos of an arm are alike
        starts[~determined, GRAVITY] = starts[determined, GRAVITY].mean()
    return tuple(
        _followed(own, fit, x, used) for own, fit, x in zip(logs, fits, starts, strict=True)
    )


def _followed(logs: Sequence[JointLog], fit: JointEstimate, x: Array, used: Array) -> Followed:
    """The filter of one joint, from ln T, ln f, ln g (3,)."""
    theta, inertia = fit.theta.copy(), np.concatenate([log.inertia for log in logs])
    J = theta[3] + theta[GRAVITY] * float(inertia.mean())
    power = np.pi / 2 * fit.error**2 / fit.effective  # density of the residual [rad²·s]
    x, P = np.r_[0.0, 0.0, x], np.diag(np.r_[0.0, 0.0, _SPREAD**2])
    if not fit.gravity:
        x[2 + GRAVITY], P[2 + GRAVITY] = fit.x[GRAVITY], 0.0
    begin = 0
    for log in logs:
        counts, h = used[begin : begin + len(log.t)], float(np.median(np.diff(log.t)))
        begin += len(log.t)
        x[:2], P[:2], P[:, :2] = (log.position[0], 0.0), 0.0, 0.0
        P[0, 0] = noise = power / h
        _follow(*log, log.own(theta), x, P, counts, noise, power / (EFFECTIVE * h) / J**2)
    return Followed(x[2:], np.sqrt(np.diag(P)[2:]))


@njit(cache=True)
def _follow(t, target, position, load, inertia, limit, stiffer, theta, x, P, used, noise, power):
    """Predicts and corrects at every sample; x (5,) is q, v, ln T, ln f, ln g, P (5, 5) is of it.

    `noise` is the variance of a position [rad²], `power` the density of accelerations [rad²/s³].
    Loops over P compile six times as fast as products of matrices.
    """
    held, ends, F = 0, np.empty((2, 2)), np.empty((2, 5))
    last, spare, own = theta.copy(), np.empty(len(t)), (t, target, load, inertia, limit)
    for i in range(len(t)):
        if i:
            for k in range(5):
                for side in range(2):
                    y = x.copy()
                    y[k] += _CHANGES[k] * (1 - 2 * side)
                    last[:3] = np.exp(y[2:]) / stiffer
                    ends[side, 0], ends[side, 1], _ = move(
                        *own, last, NONE, STEP, i - 1, i, held, y[0], y[1], spare
                    )
                for j in range(2):
                    F[j, k] = (ends[0, j] - ends[1, j]) / (2 * _CHANGES[k])
            last[:3] = np.exp(x[2:]) / stiffer
            x[0], x[1], held = move(*own, last, NONE, STEP, i - 1, i, held, x[0], x[1], spare)
            _propagate(F, P)
            h = t[i] - t[i - 1]
            P[0, 0] += power * h**3 / 3
            P[0, 1] += power * h * h / 2
            P[1, 0] += power * h * h / 2
            P[1, 1] += power * h
            if used[i] > 0:
                row, variance, off = P[0].copy(), P[0, 0] + noise, position[i] - x[0]
                for j in range(5):
                    x[j] += row[j] / variance * off
                    for k in range(5):
                        P[j, k] -= row[j] * row[k] / variance


@njit(cache=True)
def _propagate(F, P):
    """P (5, 5) of the next sample: q and v change by F (2, 5), the parameters do not."""
    top = np.zeros((2, 5))
    for i in range(2):
        for j in range(5):
            for k in range(5):
                top[i, j] += F[i, k] * P[k, j]
    for i in range(2):
        for j in range(5):
            P[i, j] = P[j, i] = top[i, j]
    for i in range(2):
        for j in range(2):
            P[i, j] = 0.0
            for k in range(5):
                P[i, j] += top[i, k] * F[j, k]
