"""How badly a θ explains remembered data: a cost that a change of scale does not change.

    R(θ) = ½ Σ_i w_i λ_i(θ),    λ_i(θ) = θᵀ (G_i − N_i) θ / θᵀ Σ_i θ,

G_i the Gramian of row i of the momentum balance, N_i the part of it that sensor noise made, Σ_i ⪰ 0
diagonal on the actuators: the balance is measured in shares of the actuators' own effort, as if
every command had a relative error. θᵀ∇R = 0, and ∇Rᵀ θ* ≤ 0 for every true θ* (docs/theory.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..parameters import Array, ParameterSpace
from .memory import Memory, View

_QUADRATURE = 1e-8  # floor of λ where sensors are exact: what is left is the quadrature's error
_NOISE = 1e-12  # … and where they are not
_DRIVEN = 1e-6  # share of a row's size below which it counts as not actuated
_CORRELATED = 0.95  # correlation of neighbouring blocks, at most


@dataclass(frozen=True)
class Quotient:
    """R, of a memory as it stands.

    Attributes:
        gramian: (n, p, p) G_i, means over the blocks.
        noise: (n, p, p) N_i, likewise; zeros where sensors are exact.
        effort: (n, p) diagonals of Σ_i.
        weights: (n,) w_i.
    """

    gramian: Array
    noise: Array
    effort: Array
    weights: Array

    def value(self, theta: Array) -> float:
        """R(θ)."""
        return 0.5 * float(self.weights @ self._levels(theta, self.gramian - self.noise))

    def gradient(self, theta: Array) -> Array:
        """(p,) ∇R(θ) = Σ_i w_i (E_i θ − λ_i Σ_i θ) / θᵀ Σ_i θ, E_i = G_i − N_i."""
        pull = (self.gramian - self.noise) @ theta
        effort = self.effort @ theta**2
        level = pull @ theta / effort
        return (self.weights / effort) @ (pull - level[:, None] * self.effort * theta)

    def curvature(self, theta: Array) -> tuple[Array, Array]:
        """(p, p) Gauss–Newton's Hessian without N, and what N takes from it.

        With Π = 1 − θ (Σ_i θ)ᵀ / θᵀ Σ_i θ the first is Σ_i w_i Πᵀ G_i Π / θᵀ Σ_i θ ⪰ 0.
        """
        effort = self.effort @ theta**2
        share = self.weights / effort
        return tuple(_projected(G, self.effort * theta, theta, effort, share)
                     for G in (self.gramian, self.noise))  # type: ignore[return-value]  # fmt: skip

    def weighted(self, theta: Array, memory: Memory) -> tuple[Quotient, View]:
        """R as a log-likelihood near θ, for residuals that are correlated from block to block.

        With ρ_i the correlation of neighbours in row i at θ, Y − ρ_i Y′ is what is new in a block
        (Cochrane and Orcutt, J. Am. Stat. Assoc. 44, 1949); its Gramian takes G_i's place, and
        w_i = blocks/λ_i(θ).

        Returns:
            R with these weights, and how they weigh what comes next.
        """
        floor = _QUADRATURE if memory.noise is None else _NOISE
        level = np.maximum(self._levels(theta, self.gramian), floor)
        rho = np.clip(self._levels(theta, memory.lagged) / level, 0.0, _CORRELATED)
        r = rho[:, None, None]
        new = replace(
            self,
            gramian=memory.gramian - 2 * r * memory.lagged + r**2 * memory.before,
            noise=self.noise
            if memory.noise is None
            else (1 + r**2) * memory.noise[0] - 2 * r * memory.noise[1],
        )
        least = np.maximum(new._levels(theta, new.noise), floor)  # few data can be fitted too well
        level = np.maximum(new._levels(theta, new.gramian), least)
        view = View(theta, rho, 1 / (level * (self.effort @ theta**2)))
        return replace(new, weights=memory.blocks / level), view

    def _levels(self, theta: Array, gramian: Array) -> Array:
        """(n,) θᵀ G_i θ / θᵀ Σ_i θ."""
        return (gramian @ theta) @ theta / (self.effort @ theta**2)


def quotient(memory: Memory, space: ParameterSpace) -> Quotient | None:
    """R of a memory, with weights 0; None as long as no actuator has moved anything.

    A row without an actuator of its own (a rotor pushes along one axis only) is measured in shares
    of all others' effort.
    """
    size = np.einsum("ipp,p->i", memory.gramian, space.scale**2)
    effort = np.zeros(memory.last.shape)
    effort[:, space.actuators] = np.einsum("ipp->ip", memory.gramian)[:, space.actuators]
    driven = effort @ space.scale**2 > _DRIVEN * size
    if not driven.any():
        return None
    shared = np.mean(effort[driven] / size[driven, None], axis=0)
    effort = np.where(driven[:, None], effort, size[:, None] * shared)
    noise = np.zeros_like(memory.gramian) if memory.noise is None else memory.noise[0]
    still = size <= 0  # a row in which nothing has happened says nothing
    effort[still] = shared
    return Quotient(memory.gramian, noise, effort, np.zeros(len(size)))


def _projected(gramian: Array, slope: Array, theta: Array, effort: Array, share: Array) -> Array:
    """Σ_i share_i Πᵀ G_i Π, Π = 1 − θ slope_iᵀ / effort_i."""
    pull = gramian @ theta
    mixed = np.einsum("i,ip,iq->pq", share / effort, pull, slope)
    bent = np.einsum("i,ip,iq->pq", share * (pull @ theta) / effort**2, slope, slope)
    return np.tensordot(share, gramian, 1) - mixed - mixed.T + bent
