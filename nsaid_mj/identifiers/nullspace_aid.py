"""The paper's identifier, (44) and (45)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..dynamics.interpolation import between_two, midpoints
from ..dynamics.motions import (
    BodyMotion,
    LoadedMotion,
    Motion,
    TreeMotion,
    tree_batch,
    tree_motion,
)
from ..dynamics.tree_lanes import LANES
from ..errors import InvalidInput
from ..log import Log, Measurement
from ..parameters import Array
from ..system import SecondOrderSystem, checked
from .base import Estimates, Identifier, State, Status
from .metric import Flat, Law
from .rk4 import advance_by_regressor, begin, follow, inside_law, room

RK4_LIMIT = 2.5  # |λ| dt within which RK4 is stable on the negative real axis (2.785), with room
_PIECE = 500  # steps whose motion is held at once
_FEWEST = 9  # identifiers for which a batch is faster than one after the other


class NullspaceIdentifier(Identifier):
    """(44) and (45), integrated by RK4 between measurements, the command held.

    Args:
        system: the structure.
        K: (n,) or (n, n) positive definite gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) positive definite adaptation gain. Zero rows and columns of a
            diagonal hold a parameter at its prior, for `ConventionalAID`.
        prior: (p,) θ̂(0).
        dt: time between measurements [s].
        hermite: how the state between samples is had; see `NullspaceAID.interpolation`.
        held: (p,) which parameters are held at their prior; their Γ must be 0.

    Raises:
        InvalidInput: a shape or value is wrong, a gain is not positive definite, or K is too
            fast for dt.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        K: Array,
        Gamma: Array,
        prior: Array,
        dt: float,
        hermite: bool = True,
        held: np.ndarray | None = None,
    ):
        self.system, self.prior, self.hermite = system, system.space.check(prior, "prior"), hermite
        self.K = positive_gain("K", K, system.n)
        moving = np.ones(system.p, dtype=bool) if held is None else ~np.asarray(held)
        self.Gamma = positive_gain("Gamma", Gamma, system.p, moving)
        self.moving, self.conserves = moving, bool(moving.all())
        fastest = np.abs(self.K).max() if self.K.ndim == 1 else np.linalg.eigvalsh(self.K)[-1]
        if not fastest * dt <= RK4_LIMIT:
            raise InvalidInput(
                "K",
                f"λ_max(K)·dt ≤ {RK4_LIMIT} for RK4",
                f"{fastest:g}/s · {dt:g} s = {fastest * dt:g}",
                f"Take K ≤ {RK4_LIMIT / dt:g}/s or a smaller dt.",
            )

    @property
    def law(self) -> Law:
        """Its gains and metric, for compiled loops."""
        return Flat(self.K, self.Gamma)

    def init(self, first: Measurement) -> State:
        """v̂ = v, so that Δv(t₀) = 0 as (46) assumes, and θ̂ the prior."""
        first = checked(self.system, first)
        return State(first.t, first.v.copy(), self.prior.copy(), np.inf, Status.completed)

    def step(self, state: State, previous: Measurement, following: Measurement) -> State:
        """One RK4 step of (44, 45) from `previous` to `following`.

        Raises:
            InvalidInput: time does not increase, or a shape is wrong.
        """
        for sample in (previous, following):
            if tuple(map(np.shape, sample)) != ((), *((k,) for k in self._widths)):
                checked(self.system, sample)  # says which
        return self.follow(state, Log.of([previous, following]))[0]

    def motion(self, log: Log) -> Motion | None:
        """What a log alone decides of its steps; None where no compiled loop knows the system.

        Identifiers of one system that have the state between samples the same way may share it.
        """
        system, (t, q, v, u) = self.system, log
        if system.linkage is not None:
            return tree_motion(system.linkage, self.hermite, *log)
        if system.loaded is not None:
            tree = tree_motion(system.loaded.linkage, self.hermite, *log)
            F = np.stack([
                system.applied(states, u[:-1])
                for states in (tree.states[:-1], tree.middles, tree.states[1:])
            ])  # fmt: skip
            return LoadedMotion(system.loaded, *tree[1:], F)
        if system.inertia is None:
            return None
        qm, vm = midpoints(system, log, self.hermite)
        tm, held = 0.5 * (t[:-1] + t[1:]), u[:-1]
        F = np.stack([
            system.forces(t[:-1], q[:-1], v[:-1], held),
            system.forces(tm, qm, vm, held),
            system.forces(t[1:], q[1:], v[1:], held),
        ])  # fmt: skip
        return BodyMotion(system.inertia, system.group, t, v, vm, F)

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """RK4 steps of (44, 45) along a log.

        Raises:
            InvalidInput: time does not increase, or a shape is wrong.
        """
        return self.along(state, log)

    def along(
        self, state: State, log: Log, motion: Motion | None = None
    ) -> tuple[State, Estimates]:
        """The same, where the log's `motion` may be known already.

        Raises:
            InvalidInput: time does not increase, or a shape is wrong.
        """
        self._check(log)
        estimates = Estimates(
            np.empty((len(log.t), self.system.n)), np.empty((len(log.t), self.system.p)),
            np.empty(len(log.t)), np.full(len(log.t), state.spent),
        )  # fmt: skip
        for start, part in zip(
            estimates, (state.v_hat, state.theta_hat, state.pivot), strict=False
        ):
            start[0] = part
        if state.status is not Status.completed:
            return state, estimates.first(1)
        return _end(state, log, estimates, self._follow(log, estimates, motion))

    def _check(self, log: Log) -> None:
        """Accepts a log."""
        shapes = tuple(part.shape for part in log)
        if shapes != (log.t.shape, *((len(log.t), k) for k in self._widths)):
            checked(self.system, log.at(0))  # says which
        wrong = ~((np.diff(log.t) > 0) & np.isfinite(log.t[1:]))
        if wrong.any():
            before, after = log.t[int(np.argmax(wrong)) :][:2].tolist()
            raise InvalidInput("t", f"a time after {before!r} s", repr(after),
                               "Sort the samples by time.")  # fmt: skip

    @property
    def _widths(self) -> tuple[int, int, int]:
        return self.system.m, self.system.n, self.system.n_u

    def _follow(self, log: Log, estimates: Estimates, motion: Motion | None = None) -> int:
        """Writes the estimates from row 1 on; returns the row that failed, N where none did."""
        if motion is not None:
            return follow(self.law, motion, *estimates[:3])
        for at in range(0, len(log.t) - 1, _PIECE):
            rows = [part[at : at + _PIECE + 1] for part in estimates[:3]]
            piece = self.motion(log.part(at, at + _PIECE + 1))
            if piece is None:
                return self._follow_any(log, estimates)
            failed = follow(self.law, piece, *rows)
            if failed < len(rows[0]):
                return at + failed
        return len(log.t)

    def _follow_any(self, log: Log, estimates: Estimates) -> int:
        """The same for any system, stage by stage."""
        system, n, law = self.system, self.system.n, self.law
        work = room(law, n, system.p)
        z, theta, last = work[1], work[4], system.at(*log.at(0))
        for k in range(1, len(log.t)):
            previous, following = log.at(k - 1), log.at(k)
            (t, q, v, _), u = following, previous.u
            dt = t - previous.t
            between = between_two(system, previous, following, self.hermite)
            first, last = last.commanded(previous.t, u), system.at(t, q, v, u)
            middle = system.at(previous.t + 0.5 * dt, *between, u)
            begin(law, work, estimates.v_hat[k - 1], estimates.theta_hat[k - 1])
            smallest = np.inf
            for instant, weight, reach in (
                (first, dt / 6, dt / 2),
                (middle, dt / 3, dt / 2),
                (middle, dt / 3, dt),
                (last, dt / 6, 0.0),
            ):
                a_hat, W, pivot = instant.evaluate(z[:n], theta)  # (29), (10, 31)
                if not pivot > 0:
                    estimates.pivot[k] = pivot
                    return k
                smallest = min(smallest, pivot)
                advance_by_regressor(law, work, instant.v, a_hat, W, weight, reach)
            if not inside_law(law, theta):
                estimates.pivot[k] = np.nan
                return k
            estimates.v_hat[k], estimates.theta_hat[k] = z[:n], theta
            estimates.pivot[k] = smallest
        return len(log.t)

    def conserved(self, theta_hat: Array) -> Array:
        """θ̂ᵀ Γ⁻¹ θ̂ over the parameters that move, constant under (45) by (30).

        Constant only where none is held: (30) says W θ̂ = 0 for the whole θ̂.
        """
        moving = self.moving
        theta = np.asarray(theta_hat)[..., moving]
        if self.Gamma.ndim == 1:
            return np.sum(theta**2 / self.Gamma[moving], axis=-1)
        return np.sum(theta * np.linalg.solve(self.Gamma, theta[..., None])[..., 0], axis=-1)


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
        and all(isinstance(law.law, Flat) and law.K.ndim == law.Gamma.ndim == 1 for law in laws)
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

    law = Flat(lanes(law.K for law in laws), lanes(law.Gamma for law in laws))
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


def positive_gain(name: str, value: Array, size: int, moving: np.ndarray | None = None) -> Array:
    """A gain given by its diagonal (size,) or whole (size, size), checked positive definite.

    Raises:
        InvalidInput: the shape is wrong, it is not symmetric or not positive definite.
    """
    gain = np.ascontiguousarray(value, dtype=np.float64)
    if gain.shape not in ((size,), (size, size)):
        raise InvalidInput(
            name, f"shape ({size},) or ({size}, {size})", gain.shape, "Give the diagonal or all."
        )
    if not np.isfinite(gain).all():
        raise InvalidInput(name, "finite values", "NaN or infinity", "Check how it was computed.")
    if gain.ndim == 2 and not np.allclose(gain, gain.T, rtol=1e-10, atol=0):
        raise InvalidInput(name, "a symmetric matrix", "one that is not", "Use (G + Gᵀ)/2.")
    smallest = (
        gain[moving if moving is not None else slice(None)].min(initial=np.inf)
        if gain.ndim == 1
        else np.linalg.eigvalsh(gain)[0]
    )
    if not smallest > 0:
        raise InvalidInput(
            name, "a positive definite gain", f"smallest eigenvalue {smallest:g}", "Make it > 0."
        )
    return gain
