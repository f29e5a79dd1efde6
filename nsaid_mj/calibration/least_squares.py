"""Weighted least squares on the rows of a problem, with given gains: the method to beat."""

from __future__ import annotations

import numpy as np

from ..parameters import Array
from .problem import Problem

_REWEIGHTED = 5


def least_squares(problem: Problem, gain: Array) -> Array:
    """(p,) θ of weighted least squares with minimum norm in θ/scale, no prior, no physical bounds.

    The actuator parameters gain (k,) are given, not estimated.
    """
    at = problem.space.actuators
    rest = np.setdiff1d(np.arange(len(problem.space)), at)
    scale = problem.space.scale[rest]
    X, y = problem.Y[:, :, rest] * scale, -(problem.Y[:, :, at] @ gain)
    x, deviation = np.zeros(len(rest)), np.ones(X.shape[1])
    counts = np.maximum(problem.usable.sum(axis=0), 1)
    for _ in range(_REWEIGHTED):
        weight = problem.usable / deviation
        rows = (X * weight[:, :, None]).reshape(-1, len(rest))
        x = np.linalg.lstsq(rows, (y * weight).ravel(), rcond=1e-8)[0]
        error = np.where(problem.usable, X @ x - y, 0.0)
        deviation = np.sqrt(np.sum(error**2, axis=0) / counts)
        deviation = np.maximum(deviation, 1e-6 * max(float(deviation.max()), 1e-300))
    theta = np.empty(len(problem.space))
    theta[rest], theta[at] = x * scale, gain
    return theta
