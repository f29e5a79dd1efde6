"""What all past data say about θ, as statistics of constant size.

Every row i of the momentum balance (`momentum`), averaged over short blocks, enters a Gramian
G_i (p, p). The scores of blocks that follow an estimate show its uncertainty.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...log import Log, Measurement, SensorLevels
from ...parameters import Array
from ...quotient.gramians import Means
from ...structure.system import SecondOrderSystem
from ..settings import MemoryConfig
from .feedback import FedBack
from .momentum import CORRECTION_TIME, Balance, along, correct_drift, steady_gain

_NEIGHBOURS = 4  # blocks whose residuals may be correlated (Newey and West, Econometrica 55, 1987)
_DETERMINED = 3  # rows per parameter before the residuals' variance can be estimated
_FRESH = 16  # blocks buffered before they enter the means, at most
_PIECE = 64  # steps whose regressors are in memory at once: they fit the cache
_JUDGED = 50  # blocks, at least, before their scores show an estimate's uncertainty


class ResidualView(NamedTuple):
    """An estimate, and the weights of the residuals that it leaves in later blocks."""

    theta: Array  # (p,) the estimate
    rho: Array  # (n,) correlation of its residuals between neighbouring blocks, for every row
    share: Array  # (n,) inverse variance of the residuals' innovations


class Scores(NamedTuple):
    """Scores of the blocks: gradients of ½ residual² under the estimate that preceded them."""

    view: ResidualView | None  # view of the last estimate; None before the first
    latest: Array  # (4, p) scores of the last blocks
    # (p, p) mean of the scores' outer products, summed over neighbouring blocks: the middle of the
    # sandwich covariance
    meat: Array
    count: float  # effective number of blocks in `meat`

    @staticmethod
    def empty(p: int) -> Scores:
        """The scores before any block."""
        return Scores(None, np.zeros((_NEIGHBOURS, p)), np.zeros((p, p)), 0.0)

    def with_blocks(self, fade: float, rows: Array, before: Array) -> Scores:
        """The scores after k further blocks, rows (k, n, p), and before (k, n, p) preceding each.

        Rows and neighbouring blocks may be correlated; `fade` is a block's weight relative to the
        next one's.
        """
        k = len(rows)
        view = self.view
        if view is None or not k:
            return self
        new = rows - view.rho[:, None] * before
        scores = np.matmul((view.share * (new @ view.theta))[:, None], new)[:, 0]
        known = np.concatenate([self.latest, scores])
        together = sum((known[i : i + k] for i in range(1, _NEIGHBOURS + 1)), np.zeros_like(scores))
        weights = fade ** np.arange(k)[::-1]
        old = fade**k * self.count
        count = old + float(weights.sum())
        outer = (weights[:, None] * together).T @ together / _NEIGHBOURS
        return Scores(view, known[k:], (old * self.meat + outer) / count, count)


class Memory(NamedTuple):
    """The statistics of all data up to a sample."""

    step: int  # index of the sample
    balance: Balance  # the momentum balance at the sample
    fresh: Array  # (k, n, p) blocks not yet in the means
    means: Means  # over the blocks
    scores: Scores  # scores of the blocks

    @property
    def sure(self) -> bool:
        """Whether enough blocks followed an estimate to determine its uncertainty."""
        n, p = self.means.last.shape
        return self.scores.count >= max(_JUDGED, _DETERMINED * p / n)


class Recorder:
    """Updates a `Memory` from measurements, `dt` [s] apart, by pure functions.

    `levels` are standard deviations of the sensors' noise; interpolation between samples is cubic
    if `hermite`, else linear. Rows are `exact` if sensors and contacts' places are. There are
    `every` samples between two implicit steps, `block` in a block, whose weight decreases by the
    factor `fade` per block.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        config: MemoryConfig,
        dt: float,
        levels: SensorLevels,
        hermite: bool = True,
    ):
        self.system = system
        self.levels = levels
        self.hermite = hermite
        self.every = max(1, round(config.interval / dt))
        self.block = max(1, round(config.block / dt))
        self._periods = self.every, _FRESH * self.block
        self.fade = float(np.exp(-self.block * dt / config.horizon)) if config.horizon else 1.0
        self._leak, self._gain = 1 / config.window, steady_gain(levels, dt)
        # variances of W_M, of ż, and of ż where it follows the commands, in a block
        drifting = 0.5 * config.window * dt
        self._averaging = 1 / self.block, min(drifting, CORRECTION_TIME * dt), drifting
        self._displaced = _displaced(system)
        self.exact = levels.exact and not self._displaced

    def begin(self, first: Measurement) -> Memory:
        """The empty memory at a first measurement."""
        n = self.system.n
        p = self.system.p
        means = Means.empty(n, p, self.fade)
        return Memory(0, self._balance(first), np.zeros((0, n, p)), means, Scores.empty(p))

    def resume(self, memory: Memory, here: Measurement) -> Memory:
        """The memory at a later sample, without the data in between."""
        means = memory.means._replace(last=np.zeros_like(memory.means.last))
        return memory._replace(balance=self._balance(here), means=means)

    def _balance(self, first: Measurement) -> Balance:
        """The momentum balance that begins at a sample: Y = 0."""
        n = self.system.n
        lag = self.system.momentum(first.q, first.v)
        fed = FedBack.unknown(n, self.system.n_u)
        return Balance(lag, np.zeros(n), np.zeros(n), np.zeros_like(lag), 0, fed)

    def follow(self, memory: Memory, log: Log) -> Memory:
        """The memory at the end of a log that begins at the memory's sample.

        Blocks enter the means together, at the end of every interval or after 16 of them.
        """
        at = 0
        while at < len(log.t) - 1:
            steps = min(period - memory.step % period for period in self._periods)
            piece = log.part(at, at + steps + 1)
            balance, rows = self._balanced(memory.balance, piece)
            memory = memory._replace(
                step=memory.step + len(piece.t) - 1,
                balance=balance,
                fresh=np.concatenate([memory.fresh, rows]),
            )
            if any(memory.step % period == 0 for period in self._periods):
                memory = self.absorb_blocks(memory, piece.at(-1))
            at += steps
        return memory

    def _balanced(self, balance: Balance, log: Log) -> tuple[Balance, Array]:
        """The momentum balance after a log, and (k, n, p) the means of Y over blocks completed."""
        middle = self.system.midpoints(log, self.hermite)
        if not self.levels.exact:
            moves = self.system.moves(log.q)
            balance = balance._replace(
                fed=balance.fed.along(moves, log),
                ahead=balance.ahead.copy(),
                pending=balance.pending.copy(),
            )
            middle = middle._replace(v=middle.v.copy())
            correct_drift(self._gain, log.t, log.v, moves, *balance[1:3], middle.v)
        lag = balance.lag.copy()
        total = balance.total.copy()
        filled = balance.filled
        rows = np.empty(((filled + len(log.t) - 1) // self.block, *lag.shape))
        made = 0
        for at in range(0, len(log.t) - 1, _PIECE):
            piece = log.part(at, at + _PIECE + 1)
            half = middle.part(at, at + _PIECE)
            terms = self.system.momentum_balance(self._leak, piece, *half)
            made, filled = along(
                self._leak, self.block, piece.t, *terms, lag, total, filled, rows, made
            )
        return balance._replace(lag=lag, total=total, filled=filled), rows

    def absorb_blocks(self, memory: Memory, here: Measurement) -> Memory:
        """Merges the buffered blocks, the last of which ends near a sample, into means and scores.

        Blocks count in the scores only once enough others precede them to estimate the residuals'
        variance.
        """
        means = memory.means
        fresh = memory.fresh
        before = np.concatenate([means.last[None], fresh])[:-1]
        n, p = means.last.shape
        blocks = means.blocks
        first = 0
        while first < len(fresh) and blocks * n < _DETERMINED * p:
            blocks = self.fade * blocks + 1
            first = first + 1
        noise = means.noise
        if not self.levels.exact:
            noise = self._noise(here, memory.balance.fed.deviations())
        if self._displaced:
            noise = self._of_contacts(here) + (0.0 if self.levels.exact else noise)
        return memory._replace(
            fresh=fresh[:0],
            scores=memory.scores.with_blocks(self.fade, fresh[first:], before[first:]),
            means=means.with_blocks(fresh, before, noise),
        )

    def _noise(self, here: Measurement, fed: Array) -> Array:
        """(n, p, p) Gramians, one for every row, of the sensor noise in a block near a sample.

        To first order, and with noise that is independent from sample to sample: that of W_M(q, v)
        is averaged over the block, that of ż over the window. Noise fed back by a controller
        excites the plant, but counts as noise of the commands. fed (k, n_u) are deviations of the
        commands, each from an independent noise.
        """
        system = self.system
        n = self.system.n
        k = len(fed)
        count = 2 * n + k + 2
        many = Log.unchecked(*(np.repeat(np.asarray(part)[None], count, 0) for part in here))
        for i, step in enumerate(np.eye(n)):
            many.q[i] = system.integrate(here.q, self.levels.position * step)
            many.v[n + i] += self.levels.velocity * step
        many.u[2 * n : 2 * n + k] += fed
        momenta, rates, *_ = system.momentum_balance(self._leak, many, many.q[1:], many.v[1:])
        momenta = momenta[:-2] - momenta[-1]
        rates = rates[:-1] - rates[-1]
        effects = momenta, rates[: 2 * n], rates[2 * n :]
        rows = [s**0.5 * part for s, part in zip(self._averaging, effects, strict=True)]
        both = np.concatenate(rows).transpose(1, 0, 2)
        return np.matmul(both.transpose(0, 2, 1), both)

    def _of_contacts(self, here: Measurement) -> Array:
        """(n, p, p) Gramians of what inaccurate places of the contacts make of a block.

        To first order, near a sample, and of places that stay wrong as long as the balance's
        window: z follows its right-hand side, divided by a.
        """
        log = Log.unchecked(*(np.repeat(np.asarray(part)[None], 2, 0) for part in here))

        def balance(system: SecondOrderSystem) -> Array:
            momenta, rates, *_ = system.momentum_balance(self._leak, log, log.q[1:], log.v[1:])
            return momenta[0] - rates[0] / self._leak

        right = balance(self.system)
        off = np.array([balance(system) - right for system in self._displaced]).transpose(1, 0, 2)
        return np.matmul(off.transpose(0, 2, 1), off)


def _displaced(system: SecondOrderSystem) -> list[SecondOrderSystem]:
    """The system with one of its contacts, each in turn, `ContactPoint.sinking` away."""
    contacts = system.structure.contacts
    found = []
    for k, contact in enumerate(contacts):
        if contact.sinking:
            higher = replace(contact, radius=contact.radius - contact.sinking)
            moved = (*contacts[:k], higher, *contacts[k + 1 :])
            structure = replace(system.structure, contacts=moved)
            found.append(system.rebuilt(structure, system.space))
    return found
