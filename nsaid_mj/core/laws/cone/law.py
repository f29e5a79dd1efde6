"""(44) and (45) in the metric of the cone of physical parameters: M̂ ≻ 0 without (46).

Γ is replaced by the inverse Hessian of ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ), with b the barrier of the cone.
With the Bregman divergence D_ψ(θ‖θ̂) in place of ½ Δθᵀ Γ⁻¹ Δθ, V̇ = −Δvᵀ M K Δv as in Theorem 1,
and θ̂ cannot leave the cone, as b grows without bound towards its boundary. Since b is
logarithmically homogeneous, ∇²b θ = −∇b, and by (30) ½ θ̂ᵀ Γ⁻¹ θ̂ − μ b(θ̂) is conserved. Proofs are
in docs/theory.md.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ....base import InvalidInput
from ...numerics.kernels import boolean, f8, matrix, routine, vector, void
from ...parameters import Array, ParameterSpace
from ...quotient.barrier import barriers, gaps
from ...quotient.cone import CONE, Cone, coordinates, inside
from ..metric import CompiledMetric, ConstantMetric, Metric
from .chart import (
    CHART,
    Chart,
    chart_of,
    confine,
    dense_rate_into,
    from_chart_into,
    height,
    natural_rate_into,
    to_chart_into,
)

ACCURACY = 1e-7
"""Largest change of the conserved quantity in one step, relative to μν."""


class ConeNumbers(NamedTuple):
    """The cone's metric for compiled loops."""

    stiffness: Array  # (p, p) Γ⁻¹, or its diagonal (1, p)
    cone: Cone
    pairing: Array  # (e,) `coordinates` of the cone
    mu: float  # weight μ of the barrier [J]


_NUMBERS = types.NamedTuple((matrix, CONE, vector, f8), ConeNumbers)


@routine(void(_NUMBERS, vector, vector, CHART))
def _enter(numbers, theta, eta, chart):
    """Writes η (p,) of θ̂ (p,)."""
    to_chart_into(numbers.cone, theta, eta, chart)


@routine(void(_NUMBERS, vector, vector, CHART))
def _leave(numbers, eta, theta, chart):
    """Writes θ̂ (p,) of η (p,)."""
    from_chart_into(numbers.cone, eta, numbers.pairing, theta, chart)


@routine(void(_NUMBERS, vector, vector, vector, vector, CHART))
def _adapt(numbers, eta, theta, gradient, rate, chart):
    """Writes η̇ (p,) for θ̂̇ = (Γ⁻¹ + μ ∇²b)⁻¹ Wᵀ Δv, at η and θ̂ (p,)."""
    cone = numbers.cone
    stiffness = numbers.stiffness
    mu = numbers.mu
    if stiffness.shape[0] == 1:
        natural_rate_into(cone, eta, theta, stiffness[0], mu, gradient, rate, chart)
    else:
        dense_rate_into(cone, eta, theta, stiffness, mu, gradient, rate)


@routine(void(_NUMBERS, vector, vector, CHART))
def _hold(numbers, start, eta, chart):
    """Shortens the step from `start` (p,) to η (p,), in place, where θ̂ would leave the cone."""
    confine(numbers.cone, start, eta)


@routine(f8(matrix, vector))
def _stored(stiffness, theta):
    """θᵀ Γ⁻¹ θ at θ (p,), for Γ⁻¹ (p, p) or its diagonal (1, p)."""
    total = 0.0
    for i in range(theta.shape[0]):
        if stiffness.shape[0] == 1:
            total += stiffness[0, i] * theta[i] * theta[i]
            continue
        for j in range(theta.shape[0]):
            total += theta[i] * stiffness[i, j] * theta[j]
    return total


@routine(boolean(_NUMBERS, vector, vector, vector, vector, CHART))
def _accurate(numbers, start, eta, before, theta, chart):
    """Whether the conserved quantity's change in a step is at most `ACCURACY`.

    It is not where θ̂ is outside the cone, as only rounding could bring about.
    """
    cone = numbers.cone
    change = _stored(numbers.stiffness, theta) - _stored(numbers.stiffness, before)
    b = height(cone, eta, theta, chart) - height(cone, start, before, chart)
    return abs(change - 2 * numbers.mu * b) <= ACCURACY * numbers.mu * cone.degree


class ConeMetric(Metric):
    """∇²ψ(θ̂) = Γ⁻¹ + μ ∇²b(θ̂) in place of Γ⁻¹.

    Args:
        space: names, units and scale of the parameters.
        Gamma: (p,) or (p, p) positive definite adaptation gain.
        prior: (p,) θ̂(0), inside the cone; the offset of the conserved quantity refers to it.
        mu: weight μ of the barrier [J]; > 0.

    Attributes:
        mu: weight μ of the barrier [J].
        cone: the cone.
        stiffness: (p, p) Γ⁻¹/μ.

    Raises:
        InvalidInput: Γ is not positive definite, μ is not > 0, or the prior is outside the cone.
    """

    conserves = True
    divides = True
    compiled = CompiledMetric(_NUMBERS, CHART, _enter, _leave, _adapt, _hold, _accurate)

    def __init__(self, space: ParameterSpace, Gamma: Array, prior: Array, mu: float):
        self._flat = ConstantMetric(Gamma, size=len(space))
        self.Gamma = self._flat.Gamma
        if not (np.isfinite(mu) and mu > 0):
            raise InvalidInput("mu", "a weight > 0", mu, "0 is the paper's law: --law paper.")
        self.mu, self.cone = float(mu), Cone.of(space)
        whole = self.Gamma.ndim == 2
        stiffness = np.asarray(np.linalg.inv(self.Gamma) if whole else 1 / self.Gamma, np.float64)
        pairing = coordinates(self.cone)
        self.numbers = ConeNumbers(np.atleast_2d(stiffness), self.cone, pairing, self.mu)
        prior = space.check(prior, "prior")
        if not inside(self.cone, prior):
            raise InvalidInput(
                "prior",
                "parameters a real body could have",
                "an estimate outside the cone",
                "Draw it by cone.prior.Prior, or use law='paper', which accepts any.",
            )
        self._offset = self.cone.barrier(prior)
        self.cancelling = self.mu * (2 * abs(self._offset) + self.cone.degree)
        self.stiffness = (stiffness if whole else np.diag(stiffness)) / self.mu

    def workspace(self) -> Chart:
        """New workspace of the compiled functions."""
        return chart_of(self.cone)

    def conserved(self, theta_hat: Array) -> Array:
        """(...,) θ̂ᵀ Γ⁻¹ θ̂ − 2 μ (b(θ̂) − b(θ̂₀)) of estimates (..., p)."""
        quadratic = self._flat.conserved(theta_hat)
        b = barriers(self.cone, _rows(theta_hat)).reshape(np.shape(quadratic))
        return quadratic - 2 * self.mu * (b - self._offset)

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) D_ψ(θ‖θ̂) = ψ(θ) − ψ(θ̂) − ∇ψ(θ̂)·(θ − θ̂), at θ (p,) and estimates (..., p)."""
        quadratic = 0.5 * self._flat.conserved(theta - theta_hat)
        gap = gaps(self.cone, theta, _rows(theta_hat)).reshape(np.shape(quadratic))
        return quadratic + self.mu * gap

    def potential(self, theta: Array) -> float:
        """ψ(θ)/μ at θ (p,)."""
        return float(0.5 * theta @ self.stiffness @ theta + self.cone.barrier(theta))

    def mirror(self, theta: Array) -> tuple[Array, Array]:
        """(p,) ∇ψ(θ)/μ and (p, p) ∇²ψ(θ)/μ."""
        slope, metric = self.cone.derivatives(theta)
        return self.stiffness @ theta + slope, self.stiffness + metric


def _rows(theta: Array) -> Array:
    """(N, p) estimates of (..., p)."""
    return np.ascontiguousarray(theta, dtype=np.float64).reshape(-1, np.shape(theta)[-1])
