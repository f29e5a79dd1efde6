"""Statistics of all past data about θ, in constant memory.

Every row i of the momentum balance (`momentum`), averaged over short blocks, enters a Gramian
G_i (p, p). Blocks that follow an estimate also test it: their residuals must be no larger than
their own noise and the estimate's uncertainty together explain.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from ...bounds import Config, NonNegative, Positive, config
from ...log import Log, Measurement, SensorLevels
from ...parameters import Array
from ...system import SecondOrderSystem
from .forgetting import forgetting
from .matrices import eliminated
from .momentum import Balance, Rows

_NEIGHBOURS = 4  # blocks whose residuals may be correlated (Newey and West, Econometrica 55, 1987)
_DETERMINED = 3  # rows per parameter before the residuals' variance can be estimated
_FRESH = 16  # blocks buffered before they enter the means, at most
_TOGETHER = 0.25  # share of the horizon whose blocks are forgotten for together
_JUDGED = 50  # blocks, at least, before residuals can contradict an estimate


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
        horizon: time constant of forgetting [s]; 0 never forgets. Information is forgotten only
            in directions in which new data bring as much: what is not excited is kept.
        surprise: ratio of squared innovations to their predicted variance, the estimate's
            uncertainty included, above which an interval contradicts the estimate. If two
            consecutive intervals do, and changed gains of the actuators explain the second one, an
            actuator counts as changed: the estimate returns to its value before the change, and of
            the information gathered until then that about the actuators is discarded. 0 disables
            the test.
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
    """Means over blocks, with directional forgetting if there is a horizon.

    Attributes:
        fade: factor by which information decreases per block where blocks renew it.
        blocks: effective number of blocks.
        gramian: (n, p, p) mean over the blocks of every row's Yᵀ Y.
        lagged: (n, p, p) mean of Yᵀ Y′, symmetrised, with Y′ the preceding block.
        last: (n, p) what is kept of the last completed block; 0 after a restart of the balance.
        noise: (n, p, p) mean of N_i, the expected effect of the sensors' noise on `gramian`.
        recent: (n, p, p) sum of Yᵀ Y since something was last forgotten.
        since: number of blocks in it.
    """

    fade: float
    blocks: float
    gramian: Array
    lagged: Array
    last: Array
    noise: Array
    recent: Array
    since: int = 0

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
        return (1 + r**2) * own - 2 * r * lagged - r**2 / max(self.blocks, 1.0) * last

    def innovations(self, rho: Array) -> Array:
        """(n, p, p) mean of (Y − ρ Y′)ᵀ (Y − ρ Y′), with ρ (n,) the correlation of neighbours."""
        last = self.last[:, :, None] * self.last[:, None, :]
        return self.of_innovations(rho, self.gramian, self.lagged, last)

    @staticmethod
    def empty(n: int, p: int, fade: float) -> Means:
        """The means before any block."""
        flat, cube = np.zeros((n, p)), np.zeros((n, p, p))
        return Means(fade, 0.0, cube, cube, flat, cube, cube)

    def with_blocks(self, rows: Array, before: Array, noise: Array) -> Means:
        """The means after further blocks.

        Args:
            rows: (k, n, p) the blocks.
            before: (k, n, p) the block preceding each.
            noise: (n, p, p) the N_i of each of them.
        """
        if not len(rows):
            return self
        old, blocks = self.blocks, self.blocks + len(rows)
        share = 1 / blocks

        def mean(kept: Array, other: Array) -> Array:
            half = np.matmul((share * rows).transpose(1, 2, 0), other.transpose(1, 0, 2))
            half += half.transpose(0, 2, 1)
            half *= 0.5
            half += old / blocks * kept
            return half

        gramian, lagged = mean(self.gramian, rows), mean(self.lagged, before)
        noise = self.noise + len(rows) / blocks * (noise - self.noise)
        means = Means(self.fade, blocks, gramian, lagged, rows[-1], noise, self.recent, self.since)
        return means if self.fade == 1 else means.renewed_by(rows)

    def renewed_by(self, rows: Array) -> Means:
        """The means, which contain the last blocks (k, n, p), after forgetting what they renew.

        The blocks of a share of the horizon count together: those of an interval have less rank
        than a motion.
        """
        recent = self.recent + np.matmul(rows.transpose(1, 2, 0), rows.transpose(1, 0, 2))
        since = self.since + len(rows)
        if since < -_TOGETHER / np.log(self.fade):
            return self._replace(recent=recent, since=since)
        lost, expected = 1 - self.fade**since, since * self.noise
        maps, share = forgetting(self.blocks * self.gramian, recent, expected, lost)
        back = maps.transpose(0, 2, 1)

        def part(mean: Array) -> Array:
            found = maps @ mean @ back / share
            return 0.5 * (found + found.transpose(0, 2, 1))

        return self._replace(
            blocks=share * self.blocks,
            gramian=part(self.gramian),
            lagged=part(self.lagged),
            last=(maps @ self.last[:, :, None])[:, :, 0],
            noise=part(self.noise),
            recent=0 * recent,
            since=0,
        )


class View(NamedTuple):
    """An estimate, its uncertainty, and the weights of the residuals it leaves in later blocks.

    Attributes:
        theta: (p,) the estimate.
        rho: (n,) correlation of its residuals between neighbouring blocks, for every row.
        share: (n,) inverse variance of the residuals' innovations.
        effort: (n, p) diagonals of the Σ_i, the reference of these variances.
        root: (p, p) factor L of the estimate's covariance L Lᵀ.
        information: (p, p) the data's about the parameters.
        driven: (p,) whether a parameter is the gain of an actuator that has had an effect.
    """

    theta: Array
    rho: Array
    share: Array
    effort: Array
    root: Array
    information: Array
    driven: np.ndarray

    def freed(self) -> Array:
        """(p, p + k) the factor if each of the k driven gains may have changed by all of itself."""
        return np.hstack([self.root, np.diag(self.theta)[:, self.driven]])


class Evidence(NamedTuple):
    """Innovations e = (Y − ρ Y′) θ̂ since the last view, divided by their standard deviations.

    Attributes:
        information: (p, p) sum of (Y − ρ Y′)ᵀ (Y − ρ Y′), each row so divided.
        slope: (p,) sum of (Y − ρ Y′)ᵀ e.
        squares: sum of e².
        number: of innovations.
    """

    information: Array
    slope: Array
    squares: float
    number: int

    @staticmethod
    def empty(p: int) -> Evidence:
        """No innovations yet."""
        return Evidence(np.zeros((p, p)), np.zeros(p), 0.0, 0)

    def with_rows(self, rows: Array, innovations: Array) -> Evidence:
        """The evidence after further rows (k, p) with innovations (k,)."""
        return Evidence(
            self.information + rows.T @ rows,
            self.slope + rows.T @ innovations,
            self.squares + float(innovations @ innovations),
            self.number + len(innovations),
        )

    def ratio(self, root: Array) -> float:
        """Mean of eᵀ (1 + Y P Yᵀ)⁻¹ e, P = L Lᵀ: the innovations over their predicted variance.

        Args:
            root: (p, k) L.
        """
        if not self.number:
            return 0.0
        whole = np.eye(root.shape[1]) + root.T @ self.information @ root
        values, vectors = scipy.linalg.eigh(whole)
        explained = (vectors.T @ (root.T @ self.slope)) ** 2 / np.maximum(values, 1.0)
        return max(0.0, self.squares - float(explained.sum())) / self.number


class Scores(NamedTuple):
    """Scores of the blocks: gradients of ½ residual² under the estimate that preceded them.

    Attributes:
        view: of the last estimate; None before the first.
        latest: (4, p) scores of the last blocks.
        meat: (p, p) mean of the scores' outer products, summed over neighbouring blocks: the
            middle of the sandwich covariance.
        count: effective number of blocks in `meat`.
        evidence: of the blocks since the last view.
    """

    view: View | None
    latest: Array
    meat: Array
    count: float
    evidence: Evidence

    @staticmethod
    def empty(p: int) -> Scores:
        """The scores before any block."""
        nothing = np.zeros((_NEIGHBOURS, p))
        return Scores(None, nothing, np.zeros((p, p)), 0.0, Evidence.empty(p))

    def with_blocks(self, fade: float, rows: Array, before: Array) -> Scores:
        """The scores after k further blocks; rows and neighbouring blocks may be correlated.

        The variance of an innovation grows with the actuators' effort in its block: as in the
        quotient, every command is taken to have a relative error.

        Args:
            fade: factor by which a block's weight decreases per block.
            rows: (k, n, p) the blocks.
            before: (k, n, p) the block preceding each.
        """
        k, view = len(rows), self.view
        if view is None or not k:
            return self
        new = rows - view.rho[:, None] * before
        residual = new @ view.theta
        scores = np.matmul((view.share * residual)[:, None], new)[:, 0]
        known = np.concatenate([self.latest, scores])
        together = sum((known[i : i + k] for i in range(1, _NEIGHBOURS + 1)), np.zeros_like(scores))
        weights, old = fade ** np.arange(k)[::-1], fade**k * self.count
        count = old + float(weights.sum())
        outer = (weights[:, None] * together).T @ together / _NEIGHBOURS
        effort = ((rows * view.theta) ** 2 * (view.effort > 0)).sum(axis=2)
        usual = view.effort @ view.theta**2
        deviation = np.sqrt(view.share / np.maximum(1.0, effort / usual))
        return Scores(
            view=view,
            latest=known[k:],
            meat=(old * self.meat + outer) / count,
            count=count,
            evidence=self.evidence.with_rows(
                (deviation[..., None] * new).reshape(-1, new.shape[2]),
                (deviation * residual).ravel(),
            ),
        )


class Memory(NamedTuple):
    """The statistics of all data up to a sample.

    Attributes:
        step: index of the sample.
        balance: the momentum balance at the sample.
        fresh: (k, n, p) blocks not yet in the means.
        means: over the blocks.
        scores: of the blocks.
        alarmed: whether the preceding interval contradicted the estimate.
        kept: (p, p) information about all parameters but the actuators' that survived the last
            detected change of an actuator; None before the first.
    """

    step: int
    balance: Balance
    fresh: Array
    means: Means
    scores: Scores
    alarmed: bool = False
    kept: Array | None = None

    @property
    def sure(self) -> bool:
        """Whether enough blocks were compared with an estimate for others to contradict it."""
        n, p = self.means.last.shape
        return self.scores.count >= max(_JUDGED, _DETERMINED * p / n)


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
        self.system, self.hermite = system, hermite
        self.surprise, self.every = config.surprise, max(1, round(config.interval / dt))
        self.block = max(1, round(config.block / dt))
        self._periods = self.every, _FRESH * self.block
        self.rows = Rows(system, config.window, self.block, dt, levels)
        self.fade = float(np.exp(-self.block * dt / config.horizon)) if config.horizon else 1.0

    def begin(self, first: Measurement) -> Memory:
        """The empty memory at a first measurement."""
        n, p = self.system.n, self.system.p
        balance, means = self.rows.begin(first.q, first.v), Means.empty(n, p, self.fade)
        return Memory(0, balance, np.zeros((0, n, p)), means, Scores.empty(p))

    def follow(self, memory: Memory, log: Log) -> Memory:
        """The memory at the end of a log that begins at the memory's sample.

        Blocks enter the means together, at the end of every interval or after 16 of them.
        """
        at = 0
        while at < len(log.t) - 1:
            steps = min(period - memory.step % period for period in self._periods)
            piece = log.part(at, at + steps + 1)
            middle = self.system.midpoints(piece, self.hermite)
            balance, rows = self.rows.follow(memory.balance, piece, middle)
            memory = memory._replace(
                step=memory.step + len(piece.t) - 1,
                balance=balance,
                fresh=np.concatenate([memory.fresh, rows]),
            )
            if any(memory.step % period == 0 for period in self._periods):
                memory = self.absorb_blocks(memory, piece.at(-1))
            at += steps
        return memory

    def absorb_blocks(self, memory: Memory, here: Measurement) -> Memory:
        """Merges the buffered blocks, the last of which ends near a sample, into means and scores.

        Blocks count in the scores only once enough others precede them to estimate the residuals'
        variance.
        """
        means, fresh = memory.means, memory.fresh
        before = np.concatenate([means.last[None], fresh])[:-1]
        (n, p), blocks, first = means.last.shape, means.blocks, 0
        while first < len(fresh) and blocks * n < _DETERMINED * p:
            blocks, first = self.fade * blocks + 1, first + 1
        noise = means.noise
        if not self.rows.levels.exact:
            noise = self.rows.noise(here, memory.balance.fed.deviations())
        return memory._replace(
            fresh=fresh[:0],
            scores=memory.scores.with_blocks(self.fade, fresh[first:], before[first:]),
            means=means.with_blocks(fresh, before, noise),
            kept=None if memory.kept is None else self.fade ** len(fresh) * memory.kept,
        )

    def resume(self, memory: Memory, here: Measurement) -> Memory:
        """The memory at a later sample, whose data in between are left out."""
        means = memory.means._replace(last=np.zeros_like(memory.means.last))
        return memory._replace(balance=self.rows.begin(here.q, here.v), means=means)

    def check_consistency(self, memory: Memory, here: Measurement) -> tuple[Memory, bool]:
        """Tests an interval's innovations against the estimate that preceded them.

        An interval whose squared innovations exceed `surprise` times their predicted variance, the
        estimate's uncertainty included, raises an alarm: no θ explains old and new data. The
        momentum balance restarts, since its filter may hold motion under other gains. If the next
        interval contradicts the same estimate, but not one with other gains, an actuator counts as
        changed and the data are discarded; only the information about the other parameters is kept.

        Args:
            memory: at the interval's end.
            here: the last measurement.

        Returns:
            The memory; and whether data were discarded.
        """
        scores, means = memory.scores, memory.means
        view, evidence, (n, p) = scores.view, scores.evidence, means.last.shape
        if view is None or not (memory.sure and 0 < self.surprise < evidence.ratio(view.root)):
            return memory._replace(alarmed=False), False
        memory = memory._replace(balance=self.rows.restart(memory.balance, here.q, here.v))
        if not memory.alarmed:
            scores = scores._replace(evidence=Evidence.empty(p))
            means = means._replace(last=np.zeros((n, p)))
            return memory._replace(scores=scores, means=means, alarmed=True), False
        if evidence.ratio(view.freed()) > self.surprise:
            return memory._replace(alarmed=False), False
        return Memory(
            memory.step,
            memory.balance,
            memory.fresh,
            Means.empty(n, p, self.fade),
            Scores.empty(p),
            kept=eliminated(view.information, view.driven),
        ), True
