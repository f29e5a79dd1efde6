"""The regression that all batch methods share: rows of W θ = 0 (13), and the scale they leave free.

All regressors are taken in θ/scale. A log says nothing about the common scale of θ, so it is fixed
by the prior: Σ k_i/scale_i over the actuator gains stays what it was. Directions that the rows do
not see stay at the prior: of all minimisers the one nearest to it in θ/scale is taken.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..errors import InvalidInput
from ..log import Log
from ..nullspace import TOLERANCE
from ..parameters import Array
from ..system import SecondOrderSystem


def central_rows(system: SecondOrderSystem, log: Log) -> Array:
    """(N−2, n, p) W(t, x, v, v̇, u)·diag(scale) of (10) at the inner samples.

    v̇ is the central difference of the measured velocities: the mean acceleration over the two
    steps beside a sample. The force that made it is the mean over both, so F is averaged over
    the two commands held there. Half a step of misalignment costs a factor of hundreds.

    Raises:
        InvalidInput: the log has less than three samples.
    """
    t, q, v, u = log
    if len(t) < 3:
        raise InvalidInput("log", "at least 3 samples", len(t), "Record longer.")
    before, after = t[1:-1] - t[:-2], t[2:] - t[1:-1]
    both = (before + after)[:, None]
    here, x, w = t[1:-1], np.hstack([q, v])[1:-1], v[1:-1]
    a = (v[2:] - v[:-2]) / both
    share = (before[:, None] / both)[:, :, None]
    W = system.regressor(here, x, w, a, u[:-2])
    W *= share
    W += (1 - share) * system.regressor(here, x, w, a, u[1:-1])
    W *= system.space.scale
    return W


def condense(W: Array) -> Array:
    """(n, p, p) triangular factors with the same ‖W_i θ‖ for every velocity row i of (N, n, p)."""
    N, _, p = W.shape
    if p > N:
        W = np.concatenate([W, np.zeros((p - N, *W.shape[1:]))])
    return np.stack([np.linalg.qr(W[:, i], mode="r") for i in range(W.shape[1])])


class Gauge:
    """The scale that no log can tell, and the directions that this one does not: from the prior.

    Args:
        system: the structure.
        prior: (p,) θ̂(0).
    """

    def __init__(self, system: SecondOrderSystem, prior: Array):
        self.scale = system.space.scale
        self.start = prior / self.scale
        normal = np.zeros((system.p, 1))
        normal[system.space.actuators] = 1.0
        self.normal = normal[:, 0]
        self.tangent = scipy.linalg.null_space(normal.T)  # (p, p−1)

    def solve(self, rows: Array, tolerance: float = TOLERANCE) -> Array:
        """(p,) θ/scale that minimises ‖rows·θ/scale‖, of all minimisers the nearest to the prior.

        Args:
            rows: (N, p) of W·diag(scale).
            tolerance: singular values below this share of the largest count as 0.
        """
        target = -rows @ self.start
        y = np.linalg.lstsq(rows @ self.tangent, target, rcond=tolerance)[0]
        return self.start + self.tangent @ y

    def rescaled(self, theta_s: Array) -> Array:
        """(p,) the multiple of θ/scale that has the prior's sum of gains.

        Raises:
            InvalidInput: its gains add up to nothing.
        """
        total = self.normal @ theta_s
        if not abs(total) > 1e-9 * np.linalg.norm(theta_s):
            raise InvalidInput("gains", "a sum that is not 0", total, "Record longer.")
        return theta_s * (self.normal @ self.start / total)
