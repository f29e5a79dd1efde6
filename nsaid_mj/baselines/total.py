"""Total least squares: the direction in which the rows of W are shortest."""

from __future__ import annotations

import numpy as np

from ..errors import NoEstimate
from ..nullspace import TOLERANCE
from .base import Estimate, Problem
from .filters import low_passed
from .least_squares import filtered
from .regression import Gauge, condense


def total(problem: Problem) -> Estimate:
    """θ/scale along the smallest singular vector of W·diag(scale).

    It would be right if all columns were noisy alike; they are not. W is filtered as in
    `least_squares.practitioners`, with the cut-off chosen there, and the rows of each velocity are
    scaled to the same size. Directions that no row sees are left out of the search, and stay at
    the prior.

    Raises:
        InvalidInput: the log is too short for any cut-off.
        NoEstimate: the vector holds no gains.
    """
    W, rate, cutoff = filtered(problem)
    gauge = Gauge(problem.system, problem.prior)
    factors = condense(low_passed(W, rate, cutoff))
    factors /= np.linalg.norm(factors, axis=(1, 2), keepdims=True)
    _, s, Vt = np.linalg.svd(factors.reshape(-1, problem.system.p))
    seen = int(np.count_nonzero(s > TOLERANCE * s[0]))
    shortest, unseen = Vt[seen - 1], Vt[seen:]
    rest = unseen.T @ (unseen @ gauge.start)
    gains = gauge.normal @ shortest
    if not abs(gains) > TOLERANCE:
        raise NoEstimate("the smallest singular vector holds no gains", "Record longer.")
    theta_s = rest + shortest * (gauge.normal @ (gauge.start - rest)) / gains
    return Estimate(gauge.scale * theta_s, f"cut-off {cutoff:.3g} Hz")
