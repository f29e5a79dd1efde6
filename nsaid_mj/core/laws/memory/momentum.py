"""The filtered momentum balance: rows Y with Y θ = 0 for every true θ, without accelerations.

With Ṁ − 2C skew, d/dt(M v) = F θ + Cᵀ v. A first-order filter of rate a, the leak, removes the
derivative: with

    ż = −a z + a W_M(q, v) + F + (the regressor of Cᵀ v),    z(t₀) = W_M(q, v)(t₀),

Y = W_M(q, v) − z satisfies Ẏ θ = −a Y θ, so Y θ = 0 for every true θ. It is the momentum balance
over a window with exponential weights e^{−a t} (docs/theory.md). Sensor noise enters Y through
W_M(q, v) almost undifferentiated; averaging over short blocks reduces it further.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ...log import SensorLevels
from ...numerics.kernels import cube, f8, i8, kernel, matrix, vector, void
from ...parameters import Array
from .feedback import FedBack

CORRECTION_TIME = 0.1  # time constant with which drift corrections enter the velocities [s]


class Balance(NamedTuple):
    """The momentum balance at a sample, and the block that is being filled."""

    lag: Array  # (n, p) filter state z
    ahead: Array  # (n,) measured position relative to that estimated from positions and velocities
    pending: Array  # (n,) correction of the latter not yet added to the velocities [rad or m]
    total: Array  # (n, p) sum of Y over the current block
    filled: int  # number of samples in the current block
    fed: FedBack  # the sensor noise fed back into the commands


@kernel(void(f8, vector, matrix, matrix, vector, vector, matrix))
def correct_drift(gain, t, v, moves, ahead, pending, middle):
    """Corrects the drift of integrated velocities by the positions, in place.

    Velocity noise accumulates in the integrals of terms proportional to v, position noise does not.
    A steady-state Kalman filter estimates the position from both, and its updates are added to the
    velocities half-way between samples over `CORRECTION_TIME`. The filter's position is as near as
    noise to the measured one, so a body's turn in a step does not affect their difference.

    `gain` is the filter's, 0 for exact velocities; t (N,) in s, v (N, n) and the tangent steps
    moves (N−1, n) are measured. Updated are ahead (n,), the measured position relative to the
    filter's, pending (n,), the correction not yet added, and middle (N−1, n), the velocities
    half-way.
    """
    for k in range(moves.shape[0]):
        dt = t[k + 1] - t[k]
        share = min(1.0, dt / CORRECTION_TIME)
        for i in range(ahead.shape[0]):
            found = ahead[i] + moves[k, i] - 0.5 * dt * (v[k, i] + v[k + 1, i])
            correction = share * pending[i]
            middle[k, i] += 1.5 / dt * correction  # Simpson's rule weighs the middle by two thirds
            pending[i] += gain * found - correction
            ahead[i] = (1.0 - gain) * found


@kernel(types.UniTuple(i8, 2)(f8, i8, vector, cube, cube, cube, cube, matrix, matrix, i8, cube, i8))
def along(leak, block, t, momenta, start, half, end, lag, total, filled, rows, made):
    """Integrates z by Simpson's rule and averages Y over blocks, in place.

    Args:
        leak: a [1/s].
        block: samples in a block.
        t: (N,) times [s].
        momenta: (N, n, p) W_M(q, v), of `SecondOrderSystem.momentum_balance`, as the next three.
        start: (N−1, n, p) right-hand side at the start of every step.
        half: (N−1, n, p) right-hand side half-way.
        end: (N−1, n, p) right-hand side at the end.
        lag: (n, p) z; updated.
        total: (n, p) sum of Y over the current block; updated.
        filled: samples in the current block.
        rows: (k, n, p) buffer for the means of completed blocks.
        made: rows of the buffer already in use.

    Returns:
        The number of rows in use, and of samples in the current block.
    """
    n, p = lag.shape
    for k in range(t.shape[0] - 1):
        dt = t[k + 1] - t[k]
        fade = np.exp(-0.5 * leak * dt)
        first = fade * fade * dt / 6
        second = 2 / 3 * dt * fade
        third = dt / 6
        for i in range(n):
            for j in range(p):
                z = fade * fade * lag[i, j] + first * start[k, i, j]
                z += second * half[k, i, j] + third * end[k, i, j]
                lag[i, j] = z
                total[i, j] += momenta[k + 1, i, j] - z
        filled += 1
        if filled == block:
            for i in range(n):
                for j in range(p):
                    rows[made, i, j] = total[i, j] / block
                    total[i, j] = 0.0
            made = made + 1
            filled = 0
    return made, filled


def steady_gain(levels: SensorLevels, dt: float) -> float:
    """Steady-state Kalman gain in [0, 1] of a position predicted from noisy velocities.

    They are dt [s] apart. The gain is 0 where velocities are exact.
    """
    if levels.velocity == 0:
        return 0.0
    if levels.position == 0:
        return 1.0
    ratio = levels.velocity * dt / levels.position
    return 0.5 * ratio * (np.sqrt(ratio**2 + 4) - ratio)
