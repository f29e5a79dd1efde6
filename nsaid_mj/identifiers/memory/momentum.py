"""The momentum balance behind a leak: rows Y with Y θ = 0 for every true θ, without accelerations.

With Ṁ − 2C skew, d/dt(M v) = F θ + Cᵀ v. Behind a leak of rate a the balance needs no acceleration:
with

    ż = −a z + a W_M(q, v) + F + (the regressor of Cᵀ v),    z(t₀) = W_M(q, v)(t₀),

Y = W_M(q, v) − z has Ẏ θ = −a Y θ, so Y θ = 0 for every true θ. It is the momentum balance over a
window that fades with e^{−a t} (docs/theory.md). Sensor noise enters Y through W_M(q, v) nearly
undifferentiated; means over short blocks make it smaller still.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...log import Log, Middle, SensorLevels
from ...parameters import Array
from ...system import SecondOrderSystem

_PAYBACK = 0.1  # in which velocities make up for what positions say they have missed [s]
_PIECE = 64  # steps whose regressors are held at once: they stay in the processor's cache


class Balance(NamedTuple):
    """The momentum balance at a sample, and how far its block is filled.

    Attributes:
        lag: (n, p) z.
        track: (m,) the position that velocities and positions agree on best.
        owed: (n,) by how much the velocities' integral is still behind it [rad or m].
        total: (n, p) sum of Y over the block that is being filled.
        filled: number of samples in it.
    """

    lag: Array
    track: Array
    owed: Array
    total: Array
    filled: int


class Rows:
    """Makes rows of a log: two pure functions over a `Balance`.

    Args:
        system: the structure.
        window: time constant 1/a of the leak [s].
        block: samples in a block.
        dt: time between measurements [s].
        levels: of the sensors' noise.
    """

    def __init__(
        self, system: SecondOrderSystem, window: float, block: int, dt: float, levels: SensorLevels
    ):
        self.system, self.leak, self.block = system, 1 / window, block
        self.trust = steady_gain(levels, dt)

    def begin(self, q: Array, v: Array) -> Balance:
        """The balance at a first sample q (m,), v (n,): Y = 0."""
        lag = self.system._W_M(q, v)
        return Balance(lag, q, np.zeros(self.system.n), np.zeros_like(lag), 0)

    def restart(self, balance: Balance, q: Array, v: Array) -> Balance:
        """The balance at a sample, with nothing of the past behind the leak."""
        lag = self.system._W_M(q, v)
        return balance._replace(lag=lag, total=np.zeros_like(lag), filled=0)

    def follow(self, balance: Balance, log: Log, middle: Middle) -> tuple[Balance, Array]:
        """Goes along a log that begins where the balance stands.

        Args:
            balance: at the first measurement.
            log: N measurements.
            middle: the states half-way between them.

        Returns:
            The balance at the last measurement; and (k, n, p) the means of the blocks that were
            filled on the way.
        """
        if self.trust:
            balance, middle = self._made_up(balance, log, middle)
        lag, total, filled = balance.lag.copy(), balance.total.copy(), balance.filled
        rows = np.empty(((filled + len(log.t) - 1) // self.block, *lag.shape))
        made = 0
        for at in range(0, len(log.t) - 1, _PIECE):
            piece = log.part(at, at + _PIECE + 1)
            half = middle.part(at, at + _PIECE)
            terms = self.system.momentum_balance(self.leak, piece, *half)
            made, filled = along(
                self.leak, self.block, piece.t, *terms, lag, total, filled, rows, made
            )
        return balance._replace(lag=lag, total=total, filled=filled), rows

    def _made_up(self, balance: Balance, log: Log, middle: Middle) -> tuple[Balance, Middle]:
        """Velocities half-way, corrected little by little (a steady Kalman filter).

        Velocities' noise adds up in the integral of what is proportional to them, a position's does
        not: so that integral is made to follow the positions.
        """
        system, track, owed, v = self.system, balance.track, balance.owed, middle.v.copy()
        for k in range(len(log.t) - 1):
            dt = log.t[k + 1] - log.t[k]
            ahead = system.integrate(track, 0.5 * dt * (log.v[k] + log.v[k + 1]))
            missed = self.trust * system.difference(ahead, log.q[k + 1])
            track = system.integrate(ahead, missed)
            paid = min(1.0, dt / _PAYBACK) * owed
            v[k] += 1.5 / dt * paid  # Simpson's rule counts the middle two thirds
            owed = owed + missed - paid
        return balance._replace(track=track, owed=owed), middle._replace(v=v)


@njit(cache=True)
def along(leak, block, t, momenta, start, half, end, lag, total, filled, rows, made):
    """Steps ż by Simpson's rule and takes the means of blocks.

    Args:
        leak: a [1/s].
        block: samples in a block.
        t: (N,) times [s].
        momenta: (N, n, p), and
        start: (N−1, n, p), and
        half: (N−1, n, p), and
        end: (N−1, n, p) as in `SecondOrderSystem.momentum_balance`.
        lag: (n, p) z, which is moved.
        total: (n, p) sum of Y over the block that is being filled, likewise.
        filled: samples in it.
        rows: (k, n, p) means of whole blocks, written from
        made: on.

    Returns:
        How many rows are made; samples in the block that is being filled.
    """
    n, p = lag.shape
    for k in range(t.shape[0] - 1):
        dt = t[k + 1] - t[k]
        fade = np.exp(-0.5 * leak * dt)
        first, second, third = fade * fade * dt / 6, 2 / 3 * dt * fade, dt / 6
        for i in range(n):
            for j in range(p):
                z = fade * fade * lag[i, j] + first * start[k, i, j]
                z += second * half[k, i, j] + third * end[k, i, j]
                lag[i, j] = z
                total[i, j] += momenta[k + 1, i, j] - z
        filled += 1
        if filled == block:
            rows[made] = total / block
            total[:] = 0.0
            made, filled = made + 1, 0
    return made, filled


def steady_gain(levels: SensorLevels, dt: float) -> float:
    """Gain of the steady Kalman filter of a position that noisy velocities carry on; 0 if exact."""
    if levels.velocity == 0:
        return 0.0
    if levels.position == 0:
        return 1.0
    ratio = levels.velocity * dt / levels.position
    return 0.5 * ratio * (np.sqrt(ratio**2 + 4) - ratio)
