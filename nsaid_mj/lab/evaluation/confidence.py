"""Per-direction standard deviations of an estimate, from its identifier's covariance.

The directions span P_⊥(θ̂), the observable part of θ. Standard deviations are relative to
‖θ̂/scale‖, like `theta_perp_ratio`.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ...core import Array, Confidence, Indices, Nullspace, ParameterSpace

INTERVAL = 1.96  # half width of a 95 % interval of the normal distribution [standard deviations]
_BELOW = 0.7  # posterior over prior standard deviation above which data count as uninformative

_FIXED = 1e-6  # share of a combination along P_s(θ̂) below which the motion determines it


@dataclass(frozen=True)
class KnownDirections:
    """The observable directions, the most accurately known first."""

    directions: Array  # (k, p) orthonormal basis of P_⊥, in θ/scale
    deviation: Array  # (k,) standard deviation along each, relative to ‖θ̂/scale‖
    below_noise: np.ndarray  # (k,) whether the data are uninformative along it
    actuators: Array  # (a,) relative standard deviation of each actuator's k_i/mean(k)
    blocks: Array  # (n,) number of independent samples in each row of the momentum balance

    def covered(self, theta_hat_s: Array, theta_s: Array) -> float:
        """Share of the directions whose 95 % interval contains θ; θ̂ and θ (p,) are over scale."""
        off = self.directions @ (theta_s / np.linalg.norm(theta_s))
        off -= self.directions @ (theta_hat_s / np.linalg.norm(theta_hat_s))
        return float(np.mean(np.abs(off) <= INTERVAL * self.deviation))

    def forces_covered(self, theta_hat_s: Array, W_s: Array) -> float:
        """Share of predicted forces whose 95 % interval contains the actual force.

        W θ̂ along a motion of the plant is the error of the prediction: the force that θ̂ predicts
        from the motion, less that of the actuators. `W_s` (k, n, p) is W times scale.
        """
        spread = W_s @ (self.directions.T * self.deviation) * np.linalg.norm(theta_hat_s)
        deviation = np.linalg.norm(spread, axis=-1)
        return float(np.mean(np.abs(W_s @ theta_hat_s) <= INTERVAL * deviation))


class Determined(NamedTuple):
    """The parameters that the motion determines one by one, once the common scale is fixed.

    The scale is fixed such that the mean of the actuators' gains is exact.
    """

    indices: Indices  # (k,) in θ
    deviation: Array  # (k,) standard deviation of each, in its unit
    below_noise: np.ndarray  # (k,) whether the data are uninformative about it
    correlation: Array  # (k, k) correlation of their errors


def determined(
    confidence: Confidence, theta_hat: Array, nullspace: Nullspace, space: ParameterSpace
) -> Determined:
    """Standard deviations and correlations of single parameters; arguments as of `known`.

    θ̂_i − θ_i, less the common scale's share θ̂_i · mean_j(θ̂_j/θ_j − 1) over the actuators j, is
    determined if it does not change along P_s(θ̂).
    """
    theta_s = theta_hat / space.scale
    k = space.actuators
    k = k[theta_hat[k] != 0]  # those of failed actuators say nothing of the scale
    rows = np.eye(len(space))
    if len(k):
        rows[:, k] -= np.outer(theta_s, 1 / theta_s[k]) / len(k)
    length = np.linalg.norm(rows, axis=1)
    length = np.where(length > 0, length, np.inf)  # a single actuator is its own reference
    along = np.linalg.norm(rows @ nullspace.P, axis=1) / length
    indices = np.flatnonzero(np.isfinite(length) & (along < _FIXED))
    rows = rows[indices]
    scales = np.outer(space.scale, space.scale)
    covariance, prior = (rows @ (part / scales) @ rows.T for part in confidence[:2])
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(deviation > 0, deviation, np.inf)
    below = deviation**2 > _BELOW**2 * np.diag(prior)
    correlation = covariance / np.outer(safe, safe)
    return Determined(indices, deviation * space.scale[indices], below, correlation)


def known(
    confidence: Confidence, theta_hat: Array, nullspace: Nullspace, space: ParameterSpace
) -> KnownDirections:
    """Decomposes the covariance of an estimate θ̂ (p,) along the observable directions there."""
    basis = nullspace.P_perp
    size = float(np.linalg.norm(theta_hat / space.scale))
    scales = np.outer(space.scale, space.scale)
    covariance, prior = (basis.T @ (part / scales) @ basis for part in confidence[:2])
    variance, vectors = scipy.linalg.eigh(covariance)
    before = np.einsum("ik,ij,jk->k", vectors, prior, vectors)
    return KnownDirections(
        (basis @ vectors).T,
        np.sqrt(np.maximum(variance, 0.0)) / size,
        variance > _BELOW**2 * before,
        Confidence.of_gains(confidence, theta_hat, space),
        confidence.blocks,
    )
