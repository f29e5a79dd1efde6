"""(44) and (45) in the metric of the cone of physical parameters: M̂ ≻ 0 without (46).

Γ is replaced by the inverse Hessian of ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ), b the barrier of the cone. With
the Bregman divergence D_ψ(θ‖θ̂) in place of ½ Δθᵀ Γ⁻¹ Δθ, V̇ = −Δvᵀ M K Δv as in Theorem 1, and θ̂
cannot leave the cone, where b is infinite. As b is logarithmically homogeneous, ∇²b θ = −∇b, and
(30) conserves ½ θ̂ᵀ Γ⁻¹ θ̂ − μ b(θ̂). Proofs: docs/theory.md.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..cone import (
    barrier,
    chart_rate,
    cone_of,
    coordinates,
    from_chart,
    gradient_and_hessian,
    inside,
    to_chart,
)
from ..errors import InvalidInput
from ..kernels import cholesky, solve, times
from ..parameters import Array
from ..system import Instant, Measurement, SecondOrderSystem
from .base import State
from .nullspace_aid import NullspaceIdentifier, body_gradient


@njit(cache=True)
def cone_rate(cone, inverse_gain, mu, eta, theta, gradient):
    """(p,) η̇ of (45) with Γ replaced by (Γ⁻¹ + μ ∇²b(θ̂))⁻¹."""
    _, metric = gradient_and_hessian(cone, theta)
    metric = inverse_gain + mu * metric
    L = np.zeros(metric.shape)
    cholesky(metric, L)
    return chart_rate(cone, eta, solve(L, gradient))


@njit(cache=True)
def cone_body_step(
    entries, values, group, F0, F1, F2, v0, v1, v2, v_hat, theta_hat, dt, K, cone, dual,
    inverse_gain, mu,
):  # fmt: skip
    """One RK4 step in the cone's chart for a body with M constant in its frame."""
    n = v_hat.shape[0]
    start = np.concatenate((v_hat, to_chart(cone, theta_hat)))
    z, end, smallest = start, start.copy(), np.inf
    for F, v, weight, reach in (
        (F0, v0, dt / 6, dt / 2),
        (F1, v1, dt / 3, dt / 2),
        (F1, v1, dt / 3, dt),
        (F2, v2, dt / 6, 0.0),
    ):
        theta = from_chart(cone, z[n:], dual)
        a_hat, gradient, pivot = body_gradient(entries, values, group, F, v, z[:n], theta)
        if not pivot > 0.0:
            return v_hat, theta_hat, pivot
        smallest = min(smallest, pivot)
        rate = cone_rate(cone, inverse_gain, mu, z[n:], theta, gradient)
        slope = np.concatenate((a_hat - times(K, z[:n] - v), rate))
        end += weight * slope
        z = start + reach * slope
    return end[:n].copy(), from_chart(cone, end[n:], dual), smallest


class ConeIdentifier(NullspaceIdentifier):
    """(44) and (45) in the cone's metric, integrated by RK4 in its chart.

    Args:
        system: the structure.
        K: (n,) or (n, n) gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) adaptation gain.
        prior: (p,) θ̂(0), inside the cone.
        dt: time between measurements [s].
        mu: weight μ of the barrier [J]; > 0.
        hermite: how the state between samples is had.

    Raises:
        InvalidInput: as for the base class; μ is not > 0; the prior is outside the cone.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        K: Array,
        Gamma: Array,
        prior: Array,
        dt: float,
        mu: float,
        hermite: bool = True,
    ):
        super().__init__(system, K, Gamma, prior, dt, hermite)
        if not (np.isfinite(mu) and mu > 0):
            raise InvalidInput("mu", "a weight > 0", mu, "0 is the paper's law: --law paper.")
        self.mu, self.cone = float(mu), cone_of(system.space)
        self._dual = coordinates(self.cone)
        self._inverse_gain = (
            np.diag(1 / self.Gamma) if self.Gamma.ndim == 1 else np.linalg.inv(self.Gamma)
        )
        if not inside(self.cone, self.prior):
            raise InvalidInput(
                "prior", "parameters a real body could have", "an estimate outside the cone",
                "Take a smaller initial_error, or draw it in the cone: --prior cone.",
            )  # fmt: skip
        self._offset = barrier(self.cone, self.prior)

    def _step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        n = self.system.n
        first, middle, last = self._instants(state, previous, following, dt)
        start = np.concatenate((state.v_hat, to_chart(self.cone, state.theta_hat)))
        z, end, smallest = start, start.copy(), np.inf
        for instant, weight, reach in (
            (first, dt / 6, dt / 2),
            (middle, dt / 3, dt / 2),
            (middle, dt / 3, dt),
            (last, dt / 6, 0.0),
        ):
            theta = from_chart(self.cone, z[n:], self._dual)
            a_hat, W, pivot = instant.evaluate(z[:n], theta)  # (29), (10, 31)
            if not pivot > 0:
                return state.v_hat, state.theta_hat, pivot, last
            smallest = min(smallest, pivot)
            dv = z[:n] - instant.v  # (37)
            rate = cone_rate(self.cone, self._inverse_gain, self.mu, z[n:], theta, dv @ W)
            slope = np.concatenate((a_hat - times(self.K, dv), rate))
            end += weight * slope
            z = start + reach * slope
        return end[:n], from_chart(self.cone, end[n:], self._dual), smallest, last

    def _body_step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        v_hat, theta_hat, pivot = cone_body_step(
            *self._body_stages(previous, following, dt), state.v_hat, state.theta_hat, dt, self.K,
            self.cone, self._dual, self._inverse_gain, self.mu,
        )  # fmt: skip
        t, q, v, _ = following
        return v_hat, theta_hat, pivot, Instant(self.system, t, q, v, previous.u)

    def conserved(self, theta_hat: Array) -> Array:
        """½ θ̂ᵀ Γ⁻¹ θ̂ − μ (b(θ̂) − b(θ̂₀)), twice: as the base class's for μ = 0."""
        quadratic = super().conserved(theta_hat)
        b = np.apply_along_axis(lambda theta: barrier(self.cone, theta), -1, theta_hat)
        return quadratic - 2 * self.mu * (b - self._offset)

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) D_ψ(θ‖θ̂) = ψ(θ) − ψ(θ̂) − ∇ψ(θ̂)·(θ − θ̂)."""
        quadratic = 0.5 * super().conserved(theta - theta_hat)
        own = barrier(self.cone, theta)

        def gap(estimate: Array) -> float:
            slope, _ = gradient_and_hessian(self.cone, estimate)
            return float(own - barrier(self.cone, estimate) - slope @ (theta - estimate))

        return quadratic + self.mu * np.apply_along_axis(gap, -1, theta_hat)
