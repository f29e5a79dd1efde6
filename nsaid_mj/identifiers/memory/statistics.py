"""Statistics of all past data about θ, in constant memory.

Every row i of the momentum balance (`momentum`), averaged over short blocks, enters a Gramian
G_i (p, p).

To first order, sensor noise biases G_i upwards by the Gramian N_i of its own effect on Y. N_i is
estimated by processing the same motion a second time, with an independent draw of noise of the
same level added to the measurements.
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
_DETERMINED = 3  # rows per parameter before the residuals' variance can be estimated
_FRESH = 16  # blocks buffered before they enter the means, at most
_JUDGED = 50  # blocks, at least, before residuals can contradict an estimate
_DRAWS = 32749  # noise samples, used cyclically: a prime, so that no block repeats soon


@config
class MemoryConfig(Config):
    """How past data are kept and used, where the law is `memory`.

    Attributes:
        window: time constant 1/a of the leak in the momentum balance [s].
        block: time over which its rows are averaged [s].
        interval: time between two implicit steps [s].
        pace: κ/μ [1/s], the rate at which a direction converges in which the data carry as much
            information as the barrier; better observed directions converge faster.
        anchor: weight of the divergence from the prior relative to the data; 1 counts the prior as
            one measurement whose error is as large as the prior itself. None is 1 with noisy
            sensors and 0 with exact ones, where unexcited directions simply stay where they are.
            With noisy sensors 0 or a small weight is not recommended: along unexcited directions
            noise alone then moves the estimate, and its scale, which the anchor would hold.
        horizon: time constant of forgetting [s]; 0 never forgets.
        surprise: ratio of squared residuals to their expected value that, exceeded in two
            consecutive intervals, is taken as a change of an actuator: the estimate returns to
            its value before the change, and of the information gathered until then only that
            about the actuators is discarded. 0 disables the test.
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
    """Means over blocks, with exponential forgetting if there is a horizon.

    Attributes:
        fade: factor by which a block's weight decreases per block.
        blocks: effective number of blocks, the sum of their weights.
        gramian: (n, p, p) mean over the blocks of every row's Yᵀ Y.
        lagged: (n, p, p) mean of Yᵀ Y′, symmetrised, with Y′ the preceding block.
        last: (n, p) the last completed block.
        noise: (2, n, p, p) `gramian` and `lagged` of the effect of noise on a block; None where
            sensors are exact.
        last_effect: (n, p) effect of noise on the last block.
    """

    fade: float
    blocks: float
    gramian: Array
    lagged: Array
    last: Array
    noise: Array | None
    last_effect: Array

    def of_innovations(self, rho: Array, own: Array, lagged: Array, last: Array) -> Array:
        """The mean square of the innovation Y − ρ Y′, from sufficient statistics.

        The mean of Y′² is that of Y² without the last block.

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
        """(n, p, p) mean of (Y − ρ Y′)ᵀ (Y − ρ Y′), with ρ (n,) the correlation of neighbours."""
        last = self.last[:, :, None] * self.last[:, None, :]
        return self.of_innovations(rho, self.gramian, self.lagged, last)

    def weighted_sum(self, rho: Array, share: Array) -> Array:
        """(p, p) sum over the rows of `innovations`, weighted by `share` (n,)."""
        again = share * rho**2 / self.fade
        last = (again / max(self.blocks, 1.0))[:, None] * self.last
        return (
            np.tensordot(share + again, self.gramian, 1)
            - np.tensordot(2 * share * rho, self.lagged, 1)
            - self.last.T @ last
        )

    def weighted_noise(self, rho: Array, share: Array) -> Array:
        """(p, p) contribution of noise to `weighted_sum`, with the same arguments."""
        assert self.noise is not None
        own, lagged = self.noise
        whole = np.tensordot(share * (1 + rho**2), own, 1)
        return np.asarray(whole - np.tensordot(2 * share * rho, lagged, 1), dtype=np.float64)

    @staticmethod
    def empty(n: int, p: int, fade: float, noisy: bool) -> Means:
        """The means before any block."""
        flat, cube = np.zeros((n, p)), np.zeros((n, p, p))
        noise = np.zeros((2, n, p, p)) if noisy else None
        return Means(fade, 0.0, cube, cube, flat, noise, flat)

    def with_blocks(
        self, rows: Array, before: Array, effects: Array, effects_before: Array
    ) -> Means:
        """The means after further blocks; arguments are those of `Scores.with_blocks`."""
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

        noise, last_effect = self.noise, self.last_effect
        if noise is not None:
            lagged = mean(noise[1], effects, effects_before)
            noise = np.stack([mean(noise[0], effects, effects), lagged])
            last_effect = effects[-1]
        return Means(
            self.fade,
            blocks,
            mean(self.gramian, rows, rows),
            mean(self.lagged, rows, before),
            rows[-1],
            noise,
            last_effect,
        )


class View(NamedTuple):
    """An estimate, and the weights of the residuals it will leave in later blocks.

    Attributes:
        theta: (p,) the estimate.
        rho: (n,) correlation of its residuals between neighbouring blocks, for every row.
        share: (n,) inverse variance of the residuals' innovations.
    """

    theta: Array
    rho: Array
    share: Array


class Scores(NamedTuple):
    """Scores of the blocks: gradients of ½ residual² under the estimate that preceded them.

    Attributes:
        view: of the last estimate; None before the first.
        latest: (4, p) scores of the last blocks.
        meat: (p, p) mean of the scores' outer products, summed over neighbouring blocks: the
            middle of the sandwich covariance.
        bias: (p,) mean effect of added noise on a score, which estimates that of the sensors'.
        count: effective number of blocks in `meat` and `bias`.
        recent: mean squared residual of the blocks since the last view, relative to what the view
            predicts; and the number of these blocks.
    """

    view: View | None
    latest: Array
    meat: Array
    bias: Array
    count: float
    recent: tuple[float, int]

    @staticmethod
    def empty(p: int) -> Scores:
        """The scores before any block."""
        return Scores(
            None, np.zeros((_NEIGHBOURS, p)), np.zeros((p, p)), np.zeros(p), 0.0, (0.0, 0)
        )

    def with_blocks(
        self, fade: float, rows: Array, before: Array, effects: Array, effects_before: Array
    ) -> Scores:
        """The scores after k further blocks; rows and neighbouring blocks may be correlated.

        Args:
            fade: factor by which a block's weight decreases per block.
            rows: (k, n, p) the blocks.
            before: (k, n, p) the block preceding each.
            effects: (k, n, p) effect of noise on the blocks.
            effects_before: (k, n, p) effect of noise on the preceding blocks.
        """
        k, (mean, number) = len(rows), self.recent
        if self.view is None or not k:
            return self
        theta, rho, share = self.view
        new, effect = rows - rho[:, None] * before, effects - rho[:, None] * effects_before
        residual = new @ theta
        scores = _summed(share * residual, new)
        biases = _summed(share * (effect @ theta), new) + _summed(share * residual, effect)
        known = np.concatenate([self.latest, scores])
        together = sum((known[i : i + k] for i in range(1, _NEIGHBOURS + 1)), np.zeros_like(scores))
        weights, old = fade ** np.arange(k)[::-1], fade**k * self.count
        count = old + float(weights.sum())
        outer = (weights[:, None] * together).T @ together / _NEIGHBOURS
        squares = float(np.sum(np.mean(share * residual**2, axis=1)))
        return Scores(
            view=self.view,
            latest=known[k:],
            meat=(old * self.meat + outer) / count,
            bias=(old * self.bias + weights @ biases) / count,
            count=count,
            recent=((number * mean + squares) / (number + k), number + k),
        )


def _summed(share: Array, rows: Array) -> Array:
    """(k, p) sums over the rows (k, n, p) of blocks, weighted by `share` (k, n)."""
    return np.matmul(share[:, None], rows)[:, 0]


class Trusted(NamedTuple):
    """An estimate that later data have not contradicted.

    Attributes:
        theta: (p,) the estimate.
        plant: (p, p) curvature of R there with the actuators' gains eliminated: the Schur
            complement.
    """

    theta: Array
    plant: Array


class Memory(NamedTuple):
    """The statistics of all data up to a sample.

    Attributes:
        step: index of the sample.
        balance: the momentum balance at the sample.
        perturbed: the balance of the measurements with added noise; None where sensors are exact.
        fresh: (k, n, p) blocks not yet in the means.
        effects: (k, n, p) effect of noise on these blocks; 0 where sensors are exact.
        means: over the blocks.
        scores: of the blocks.
        alarmed: whether the preceding interval contradicted the estimate.
        trusted: the last estimate before any alarm.
        kept: (p, p) information about all parameters but the actuators' that survived the last
            detected change of an actuator; None before the first.
    """

    step: int
    balance: Balance
    perturbed: Balance | None
    fresh: Array
    effects: Array
    means: Means
    scores: Scores
    alarmed: bool = False
    trusted: Trusted | None = None
    kept: Array | None = None


class Recorder:
    """Updates a `Memory` from measurements, by pure functions.

    Args:
        system: the structure.
        config: window, block, interval and horizon.
        dt: time between measurements [s].
        levels: of the sensors' noise.
        hermite: cubic Hermite interpolation between samples; else linear.

    Attributes:
        every: samples between two implicit steps.
        block: samples in a block.
        fade: factor by which a block's weight decreases per block.
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
        """(draws, 2, n) noise of positions and velocities, in their units."""
        unit = np.random.default_rng(0).standard_normal((_DRAWS, 2, self.system.n))
        return unit * np.array(self.levels)[:, None]

    def begin(self, first: Measurement) -> Memory:
        """The empty memory at a first measurement."""
        n, p, exact = self.system.n, self.system.p, self.levels.exact
        perturbed = None if exact else self.rows.begin(*self._perturb(0, first.q, first.v))
        nothing = np.zeros((0, n, p))
        return Memory(
            0,
            self.rows.begin(first.q, first.v),
            perturbed,
            nothing,
            nothing,
            Means.empty(n, p, self.fade, not exact),
            Scores.empty(p),
        )

    def follow(self, memory: Memory, log: Log) -> Memory:
        """The memory at the end of a log that begins at the memory's sample.

        Blocks enter the means together, at the end of every interval or after 16 of them.
        """
        at = 0
        while at < len(log.t) - 1:
            steps = min(period - memory.step % period for period in self._periods)
            memory = self._advance(memory, log.part(at, at + steps + 1))
            if any(memory.step % period == 0 for period in self._periods):
                memory = self.absorb_blocks(memory)
            at += steps
        return memory

    def _advance(self, memory: Memory, log: Log) -> Memory:
        middle = self.system.midpoints(log, self.hermite)
        balance, rows = self.rows.follow(memory.balance, log, middle)
        perturbed, effects = memory.perturbed, np.zeros_like(rows)
        if perturbed is not None:
            noisier = self._perturbed(memory.step, log, middle)
            perturbed, noisier_rows = self.rows.follow(perturbed, *noisier)
            effects = noisier_rows - rows
        return memory._replace(
            step=memory.step + len(log.t) - 1,
            balance=balance,
            perturbed=perturbed,
            fresh=np.concatenate([memory.fresh, rows]),
            effects=np.concatenate([memory.effects, effects]),
        )

    def absorb_blocks(self, memory: Memory) -> Memory:
        """Merges the buffered blocks into means and scores.

        Blocks count in the scores only once enough others precede them to estimate the residuals'
        variance.
        """
        means, fresh, effects = memory.means, memory.fresh, memory.effects
        before = np.concatenate([means.last[None], fresh])[:-1]
        effects_before = np.concatenate([means.last_effect[None], effects])[:-1]
        (n, p), blocks, first = means.last.shape, means.blocks, 0
        while first < len(fresh) and blocks * n < _DETERMINED * p:
            blocks, first = self.fade * blocks + 1, first + 1
        scores = memory.scores.with_blocks(
            self.fade, *(part[first:] for part in (fresh, before, effects, effects_before))
        )
        return memory._replace(
            fresh=fresh[:0],
            effects=fresh[:0],
            scores=scores,
            means=means.with_blocks(fresh, before, effects, effects_before),
            kept=None if memory.kept is None else self.fade ** len(fresh) * memory.kept,
        )

    def check_consistency(self, memory: Memory, here: Measurement) -> tuple[Memory, bool]:
        """Tests an interval's residuals against the estimate that preceded them.

        An interval whose squared residuals exceed `surprise` times their expected value raises an
        alarm. After a second one in a row, under the same view, an actuator counts as changed and
        the data are discarded; only the information about the other parameters from before the
        first alarm is kept. The momentum balance restarts, since its filter still holds motion
        under the old gains.

        Args:
            memory: at the interval's end.
            here: the last measurement.

        Returns:
            The memory; and whether data were discarded.
        """
        scores, (n, p) = memory.scores, memory.means.last.shape
        alarmed = bool(0 < self.surprise < scores.recent[0])
        if memory.trusted is None or not (alarmed and memory.alarmed):
            sure = scores.count >= max(_JUDGED, _DETERMINED * p / n)
            scores = scores._replace(recent=(0.0, 0))
            return memory._replace(scores=scores, alarmed=alarmed and sure), False
        perturbed = memory.perturbed
        if perturbed is not None:
            perturbed = self.rows.restart(perturbed, *self._perturb(memory.step, here.q, here.v))
        changed = Memory(
            memory.step,
            self.rows.restart(memory.balance, here.q, here.v),
            perturbed,
            memory.fresh,
            memory.effects,
            Means.empty(n, p, self.fade, perturbed is not None),
            Scores.empty(p),
            trusted=memory.trusted,
            kept=memory.trusted.plant,
        )
        return changed, True

    def _perturbed(self, step: int, log: Log, middle: Middle) -> tuple[Log, Middle]:
        """The log with added noise, and the states half-way between its samples."""
        system = self.system
        samples = enumerate(zip(log.q, log.v, strict=True))
        states = [self._perturb(step + k, *sample) for k, sample in samples]
        q, v = (np.array(part) for part in zip(*states, strict=True))
        half = [
            system.integrate(there, system.difference(here, mid))
            for there, here, mid in zip(q, log.q, middle.q, strict=False)
        ]
        return Log.unchecked(log.t, q, v, log.u), Middle(np.array(half), 0.5 * (v[:-1] + v[1:]))

    def _perturb(self, step: int, q: Array, v: Array) -> tuple[Array, Array]:
        """A measured state q (m,), v (n,) with added noise of the sensors' level."""
        position, velocity = self._draws[step % _DRAWS]
        return self.system.integrate(q, position), v + velocity
