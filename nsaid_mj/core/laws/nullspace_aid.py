"""The identifier of (44) and (45), in any metric, with or without a memory of past data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base import InvalidInput
from ..log import Log, Measurement
from ..numerics.lanes import COMPILED, WIDTH
from ..numerics.threads import beside
from ..parameters import Array
from ..structure.motion import Motion
from ..structure.system import SecondOrderSystem, checked
from .base import Confidence, Estimates, Identifier, State, Status
from .metric import ConstantMetric, Metric, positive_gain
from .rk4 import Step, flow_in, flow_together_in

if TYPE_CHECKING:
    from .memory.implicit import ImplicitMemory

RK4_LIMIT = 2.5  # bound of |λ| dt, below RK4's stability limit of 2.785 on the negative real axis
_DIVISIONS = 3  # times, at most, that a step is divided by four


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

    Gamma, (p,) or (p, p), and held, a mask (p,), are those of `ConstantMetric`, the other arguments
    those of `NullspaceIdentifier`.

    Raises:
        InvalidInput: a shape or value is wrong, a gain is not positive definite, or K is too
            fast for dt.
    """
    metric = ConstantMetric(Gamma, held, system.p)
    return NullspaceIdentifier(system, K, metric, prior, dt, hermite)


class NullspaceIdentifier(Identifier):
    """(44) and (45), integrated by RK4 between measurements, the command held.

    Under contacts whose forces nobody measures (44) cannot be evaluated: v̂ is then v, so that Δv =
    0, and the memory's steps alone move θ̂ (docs/theory.md, section 8).

    Args:
        system: the structure.
        K: (n,) or (n, n) positive definite gain of the identification plant [1/s].
        metric: maps Wᵀ Δv to θ̂̇ (45).
        prior: (p,) θ̂(0).
        dt: time between measurements [s].
        hermite: cubic Hermite interpolation between samples; else linear.
        memory: memory of past data; None for a law without one.

    Raises:
        InvalidInput: a shape or value is wrong, K is not positive definite, or too fast for dt; or
            the system has contacts, and there is no memory.
    """

    metric: Metric  # pyright: ignore[reportIncompatibleVariableOverride]  # this law has one

    def __init__(
        self,
        system: SecondOrderSystem,
        K: Array,
        metric: Metric,
        prior: Array,
        dt: float,
        hermite: bool = True,
        memory: ImplicitMemory | None = None,
    ):
        if system.structure.contacts and memory is None:
            raise InvalidInput(
                "law",
                "memory or efficient, for a robot on the ground",
                "a law that predicts its acceleration",
                "Nobody measures the contacts' forces: use --law memory or efficient.",
            )
        self.system = system
        self.metric = metric
        self.memory = memory
        self.prior = system.space.check(prior, "prior")
        self.hermite = hermite
        self.K = positive_gain("K", K, system.n)
        self.conserves = metric.conserves
        self._gain = np.atleast_2d(self.K)
        self._spare: list[tuple[Step, Any]] = []  # workspaces that no call uses at the moment
        fastest = np.abs(self.K).max() if self.K.ndim == 1 else np.linalg.eigvalsh(self.K)[-1]
        if not fastest * dt <= RK4_LIMIT:
            raise InvalidInput(
                "K",
                f"λ_max(K)·dt ≤ {RK4_LIMIT} for RK4",
                f"{fastest:g}/s · {dt:g} s = {fastest * dt:g}",
                f"Use K ≤ {RK4_LIMIT / dt:g}/s or a smaller dt.",
            )

    def init(self, first: Measurement) -> State:
        """The state with v̂ = v, so that Δv(t₀) = 0 as (46) assumes, θ̂ = prior and no past data.

        Raises:
            InvalidInput: the measurement has a wrong shape or is not finite.
        """
        first = checked(self.system, first)
        memory = self.memory.recorder.begin(first) if self.memory else None
        theta = self.prior.copy()
        return State(first.t, first.v.copy(), theta, np.inf, Status.completed, memory)

    def resume(self, state: State, here: Measurement) -> State:
        """The state at a measurement after a gap, with v̂ = v."""
        here = checked(self.system, here)
        memory = state.memory
        if self.memory is not None and memory is not None:
            memory = self.memory.recorder.resume(memory, here)
        return state._replace(t=here.t, v_hat=here.v.copy(), memory=memory)

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """RK4 steps of (44, 45) along a log, with the memory's updates if there is one.

        Raises:
            InvalidInput: the log's widths are not the system's.
        """
        if self.memory is None:
            return self.along(state, log)
        made = [Estimates.of(state)]
        end = state
        for _, end, estimates in self._updates(state, log):
            estimates.theta_hat[-1] = end.theta_hat
            estimates.spent[-1] = end.spent
            made.append(estimates.after(1))
        return end, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def _updates(self, state: State, log: Log) -> Iterator[tuple[State, State, Estimates]]:
        """The states before and after each update by the memory, and the estimates before it."""
        at = 0
        while at < len(log.t) - 1 and state.status is Status.completed:
            assert self.memory is not None and state.memory is not None
            steps = self.memory.every - state.memory.step % self.memory.every
            piece = log.part(at, at + steps + 1)
            recorder = self.memory.recorder
            recorded = beside(len(piece.t) - 1, recorder.follow, state.memory, piece)
            before, estimates = self.along(state, piece)
            completed = before.status is Status.completed
            state = self.memory.updated(before, recorded()) if completed else before
            yield before, state, estimates
            at += len(estimates.pivot) - 1

    def along(
        self, state: State, log: Log, motion: Motion | None = None
    ) -> tuple[State, Estimates]:
        """RK4 steps of (44, 45) along a log, without a memory's updates.

        `state`, at the log's first measurement, is returned unchanged unless its status is
        `completed`. `motion` is that of the log if already computed: identifiers of one system with
        the same interpolation can share it.

        Raises:
            InvalidInput: the log's widths are not the system's.
        """
        self.check(log)
        if state.status is not Status.completed:
            return state, Estimates.of(state)
        estimates = Estimates.of(state, len(log.t))
        if self.system.structure.contacts:
            return end_of(state, log, estimates, _stay(log, estimates))
        return end_of(state, log, estimates, self._follow(log, estimates, motion))

    @staticmethod
    def shared_motion(law: Identifier, log: Log) -> Motion | None:
        """The motion that identifiers of this kind share on a log; None if each runs alone."""
        if isinstance(law, NullspaceIdentifier) and law.memory is None:
            return law.motion(log)
        return None

    @staticmethod
    def followed_together(
        laws: Sequence[Any], states: Sequence[State], log: Log, motion: Motion | None
    ) -> Iterator[tuple[State, Estimates]]:
        """What `follow` returns for each of several identifiers of one kind, with the same bits.

        `motion` is their `shared_motion` of the log. Where their metric allows it, `WIDTH` of them
        take their steps at once, each in a SIMD lane.

        Raises:
            InvalidInput: the log's widths are not the system's.
        """
        if motion is None:
            yield from (law.follow(state, log) for law, state in zip(laws, states, strict=True))
            return
        for at in range(0, len(laws), WIDTH):
            some = list(zip(laws[at : at + WIDTH], states[at : at + WIDTH], strict=True))
            if _fit_in_lanes(some, motion):
                yield from _in_lanes(some, log, motion)
            else:
                yield from (law.along(state, log, motion) for law, state in some)

    def motion(self, log: Log) -> Motion:
        """All parts of the RK4 stages along a log that do not depend on the estimate."""
        return self.system.motion(log, self.hermite)

    def _follow(self, log: Log, estimates: Estimates, motion: Motion | None) -> int:
        """Writes the estimates from row 1 on; returns the row that failed, or N."""
        steps = self.system.motion_steps
        if motion is not None or len(log.t) <= steps + 1:
            return self._integrate(log, motion or self.motion(log), [*estimates[:3]])
        for at in range(0, len(log.t) - 1, steps):
            piece = log.part(at, at + steps + 1)
            rows = [part[at : at + steps + 1] for part in estimates[:3]]
            failed = self._integrate(piece, self.motion(piece), rows)
            if failed < len(piece.t):
                return at + failed
        return len(log.t)

    def _flow(
        self, motion: Motion, v_hats: Array, theta_hats: Array, pivots: Array, first: int
    ) -> int:
        """Calls `rk4.follow` in the identifier's metric."""
        follow = flow_in(type(self.metric))
        numbers = self.metric.numbers
        step, own = self._spare.pop() if self._spare else self._workspace()
        row = follow(self._gain, numbers, motion, v_hats, theta_hats, pivots, first, step, own)
        self._spare.append((step, own))
        return row

    def _workspace(self) -> tuple[Step, Any]:
        """New workspace of `rk4.follow`."""
        bodies = len(self.system.structure.bodies)
        n = self.system.n
        return Step.of(bodies, n, self.system.p), self.metric.workspace()

    def _integrate(self, log: Log, motion: Motion, rows: list[Array], divided: int = 0) -> int:
        """RK4 steps along a log with its motion; in the cone's metric inaccurate ones are divided.

        `rows` are v̂ (N, n), θ̂ (N, p) and pivots (N,), written from row 1 on; `divided` counts
        earlier divisions of this log's steps. Returns the row that failed, or N.
        """
        v_hats, theta_hats, pivots = rows
        row = self._flow(motion, v_hats, theta_hats, pivots, 1)
        while row < len(log.t) and divided < _DIVISIONS and self.metric.divides:
            step = log.part(row - 1, row + 1)
            if not all(np.isfinite(part).all() for part in step):
                break
            finer = self._halved(self._halved(step))
            inner = [np.repeat(part[row - 1 : row], len(finer.t), axis=0) for part in rows]
            failed = self._integrate(finer, self.motion(finer), inner, divided + 1)
            if failed < len(finer.t):
                pivots[row] = inner[2][failed]
                break
            v_hats[row] = inner[0][-1]
            theta_hats[row] = inner[1][-1]
            pivots[row] = inner[2][1:].min()
            row = self._flow(motion, v_hats, theta_hats, pivots, row + 1)
        return row

    def _halved(self, log: Log) -> Log:
        """The log with the interpolated states half-way between its N samples, 2N − 1 in all."""
        between = self.system.midpoints(log, self.hermite)
        halves = 0.5 * (log.t[1:] + log.t[:-1]), between.q, between.v, log.u[:-1]
        made = []
        for part, half in zip(log, halves, strict=True):
            made.append(np.repeat(part, 2, axis=0)[:-1])
            made[-1][1::2] = half
        return Log.unchecked(*made)

    def implicit(self, t: Array) -> np.ndarray:
        """(N−1,) whether an update by the memory lies between consecutive times (N,) of a run."""
        if self.memory is None:
            return np.zeros(max(0, len(t) - 1), dtype=bool)
        return self.memory.updates(t)

    def slacks(self, log: Log, theta: Array) -> Array:
        """(N−1,) bounds on the rise of V [J] in the memory's updates, under the true θ (p,).

        Sensor noise and quadrature error leave a residual even at the true θ, so V may rise. The
        bounds are 0 in steps without an update. The law follows the log, of a whole run, again.
        """
        slacks = np.zeros(len(log.t) - 1)
        at = 0
        if self.memory is not None:
            for before, after, estimates in self._updates(self.init(log.at(0)), log):
                at += len(estimates.pivot) - 1
                if after is not before:
                    slacks[at - 1] = self.memory.slack(before, after, theta)
        return slacks

    def confidence(self, state: State) -> Confidence | None:
        """The estimate's uncertainty according to the memory; None without one."""
        return None if self.memory is None else self.memory.confidence(state)


def _stay(log: Log, estimates: Estimates) -> int:
    """Writes v̂ = v and θ̂ as it is from row 1 on; returns the first row that is not finite, or N."""
    estimates.v_hat[1:] = log.v[1:]
    estimates.theta_hat[1:] = estimates.theta_hat[0]
    estimates.pivot[1:] = estimates.pivot[0]
    finite = np.all([np.isfinite(p.reshape(len(p), -1)).all(axis=1) for p in log], axis=0)
    return int(np.argmin(finite)) if not finite.all() else len(log.t)


_FEW = 2
"""So many identifiers are faster one by one than in lanes of which most are spare."""


def _fit_in_lanes(runs: Sequence[tuple[NullspaceIdentifier, State]], motion: Motion) -> bool:
    """Whether identifiers with their states can take their steps together."""
    kinds = {(type(law.metric), law._gain.shape, law.metric.Gamma.shape) for law, _ in runs}
    return (
        COMPILED
        and len(runs) > _FEW
        and len(kinds) == 1
        and runs[0][0].metric.together
        and not motion.outside.address
        and not runs[0][0].system.structure.contacts
        and all(state.status is Status.completed for _, state in runs)
    )


def _in_lanes(
    runs: Sequence[tuple[NullspaceIdentifier, State]], log: Log, motion: Motion
) -> list[tuple[State, Estimates]]:
    """What `along` returns for up to `WIDTH` identifiers, each with its state."""
    law, _ = runs[0]
    law.check(log)
    count = len(log.t)
    spare = [runs[-1]] * (WIDTH - len(runs))
    lanes = [*runs, *spare]
    v_hats = np.empty((count, law.system.n, WIDTH))
    theta_hats = np.empty((count, law.system.p, WIDTH))
    pivots = np.empty((count, WIDTH))
    v_hats[0] = np.stack([state.v_hat for _, state in lanes], axis=-1)
    theta_hats[0] = np.stack([state.theta_hat for _, state in lanes], axis=-1)
    pivots[0] = [state.pivot for _, state in lanes]
    gains = _beside([one._gain for one, _ in lanes])
    numbers = _beside([one.metric.numbers for one, _ in lanes])
    step, own = (_beside([part] * WIDTH) for part in law._workspace())
    follow = flow_together_in(type(law.metric))
    row = follow(gains, numbers, motion, v_hats, theta_hats, pivots, 1, step, own)
    found = []
    for k, (one, state) in enumerate(runs):
        estimates = Estimates(
            v_hats[..., k].copy(),
            theta_hats[..., k].copy(),
            pivots[:, k].copy(),
            np.full(count, state.spent),
        )
        failed = row
        if row < count and estimates.pivot[row] > 0:  # another one's M̂ is not positive definite
            failed = one._flow(motion, *estimates[:3], row)
        found.append(end_of(state, log, estimates, failed))
    return found


def _beside(parts: Sequence[Any]) -> Any:
    """Arrays, or tuples of arrays, side by side along a new last axis."""
    if isinstance(parts[0], tuple):
        return type(parts[0])(*(_beside(each) for each in zip(*parts, strict=True)))
    return np.stack(parts, axis=-1)


def end_of(state: State, log: Log, estimates: Estimates, failed: int) -> tuple[State, Estimates]:
    """The state and the estimates after a log whose row `failed` is the first invalid one, or N."""
    last = failed - 1
    state = state._replace(
        t=float(log.t[last]),
        v_hat=estimates.v_hat[last].copy(),
        theta_hat=estimates.theta_hat[last].copy(),
        pivot=float(estimates.pivot[last]),
    )
    if failed < len(log.t):
        finite = all(np.isfinite(part[last : last + 2]).all() for part in log)
        status = Status.measurement_not_finite
        if finite:
            lost = not estimates.pivot[failed] > 0
            status = Status.estimate_not_positive_definite if lost else Status.adaptation_too_fast
        state = state._replace(pivot=float(estimates.pivot[failed]), status=status)
    return state, estimates.first(failed)
