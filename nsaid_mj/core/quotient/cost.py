"""Scale-invariant cost R(θ) of rows Y with Y θ = 0 for every true θ, from their Gramians.

    R(θ) = ½ Σ_i w_i λ_i(θ),    λ_i(θ) = θᵀ G_i θ / θᵀ Σ_i θ,

with G_i ⪰ 0 the Gramian of row i of the momentum balance, and Σ_i ⪰ 0 that of the actuators'
effort. The residual is thus relative to the effort, which makes R independent of the scale of θ.
θᵀ∇R = 0, and ∇Rᵀ θ* ≤ 0 for every true θ* where Σ_i is diagonal (docs/theory.md).

The law `memory`, the batch fit of a log and weighted least squares minimise it with other weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameters import Array, ParameterSpace
from .descent import ConeFunction, Rules, minimise
from .gramians import Means
from .matrices import common_root

_QUADRATURE = 1e-8  # floor of λ, at the level of the quadrature's error
_DRIVEN = 1e-6  # share of a row's size below which the row counts as unactuated
_CORRELATED = 0.95  # upper bound of the correlation of neighbouring blocks
_EXACT = 1e-12  # share of noise below which a direction is measured exactly
_OWN = 1e-2  # share of a row's size that its positive parameters need to serve as its reference


@dataclass(frozen=True)
class Quotient:
    """R of some Gramians."""

    gramian: Array  # (n, p, p) G_i, means over the rows
    effort: Array  # (n, p) diagonals of Σ_i, or (n, p, p) all of them
    weights: Array  # (n,) w_i
    added: Array | float = 0.0  # (n,) of θᵀ Σ_i θ; 1 for a row without effort, in its own units

    def pull(self, theta: Array) -> Array:
        """(n, p) Σ_i θ."""
        return self.effort * theta if self.effort.ndim == 2 else self.effort @ theta

    def efforts(self, theta: Array) -> Array:
        """(n,) θᵀ Σ_i θ."""
        return self.pull(theta) @ theta + self.added

    def levels(self, theta: Array) -> Array:
        """(n,) λ_i = θᵀ G_i θ / θᵀ Σ_i θ."""
        return (self.gramian @ theta) @ theta / self.efforts(theta)

    def value(self, theta: Array) -> float:
        """R(θ)."""
        return 0.5 * float(self.weights @ self.levels(theta))

    def gradient(self, theta: Array) -> Array:
        """(p,) ∇R(θ) = Σ_i w_i (G_i θ − λ_i Σ_i θ) / θᵀ Σ_i θ."""
        pull = self.gramian @ theta
        slope = self.pull(theta)
        effort = slope @ theta + self.added
        level = pull @ theta / effort
        return (self.weights / effort) @ (pull - level[:, None] * slope)

    def curvature(self, theta: Array) -> Array:
        """(p, p) Gauss–Newton approximation of ∇²R.

        With Π = 1 − θ (Σ_i θ)ᵀ / θᵀ Σ_i θ it is Σ_i w_i Πᵀ G_i Π / θᵀ Σ_i θ ⪰ 0.
        """
        pull = self.gramian @ theta
        slope = self.pull(theta)
        effort = slope @ theta + self.added
        share = self.weights / effort
        bent = (0.5 * (pull @ theta) / effort)[:, None] * slope - pull
        mixed = ((share / effort)[:, None] * bent).T @ slope
        return np.tensordot(share, self.gramian, 1) + mixed + mixed.T

    def information(self, theta: Array) -> Array:
        """(p, p) curvature of R at θ (p,) with Σ held."""
        return np.tensordot(self.weights / self.efforts(theta), self.gramian, 1)

    @staticmethod
    def reference(gramian: Array, space: ParameterSpace) -> Array | None:
        """(n, p) diagonals of Σ_i for Gramians (n, p, p); None if no actuator has an effect.

        The reference of a row without an actuator of its own (a car is pushed sideways by its
        tyres, not by its engine) is the effort of its other positive parameters, such as tyres or
        drag; where that is negligible, the mean effort in the actuated rows, scaled to the row's
        size.
        """
        diagonal = np.einsum("ipp->ip", gramian)
        size = diagonal @ space.scale**2
        effort = np.zeros_like(diagonal)
        effort[:, space.actuators] = diagonal[:, space.actuators]
        driven = effort @ space.scale**2 > _DRIVEN * size
        if not driven.any():
            return None
        shared = np.mean(effort[driven] / size[driven, None], axis=0)
        own = diagonal * (space.geometries == "positive")
        others = np.where(
            (own @ space.scale**2 > _OWN * size)[:, None], own, size[:, None] * shared
        )
        effort = np.where(driven[:, None], effort, others)
        effort[size <= 0] = shared  # a row without motion: its G is 0, so any effort > 0 will do
        return effort


class Remembered:
    """R of means over blocks in time, whose residuals may be correlated between blocks.

    With ρ_i the correlation of neighbouring blocks in row i at θ, Y − ρ_i Y′ is a block's
    innovation (Cochrane and Orcutt, J. Am. Stat. Assoc. 44, 1949). effort (n, p) are diagonals of
    Σ_i.
    """

    def __init__(self, means: Means, effort: Array):
        self.means = means
        self.effort = effort

    @staticmethod
    def of(means: Means, space: ParameterSpace) -> Remembered | None:
        """R of some means; None before any actuator has had an effect."""
        effort = Quotient.reference(means.gramian, space)
        return None if effort is None else Remembered(means, effort)

    def levels(self, theta: Array) -> Array:
        """(n,) λ_i = θᵀ G_i θ / θᵀ Σ_i θ of the blocks themselves."""
        return (self.means.gramian @ theta) @ theta / (self.effort @ theta**2)

    def weighted(self, theta: Array) -> Quotient:
        """R weighted as a negative log-likelihood near θ (p,): w_i = blocks/λ_i(θ).

        G_i is replaced by the part of the innovations' Gramian that is not the sensors' noise.
        """
        means = self.means
        rho, share = self.residuals(theta)
        gramian = means.innovations(rho)
        if means.noise.any():
            expected = (1 + rho**2)[:, None, None] * means.noise
            parts = zip(gramian, expected, strict=True)
            gramian = np.array([without_noise(*pair, means.blocks) for pair in parts])
        return Quotient(gramian, self.effort, means.blocks * share * (self.effort @ theta**2))

    def of_noise(self, theta: Array) -> Quotient:
        """The part of `weighted` that the sensors' noise is expected to contribute."""
        means = self.means
        rho, share = self.residuals(theta)
        noise = (1 + rho**2)[:, None, None] * means.noise
        return Quotient(noise, self.effort, means.blocks * share * (self.effort @ theta**2))

    def residuals(self, theta: Array) -> tuple[Array, Array]:
        """(n,) correlations ρ_i of neighbouring residuals at θ (p,); (n,) their inverse variances.

        The variances are those of the innovations, at least those of the quadrature's error.
        """

        def level(gramian: Array) -> Array:
            return (gramian @ theta) @ theta / effort

        means = self.means
        effort = self.effort @ theta**2
        own = level(means.gramian)
        lagged = level(means.lagged)
        last = (means.last @ theta) ** 2
        rho = np.clip(lagged / np.maximum(own, _QUADRATURE), 0.0, _CORRELATED)
        new = means.of_innovations(rho, own, lagged, last / effort)
        least = np.maximum((1 + rho**2) * level(means.noise), _QUADRATURE)
        return rho, 1 / (np.maximum(new, least) * effort)


def without_noise(gramian: Array, noise: Array, blocks: float) -> Array:
    """The part of a row's Gramian that is not noise: ⪰ 0, and at most the Gramian.

    Relative to the noise, the eigenvalues of a sample Gramian of signal and noise follow the spiked
    model: one of 1 + ℓ appears as (1 + ℓ)(1 + γ/ℓ) with γ = p/blocks, and not at all where ℓ ≤ √γ.
    Each is replaced by its ℓ (Donoho, Gavish and Johnstone, Annals of Statistics 46, 2018). This
    removes the noise's apparent information about θ, and leaves the rest unbiased.

    gramian (p, p) is the mean of Yᵀ Y over blocks, noise (p, p) its expectation for noise alone.
    """
    seen = np.diag(gramian) > 0
    if not seen.any():  # LAPACK writes to standard output about a matrix without entries
        return np.zeros_like(gramian)
    part = np.ix_(seen, seen)
    whole = gramian[part] + noise[part]
    found = np.zeros_like(gramian)
    root, shares = common_root(whole, noise[part])
    shares = np.clip(shares, _EXACT, 1.0)
    gamma = float(seen.sum()) / max(blocks, 1.0)
    excess = (1 - shares) / shares - 1 - gamma
    spike = 0.5 * (excess + np.sqrt(np.maximum(excess**2 - 4 * gamma, 0.0)))
    spike[excess**2 < 4 * gamma] = 0.0
    found[part] = (root * (np.maximum(spike, 0.0) * shares)) @ root.T
    return found


_FLOOR = 1e-12  # smallest λ: numbers' rounding


class Posterior:
    """J(θ) = ½ Σ_i N_i log λ_i(θ) + the prior, the negative logarithm of a density.

    The quotient's levels are λ, and its weights the numbers of rows N_i.
    """

    def __init__(self, quotient: Quotient, prior: ConeFunction):
        self.quotient = quotient
        self.prior = prior
        self.length = prior.length

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
        weighted = self.likelihood(theta)
        slope, curvature = self.prior.derivatives(theta)
        return weighted.gradient(theta) + slope, weighted.curvature(theta) + curvature

    def gradient(self, theta: Array) -> Array:
        """(p,) ∇J(θ)."""
        return self.derivatives(theta)[0]

    def minimised(self, start: Array, basis: Array, **limits: float) -> tuple[Array, Array]:
        """(p,) minimiser of J from a start θ (p,) inside the cone, (p, p) Gauss–Newton Hessian.

        basis (p, k) are the directions in which θ may move; `limits` are those of `Rules`.
        """
        found = minimise(self, start, Rules(**limits), basis)  # pyright: ignore[reportArgumentType]
        return found.theta, found.hessian
