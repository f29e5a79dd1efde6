"""(44) and (45) in the metric of the cone of physical parameters: M̂ ≻ 0 without (46).

Γ is replaced by the inverse Hessian of ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ), b the barrier of the cone. With
the Bregman divergence D_ψ(θ‖θ̂) in place of ½ Δθᵀ Γ⁻¹ Δθ, V̇ = −Δvᵀ M K Δv as in Theorem 1, and θ̂
cannot leave the cone, where b is infinite. As b is logarithmically homogeneous, ∇²b θ = −∇b, and
(30) conserves ½ θ̂ᵀ Γ⁻¹ θ̂ − μ b(θ̂). Proofs: docs/theory.md.
"""

from __future__ import annotations

import numpy as np

from ...errors import InvalidInput
from ...parameters import Array
from ...system import SecondOrderSystem
from ..metric import Curved
from ..nullspace_aid import NullspaceIdentifier
from .barrier import barrier, cone_of, coordinates, gradient_and_hessian, inside


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
        whole = self.Gamma.ndim == 2
        stiffness = np.asarray(np.linalg.inv(self.Gamma) if whole else 1 / self.Gamma, np.float64)
        self._pairing, self._inverse_gain = coordinates(self.cone), stiffness
        if not inside(self.cone, self.prior):
            raise InvalidInput(
                "prior", "parameters a real body could have", "an estimate outside the cone",
                "Draw it with cone.drawn_inside, or take law='paper', which takes any.",
            )  # fmt: skip
        self._offset = barrier(self.cone, self.prior)
        self.cancelling = self.mu * (2 * abs(self._offset) + self.cone.degree)

    @property
    def law(self) -> Curved:
        """Its gains and metric, for compiled loops."""
        return Curved(self.K, self.cone, self._pairing, self._inverse_gain, self.mu)

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
