"""Total least squares: the smallest right singular vector of W."""

from __future__ import annotations

import numpy as np

from ..errors import NoEstimate
from ..nullspace import TOLERANCE
from .base import Estimate, Problem
from .filters import low_passed
from .least_squares import filtered
from .regression import Gauge, condense


def total(problem: Problem) -> Estimate:
    """θ/scale along the smallest right singular vector of W·diag(scale).

    This is consistent only if the noise of all columns has the same variance, which does not hold
    here. W is filtered as in `least_squares.practitioners`, with the same choice of the cut-off,
    and the rows of each velocity are scaled to the same norm. Unobserved directions are excluded;
    they keep the prior's values.

    Raises:
        InvalidInput: the log is too short for any cut-off.
        NoEstimate: the actuator gains of the vector sum to 0.
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
        raise NoEstimate("the gains in the smallest singular vector sum to 0", "Record longer.")
    theta_s = rest + shortest * (gauge.normal @ (gauge.start - rest)) / gains
    return Estimate(gauge.scale * theta_s, f"cut-off {cutoff:.3g} Hz")
