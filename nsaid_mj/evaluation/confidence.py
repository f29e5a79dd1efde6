"""How well every direction of θ that can be known is known, told from an identifier's covariance.

Directions are those of P_⊥(θ̂): what the structure lets anybody see. Along each of them a deviation
is told in shares of ‖θ̂/scale‖, as `theta_perp_ratio` is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..identifiers import Confidence
from ..nullspace import Nullspace
from ..parameters import Array, ParameterSpace

INTERVAL = 1.96  # standard deviations on either side that hold 95 % of a normal distribution
_BELOW = 0.7  # share of the prior's deviation that is left where data have said next to nothing


@dataclass(frozen=True)
class Known:
    """The directions of P_⊥, the best known first.

    Attributes:
        directions: (k, p) orthonormal, in θ/scale.
        deviation: (k,) standard deviation along each, in shares of ‖θ̂/scale‖.
        below_noise: (k,) where the data have told next to nothing.
        actuators: (a,) standard deviation of every actuator's share k_i/mean(k), relative.
        blocks: (n,) independent samples in each row of the balance.
    """

    directions: Array
    deviation: Array
    below_noise: np.ndarray
    actuators: Array
    blocks: Array

    def covered(self, theta_hat_s: Array, theta_s: Array) -> float:
        """Share of the directions whose 95 % interval holds a θ.

        Args:
            theta_hat_s: (p,) the estimate/scale.
            theta_s: (p,) another θ/scale, at any common scale.
        """
        off = self.directions @ (theta_s / np.linalg.norm(theta_s))
        off -= self.directions @ (theta_hat_s / np.linalg.norm(theta_hat_s))
        return float(np.mean(np.abs(off) <= INTERVAL * self.deviation))


def known(
    confidence: Confidence, theta_hat: Array, nullspace: Nullspace, space: ParameterSpace
) -> Known:
    """The directions of an estimate's P_⊥ and how well each is known.

    Args:
        confidence: of the estimate.
        theta_hat: (p,) the estimate.
        nullspace: P_s(θ̂), under the estimate.
        space: names and scale of θ.
    """
    basis, size = nullspace.P_perp, float(np.linalg.norm(theta_hat / space.scale))
    covariance, prior = (_within(part, basis, space.scale) for part in confidence[:2])
    variance, vectors = np.linalg.eigh(covariance)
    before = np.einsum("ik,ij,jk->k", vectors, prior, vectors)
    k = space.actuators
    share = np.eye(len(k)) - 1 / len(k)
    relative = confidence.covariance[np.ix_(k, k)] / np.outer(theta_hat[k], theta_hat[k])
    return Known(
        (basis @ vectors).T,
        np.sqrt(np.maximum(variance, 0.0)) / size,
        variance > _BELOW**2 * before,
        np.sqrt(np.maximum(np.diag(share @ relative @ share), 0.0)),
        confidence.blocks,
    )


def _within(covariance: Array, basis: Array, scale: Array) -> Array:
    return basis.T @ (covariance / np.outer(scale, scale)) @ basis
