"""(44) and (45) in the metric of the cone of physical parameters: M̂ ≻ 0 without (46).

Γ is replaced by the inverse Hessian of ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ), b the barrier of the cone. With
the Bregman divergence D_ψ(θ‖θ̂) in place of ½ Δθᵀ Γ⁻¹ Δθ, V̇ = −Δvᵀ M K Δv as in Theorem 1, and θ̂
cannot leave the cone, where b is infinite. As b is logarithmically homogeneous, ∇²b θ = −∇b, and
(30) conserves ½ θ̂ᵀ Γ⁻¹ θ̂ − μ b(θ̂). Proofs: docs/theory.md.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..cone import barrier, cone_of, coordinates, gradient_and_hessian, inside
from ..errors import InvalidInput
from ..kernels import times
from ..parameters import Array
from ..recursion import tree_gradient, tree_state, tree_work
from ..system import Instant, Measurement, SecondOrderSystem
from .base import State
from .chart import confine, from_chart, natural_rate, to_chart
from .nullspace_aid import NullspaceIdentifier, body_gradient, tree_half_way


@njit(cache=True)
def begin(cone, v_hat, theta_hat):
    """(n+p,) z = (v̂, η) where a step begins."""
    return np.concatenate((v_hat, to_chart(cone, theta_hat)))


@njit(cache=True)
def body_stage(
    start, total, z, theta, v, a_hat, gradient, weight, reach, K, cone, pairing, stiffness, mu
):  # fmt: skip
    """Adds a stage's rates to RK4's total; returns the next z = (v̂, η) and θ̂, at last the end's.

    The metric of (45) is Γ⁻¹ + μ ∇²b(θ̂), and the rate of θ̂ is carried into the chart.
    """
    n = v.shape[0]
    rate = np.empty(z.shape[0])
    rate[:n] = a_hat - times(K, z[:n] - v)  # (44)
    rate[n:] = natural_rate(cone, z[n:], theta, stiffness, mu, gradient)  # (45)
    total += weight * rate
    z = start + reach * rate if reach > 0.0 else total
    confine(cone, start[n:], z[n:])
    return z, from_chart(cone, z[n:], pairing)


@njit(cache=True)
def stage(start, total, z, theta, v, a_hat, W, weight, reach, K, cone, pairing, stiffness, mu):
    """The same from the regressor W (n, p) in place of Wᵀ Δv."""
    gradient = np.dot(z[: v.shape[0]] - v, W)
    return body_stage(
        start, total, z, theta, v, a_hat, gradient, weight, reach, K, cone, pairing, stiffness, mu
    )


@njit(cache=True)
def cone_body_step(
    entries, values, group, F0, F1, F2, v0, v1, v2, v_hat, theta_hat, dt,
    K, cone, pairing, stiffness, mu,
):  # fmt: skip
    """One RK4 step in the cone's chart for a body with M constant in its frame."""
    n = v_hat.shape[0]
    start = begin(cone, v_hat, theta_hat)
    z, theta, total, smallest = start, theta_hat, start.copy(), np.inf
    for F, v, weight, reach in (
        (F0, v0, dt / 6, dt / 2),
        (F1, v1, dt / 3, dt / 2),
        (F1, v1, dt / 3, dt),
        (F2, v2, dt / 6, 0.0),
    ):
        a_hat, gradient, pivot = body_gradient(entries, values, group, F, v, z[:n], theta)
        if not pivot > 0.0:
            return v_hat, theta_hat, pivot
        smallest = min(smallest, pivot)
        z, theta = body_stage(
            start, total, z, theta, v, a_hat, gradient, weight, reach,
            K, cone, pairing, stiffness, mu,
        )  # fmt: skip
    return z[:n].copy(), theta, smallest if inside(cone, theta) else np.nan


@njit(cache=True)
def cone_tree_step(
    joints, numbers, gravity, columns, q0, v0, u, q1, v1, v_hat, theta_hat, dt, hermite,
    K, cone, pairing, stiffness, mu,
):  # fmt: skip
    """One RK4 step in the cone's chart for a tree of bodies; returns as `tree_step` does."""
    linkage, n, p = (joints, numbers, gravity, columns), v_hat.shape[0], theta_hat.shape[0]
    q, v, end = np.empty(q0.shape[0]), np.empty(n), np.empty(n + p + 1)
    tree_half_way(linkage, q0, v0, q1, v1, dt, hermite, q, v)
    work, a_hat, gradient = tree_work(linkage, n), np.empty(n), np.empty((1, p))
    state0, state1 = tree_state(linkage, q0, v0), tree_state(linkage, q, v)
    state2 = tree_state(linkage, q1, v1)
    start = begin(cone, v_hat, theta_hat)
    z, theta, total, smallest = start, theta_hat, start.copy(), np.inf
    for state, v_x, weight, reach in (
        (state0, v0, dt / 6, dt / 2),
        (state1, v, dt / 3, dt / 2),
        (state1, v, dt / 3, dt),
        (state2, v1, dt / 6, 0.0),
    ):
        pivot = tree_gradient(linkage, state, v_x, u, z[:n], theta, work, a_hat, gradient)
        if not pivot > 0.0:
            end[:n], end[n:-1], end[-1] = v_hat, theta_hat, pivot
            return end
        smallest = min(smallest, pivot)
        z, theta = body_stage(
            start, total, z, theta, v_x, a_hat, gradient[0], weight, reach,
            K, cone, pairing, stiffness, mu,
        )  # fmt: skip
    end[:n], end[n:-1], end[-1] = z[:n], theta, smallest if inside(cone, theta) else np.nan
    return end


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
        stiffness = 1 / self.Gamma if self.Gamma.ndim == 1 else np.linalg.inv(self.Gamma)
        self._gains = self.K, self.cone, coordinates(self.cone), stiffness, self.mu
        if not inside(self.cone, self.prior):
            raise InvalidInput(
                "prior", "parameters a real body could have", "an estimate outside the cone",
                "Take a smaller initial_error, or draw it in the cone: --prior cone.",
            )  # fmt: skip
        self._offset = barrier(self.cone, self.prior)
        self.cancelling = self.mu * (2 * abs(self._offset) + self.cone.degree)

    def _step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        n, gains = self.system.n, self._gains
        first, middle, last = self._instants(state, previous, following, dt)
        start = begin(self.cone, state.v_hat, state.theta_hat)
        z, theta, total, smallest = start, state.theta_hat, start.copy(), np.inf
        for instant, weight, reach in (
            (first, dt / 6, dt / 2),
            (middle, dt / 3, dt / 2),
            (middle, dt / 3, dt),
            (last, dt / 6, 0.0),
        ):
            a_hat, W, pivot = instant.evaluate(z[:n], theta)  # (29), (10, 31)
            if not pivot > 0:
                return state.v_hat, state.theta_hat, pivot, last
            smallest, v = min(smallest, pivot), instant.v
            z, theta = stage(start, total, z, theta, v, a_hat, W, weight, reach, *gains)
        return z[:n], theta, smallest if inside(self.cone, theta) else np.nan, last

    def _body_step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        v_hat, theta_hat, pivot = cone_body_step(
            *self._body_stages(previous, following, dt), state.v_hat, state.theta_hat, dt,
            *self._gains,
        )  # fmt: skip
        t, q, v, _ = following
        return v_hat, theta_hat, pivot, Instant(self.system, t, q, v, previous.u)

    def _tree_step(
        self, state: State, previous: Measurement, following: Measurement, dt: float
    ) -> tuple[Array, Array, float, Instant]:
        (_, q0, v0, u), (t, q1, v1, _), n = previous, following, self.system.n
        assert self.system.linkage is not None
        end = cone_tree_step(
            *self.system.linkage, q0, v0, u, q1, v1, state.v_hat, state.theta_hat, dt,
            self.hermite, *self._gains,
        )  # fmt: skip
        return end[:n], end[n:-1], float(end[-1]), self.system.at(t, q1, v1, u)

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
