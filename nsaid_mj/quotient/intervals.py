"""Covariances of an estimate from the curvature of its cost."""

import numpy as np
import scipy.linalg

from ..parameters import Array, Indices
from .matrices import cholesky, square_root

_RIDGE = 1e-12  # share of the mean diagonal that is added against rounding errors


def sandwich_root(hessian: Array, scatter: Array) -> Array:
    """(p, p) R with R Rᵀ = H⁻¹ S H⁻¹, for H > 0 and S ⪰ 0, both (p, p)."""
    unit = 1 / np.sqrt(np.diag(hessian))
    balance = np.outer(unit, unit)
    bread = cholesky(hessian * balance)
    root = np.linalg.solve(bread.T, np.linalg.solve(bread, square_root(scatter * balance)))
    return np.array(unit[:, None] * root, dtype=np.float64)


def inverse_on(hessian: Array, free: Indices, scale: Array) -> Array:
    """(p, p) inverse of H ⪰ 0 (p, p) among the parameters `free`, and 0 for all others.

    scale (p,) of all parameters serves conditioning.
    """
    found, unit = np.zeros_like(hessian), np.outer(scale[free], scale[free])
    inner = hessian[np.ix_(free, free)] * unit
    inner[np.diag_indices_from(inner)] += _RIDGE * np.trace(inner) / len(inner)
    found[np.ix_(free, free)] = scipy.linalg.inv(inner) * unit
    return found
