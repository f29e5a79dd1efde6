"""The evidence for a jump of θ, from the estimates before and after it.

A filter without a model of the jump goes from (θ̂_s, P_s) to (θ̂_t, P_t). Without a jump, the shift
Δ = θ̂_t − θ̂_s has the covariance V = P_s − P_t; a jump D δ at time s, δ ~ N(0, 1), adds A δ to it:

    A = (1 − P_t P_s⁻¹) D,    score g = Aᵀ V⁻¹ Δ,    information I = Aᵀ V⁻¹ A,
    likelihood ratio, maximised over δ:  exp(½ gᵀ I⁻¹ g),
    and averaged over its prior:         exp(½ gᵀ (1 + I)⁻¹ g) / √det(1 + I).

The average equals the maximum times a penalty for the number and prior range of the directions. V
also includes variations of a healthy robot's parameters, and the filter's nonlinearity.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ...core import Array

_EVIDENT = 9.0  # mean squared deviation of δ that is more than chance


class Jump(NamedTuple):
    """A jump of θ under one hypothesis."""

    evidence: float  # logarithm of the averaged likelihood ratio against no jump
    delta: Array  # (d,) the most probable δ
    covariance: Array  # (d, d) covariance of δ

    @property
    def evident(self) -> bool:
        """Whether δ as a whole is significant, even if its components are correlated."""
        squares = float(self.delta @ np.linalg.solve(self.covariance, self.delta))
        return squares > _EVIDENT * len(self.delta)

    def interval(self, size: Array) -> tuple[float, float, float]:
        """sizeᵀδ with the ends of its 95 % interval, for a vector `size` (d,)."""
        middle = float(size @ self.delta)
        wide = 1.96 * float(np.sqrt(max(0.0, size @ self.covariance @ size)))
        return middle, middle - wide, middle + wide


def most_evident(Ps: Array, Pt: Array, shift: Array, tolerance: Array) -> float:
    """½ Δᵀ V⁻¹ Δ, which no jump's evidence exceeds; arguments are those of `shift_jumps`."""
    return 0.5 * float(shift @ cho_solve(cho_factor(Ps - Pt + np.diag(tolerance**2)), shift))


def shift_jumps(
    Ps: Array, Pt: Array, shift: Array, tolerance: Array, directions: list[Array]
) -> list[Jump]:
    """The jumps that explain a shift (p,) of θ̂/scale, one for each D (p, d) in `directions`.

    Ps and Pt (p, p) are P_θθ before and after, tolerance (p,) is the standard deviation of θ/scale
    where nothing has failed.
    """
    V = cho_factor(Ps - Pt + np.diag(tolerance**2))
    before = cho_factor(Ps)
    weighted = cho_solve(V, shift)
    found = []
    for D in directions:
        A = D - Pt @ cho_solve(before, D)
        score = A.T @ weighted
        information = A.T @ cho_solve(V, A)
        spread = np.linalg.inv(np.eye(D.shape[1]) + 0.5 * (information + information.T))
        sign, logdet = np.linalg.slogdet(spread)
        delta = spread @ score
        evidence = 0.5 * float(score @ delta) + 0.5 * logdet if sign > 0 else -np.inf
        found.append(Jump(evidence, delta, spread))
    return found


def jumped(Ps: Array, Pt: Array, shift: Array, D: Array) -> Jump:
    """The jump estimated by a filter whose P_s already contains D Dᵀ."""
    whitened = cho_solve(cho_factor(Ps), D)
    delta = whitened.T @ shift
    spread = np.eye(D.shape[1]) - D.T @ whitened + whitened.T @ Pt @ whitened
    return Jump(0.0, delta, spread)


def posterior(evidence: Array) -> Array:
    """(h,) probabilities of hypotheses with logarithmic evidences (h,) and equal prior."""
    weight = np.exp(evidence - evidence.max())
    return weight / weight.sum()
