"""(44) and (45) in the metric of the cone of physical parameters: M̂ ≻ 0 without (46).

Γ is replaced by the inverse Hessian of ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ), with b the barrier of the cone.
With the Bregman divergence D_ψ(θ‖θ̂) in place of ½ Δθᵀ Γ⁻¹ Δθ, V̇ = −Δvᵀ M K Δv as in Theorem 1,
and θ̂ cannot leave the cone, as b grows without bound towards its boundary. Since b is
logarithmically homogeneous, ∇²b θ = −∇b, and by (30) ½ θ̂ᵀ Γ⁻¹ θ̂ − μ b(θ̂) is conserved. Proofs are
in docs/theory.md.
"""

import numpy as np

from ...errors import InvalidInput
from ...parameters import Array, ParameterSpace
from ...quotient.barrier import barrier, barriers, gaps, gradient_and_hessian
from ...quotient.cone import cone_of, coordinates, inside
from ..metric import ConstantMetric, Law, Metric


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

    def __init__(self, space: ParameterSpace, Gamma: Array, prior: Array, mu: float):
        self._flat = ConstantMetric(Gamma, size=len(space))
        self.Gamma = self._flat.Gamma
        if not (np.isfinite(mu) and mu > 0):
            raise InvalidInput("mu", "a weight > 0", mu, "0 is the paper's law: --law paper.")
        self.mu, self.cone = float(mu), cone_of(space)
        whole = self.Gamma.ndim == 2
        stiffness = np.asarray(np.linalg.inv(self.Gamma) if whole else 1 / self.Gamma, np.float64)
        self._pairing, self._inverse_gain = coordinates(self.cone), stiffness
        prior = space.check(prior, "prior")
        if not inside(self.cone, prior):
            raise InvalidInput(
                "prior",
                "parameters a real body could have",
                "an estimate outside the cone",
                "Draw it with cone.prior.drawn_inside, or use law='paper', which accepts any.",
            )
        self._offset = barrier(self.cone, prior)
        self.cancelling = self.mu * (2 * abs(self._offset) + self.cone.degree)
        self.stiffness = (stiffness if whole else np.diag(stiffness)) / self.mu

    def law(self, K: Array) -> Law:
        """K (n,) or (n, n) and the metric, for compiled loops."""
        gains = np.atleast_2d(K), np.atleast_2d(self._inverse_gain)
        return Law(*gains, self.cone, self._pairing, self.mu)

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
        return float(0.5 * theta @ self.stiffness @ theta + barrier(self.cone, theta))

    def mirror(self, theta: Array) -> tuple[Array, Array]:
        """(p,) ∇ψ(θ)/μ and (p, p) ∇²ψ(θ)/μ."""
        slope, metric = gradient_and_hessian(self.cone, theta)
        return self.stiffness @ theta + slope, self.stiffness + metric


def _rows(theta: Array) -> Array:
    """(N, p) estimates of (..., p)."""
    return np.ascontiguousarray(theta, dtype=np.float64).reshape(-1, np.shape(theta)[-1])
