"""Covariances of fitted servos: residuals are correlated over seconds, and throughout a log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...parameters import Array, Indices
from .fit import OutputError, Prior, Simulated, weights
from .logs import ServoLog

OFFSET = 2e-3
"""Largest standard deviation of a target's zero against the position's [rad or m]."""
_NUMERICAL = 0.01  # relative accuracy of the simulation itself, by arms with known servos
_FEWEST = 5  # logs that serve as clusters; fewer are divided into blocks
_BLOCK = 10.0  # shortest of them [s]
_BLOCKS = 20  # at most, in one log
_TICKS = 4 / 3  # the same in steps of the encoder, where those are finer


def clusters(logs: Sequence[ServoLog]) -> Indices:
    """(N,) number of the cluster of each sample: its log, or a block of time of few logs."""
    if len(logs) >= _FEWEST:
        return np.repeat(np.arange(len(logs)), [len(log.t) for log in logs])
    length = max(_BLOCK, sum(log.t[-1] - log.t[0] for log in logs) / _BLOCKS)
    found, count = [], 0
    for log in logs:
        own = ((log.t - log.t[0]) / length).astype(int) + count
        found.append(own)
        count = own[-1] + 1
    return np.concatenate(found)


def zeros(logs: Sequence[ServoLog]) -> Array:
    """(n,) standard deviations of the zeros of targets against those of positions [rad or m].

    They are steps of the encoders, which truncate: small changes from sample to sample.
    """
    changes = np.abs(np.concatenate([np.diff(log.position, axis=0) for log in logs]))
    ticks = [np.quantile(own[own > 0], 0.05) if own.any() else np.inf for own in changes.T]
    return np.minimum(_TICKS * np.array(ticks), OFFSET)


def covariance_of(
    simulated: Simulated, fit: OutputError, prior: Prior, cluster: Indices, zero: Array
) -> tuple[Array, Array]:
    """(k, k) of the parameters, and their (k, 2 n) change by offsets `zero` (n,), and by play.

    The covariance is that of the jackknife over clusters, each left out by one Gauss–Newton step,
    plus the prior's part A⁻¹ P A⁻¹, plus that of the zeros. Residuals of a simulation are
    correlated over seconds, and a motion that the structure misses is missed throughout a log:
    independent residuals would make intervals many times too narrow. Play is not in it: it leaves
    no residual, but hardly moves joints whose load keeps its side.
    """
    weight = weights(simulated, fit.residual, fit.sigma)
    free, P = prior.free, np.diag(prior.deviation[prior.free] ** -2.0)
    weighted = fit.jacobian * weight[:, None]
    H, count = weighted.T @ fit.jacobian + P, int(cluster.max()) + 1
    A = np.linalg.inv(H)
    shifts = []
    for k in range(count):
        own = cluster == k
        rest = H - weighted[own].T @ fit.jacobian[own]
        shifts.append(np.linalg.solve(rest, weighted[own].T @ fit.residual[own]))
    jackknife = np.cov(np.array(shifts).T, bias=True) * max(count - 1, 1)
    out, offset = np.zeros((len(fit.x), len(fit.x))), simulated.moved(fit.x, zero)
    moved = np.zeros((len(fit.x), offset.shape[1]))
    moved[free] = A @ weighted.T @ offset
    own = _NUMERICAL**2 * np.eye(len(free))
    out[np.ix_(free, free)] = jackknife + A @ P @ A + own
    by_zero = moved[:, : len(zero)]
    return out + by_zero @ by_zero.T, moved
