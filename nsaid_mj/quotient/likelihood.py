"""Negative log-likelihood of Gaussian residuals of unknown variance in every row, and a prior."""

from __future__ import annotations

import numpy as np

from ..parameters import Array
from .cost import Quotient
from .descent import Cost

_FLOOR = 1e-12  # smallest λ: numbers' rounding


class Posterior:
    """J(θ) = ½ Σ_i N_i log λ_i(θ) + the prior, the negative logarithm of a density.

    The quotient's levels are λ, and its weights the numbers of rows N_i.
    """

    def __init__(self, quotient: Quotient, prior: Cost):
        self.quotient, self.prior, self.length = quotient, prior, prior.length

    def value(self, theta: Array) -> float:
        """J(θ)."""
        before = self.prior.value(theta)
        if not before < np.inf:
            return np.inf
        level = np.maximum(self.quotient.levels(theta), _FLOOR)
        return 0.5 * float(self.quotient.weights @ np.log(level)) + before

    def likelihood(self, theta: Array) -> Quotient:
        """R whose gradient and Gauss–Newton Hessian at θ (p,) are those of the first sum of J."""
        own = self.quotient
        levels = np.maximum(own.levels(theta), _FLOOR)
        return Quotient(own.gramian, own.effort, own.weights / levels, own.added)

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """(p,) gradient and (p, p) Gauss–Newton Hessian of J at θ (p,)."""
        weighted, (slope, curvature) = self.likelihood(theta), self.prior.derivatives(theta)
        return weighted.gradient(theta) + slope, weighted.curvature(theta) + curvature

    def gradient(self, theta: Array) -> Array:
        """(p,) ∇J(θ)."""
        return self.derivatives(theta)[0]
