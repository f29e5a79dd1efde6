"""Scale-invariant cost R(θ) of remembered data.

    R(θ) = ½ Σ_i w_i λ_i(θ),    λ_i(θ) = θᵀ G_i θ / θᵀ Σ_i θ,

with G_i ⪰ 0 the Gramian of row i of the momentum balance and Σ_i ⪰ 0 diagonal on the actuators:
the residual is measured relative to the actuators' effort, as if every command had a relative
error. θᵀ∇R = 0, and ∇Rᵀ θ* ≤ 0 for every true θ* (docs/theory.md).

Information kept from before a change of the actuators is a further row, relative to Σ̄, the mean of
the Σ_i/θ̂ᵀΣ_iθ̂.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...parameters import Array, ParameterSpace
from .matrices import common_root
from .statistics import Means, Memory

_QUADRATURE = 1e-8  # floor of λ, where the quadrature's error remains
_DRIVEN = 1e-6  # share of a row's size below which the row counts as unactuated
_CORRELATED = 0.95  # upper bound of the correlation of neighbouring blocks
_EXACT = 1e-12  # share of noise below which a direction is measured exactly
_OWN = 1e-2  # share of a row's size that its positive parameters need to serve as its reference


@dataclass(frozen=True)
class Quotient:
    """R for the current content of a memory.

    Attributes:
        gramian: (n, p, p) G_i, means over the blocks.
        effort: (n, p) diagonals of Σ_i.
        weights: (n,) w_i.
    """

    gramian: Array
    effort: Array
    weights: Array

    def value(self, theta: Array) -> float:
        """R(θ)."""
        return 0.5 * float(self.weights @ self.levels(theta))

    def gradient(self, theta: Array) -> Array:
        """(p,) ∇R(θ) = Σ_i w_i (G_i θ − λ_i Σ_i θ) / θᵀ Σ_i θ."""
        pull, effort = self.gramian @ theta, self.effort @ theta**2
        level = pull @ theta / effort
        return (self.weights / effort) @ (pull - level[:, None] * self.effort * theta)

    def curvature(self, theta: Array) -> Array:
        """(p, p) Gauss–Newton approximation of ∇²R.

        With Π = 1 − θ (Σ_i θ)ᵀ / θᵀ Σ_i θ it is Σ_i w_i Πᵀ G_i Π / θᵀ Σ_i θ ⪰ 0.
        """
        effort = self.effort @ theta**2
        return _projected(self.gramian, self.effort * theta, theta, effort, self.weights / effort)

    def levels(self, theta: Array) -> Array:
        """(n,) λ_i = θᵀ G_i θ / θᵀ Σ_i θ."""
        return (self.gramian @ theta) @ theta / (self.effort @ theta**2)

    def weighted(self, theta: Array, memory: Memory) -> Quotient:
        """R weighted as a negative log-likelihood near θ, for residuals correlated between blocks.

        With ρ_i the correlation of neighbouring blocks in row i at θ, Y − ρ_i Y′ is a block's
        innovation (Cochrane and Orcutt, J. Am. Stat. Assoc. 44, 1949); the part of its Gramian that
        is not the sensors' noise replaces G_i, and w_i = blocks/λ_i(θ).

        Args:
            theta: (p,) an estimate.
            memory: the memory of which this is the cost.
        """
        means, (rho, share) = memory.means, self.residuals(theta, memory.means)
        gramian, effort = means.innovations(rho), self.effort @ theta**2
        if means.noise.any():
            expected = (1 + rho**2)[:, None, None] * means.noise
            parts = zip(gramian, expected, strict=True)
            gramian = np.array([without_noise(*pair, means.blocks) for pair in parts])
        weights = means.blocks * share * effort
        if memory.kept is None:
            return Quotient(gramian, self.effort, weights)
        reference = np.mean(self.effort / effort[:, None], axis=0)
        return Quotient(
            np.concatenate([gramian, memory.kept[None]]),
            np.concatenate([self.effort, reference[None]]),
            np.append(weights, 1.0),
        )

    def of_noise(self, theta: Array, means: Means) -> Quotient:
        """The part of `weighted` that the sensors' noise is expected to contribute."""
        rho, share = self.residuals(theta, means)
        noise = (1 + rho**2)[:, None, None] * means.noise
        return Quotient(noise, self.effort, means.blocks * share * (self.effort @ theta**2))

    def residuals(self, theta: Array, means: Means) -> tuple[Array, Array]:
        """(n,) correlations ρ_i of neighbouring residuals at θ (p,); (n,) their inverse variances.

        The variances are those of the innovations, at least those of the quadrature's error.
        """

        def level(gramian: Array) -> Array:
            return (gramian @ theta) @ theta / effort

        effort = self.effort @ theta**2
        own, lagged, last = level(means.gramian), level(means.lagged), (means.last @ theta) ** 2
        rho = np.clip(lagged / np.maximum(own, _QUADRATURE), 0.0, _CORRELATED)
        new = means.of_innovations(rho, own, lagged, last / effort)
        least = np.maximum((1 + rho**2) * level(means.noise), _QUADRATURE)
        return rho, 1 / (np.maximum(new, least) * effort)

    def information(self, theta: Array) -> Array:
        """(p, p) curvature of R at θ (p,) with Σ held."""
        return np.tensordot(self.weights / (self.effort @ theta**2), self.gramian, 1)


def without_noise(gramian: Array, noise: Array, blocks: float) -> Array:
    """The part of a row's Gramian that is not noise: ⪰ 0, and at most the Gramian.

    Relative to the noise, the eigenvalues of a sample Gramian of signal and noise follow the spiked
    model: one of 1 + ℓ is seen as (1 + ℓ)(1 + γ/ℓ) with γ = p/blocks, and not at all where ℓ ≤ √γ.
    Each is replaced by its ℓ (Donoho, Gavish and Johnstone, Annals of Statistics 46, 2018). What
    all that is seen of θ shows as noise is thus left out, and what is seen is unbiased.

    Args:
        gramian: (p, p) mean of Yᵀ Y.
        noise: (p, p) its expectation where only noise is seen.
        blocks: number of blocks in the mean.
    """
    seen = np.diag(gramian) > 0
    part = np.ix_(seen, seen)
    whole, found = gramian[part] + noise[part], np.zeros_like(gramian)
    root, shares = common_root(whole, noise[part])
    shares = np.clip(shares, _EXACT, 1.0)
    gamma = float(seen.sum()) / max(blocks, 1.0)
    excess = (1 - shares) / shares - 1 - gamma
    spike = 0.5 * (excess + np.sqrt(np.maximum(excess**2 - 4 * gamma, 0.0)))
    spike[excess**2 < 4 * gamma] = 0.0
    found[part] = (root * (np.maximum(spike, 0.0) * shares)) @ root.T
    return found


def quotient(means: Means, space: ParameterSpace) -> Quotient | None:
    """R of means over blocks, with weights 0; None before any actuator has had an effect.

    The reference of a row without an actuator of its own (sideways a car is pushed by its tyres,
    not by its engine) is the effort of its other positive parameters, such as tyres or drag; where
    that is negligible, the mean effort in the actuated rows, scaled to the row's size.
    """
    effort = efforts(means.gramian, space)
    return None if effort is None else Quotient(means.gramian, effort, np.zeros(len(effort)))


def efforts(gramian: Array, space: ParameterSpace) -> Array | None:
    """(n, p) diagonals of Σ_i for Gramians (n, p, p); None if no actuator has an effect."""
    diagonal = np.einsum("ipp->ip", gramian)
    size = diagonal @ space.scale**2
    effort = np.zeros_like(diagonal)
    effort[:, space.actuators] = diagonal[:, space.actuators]
    driven = effort @ space.scale**2 > _DRIVEN * size
    if not driven.any():
        return None
    shared = np.mean(effort[driven] / size[driven, None], axis=0)
    own = diagonal * positive(space)
    others = np.where((own @ space.scale**2 > _OWN * size)[:, None], own, size[:, None] * shared)
    effort = np.where(driven[:, None], effort, others)
    effort[size <= 0] = shared  # a row without motion: its G is 0, so any effort > 0 will do
    return effort


def positive(space: ParameterSpace) -> Array:
    """(p,) 1 where a parameter's block has the geometry `positive`, 0 elsewhere."""
    mask = np.zeros(len(space))
    for block, place in space:
        mask[place] = block.geometry == "positive"
    return mask


def _projected(gramian: Array, slope: Array, theta: Array, effort: Array, share: Array) -> Array:
    """(p, p) Σ_i share_i Πᵀ G_i Π with Π = 1 − θ slope_iᵀ / effort_i."""
    pull = gramian @ theta
    mixed = (pull * (share / effort)[:, None]).T @ slope
    bent = (slope * (share * (pull @ theta) / effort**2)[:, None]).T @ slope
    return np.tensordot(share, gramian, 1) - mixed - mixed.T + bent
