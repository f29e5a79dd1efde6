"""The paper's identifier, (44) and (45)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit

from ..errors import InvalidInput
from ..kernels import times
from ..parameters import Array
from ..system import Measurement, SecondOrderSystem, checked
from .base import Identifier, IdentifierConfig, State, Status

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
def half_way(dq, v0, v1, dt, hermite):
    """The tangent step to, and the velocity at, the middle of two samples dq (n,) apart.

    The slope of the cubic through both positions and velocities is Simpson's rule solved for the
    middle: exact to dt⁴, where the cubic itself is exact to dt³ only.
    """
    half = 0.5 * dq + 0.125 * dt * (v0 - v1)
    if hermite:
        return half, 1.5 / dt * dq - 0.25 * (v0 + v1)
    return half, 0.5 * (v0 + v1)


@dataclass(frozen=True)
class NullspaceAID(IdentifierConfig):
    """Nullspace adaptive identification with constant gains.

    Attributes:
        K: gain of the identification plant, K = K·I [1/s].
        gain: adaptation gain γ; Γ = γ diag(scale²) [1/J].
        interpolation: the measured state half-way between samples: `hermite`, the cubic through
            both positions and velocities, for exact encoders; `linear`, the mean of both
            velocities, where differences of positions are noise; `auto` chooses by the sensors.
    """

    K: float = 20.0
    gain: float = 1.0
    interpolation: Literal["auto", "hermite", "linear"] = "auto"

    def __post_init__(self) -> None:
        if self.interpolation not in ("auto", "hermite", "linear"):
            raise InvalidInput(
                "interpolation", "auto, hermite or linear", self.interpolation, "auto will do."
            )

    def build(self, system: SecondOrderSystem, prior: Array, dt: float, quiet: bool) -> Identifier:
        """Makes the identifier with K = K·I and Γ = γ diag(scale²)."""
        return NullspaceIdentifier(
            system,
            K=np.full(system.n, self.K),
            Gamma=self.gain * system.space.scale**2,
            prior=prior,
            dt=dt,
            hermite=quiet if self.interpolation == "auto" else self.interpolation == "hermite",
        )


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

        n, start = system.n, np.concatenate(state[1:3])
        z, end, smallest = start, start.copy(), np.inf
        for instant, weight, reach in (
            (first, dt / 6, dt / 2),
            (middle, dt / 3, dt / 2),
            (middle, dt / 3, dt),
            (last, dt / 6, 0.0),
        ):
            a_hat, W, pivot = instant.evaluate(z[:n], z[n:])  # (29), (10, 31)
            if not pivot > 0:
                finite = all(np.isfinite(part).all() for part in (*previous[1:], *following[1:]))
                status = (
                    Status.estimate_not_positive_definite
                    if finite
                    else Status.measurement_not_finite
                )
                return state._replace(pivot=pivot, status=status)
            smallest = min(smallest, pivot)
            z = stage(z, end, instant.v, a_hat, W, self.K, self.Gamma, weight, start, reach)
        return State(following.t, end[:n], end[n:], smallest, Status.completed, last)

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
        half, v = half_way(dq, previous.v, following.v, dt, self.hermite)
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
