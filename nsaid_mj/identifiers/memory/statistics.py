"""What a motion has told about θ so far, in bounded space.

Of every row i of the momentum balance (`balance`), in means over short blocks, the memory keeps the
Gramian G_i (p, p).

Noise makes G_i too large by the Gramian N_i of its own effect on Y, to first order. N_i is had by
watching the same motion a second time, through measurements with as much noise again.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...bounds import Config, NonNegative, Positive, config
from ...log import Log, Measurement, Middle, SensorLevels
from ...parameters import Array
from ...system import SecondOrderSystem
from .momentum import Balance, Rows

_NEIGHBOURS = 4  # blocks whose residuals may be correlated (Newey and West, Econometrica 55, 1987)
_DETERMINED = 3  # rows for each parameter before their residuals say how large they are
_FRESH = 16  # blocks that wait for being taken into the means, at most
_JUDGED = 50  # blocks, at least, before an estimate is old enough to be contradicted
_DRAWS = 32749  # of noise, used again and again: a prime, so that no block repeats soon


@config
class MemoryConfig(Config):
    """How past data are kept and used, where the law is `memory`.

    Attributes:
        window: time constant 1/a of the leak in the momentum balance [s].
        block: time over which its rows are averaged [s].
        interval: between two implicit steps [s].
        pace: κ/μ, at which a direction converges of which the data say as much as the barrier
            does [1/s]; directions that are better seen are faster.
        anchor: weight of the divergence from the prior beside the data; 1 counts the prior as one
            measurement with an error of its own size. None is 1 where sensors are noisy, and 0
            where they are exact: what such data do not tell stays where it is. With noisy sensors
            0 or a weak one is not advised: in directions that nothing moves noise alone then pulls
            the estimate, and with it its scale, which the anchor would have held.
        horizon: time constant of forgetting [s]; 0 remembers all.
        surprise: how many times what was expected the squared residuals must be, in two intervals
            one after the other, for an actuator to count as changed: the estimate goes back to
            where it was before, and of all that was known then only what was known of the
            actuators is forgotten. 0 is never.
    """

    _path = "identifier.memory"

    window: Positive = 0.5
    block: Positive = 0.1
    interval: Positive = 0.5
    pace: Positive = 10.0
    anchor: NonNegative | None = None
    horizon: NonNegative = 0.0
    surprise: NonNegative = 9.0

    def weight(self, levels: SensorLevels) -> float:
        """The anchor's weight with these sensors."""
        return self.anchor if self.anchor is not None else 0.0 if levels.exact else 1.0


class Means(NamedTuple):
    """Means over blocks, the newest first in weight where something is forgotten.

    Attributes:
        fade: share of a block's weight that is left one block later.
        blocks: number of blocks, less what is forgotten.
        gramian: (n, p, p) mean over the blocks of every row's Yᵀ Y.
        lagged: (n, p, p) mean of Yᵀ Y′, Y′ the block before, made symmetric.
        last: (n, p) the last whole block.
        noise: (2, n, p, p) `gramian` and `lagged` of what noise does to a block; None where sensors
            are exact.
        stirred: (n, p) what it has done to the last block.
    """

    fade: float
    blocks: float
    gramian: Array
    lagged: Array
    last: Array
    noise: Array | None
    stirred: Array

    def of_innovations(self, rho: Array, own: Array, lagged: Array, last: Array) -> Array:
        """The mean square of Y − ρ Y′, whose mean square Y′² is that of Y without the last block.

        Args:
            rho: (n,) correlation of neighbouring blocks.
            own: (n, ...) mean of Y².
            lagged: (n, ...) mean of Y Y′.
            last: (n, ...) square of the last block.
        """
        r = rho.reshape(-1, *(1,) * (own.ndim - 1))
        again = r**2 / self.fade
        return (1 + again) * own - 2 * r * lagged - again / max(self.blocks, 1.0) * last

    def innovations(self, rho: Array) -> Array:
        """(n, p, p) mean of (Y − ρ Y′)ᵀ (Y − ρ Y′), ρ (n,) the correlation of neighbours."""
        last = self.last[:, :, None] * self.last[:, None, :]
        return self.of_innovations(rho, self.gramian, self.lagged, last)

    def gathered(self, rho: Array, share: Array) -> Array:
        """(p, p) sum of the innovations of all rows, each times its share (n,)."""
        again = share * rho**2 / self.fade
        last = (again / max(self.blocks, 1.0))[:, None] * self.last
        return (
            np.tensordot(share + again, self.gramian, 1)
            - np.tensordot(2 * share * rho, self.lagged, 1)
            - self.last.T @ last
        )

    def gathered_noise(self, rho: Array, share: Array) -> Array:
        """(p, p) what noise has made of that."""
        assert self.noise is not None
        own, lagged = self.noise
        whole = np.tensordot(share * (1 + rho**2), own, 1)
        return np.asarray(whole - np.tensordot(2 * share * rho, lagged, 1), dtype=np.float64)

    @staticmethod
    def empty(n: int, p: int, fade: float, noisy: bool) -> Means:
        """Means of no block."""
        flat, cube = np.zeros((n, p)), np.zeros((n, p, p))
        noise = np.zeros((2, n, p, p)) if noisy else None
        return Means(fade, 0.0, cube, cube, flat, noise, flat)

    def with_blocks(self, rows: Array, before: Array, stirs: Array, earlier: Array) -> Means:
        """The means with further blocks; arguments are those of `Scores.with_blocks`."""
        if not len(rows):
            return self
        weights = self.fade ** np.arange(len(rows))[::-1]
        old = self.fade ** len(rows) * self.blocks
        blocks = old + weights.sum()
        share = weights[:, None, None] / blocks

        def mean(kept: Array, one: Array, other: Array) -> Array:
            half = np.matmul((share * one).transpose(1, 2, 0), other.transpose(1, 0, 2))
            half += half.transpose(0, 2, 1)
            half *= 0.5
            half += old / blocks * kept
            return half

        noise, stirred = self.noise, self.stirred
        if noise is not None:
            noise = np.stack([mean(noise[0], stirs, stirs), mean(noise[1], stirs, earlier)])
            stirred = stirs[-1]
        return Means(
            self.fade, blocks, mean(self.gramian, rows, rows), mean(self.lagged, rows, before),
            rows[-1], noise, stirred,
        )  # fmt: skip


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


class Scores(NamedTuple):
    """How the blocks have contradicted the estimates that were there before them.

    Attributes:
        view: of the last estimate that was made; None where there is none yet.
        latest: (4, p) gradients of the last blocks' squared residuals, halved, under it.
        meat: (p, p) mean of their outer products, neighbours together.
        bias: (p,) mean of what more noise does to a score: the sensors' noise has done as much.
        count: number of blocks in both, less what is forgotten.
        recent: mean square of the residuals of the blocks since the last view, over what it
            expected; and how many they are.
    """

    view: View | None
    latest: Array
    meat: Array
    bias: Array
    count: float
    recent: tuple[float, int]

    @staticmethod
    def empty(p: int) -> Scores:
        """Of no block."""
        return Scores(
            None, np.zeros((_NEIGHBOURS, p)), np.zeros((p, p)), np.zeros(p), 0.0, (0.0, 0)
        )

    def with_blocks(
        self, fade: float, rows: Array, before: Array, stirs: Array, earlier: Array
    ) -> Scores:
        """The scores with further blocks; rows and neighbouring blocks may correlate.

        Args:
            fade: as in `Means`.
            rows: (k, n, p) the blocks.
            before: (k, n, p) the ones before them.
            stirs: (k, n, p) what noise has done to the blocks.
            earlier: (k, n, p) … and to the ones before.
        """
        k, (mean, number) = len(rows), self.recent
        if self.view is None or not k:
            return self
        theta, rho, share = self.view
        new, stir = rows - rho[:, None] * before, stirs - rho[:, None] * earlier
        residual = new @ theta
        scores = _summed(share * residual, new)
        biases = _summed(share * (stir @ theta), new) + _summed(share * residual, stir)
        known = np.concatenate([self.latest, scores])
        together = sum((known[i : i + k] for i in range(1, _NEIGHBOURS + 1)), np.zeros_like(scores))
        weights, old = fade ** np.arange(k)[::-1], fade**k * self.count
        count = old + float(weights.sum())
        outer = (weights[:, None] * together).T @ together / _NEIGHBOURS
        return Scores(
            self.view, known[k:], (old * self.meat + outer) / count,
            (old * self.bias + weights @ biases) / count, count,
            ((number * mean + float(np.sum(np.mean(share * residual**2, axis=1)))) / (number + k),
             number + k),
        )  # fmt: skip


def _summed(share: Array, rows: Array) -> Array:
    """(k, p) sums of the rows (k, n, p) of blocks, each times its share (k, n)."""
    return np.matmul(share[:, None], rows)[:, 0]


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
        shaken: the same balance seen through more noise; None where sensors are exact.
        fresh: (k, n, p) blocks that are not in the means yet.
        stirs: (k, n, p) what noise has done to them; 0 where sensors are exact.
        means: over the blocks.
        scores: of the blocks.
        alarmed: whether the interval before has surprised.
        trusted: the last estimate before any alarm.
        kept: (p, p) what was known of all but the actuators when they were doubted last.
    """

    step: int
    balance: Balance
    shaken: Balance | None
    fresh: Array
    stirs: Array
    means: Means
    scores: Scores
    alarmed: bool = False
    trusted: Trusted | None = None
    kept: Array | None = None


class Recorder:
    """Keeps a `Memory` up to date: pure functions.

    Args:
        system: the structure.
        config: window, block, interval and horizon.
        dt: time between measurements [s].
        levels: of the sensors' noise.
        hermite: how the state between samples is had; see `NullspaceAID.interpolation`.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        config: MemoryConfig,
        dt: float,
        levels: SensorLevels,
        hermite: bool = True,
    ):
        self.system, self.levels, self.hermite = system, levels, hermite
        self.surprise, self.every = config.surprise, max(1, round(config.interval / dt))
        self.block = max(1, round(config.block / dt))
        self._periods = self.every, _FRESH * self.block
        self.rows = Rows(system, config.window, self.block, dt, levels)
        self.fade = float(np.exp(-self.block * dt / config.horizon)) if config.horizon else 1.0

    @cached_property
    def _draws(self) -> Array:
        """(draws, 2, n) noise of positions and of velocities."""
        unit = np.random.default_rng(0).standard_normal((_DRAWS, 2, self.system.n))
        return unit * np.array(self.levels)[:, None]

    def begin(self, first: Measurement) -> Memory:
        """A memory at the first measurement: of nothing."""
        n, p, exact = self.system.n, self.system.p, self.levels.exact
        shaken = None if exact else self.rows.begin(*self._shake(0, first.q, first.v))
        nothing = np.zeros((0, n, p))
        return Memory(
            0, self.rows.begin(first.q, first.v), shaken, nothing, nothing,
            Means.empty(n, p, self.fade, not exact), Scores.empty(p),
        )  # fmt: skip

    def follow(self, memory: Memory, log: Log) -> Memory:
        """The memory at the end of a log that begins where the memory stands.

        Blocks are taken into the means at the end of every interval, or of every 16, together.
        """
        at = 0
        while at < len(log.t) - 1:
            steps = min(period - memory.step % period for period in self._periods)
            memory = self._go(memory, log.part(at, at + steps + 1))
            if any(memory.step % period == 0 for period in self._periods):
                memory = self.absorb_blocks(memory)
            at += steps
        return memory

    def _go(self, memory: Memory, log: Log) -> Memory:
        middle = self.system.midpoints(log, self.hermite)
        balance, rows = self.rows.follow(memory.balance, log, middle)
        shaken, stirs = memory.shaken, np.zeros_like(rows)
        if shaken is not None:
            shaken, twins = self.rows.follow(shaken, *self._shaken(memory.step, log, middle))
            stirs = twins - rows
        return memory._replace(
            step=memory.step + len(log.t) - 1, balance=balance, shaken=shaken,
            fresh=np.concatenate([memory.fresh, rows]), stirs=np.concatenate([memory.stirs, stirs]),
        )  # fmt: skip

    def absorb_blocks(self, memory: Memory) -> Memory:
        """Takes what is fresh into means and scores.

        A score needs so many blocks before it that their residuals say how large they are.
        """
        means, fresh, stirs = memory.means, memory.fresh, memory.stirs
        before = np.concatenate([means.last[None], fresh])[:-1]
        earlier = np.concatenate([means.stirred[None], stirs])[:-1]
        (n, p), blocks, first = means.last.shape, means.blocks, 0
        while first < len(fresh) and blocks * n < _DETERMINED * p:
            blocks, first = self.fade * blocks + 1, first + 1
        scores = memory.scores.with_blocks(
            self.fade, *(part[first:] for part in (fresh, before, stirs, earlier))
        )
        return memory._replace(
            fresh=fresh[:0], stirs=fresh[:0], scores=scores,
            means=means.with_blocks(fresh, before, stirs, earlier),
            kept=None if memory.kept is None else self.fade ** len(fresh) * memory.kept,
        )  # fmt: skip

    def check_consistency(self, memory: Memory, here: Measurement) -> tuple[Memory, bool]:
        """The memory at the end of an interval, alarmed if the interval contradicts it.

        If the interval before did as well, and from the same view, the data are forgotten.
        What stays is what had been known, before the first of them, of all but the actuators. The
        balance begins anew: behind the leak there is motion under the old gains.

        Args:
            memory: at the interval's end.
            here: the last measurement.

        Returns:
            The memory; and whether data have been forgotten.
        """
        scores, (n, p) = memory.scores, memory.means.last.shape
        alarmed = bool(0 < self.surprise < scores.recent[0])
        if memory.trusted is None or not (alarmed and memory.alarmed):
            sure = scores.count >= max(_JUDGED, _DETERMINED * p / n)
            scores = scores._replace(recent=(0.0, 0))
            return memory._replace(scores=scores, alarmed=alarmed and sure), False
        shaken = memory.shaken
        if shaken is not None:
            shaken = self.rows.restart(shaken, *self._shake(memory.step, here.q, here.v))
        return Memory(
            memory.step, self.rows.restart(memory.balance, here.q, here.v), shaken,
            memory.fresh, memory.stirs, Means.empty(n, p, self.fade, shaken is not None),
            Scores.empty(p), trusted=memory.trusted, kept=memory.trusted.plant,
        ), True  # fmt: skip

    def _shaken(self, step: int, log: Log, middle: Middle) -> tuple[Log, Middle]:
        """The log with as much noise again, and the states half-way between its samples."""
        system = self.system
        q, v = (np.array(part) for part in zip(
            *(self._shake(step + k, *row) for k, row in enumerate(zip(log.q, log.v, strict=True))),
            strict=True,
        ))  # fmt: skip
        half = [system.integrate(there, system.difference(here, mid))
                for there, here, mid in zip(q, log.q, middle.q, strict=False)]  # fmt: skip
        return Log.unchecked(log.t, q, v, log.u), Middle(np.array(half), 0.5 * (v[:-1] + v[1:]))

    def _shake(self, step: int, q: Array, v: Array) -> tuple[Array, Array]:
        """A measured state with as much noise again."""
        position, velocity = self._draws[step % _DRAWS]
        return self.system.integrate(q, position), v + velocity
