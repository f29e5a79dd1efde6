"""What a motion has told about θ so far, without accelerations and in bounded space.

With Ṁ − 2C skew, d/dt(M v) = F θ + Cᵀ v. Behind a leak of rate a the momentum balance needs no
acceleration: with

    ż = −a z + a W_M(q, v) + F + (the regressor of Cᵀ v),    z(t₀) = W_M(q, v)(t₀),

Y = W_M(q, v) − z has Ẏ θ = −a Y θ, so Y θ = 0 for every true θ. It is the momentum balance over a
window that fades with e^{−a t} (docs/theory.md). Sensor noise enters Y through W_M(q, v) nearly
undifferentiated; means over short blocks make it smaller still. Of every row i of these means
the memory keeps the Gramian G_i (p, p), and nothing else that grows with time.

Noise makes G_i too large by the Gramian N_i of its own effect on Y, to first order. N_i is had by
watching the same motion a second time, through measurements with as much noise again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..errors import InvalidInput
from ..parameters import Array
from ..system import EXACT, Measurement, SecondOrderSystem, SensorLevels

_NEIGHBOURS = 4  # blocks whose residuals may be correlated (Newey and West, Econometrica 55, 1987)
_DETERMINED = 3  # rows for each parameter before their residuals say how large they are
_JUDGED = 50  # blocks, at least, before an estimate is old enough to be contradicted
_PAYBACK = 0.1  # in which velocities make up for what positions say they have missed [s]
_DRAWS = 32749  # of noise, used again and again: a prime, so that no block repeats soon


@dataclass(frozen=True)
class MemoryConfig:
    """How past data are kept and used, where the law is `memory`.

    Attributes:
        window: time constant 1/a of the leak in the momentum balance [s].
        block: time over which its rows are averaged [s].
        interval: between two implicit steps [s].
        pace: κ/μ, at which a direction converges of which the data say as much as the barrier
            does [1/s]; directions that are better seen are faster.
        anchor: weight of the divergence from the prior beside the data; 1 counts the prior as one
            measurement with an error of its own size. None is 1 where sensors are noisy, and 0
            where they are exact: what such data do not tell stays where it is.
        horizon: time constant of forgetting [s]; 0 remembers all.
        surprise: how many times what was expected the squared residuals must be, in two intervals
            one after the other, for an actuator to count as changed: the estimate goes back to
            where it was before, and of all that was known then only what was known of the
            actuators is forgotten. 0 is never.
    """

    window: float = 0.5
    block: float = 0.1
    interval: float = 0.5
    pace: float = 10.0
    anchor: float | None = None
    horizon: float = 0.0
    surprise: float = 9.0

    def __post_init__(self) -> None:
        for name, value in (("window", self.window), ("block", self.block),
                            ("interval", self.interval), ("pace", self.pace)):  # fmt: skip
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"memory.{name}", "a finite number > 0", value, "See its help.")
        for name, value in (("anchor", self.weight(EXACT)), ("horizon", self.horizon),
                            ("surprise", self.surprise)):  # fmt: skip
            if not (np.isfinite(value) and value >= 0):
                raise InvalidInput(f"memory.{name}", "a finite number ≥ 0", value, "0 is none.")

    def weight(self, levels: SensorLevels) -> float:
        """The anchor's weight with these sensors."""
        return self.anchor if self.anchor is not None else 0.0 if levels.exact else 1.0


class Balance(NamedTuple):
    """The momentum balance behind a leak, at one sample.

    Attributes:
        lag: (n, p) z.
        momentum: (n, p) W_M(q, v).
        drive: (n, p) a W_M(q, v) and the regressor of Cᵀ v: of ż, what no command changes.
        track: (m,) the position that velocities and positions agree on best.
        owed: (n,) by how much the velocities' integral is still behind it [rad or m].
    """

    lag: Array
    momentum: Array
    drive: Array
    track: Array
    owed: Array


class View(NamedTuple):
    """An estimate, and how it weighs what comes in after it.

    Attributes:
        theta: (p,) the estimate.
        rho: (n,) correlation of its residuals in neighbouring blocks, for every row.
        share: (n,) one over the variance of what is new in them.
    """

    theta: Array
    rho: Array
    share: Array


class Trusted(NamedTuple):
    """An estimate that no later data have contradicted yet.

    Attributes:
        theta: (p,) the estimate.
        plant: (p, p) the curvature of R there, whatever the actuators' gains: its Schur complement.
    """

    theta: Array
    plant: Array


class Memory(NamedTuple):
    """What is kept of all data up to a sample.

    Attributes:
        step: number of the sample.
        balance: the momentum balance there.
        total: (n, p) sum of Y over the block that is being filled.
        blocks: number of blocks, less what is forgotten.
        gramian: (n, p, p) mean over the blocks of every row's Yᵀ Y.
        lagged: (n, p, p) mean of Yᵀ Y′, Y′ the block before, made symmetric.
        last: (n, p) the last whole block.
        shaken: the same balance seen through more noise; None where sensors are exact.
        spread: (n, p) sum of its Y less that without the added noise.
        noise: (2, n, p, p) `gramian` and `lagged` of what noise does to a block; None likewise.
        stirred: (n, p) what it has done to the last block.
        view: of the last estimate that was made of this memory.
        scores: (4, p) gradients of the last blocks' squared residuals, halved, under it.
        meat: (p, p) mean of their outer products, neighbours together.
        bias: (p,) mean of what more noise does to a score: the sensors' noise has done as much.
        scored: number of blocks in both, less what is forgotten.
        recent: mean square of the residuals of the blocks since the last view, over what it
            expected; and how many they are.
        alarmed: whether the interval before has surprised.
        before: (n, p, p) mean of Y′ᵀ Y′, of the blocks that had a successor.
        trusted: the last estimate before any alarm.
        kept: (p, p) what was known of all but the actuators when they were doubted last.
    """

    step: int
    balance: Balance
    total: Array
    blocks: float
    gramian: Array
    lagged: Array
    last: Array
    shaken: Balance | None
    spread: Array
    noise: Array | None
    stirred: Array
    view: View | None
    scores: Array
    meat: Array
    bias: Array
    scored: float
    recent: tuple[float, int]
    alarmed: bool
    before: Array
    trusted: Trusted | None
    kept: Array | None


class Recorder:
    """Keeps a `Memory` up to date: two pure functions.

    Args:
        system: the structure.
        config: window, block and horizon.
        dt: time between measurements [s].
        levels: of the sensors' noise.
    """

    def __init__(
        self, system: SecondOrderSystem, config: MemoryConfig, dt: float, levels: SensorLevels
    ):
        self.system, self.leak, self.levels = system, 1 / config.window, levels
        self.surprise = config.surprise
        self.trust = _steady_gain(levels, dt)
        self.block = max(1, round(config.block / dt))
        self.kept = np.exp(-self.block * dt / config.horizon) if config.horizon else 1.0

    @cached_property
    def _draws(self) -> Array:
        """(draws, 2, n) noise of positions and of velocities."""
        unit = np.random.default_rng(0).standard_normal((_DRAWS, 2, self.system.n))
        return unit * np.array(self.levels)[:, None]

    def begin(self, first: Measurement) -> Memory:
        """A memory at the first measurement: of nothing."""
        q, v = first.q, first.v
        shaken = None if self.levels.exact else self._balance(*self._shake(0, q, v))
        return self._nothing(self._balance(q, v), shaken)

    def _nothing(self, balance: Balance, shaken: Balance | None) -> Memory:
        """A memory of nothing, at these balances."""
        n, p = self.system.n, self.system.p
        flat, cube = np.zeros((n, p)), np.zeros((n, p, p))
        return Memory(
            step=0, balance=balance, total=flat, blocks=0.0, gramian=cube, lagged=cube, last=flat,
            shaken=shaken, spread=flat, noise=None if shaken is None else np.stack([cube, cube]),
            stirred=flat, view=None, scores=np.zeros((_NEIGHBOURS, p)), meat=np.zeros((p, p)),
            bias=np.zeros(p), scored=0.0, recent=(0.0, 0), alarmed=False, before=cube,
            trusted=None, kept=None,
        )  # fmt: skip

    def add(
        self,
        memory: Memory,
        previous: Measurement,
        middle: tuple[Array, Array],
        following: Measurement,
    ) -> Memory:
        """The memory one sample later; `middle` is (q, v) half-way, the command is held."""
        step = memory.step + 1
        balance = self._advance(memory.balance, previous, middle, following)
        Y = balance.momentum - balance.lag
        shaken, spread = memory.shaken, memory.spread
        if shaken is not None:
            (t, q, v, u), (q0, v0) = following, self._shake(step - 1, *previous[1:3])
            q1, v1 = self._shake(step, q, v)
            dq = self.system.difference(previous.q, middle[0])
            half = self.system.integrate(q0, dq), 0.5 * (v0 + v1)
            shaken = self._advance(
                shaken, Measurement(previous.t, q0, v0, previous.u), half, Measurement(t, q1, v1, u)
            )
            spread = spread + (shaken.momentum - shaken.lag - Y)
        total = memory.total + Y
        memory = memory._replace(
            step=step, balance=balance, total=total, shaken=shaken, spread=spread
        )
        return memory if step % self.block else self._close(memory)

    def _close(self, memory: Memory) -> Memory:
        """Takes the block that is full into the means."""
        row, spread = memory.total / self.block, memory.spread / self.block
        blocks = self.kept * memory.blocks + 1
        share = 1 / blocks
        gramian = memory.gramian + share * (_square(row, row) - memory.gramian)
        lagged = memory.lagged + share * (_square(row, memory.last) - memory.lagged)
        before = memory.before + share * (_square(memory.last, memory.last) - memory.before)
        noise = memory.noise
        if noise is not None:
            now = np.stack([_square(spread, spread), _square(spread, memory.stirred)])
            noise = noise + share * (now - noise)
        nothing = np.zeros_like(row)
        memory = self._score(memory, row, spread)
        return memory._replace(
            total=nothing, blocks=blocks, gramian=gramian, lagged=lagged, last=row,
            spread=nothing, noise=noise, stirred=spread, before=before,
        )  # fmt: skip

    def _score(self, memory: Memory, row: Array, spread: Array) -> Memory:
        """Takes the scatter of a block's score into the mean; so rows and blocks may correlate."""
        n, p = row.shape
        if memory.view is None or memory.blocks * n < _DETERMINED * p:
            return memory
        theta, rho, share = memory.view
        new = row - rho[:, None] * memory.last
        residual = new @ theta
        mean, count = memory.recent
        square = float(np.mean(share * residual**2))
        recent = mean + (square - mean) / (count + 1), count + 1
        scores = np.vstack([memory.scores[1:], (share * residual) @ new])
        stir = spread - rho[:, None] * memory.stirred
        bias = (share * (stir @ theta)) @ new + (share * residual) @ stir
        together, scored = scores.sum(axis=0), self.kept * memory.scored + 1
        square = np.outer(together, together) / _NEIGHBOURS
        return memory._replace(
            scores=scores, scored=scored, meat=memory.meat + (square - memory.meat) / scored,
            bias=memory.bias + (bias - memory.bias) / scored, recent=recent,
        )  # fmt: skip

    def doubt(self, memory: Memory) -> Memory:
        """The memory at the end of an interval: alarmed if the interval contradicts it.

        If the interval before did as well, and from the same view, the data are forgotten.
        What stays is what had been known, before the first of them, of all but the actuators. The
        balance begins anew: behind the leak there is motion under the old gains.
        """
        n, p = memory.last.shape
        alarmed = bool(0 < self.surprise < memory.recent[0])
        sure = memory.scored >= max(_JUDGED, _DETERMINED * p / n)
        if memory.trusted is None or not (alarmed and memory.alarmed):
            return memory._replace(recent=(0.0, 0), alarmed=alarmed and sure)
        balance, shaken = (
            old and old._replace(lag=old.momentum) for old in (memory.balance, memory.shaken)
        )
        assert balance is not None
        return self._nothing(balance, shaken)._replace(
            step=memory.step, trusted=memory.trusted, kept=memory.trusted.plant
        )

    def _balance(self, q: Array, v: Array) -> Balance:
        """The balance at its start: Y = 0."""
        momentum = self.system._W_M(q, v)
        drive = self._drive(q, v, momentum)
        return Balance(momentum, momentum, drive, q, np.zeros(self.system.n))

    def _drive(self, q: Array, v: Array, momentum: Array) -> Array:
        return self.leak * momentum + self.system._transport(q, v)

    def _advance(
        self,
        balance: Balance,
        previous: Measurement,
        middle: tuple[Array, Array],
        following: Measurement,
    ) -> Balance:
        """One step of ż by Simpson's rule.

        Velocities' noise adds up in the integral of what is proportional to them, a position's does
        not: where both are noisy the velocity half-way is corrected, little by little, so that its
        integral follows the position (a steady Kalman filter).
        """
        system, (t, q0, v0, u), (q, v) = self.system, previous, middle
        dt = following.t - t
        fade = np.exp(-0.5 * self.leak * dt)
        track, owed = following.q, balance.owed
        if self.trust:
            ahead = system.integrate(balance.track, 0.5 * dt * (v0 + following.v))
            missed = self.trust * system.difference(ahead, following.q)
            track = system.integrate(ahead, missed)
            paid = min(1.0, dt / _PAYBACK) * owed
            v = v + 1.5 / dt * paid  # Simpson's rule counts the middle two thirds
            owed = owed + missed - paid
        momentum = system._W_M(following.q, following.v)
        drive = self._drive(following.q, following.v, momentum)
        lag = fade * fade * (balance.lag + dt / 6 * (balance.drive + system._F(t, q0, v0, u)))
        half = self._drive(q, v, system._W_M(q, v)) + system._F(t + 0.5 * dt, q, v, u)
        lag += (2 / 3 * dt * fade) * half
        lag += dt / 6 * (drive + system._F(following.t, following.q, following.v, u))
        return Balance(lag, momentum, drive, track, owed)

    def _shake(self, step: int, q: Array, v: Array) -> tuple[Array, Array]:
        """A measured state with as much noise again."""
        position, velocity = self._draws[step % _DRAWS]
        return self.system.integrate(q, position), v + velocity


def _steady_gain(levels: SensorLevels, dt: float) -> float:
    """Gain of the steady Kalman filter of a position that noisy velocities carry on; 0 if exact."""
    if levels.velocity == 0:
        return 0.0
    if levels.position == 0:
        return 1.0
    ratio = levels.velocity * dt / levels.position
    return 0.5 * ratio * (np.sqrt(ratio**2 + 4) - ratio)


def _square(a: Array, b: Array) -> Array:
    """(n, p, p) outer products of the rows of a and b (n, p), made symmetric."""
    half = 0.5 * a[:, :, None] * b[:, None, :]
    return half + half.transpose(0, 2, 1)
