"""The paper's identifier, (44) and (45)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from ..errors import InvalidInput
from ..kernels import cholesky, solve, times
from ..parameters import Array
from ..spatial import bracket, coadjoint
from ..system import Instant, Measurement, SecondOrderSystem, checked
from .base import Expected, Identifier, IdentifierConfig, State, Status

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
def body_rates(entries, values, group, F, v, z, K, Gamma):
    """(n+p,) the same rates for a body whose M is constant in its frame, and M̂'s smallest pivot.

    With h = M̂ v and C w = −ad_wᵀ h, W need not be formed: Wᵀ Δv gathers, for every entry
    M_ij = c θ_k, c (a_j Δv_i − v_j [v̂, Δv]_i).
    """
    n = v.shape[0]
    v_hat, theta_hat = z[:n], z[n:]
    dv = v_hat - v  # (37)
    M, L = np.zeros((n, n)), np.zeros((n, n))
    for e in range(values.shape[0]):
        M[entries[e, 0], entries[e, 1]] += values[e] * theta_hat[entries[e, 2]]
    pivot = cholesky(M, L)
    if not pivot > 0.0:
        return z, pivot
    a_hat = solve(L, np.dot(F, theta_hat) + coadjoint(group, v_hat, np.dot(M, v)))  # (29)
    turned = bracket(group, v_hat, dv)
    gradient = -np.dot(dv, F)  # Wᵀ Δv
    for e in range(values.shape[0]):
        i, j, k = entries[e]
        gradient[k] += values[e] * (a_hat[j] * dv[i] - v[j] * turned[i])
    return np.concatenate((a_hat - times(K, dv), times(Gamma, gradient))), pivot


@njit(cache=True)
def body_step(entries, values, group, F, v, start, dt, K, Gamma):
    """One RK4 step of (44, 45) for such a body, with F (3, n, p) and v (3, n) at its stages.

    Returns:
        (n+p,) v̂ and θ̂ at the end; the smallest pivot of M̂ on the way.
    """
    z, end, smallest = start, start.copy(), np.inf
    for stage_number in range(4):
        at = (stage_number + 1) // 2
        rate, pivot = body_rates(entries, values, group, F[at], v[at], z, K, Gamma)
        if not pivot > 0.0:
            return start, pivot
        smallest = min(smallest, pivot)
        end += (dt / 6 if stage_number in (0, 3) else dt / 3) * rate
        z = start + (dt if stage_number == 2 else dt / 2) * rate
    return end, smallest


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


@dataclass(frozen=True)
class NullspaceAID(IdentifierConfig):
    """Nullspace adaptive identification with constant gains.

    Attributes:
        K: gain of the identification plant, K = K·I [1/s].
        gain: adaptation gain γ; Γ = γ diag(scale²) [1/J].
        interpolation: the measured state half-way between samples: `hermite`, the cubic through
            both positions and velocities, for exact encoders; `linear`, the mean of both
            velocities, where differences of positions are noise; `auto` chooses by the sensors.
        gamma: `scale`, Γ = γ diag(scale²); or `simulated`, Γ = rate·K·S H⁻¹ S with H the mean of
            S Wᵀ M⁻¹ W S that a simulation under the prior expects, S = diag(scale).
        rate: at which every direction converges where `gamma` is `simulated` [1/s]; those that
            are excited less than `floor` of the best are slower.
        floor: smallest eigenvalue of H that counts, as a share of the largest.
    """

    K: float = 20.0
    gain: float = 1.0
    interpolation: Literal["auto", "hermite", "linear"] = "auto"
    gamma: Literal["scale", "simulated"] = "scale"
    rate: float = 0.1
    floor: float = 1e-2

    def __post_init__(self) -> None:
        if self.interpolation not in ("auto", "hermite", "linear"):
            raise InvalidInput(
                "interpolation", "auto, hermite or linear", self.interpolation, "auto will do."
            )
        if self.gamma not in ("scale", "simulated"):
            raise InvalidInput("gamma", "scale or simulated", self.gamma, "scale needs no driver.")
        if not (np.isfinite(self.rate) and self.rate > 0):
            raise InvalidInput("identifier.rate", "a rate > 0 /s", self.rate, "0.1 will do.")
        if not 0 < self.floor <= 1:
            raise InvalidInput("identifier.floor", "a share in (0, 1]", self.floor, "0.01 will do.")

    def build(
        self,
        system: SecondOrderSystem,
        prior: Array,
        dt: float,
        quiet: bool,
        gramian: Expected | None = None,
    ) -> Identifier:
        """Makes the identifier with K = K·I and Γ as `gamma` says.

        Raises:
            InvalidInput: `gamma` is `simulated` and there is nothing to simulate with.
        """
        return NullspaceIdentifier(
            system,
            K=np.full(system.n, self.K),
            Gamma=self._gain(system, gramian),
            prior=prior,
            dt=dt,
            hermite=quiet if self.interpolation == "auto" else self.interpolation == "hermite",
        )

    def _gain(self, system: SecondOrderSystem, gramian: Expected | None) -> Array:
        """(p,) or (p, p) Γ."""
        scale = system.space.scale
        if self.gamma == "scale":
            return self.gain * scale**2
        if gramian is None:
            raise InvalidInput("gamma", "scale, without a driver", self.gamma, "Run a scenario.")
        inverse = floored_inverse(gramian(), self.floor)
        return self.rate * self.K * inverse * np.outer(scale, scale)


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
        system, u = self.system, previous.u
        first = state.instant.commanded(previous.t, u)
        middle = system.at(previous.t + 0.5 * dt, *self._between(previous, following, dt), u)
        last = system.at(following.t, following.q, following.v, u)

        start = np.concatenate(state[1:3])
        end, smallest = self._rk4(start, first, middle, last, dt)
        if not smallest > 0:
            finite = all(np.isfinite(part).all() for part in (*previous[1:], *following[1:]))
            status = (
                Status.estimate_not_positive_definite if finite else Status.measurement_not_finite
            )
            return state._replace(pivot=smallest, status=status)
        n = system.n
        return State(following.t, end[:n], end[n:], smallest, Status.completed, last)

    def _rk4(
        self, start: Array, first: Instant, middle: Instant, last: Instant, dt: float
    ) -> tuple[Array, float]:
        """(n+p,) v̂ and θ̂ at the end of a step, and M̂'s smallest pivot; > 0 if it succeeded."""
        n, body = self.system.n, self.system.inertia
        if body is not None:
            F = np.stack((first.F, middle.F, last.F))
            v = np.stack((first.v, middle.v, last.v))
            return body_step(*body, self.system.group, F, v, start, dt, self.K, self.Gamma)
        z, end, smallest = start, start.copy(), np.inf
        for instant, weight, reach in (
            (first, dt / 6, dt / 2),
            (middle, dt / 3, dt / 2),
            (middle, dt / 3, dt),
            (last, dt / 6, 0.0),
        ):
            a_hat, W, pivot = instant.evaluate(z[:n], z[n:])  # (29), (10, 31)
            if not pivot > 0:
                return start, pivot
            smallest = min(smallest, pivot)
            z = stage(z, end, instant.v, a_hat, W, self.K, self.Gamma, weight, start, reach)
        return end, smallest

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


def floored_inverse(gramian: Array, floor: float) -> Array:
    """Inverse of a positive semidefinite matrix, its eigenvalues raised to floor·λ_max."""
    values, vectors = np.linalg.eigh(gramian)
    inverse = (vectors / np.maximum(values, floor * values[-1])) @ vectors.T
    return 0.5 * (inverse + inverse.T)


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
