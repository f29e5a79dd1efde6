"""The paper's identifier, (44) and (45)."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..errors import InvalidInput
from ..kernels import cholesky, solve, times, times_into
from ..parameters import Array, Indices
from ..recursion import BASE, CIRCLE, tree_gradient, tree_state, tree_work
from ..spatial import (
    bracket,
    coadjoint,
    planar_difference,
    planar_integrate,
    pose_difference,
    pose_integrate,
)
from ..system import Instant, Measurement, SecondOrderSystem, checked
from .base import Identifier, State, Status

RK4_LIMIT = 2.5  # |λ| dt within which RK4 is stable on the negative real axis (2.785), with room


@njit(cache=True)
def rates(a_hat, W, dv, K, Gamma):
    """(n+p,) the rates of v̂ (44) and of θ̂ (45)."""
    return np.concatenate((a_hat - times(K, dv), times(Gamma, np.dot(dv, W))))


@njit(cache=True)
def stage(z, total, v, a_hat, W, K, Gamma, weight, start, reach):
    """Adds a stage's rates to RK4's total and returns the next stage's z = (v̂, θ̂)."""
    dv = z[: v.shape[0]] - v  # (37)
    rate = rates(a_hat, W, dv, K, Gamma)
    total += weight * rate
    return start + reach * rate


@njit(cache=True)
def body_gradient(entries, values, group, F, v, v_hat, theta_hat):
    """â (n,) of (29), Wᵀ Δv (p,) and M̂'s smallest pivot, of a body with M constant in its frame.

    With h = M̂ v and C w = −ad_wᵀ h, W need not be formed: Wᵀ Δv gathers, for every entry
    M_ij = c θ_k, c (a_j Δv_i − v_j [v̂, Δv]_i).
    """
    n = v.shape[0]
    dv = v_hat - v  # (37)
    M, L = np.zeros((n, n)), np.zeros((n, n))
    for e in range(values.shape[0]):
        M[entries[e, 0], entries[e, 1]] += values[e] * theta_hat[entries[e, 2]]
    pivot = cholesky(M, L)
    gradient = -np.dot(dv, F)
    if not pivot > 0.0:
        return v_hat, gradient, pivot
    a_hat = solve(L, np.dot(F, theta_hat) + coadjoint(group, v_hat, np.dot(M, v)))  # (29)
    turned = bracket(group, v_hat, dv)
    for e in range(values.shape[0]):
        i, j, k = entries[e]
        gradient[k] += values[e] * (a_hat[j] * dv[i] - v[j] * turned[i])
    return a_hat, gradient, pivot


@njit(cache=True)
def body_rates(entries, values, group, F, v, z, K, Gamma):
    """(n+p,) the rates of v̂ (44) and of θ̂ (45) for such a body, and M̂'s smallest pivot."""
    n = v.shape[0]
    a_hat, gradient, pivot = body_gradient(entries, values, group, F, v, z[:n], z[n:])
    return np.concatenate((a_hat - times(K, z[:n] - v), times(Gamma, gradient))), pivot


@njit(cache=True)
def body_step(entries, values, group, F0, F1, F2, v0, v1, v2, v_hat, theta_hat, dt, K, Gamma):
    """One RK4 step of (44, 45) for such a body; F (n, p) and v (n,) at start, middle and end.

    Returns:
        (n,) v̂ and (p,) θ̂ at the end; the smallest pivot of M̂ on the way.
    """
    start = np.concatenate((v_hat, theta_hat))
    z, end, smallest = start, start.copy(), np.inf
    for F, v, weight, reach in (
        (F0, v0, dt / 6, dt / 2),
        (F1, v1, dt / 3, dt / 2),
        (F1, v1, dt / 3, dt),
        (F2, v2, dt / 6, 0.0),
    ):
        rate, pivot = body_rates(entries, values, group, F, v, z, K, Gamma)
        if not pivot > 0.0:
            return v_hat, theta_hat, pivot
        smallest = min(smallest, pivot)
        end += weight * rate
        z = start + reach * rate
    n = v_hat.shape[0]
    return end[:n].copy(), end[n:].copy(), smallest


@njit(cache=True)
def body_half_way(group, q0, v0, q1, v1, dt, hermite):
    """The pose and the velocity half-way between two samples of a body; see `half_way`."""
    dq = pose_difference(q0, q1) if group == 6 else planar_difference(q0, q1)
    half, v = half_way(dq, v0, v1, dt, hermite, group)
    return pose_integrate(q0, half) if group == 6 else planar_integrate(q0, half), v


@njit(cache=True)
def half_way(dq, v0, v1, dt, hermite, group):
    """The tangent step to, and the velocity at, the middle of two samples dq (n,) apart.

    The slope of the cubic through both positions and velocities is Simpson's rule solved for the
    middle: exact to dt⁴, where the cubic itself is exact to dt³ only. Where the velocities are a
    body twist, the cubic is that of the tangent step ξ, with v = ξ̇ − ½[ξ, ξ̇] + ⅙[ξ, [ξ, ξ̇]] …
    """
    once = bracket(group, dq, v1)
    slope1 = v1 + 0.5 * once + bracket(group, dq, once) / 12
    half = 0.5 * dq + 0.125 * dt * (v0 - slope1)
    if not hermite:
        return half, 0.5 * (v0 + v1)
    slope = 1.5 / dt * dq - 0.25 * (v0 + slope1)
    once = bracket(group, half, slope)
    return half, slope - 0.5 * once + bracket(group, half, once) / 6


@njit(cache=True)
def tree_half_way(linkage, q0, v0, q1, v1, dt, hermite, q, v):
    """The same for a tree of joints, into q and v."""
    joint = 0
    for at, kind in linkage[1][:, 1:]:
        if kind == BASE:
            q[:7], v[:6] = body_half_way(6, q0[:7], v0[:6], q1[:7], v1[:6], dt, hermite)
            joint = 6
            continue
        if kind == CIRCLE:
            c, s = q0[at], q0[at + 1]
            dq = np.arctan2(c * q1[at + 1] - s * q1[at], c * q1[at] + s * q1[at + 1])
        else:
            dq = q1[at] - q0[at]
        half = 0.5 * dq + 0.125 * dt * (v0[joint] - v1[joint])
        if kind == CIRCLE:
            cosine, sine = np.cos(half), np.sin(half)
            q[at], q[at + 1] = c * cosine - s * sine, s * cosine + c * sine
        else:
            q[at] = q0[at] + half
        if hermite:
            v[joint] = 1.5 / dt * dq - 0.25 * (v0[joint] + v1[joint])
        else:
            v[joint] = 0.5 * (v0[joint] + v1[joint])
        joint += 1


@njit(cache=True)
def tree_step(
    joints, numbers, gravity, columns, q0, v0, u, q1, v1, v_hat, theta_hat, dt, hermite, K, Gamma
):
    """One RK4 step of (44, 45) for a tree of bodies; the first four arguments are its `Linkage`.

    Returns:
        (n+p+1,) v̂ and θ̂ at the end, and the smallest pivot of M̂ on the way.
    """
    linkage, n, p = (joints, numbers, gravity, columns), v_hat.shape[0], theta_hat.shape[0]
    q, v = np.empty(q0.shape[0]), np.empty(n)
    tree_half_way(linkage, q0, v0, q1, v1, dt, hermite, q, v)
    work, a_hat, gradient = tree_work(linkage, n), np.empty(n), np.empty((1, p))
    state0, state1 = tree_state(linkage, q0, v0), tree_state(linkage, q, v)
    state2 = tree_state(linkage, q1, v1)
    start = np.concatenate((v_hat, theta_hat))
    z, rate, end, smallest = start.copy(), np.empty(n + p), np.empty(n + p + 1), np.inf
    end[: n + p] = start
    for state, v_x, weight, reach in (
        (state0, v0, dt / 6, dt / 2),
        (state1, v, dt / 3, dt / 2),
        (state1, v, dt / 3, dt),
        (state2, v1, dt / 6, 0.0),
    ):
        pivot = tree_gradient(linkage, state, v_x, u, z[:n], z[n:], work, a_hat, gradient)
        if not pivot > 0.0:
            end[-1] = pivot
            return end
        smallest = min(smallest, pivot)
        for i in range(n):
            z[i] -= v_x[i]  # (37)
        times_into(K, z[:n], rate[:n])
        times_into(Gamma, gradient[0], rate[n:])  # (45)
        for i in range(n):
            rate[i] = a_hat[i] - rate[i]  # (44)
        for i in range(n + p):
            end[i] += weight * rate[i]
            z[i] = start[i] + reach * rate[i]
    end[-1] = smallest
    return end


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

    def init(self, first: Measurement) -> State:
        """v̂ = v, so that Δv(t₀) = 0 as (46) assumes, and θ̂ the prior."""
        first = checked(self.system, first)
        instant = self.system.at(*first)
        return State(first.t, first.v.copy(), self.prior.copy(), np.inf, Status.completed, instant)

    def step(self, state: State, previous: Measurement, following: Measurement) -> State:
        """One RK4 step of (44, 45) from `previous` to `following`.

        Raises:
            InvalidInput: time does not increase.
        """
        dt = following.t - previous.t
        if not 0 < dt < np.inf:
            raise InvalidInput(
                "t",
                f"a time after {previous.t!r} s",
                repr(following.t),
                "Sort the samples by time.",
            )
        here = state.instant
        if (following.q.shape, following.v.shape, following.u.shape) != (
            here.q.shape, here.v.shape, here.u.shape,
        ):  # fmt: skip
            checked(self.system, following)  # says which
        if self.system.linkage is not None:
            advance = self._tree_step
        elif self.system.inertia is not None:
            advance = self._body_step
        else:
            advance = self._step
        v_hat, theta_hat, pivot, last = advance(state, previous, following, dt)
        if pivot > 0:
            return State(following.t, v_hat, theta_hat, pivot, Status.completed, last)
        finite = all(np.isfinite(part).all() for part in (*previous[1:], *following[1:]))
        status = Status.estimate_not_positive_definite if finite else Status.measurement_not_finite
        return state._replace(pivot=pivot, status=status)

    def _step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        """v̂, θ̂, M̂'s smallest pivot (> 0 if the step succeeded), and the system at its end."""
        n = self.system.n
        first, middle, last = self._instants(state, previous, following, dt)
        start = np.concatenate(state[1:3])
        z, end, smallest = start, start.copy(), np.inf
        for instant, weight, reach in (
            (first, dt / 6, dt / 2),
            (middle, dt / 3, dt / 2),
            (middle, dt / 3, dt),
            (last, dt / 6, 0.0),
        ):
            a_hat, W, pivot = instant.evaluate(z[:n], z[n:])  # (29), (10, 31)
            if not pivot > 0:
                return z[:n], z[n:], pivot, last
            smallest = min(smallest, pivot)
            z = stage(z, end, instant.v, a_hat, W, self.K, self.Gamma, weight, start, reach)
        return end[:n], end[n:], smallest, last

    def _body_step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        """The same for a body whose M is constant in its frame, all stages in one compiled call."""
        v_hat, theta_hat, pivot = body_step(
            *self._body_stages(previous, following, dt), state.v_hat, state.theta_hat, dt, self.K,
            self.Gamma,
        )  # fmt: skip
        t, q, v, _ = following
        return v_hat, theta_hat, pivot, Instant(self.system, t, q, v, previous.u)

    def _tree_step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        """The same for a tree whose bodies are moved by `recursion`, in one compiled call."""
        (_, q0, v0, u), (t, q1, v1, _), n = previous, following, self.system.n
        assert self.system.linkage is not None
        end = tree_step(
            *self.system.linkage, q0, v0, u, q1, v1, state.v_hat, state.theta_hat, dt,
            self.hermite, self.K, self.Gamma,
        )  # fmt: skip
        return end[:n], end[n:-1], float(end[-1]), self.system.at(t, q1, v1, u)

    def _instants(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Instant, Instant, Instant]:
        """The system at the start, the middle and the end of a step, its command held."""
        system, u = self.system, previous.u
        return (
            state.instant.commanded(previous.t, u),
            system.at(previous.t + 0.5 * dt, *self._between(previous, following, dt), u),
            system.at(following.t, following.q, following.v, u),
        )

    def _body_stages(
        self, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Indices, Array, int, Array, Array, Array, Array, Array, Array]:
        """What `body_step` needs of the system: M's entries and group, then F and v three times."""
        system, (t0, q0, v0, u), (t1, q1, v1, _) = self.system, previous, following
        assert system.inertia is not None
        q, v = body_half_way(system.group, q0, v0, q1, v1, dt, self.hermite)
        F = system._F(t0, q0, v0, u), system._F(t0 + 0.5 * dt, q, v, u), system._F(t1, q1, v1, u)
        entries, values = system.inertia
        return entries, values, system.group, *F, v0, v, v1

    def conserved(self, theta_hat: Array) -> Array:
        """θ̂ᵀ Γ⁻¹ θ̂ over the parameters that move, constant under (45) by (30).

        Constant only where none is held: (30) says W θ̂ = 0 for the whole θ̂.
        """
        moving = self.moving
        theta = np.asarray(theta_hat)[..., moving]
        if self.Gamma.ndim == 1:
            return np.sum(theta**2 / self.Gamma[moving], axis=-1)
        return np.sum(theta * np.linalg.solve(self.Gamma, theta[..., None])[..., 0], axis=-1)

    def _between(
        self, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array]:
        """(q, v) half-way between two measurements."""
        dq = self.system.difference(previous.q, following.q)
        half, v = half_way(dq, previous.v, following.v, dt, self.hermite, self.system.group)
        return self.system.integrate(previous.q, half), v


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
