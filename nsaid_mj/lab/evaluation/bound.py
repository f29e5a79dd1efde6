"""The Cramér–Rao bound of an experiment: the best accuracy of an estimate from its log.

The plant is deterministic given θ, the command is known, and every position and velocity has white
Gaussian noise of known variance. The state at the first sample has the covariance of one
measurement, and θ that of the scenario's prior draw (`Truth.prior_covariance`), in the observable
directions. The covariance of (q, v, θ) given all samples then follows by a Kalman filter's
recursion along the true trajectory under the true θ (H. L. Van Trees, Detection, Estimation, and
Modulation Theory, part I, 1968). The system is linearised at the measured states, whose noise
changes the bound in the second order only.

With θ/scale = G z + const and a prior of covariance 1 of z, the recursion adds the information of
every sample to a triangular A with P_zz = (Aᵀ A)⁻¹, by reflections. A recursion of P itself would
subtract: the variances of a vehicle's θ fall from 0.1 to 1e-22 within a minute, far below the
rounding errors that the subtractions of the first seconds leave.
"""

import numpy as np
import scipy.linalg

from ...base import NoEstimate
from ...core import Array, Log, SensorLevels
from .truth import Truth


def cramer_rao(truth: Truth, log: Log, levels: SensorLevels) -> Array:
    """(p, p) smallest covariance of θ̂/scale that an estimate from a log and the prior can have.

    Raises:
        NoEstimate: the sensors are exact, the system has no compiled forward dynamics, or M, or the
            covariance S of an innovation, is not positive definite along the log.
    """
    system = truth.system
    n = truth.system.n
    if system.forward is None:
        raise NoEstimate(
            "no bound for a system without compiled forward dynamics", "Use a packaged system."
        )
    if not (levels.position > 0 and levels.velocity > 0):
        raise NoEstimate("the bound is 0 for exact sensors", "Use noisy sensors.")
    R = np.repeat(np.array(levels) ** 2, n)
    basis = truth.nullspace.P_perp  # nothing is learned along P_s
    values, vectors = scipy.linalg.eigh(basis.T @ truth.prior_covariance @ basis)
    G = basis @ (vectors * np.sqrt(np.maximum(values, 0.0)))
    A = np.eye(len(values))
    if not system.add_information(A, log, truth.theta, G, R, R, root=True):
        raise NoEstimate("M or S is not positive definite along the log", "Use a shorter log.")
    root = scipy.linalg.solve_triangular(A, G.T, trans=1)
    return root.T @ root
