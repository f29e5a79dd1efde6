"""The paper's identifier, (44) and (45), in any metric, with or without a memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..dynamics.motions import TreeMotion, tree_batch
from ..dynamics.tree_lanes import LANES
from ..errors import InvalidInput
from ..log import Log, Measurement
from ..parameters import Array
from ..system import Motion, SecondOrderSystem, checked
from .base import Confidence, DataMemory, Estimates, Identifier, State, Status
from .metric import ConstantMetric, Flat, Metric, positive_gain
from .rk4 import follow

RK4_LIMIT = 2.5  # |λ| dt within which RK4 is stable on the negative real axis (2.785), with room
_FEWEST = 9  # identifiers for which a batch is faster than one after the other


def paper_identifier(
    system: SecondOrderSystem,
    K: Array,
    Gamma: Array,
    prior: Array,
    dt: float,
    hermite: bool = True,
    held: np.ndarray | None = None,
) -> NullspaceIdentifier:
    """The identifier of (44) and (45) as printed, with a constant Γ.

    Args:
        system: the structure.
        K: (n,) or (n, n) positive definite gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) positive definite adaptation gain. Zero rows and columns of a diagonal
            hold a parameter at its prior, for `ConventionalAID`.
        prior: (p,) θ̂(0).
        dt: time between measurements [s].
        hermite: cubic Hermite interpolation between samples; else linear.
        held: (p,) which parameters are held at their prior; their Γ must be 0.

    Raises:
        InvalidInput: a shape or value is wrong, a gain is not positive definite, or K is too
            fast for dt.
    """
    Gamma = np.asarray(Gamma, dtype=np.float64)
    if Gamma.shape not in ((system.p,), (system.p, system.p)):
        raise InvalidInput(
            "Gamma",
            f"shape ({system.p},) or ({system.p}, {system.p})",
            Gamma.shape,
            "Give the diagonal or all.",
        )
    return NullspaceIdentifier(system, K, ConstantMetric(Gamma, held), prior, dt, hermite)


class NullspaceIdentifier(Identifier):
    """(44) and (45), integrated by RK4 between measurements, the command held.

    Args:
        system: the structure.
        K: (n,) or (n, n) positive definite gain of the identification plant [1/s].
        metric: what turns Wᵀ Δv into θ̂̇ (45).
        prior: (p,) θ̂(0).
        dt: time between measurements [s].
        hermite: cubic Hermite interpolation between samples; else linear.
        memory: of past data; None for a law without one.

    Raises:
        InvalidInput: a shape or value is wrong, K is not positive definite, or too fast for dt.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        K: Array,
        metric: Metric,
        prior: Array,
        dt: float,
        hermite: bool = True,
        memory: DataMemory | None = None,
    ):
        self.system, self.metric, self.memory = system, metric, memory
        self.prior, self.hermite = system.space.check(prior, "prior"), hermite
        self.K = positive_gain("K", K, system.n)
        self.conserves, self.cancelling = metric.conserves, metric.cancelling
        self.law = metric.law(self.K)
        fastest = np.abs(self.K).max() if self.K.ndim == 1 else np.linalg.eigvalsh(self.K)[-1]
        if not fastest * dt <= RK4_LIMIT:
            raise InvalidInput(
                "K",
                f"λ_max(K)·dt ≤ {RK4_LIMIT} for RK4",
                f"{fastest:g}/s · {dt:g} s = {fastest * dt:g}",
                f"Take K ≤ {RK4_LIMIT / dt:g}/s or a smaller dt.",
            )

    def init(self, first: Measurement) -> State:
        """v̂ = v, so that Δv(t₀) = 0 as (46) assumes, θ̂ the prior, and a memory of nothing."""
        first = checked(self.system, first)
        memory = self.memory.begin(first) if self.memory else None
        theta = self.prior.copy()
        return State(first.t, first.v.copy(), theta, np.inf, Status.completed, memory)

    def step(self, state: State, previous: Measurement, following: Measurement) -> State:
        """One RK4 step of (44, 45) from `previous` to `following`.

        Raises:
            InvalidInput: time does not increase, or a shape is wrong.
        """
        for sample in (previous, following):
            if tuple(map(np.shape, sample)) != ((), *((k,) for k in self._widths)):
                checked(self.system, sample)  # says which
        if not (following.t > previous.t and np.isfinite(following.t)):
            raise InvalidInput(
                "t",
                f"a time after {previous.t!r} s",
                repr(following.t),
                "Sort the samples by time.",
            )
        pair = zip(previous, following, strict=True)
        return self.follow(state, Log.unchecked(*(np.array(part, np.float64) for part in pair)))[0]

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """RK4 steps of (44, 45) along a log, and the memory's updates where it has one.

        Raises:
            InvalidInput: the log's widths are not the system's.
        """
        if self.memory is None:
            return self.along(state, log)
        made, at = [Estimates.of(state)], 0
        while at < len(log.t) - 1 and state.status is Status.completed:
            assert state.memory is not None
            steps = self.memory.every - state.memory.step % self.memory.every
            piece = log.part(at, at + steps + 1)
            state, estimates = self.along(state, piece)
            if state.status is Status.completed:
                state = self.memory.absorb(state, piece)
                estimates.theta_hat[-1], estimates.spent[-1] = state.theta_hat, state.spent
            made.append(estimates.after(1))
            at += len(estimates.pivot) - 1
        return state, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def along(
        self, state: State, log: Log, motion: Motion | None = None
    ) -> tuple[State, Estimates]:
        """RK4 steps of (44, 45) along a log, without a memory's updates.

        Args:
            state: at the first measurement; one that may not go on stays as it is.
            log: N measurements.
            motion: of that log, where it is known already: identifiers of one system that
                interpolate alike may share it.

        Raises:
            InvalidInput: the log's widths are not the system's.
        """
        self._check(log)
        estimates = Estimates(
            np.empty((len(log.t), self.system.n)),
            np.empty((len(log.t), self.system.p)),
            np.empty(len(log.t)),
            np.full(len(log.t), state.spent),
        )
        for start, part in zip(
            estimates, (state.v_hat, state.theta_hat, state.pivot), strict=False
        ):
            start[0] = part
        if state.status is not Status.completed:
            return state, estimates.first(1)
        return _end(state, log, estimates, self._follow(log, estimates, motion))

    def motion(self, log: Log) -> Motion:
        """What a log alone decides of this identifier's stages."""
        return self.system.motion(log, self.hermite)

    def _check(self, log: Log) -> None:
        """Accepts a log of the system's widths."""
        if not isinstance(log, Log):
            raise InvalidInput("log", "a Log", type(log).__name__, "Make one: Log(t, q, v, u).")
        for name, part, width in zip("qvu", log[1:], self._widths, strict=True):
            if part.shape[1] != width:
                raise InvalidInput(
                    name,
                    f"{width} columns",
                    f"{part.shape[1]}",
                    "A log holds the system's own coordinates: m positions, n velocities and "
                    "n_u commands.",
                )

    @property
    def _widths(self) -> tuple[int, int, int]:
        return self.system.m, self.system.n, self.system.n_u

    def _follow(self, log: Log, estimates: Estimates, motion: Motion | None) -> int:
        """Writes the estimates from row 1 on; returns the row that failed, N where none did."""
        if motion is not None:
            return follow(self.law, motion, *estimates[:3])
        steps = self.system.motion_steps
        for at in range(0, len(log.t) - 1, steps):
            rows = [part[at : at + steps + 1] for part in estimates[:3]]
            failed = follow(self.law, self.motion(log.part(at, at + steps + 1)), *rows)
            if failed < len(rows[0]):
                return at + failed
        return len(log.t)

    def conserved(self, theta_hat: Array) -> Array:
        """(...,) the metric's conserved quantity for estimates (..., p)."""
        return self.metric.conserved(theta_hat)

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) the second term of V (66), in the metric, at θ (p,) and estimates (..., p)."""
        return self.metric.divergence(theta, theta_hat)

    def implicit(self, t: Array) -> np.ndarray:
        """(N−1,) between which of the times (N,) of a run lies an update by the memory."""
        if self.memory is None:
            return np.zeros(max(0, len(t) - 1), dtype=bool)
        return self.memory.updates(t)

    def slack(self, state: State, theta: Array) -> float:
        """By how much an update of the memory can raise V under the true θ (p,); else 0."""
        return 0.0 if self.memory is None else self.memory.slack(state, theta)

    def confidence(self, state: State) -> Confidence | None:
        """What the memory knows of the estimate's error; None without one."""
        return None if self.memory is None else self.memory.confidence(state)


def _end(state: State, log: Log, estimates: Estimates, failed: int) -> tuple[State, Estimates]:
    """The state that a log has led to, up to the row that failed (N where none did)."""
    last = failed - 1
    state = state._replace(
        t=float(log.t[last]), v_hat=estimates.v_hat[last].copy(),
        theta_hat=estimates.theta_hat[last].copy(), pivot=float(estimates.pivot[last]),
    )  # fmt: skip
    if failed < len(log.t):
        finite = all(np.isfinite(part[last : last + 2]).all() for part in log)
        status = Status.estimate_not_positive_definite if finite else Status.measurement_not_finite
        state = state._replace(pivot=float(estimates.pivot[failed]), status=status)
    return state, estimates.first(failed)


def side_by_side(
    laws: Sequence[NullspaceIdentifier], states: Sequence[State], log: Log, motion: Motion
) -> Iterator[tuple[State, Estimates]]:
    """`along` of several identifiers of one system, to the bit.

    Those of a tree with the paper's law and diagonal gains are followed in batches, one SIMD lane
    per identifier. A batch in which one fails is followed again, one after the other.

    Raises:
        InvalidInput: as for `along`.
    """
    for at in range(0, len(laws), LANES):
        group = laws[at : at + LANES], states[at : at + LANES]
        made = _batch(*group, log, motion) if _fits_batch(*group, motion) else None
        if made is None:
            made = [law.along(state, log, motion) for law, state in zip(*group, strict=True)]
        yield from made


def _fits_batch(
    laws: Sequence[NullspaceIdentifier], states: Sequence[State], motion: Motion
) -> bool:
    return (
        len(laws) >= _FEWEST
        and isinstance(motion, TreeMotion)
        and all(isinstance(law.law, Flat) for law in laws)
        and all(law.K.ndim == law.metric.Gamma.ndim == 1 for law in laws)
        and all(state.status is Status.completed for state in states)
    )


def _batch(
    laws: Sequence[NullspaceIdentifier], states: Sequence[State], log: Log, motion: Motion
) -> list[tuple[State, Estimates]] | None:
    """`along` of at most `LANES` identifiers; None where one of them fails."""
    laws[0]._check(log)
    assert isinstance(motion, TreeMotion)
    count, batch = len(log.t), tree_batch(motion)
    full = np.minimum(np.arange(LANES), len(laws) - 1)  # idle lanes repeat the last identifier

    def lanes(rows: Iterable[Array]) -> Array:
        return np.array(list(rows))[full].T.ravel()

    def rows_from(start: Array) -> Array:
        rows = np.empty((count, len(start)))
        rows[0] = start
        return rows

    law = Flat(lanes(law.K for law in laws), lanes(law.metric.Gamma for law in laws))
    v_hat = rows_from(lanes(state.v_hat for state in states))
    theta_hat = rows_from(lanes(state.theta_hat for state in states))
    if follow(law, batch, v_hat, theta_hat, np.empty(count)) < count:
        return None
    made = []
    for lane, state in enumerate(states):
        batch.pivots[0, lane] = state.pivot
        own = Estimates(
            v_hat[:, lane::LANES],
            theta_hat[:, lane::LANES],
            batch.pivots[:, lane],
            np.full(count, state.spent),
        )
        made.append(_end(state, log, own, count))
    return made
