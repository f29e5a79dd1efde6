"""Scale-invariant cost R(θ) of remembered data.

    R(θ) = ½ Σ_i w_i λ_i(θ),    λ_i(θ) = θᵀ G_i θ / θᵀ Σ_i θ,

with G_i ⪰ 0 the Gramian of row i of the momentum balance and Σ_i ⪰ 0 diagonal on the actuators:
the residual is measured relative to the actuators' effort, as if every command had a relative
error. θᵀ∇R = 0, and ∇Rᵀ θ* ≤ 0 for every true θ* (docs/theory.md).

With noisy sensors, or with information kept from before a change of the actuators, all rows are
merged into one with the same gradient at the estimate θ̂: G = Σ_i w_i G_i/θ̂ᵀΣ_iθ̂ − B + (kept
information) ⪰ 0, relative to Σ̄, the mean of the Σ_i/θ̂ᵀΣ_iθ̂. B is the bias that noise adds to the
first sum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...parameters import Array, Indices, ParameterSpace
from .statistics import Means, Memory, View

_QUADRATURE = 1e-8  # floor of λ with exact sensors, where the quadrature's error remains
_NOISE = 1e-12  # floor of λ with noisy sensors
_DRIVEN = 1e-6  # share of a row's size below which the row counts as unactuated
_CORRELATED = 0.95  # upper bound of the correlation of neighbouring blocks
_OWN = 1e-2  # share of a row's size that its positive parameters need to serve as its reference
_SURE = 3.0  # standard errors, of 1/√blocks each, by which a signal must exceed noise
_RIDGE = 1e-9  # added to a curvature of unit diagonal, which rounding may leave indefinite


@dataclass(frozen=True)
class Quotient:
    """R for the current content of a memory.

    Attributes:
        gramian: (n, p, p) G_i, means over the blocks.
        effort: (n, p) diagonals of Σ_i.
        weights: (n,) w_i.
        seen: (p, p) G before B is subtracted; None where rows are not merged.
        excess: (p, p) B, for diagnosis; None where rows are not merged.
    """

    gramian: Array
    effort: Array
    weights: Array
    seen: Array | None = None
    excess: Array | None = None

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

    def levels(self, theta: Array, gramian: Array | None = None) -> Array:
        """(n,) λ_i = θᵀ G_i θ / θᵀ Σ_i θ."""
        G = self.gramian if gramian is None else gramian
        return (G @ theta) @ theta / (self.effort @ theta**2)

    def weighted(self, theta: Array, memory: Memory) -> tuple[Quotient, View]:
        """R weighted as a negative log-likelihood near θ, for residuals correlated between blocks.

        With ρ_i the correlation of neighbouring blocks in row i at θ, Y − ρ_i Y′ is a block's
        innovation (Cochrane and Orcutt, J. Am. Stat. Assoc. 44, 1949); its Gramian replaces G_i,
        and w_i = blocks/λ_i(θ). B is the sum of the noise's Gramians with these weights; in
        directions where the rest is not significant, B is the whole sum: data that cannot be
        distinguished from noise neither move nor hold the estimate.

        Args:
            theta: (p,) an estimate.
            memory: the memory of which this is the cost.

        Returns:
            R with these weights, and the weights of the residuals in later blocks.
        """
        means, kept, view = memory.means, memory.kept, self.view(theta, memory.means)
        effort, share = self.effort @ theta**2, means.blocks * view.share
        if means.noise is None and kept is None:
            return Quotient(means.innovations(view.rho), self.effort, share * effort), view
        seen = means.weighted_sum(view.rho, share)
        excess = np.zeros_like(seen)
        if means.noise is not None:
            certain = max(0.5, 1 - _SURE / np.sqrt(means.blocks))
            excess = _conservative_noise(means.weighted_noise(view.rho, share), seen, certain)
        if kept is not None:
            seen = seen + kept
        reference = np.mean(self.effort / effort[:, None], axis=0)
        return Quotient((seen - excess)[None], reference[None], np.ones(1), seen, excess), view

    def view(self, theta: Array, means: Means) -> View:
        """The weights at θ (p,) of the blocks in these means and of later ones; see `weighted`."""

        def level(gramian: Array) -> Array:
            return (gramian @ theta) @ theta / effort

        effort, floor = self.effort @ theta**2, _QUADRATURE if means.noise is None else _NOISE
        own, lagged, last = level(means.gramian), level(means.lagged), (means.last @ theta) ** 2
        rho = np.clip(lagged / np.maximum(own, floor), 0.0, _CORRELATED)
        new, least = means.of_innovations(rho, own, lagged, last / effort), np.full(len(rho), floor)
        if means.noise is not None:  # residuals of few data underestimate the noise
            own, lagged = (level(part) for part in means.noise)
            least = np.maximum(least, (1 + rho**2) * own - 2 * rho * lagged)
        return View(theta, rho, 1 / (np.maximum(new, least) * effort))

    def plant(self, theta: Array, actuators: Indices) -> Array:
        """(p, p) curvature at θ with the actuators' gains eliminated, Σ constant.

        It is the Schur complement of the actuators' block, with zeros in that block.
        """
        whole = np.tensordot(self.weights / (self.effort @ theta**2), self.gramian, 1)
        k = actuators
        rest = whole - whole[:, k] @ inverse(whole[np.ix_(k, k)]) @ whole[k]
        rest[k], rest[:, k] = 0.0, 0.0
        return rest


def quotient(means: Means, space: ParameterSpace) -> Quotient | None:
    """R of means over blocks, with weights 0; None before any actuator has had an effect.

    The reference of a row without an actuator of its own (sideways a car is pushed by its tyres,
    not by its engine) is the effort of its other positive parameters, such as tyres or drag; where
    that is negligible, the mean effort in the actuated rows, scaled to the row's size.
    """
    diagonal = np.einsum("ipp->ip", means.gramian)
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
    return Quotient(means.gramian, effort, np.zeros(len(size)))


def positive(space: ParameterSpace) -> Array:
    """(p,) 1 where a parameter's block has the geometry `positive`, 0 elsewhere."""
    mask = np.zeros(len(space))
    for block, place in space:
        mask[place] = block.geometry == "positive"
    return mask


def _conservative_noise(excess: Array, whole: Array, certain: float) -> Array:
    """The noise bias B, raised to the whole sum in directions without a significant signal.

    Args:
        excess: (p, p) estimated contribution of noise.
        whole: (p, p) ⪰ 0, signal and noise.
        certain: share of noise in `whole` from which on a direction counts as noise only.

    Returns:
        (p, p) B ⪰ 0.
    """
    size = np.diag(whole)
    scale = np.sqrt(np.where(size > 0, size, 1.0))
    L = np.linalg.cholesky(whole / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)))
    half = np.linalg.solve(L, excess / np.outer(scale, scale))
    shares, vectors = np.linalg.eigh(np.linalg.solve(L, half.T))
    root = scale[:, None] * (L @ vectors)
    return (root * np.where(shares < certain, np.maximum(shares, 0.0), 1.0)) @ root.T


def inverse(matrix: Array) -> Array:
    """(k, k) pseudo-inverse of a symmetric matrix, computed after scaling its diagonal to 1.

    Directions that are singular to machine precision are mapped to 0.
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    balanced = np.outer(scale, scale)
    return np.linalg.pinv(matrix * balanced, rcond=1e-14, hermitian=True) * balanced


def _projected(gramian: Array, slope: Array, theta: Array, effort: Array, share: Array) -> Array:
    """(p, p) Σ_i share_i Πᵀ G_i Π with Π = 1 − θ slope_iᵀ / effort_i."""
    pull = gramian @ theta
    mixed = (pull * (share / effort)[:, None]).T @ slope
    bent = (slope * (share * (pull @ theta) / effort**2)[:, None]).T @ slope
    return np.tensordot(share, gramian, 1) - mixed - mixed.T + bent
