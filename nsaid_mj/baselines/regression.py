"""The regression common to all batch methods: rows of W θ = 0 (13), and the free scale of θ.

All regressors are those of θ/scale. A log contains no information on the common scale of θ; the
prior fixes it: Σ k_i/scale_i over the actuator gains keeps its value. Unobserved directions keep
the prior's values: of all minimisers, the one nearest to the prior in θ/scale is returned.
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

    v̇ is the central difference of the measured velocities: the mean acceleration over the two time
    steps next to a sample. F is therefore averaged over the two commands held during these steps;
    a misalignment of half a time step would increase the error several hundred times.

    Raises:
        InvalidInput: the log has fewer than three samples.
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
    """(n, p, p) triangular R_i with ‖R_i θ‖ = ‖W_i θ‖ for every velocity i of W (N, n, p)."""
    N, _, p = W.shape
    if p > N:
        W = np.concatenate([W, np.zeros((p - N, *W.shape[1:]))])
    return np.stack([np.linalg.qr(W[:, i], mode="r") for i in range(W.shape[1])])


class Gauge:
    """Fixes the free scale and the unobserved directions of θ by the prior.

    Args:
        system: the structure.
        prior: (p,) θ̂(0).

    Attributes:
        scale: (p,) of θ.
        start: (p,) the prior over the scale.
        normal: (p,) 1 at actuator gains, else 0; estimates keep normal · θ/scale.
        tangent: (p, p−1) orthonormal basis of the directions that keep it.
    """

    def __init__(self, system: SecondOrderSystem, prior: Array):
        self.scale = system.space.scale
        self.start = prior / self.scale
        normal = np.zeros((system.p, 1))
        normal[system.space.actuators] = 1.0
        self.normal = normal[:, 0]
        self.tangent = scipy.linalg.null_space(normal.T)  # (p, p−1)

    def solve(self, rows: Array, tolerance: float = TOLERANCE) -> Array:
        """(p,) the minimiser θ/scale of ‖rows·θ/scale‖ that is nearest to the prior.

        Args:
            rows: (N, p) of W·diag(scale).
            tolerance: singular values below this share of the largest count as 0.
        """
        target = -rows @ self.start
        y = np.linalg.lstsq(rows @ self.tangent, target, rcond=tolerance)[0]
        return self.start + self.tangent @ y

    def rescaled(self, theta_s: Array) -> Array:
        """(p,) θ/scale multiplied such that the sum of its gains is the prior's.

        Raises:
            InvalidInput: the sum of its gains is 0.
        """
        total = self.normal @ theta_s
        if not abs(total) > 1e-9 * np.linalg.norm(theta_s):
            raise InvalidInput("gains", "a sum that is not 0", total, "Record longer.")
        return theta_s * (self.normal @ self.start / total)
