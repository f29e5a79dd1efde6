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
    counts = np.maximum(problem.usable.sum(axis=0), 1)
    factors = []  # (n, ·, p − k + 1) R of [X, y] = Q R of every velocity, as good as its rows
    for Y, usable in zip(problem.Y.transpose(1, 0, 2), problem.usable.T, strict=True):
        rows = np.column_stack([Y[usable][:, rest] * scale, -(Y[usable][:, at] @ gain)])
        factors.append(np.linalg.qr(rows, mode="r"))
    x, deviation = np.zeros(len(rest)), np.ones(len(factors))
    for _ in range(_REWEIGHTED):
        rows = np.vstack([R / d for R, d in zip(factors, deviation, strict=True)])
        x = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=1e-8)[0]
        errors = [np.linalg.norm(R @ np.append(x, -1.0)) for R in factors]
        deviation = np.array(errors) / np.sqrt(counts)
        deviation = np.maximum(deviation, 1e-6 * max(float(deviation.max()), 1e-300))
    theta = np.empty(len(problem.space))
    theta[rest], theta[at] = x * scale, gain
    return theta
