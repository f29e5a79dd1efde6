"""Covariances of fitted servos: residuals are correlated over seconds, and throughout a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

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


class Spread(NamedTuple):
    """Uncertainty of k fitted parameters."""

    covariance: Array  # (k, k) covariance of the parameters
    moved: Array  # (k, 2 n) their change by offsets of the zeros, and by play
    free: Indices  # (f,) indices of the fitted ones
    jackknife: Array  # (f, f) part of the covariance from differences between clusters
    information: Array  # (G, f, f) information of every cluster
    inverse: Array  # (f, f) inverse of all clusters' information and the prior's

    def quantile(self, direction: Array) -> float:
        """Of Student's t, for the 95 % interval of a combination of the parameters (k,).

        If one log contains most of the information about it, there are fewer degrees of freedom
        than clusters: Satterthwaite's (Bell and McCaffrey, Survey Methodology 28, 2002), more where
        the jackknife is a small part of the variance, and at most those of equal clusters.
        """
        c, most = direction[self.free], len(self.information) - 1
        part = float(c @ self.jackknife @ c)
        if part <= 0:
            return float(stats.t.ppf(0.975, most))
        own, A = self.information, self.inverse
        left_out = np.linalg.solve(
            np.linalg.inv(A) - own, np.broadcast_to(c, own[..., 0].shape)[..., None]
        )[..., 0]
        scores = np.einsum("gij,gj->gi", own, left_out)
        seen = scores @ A
        M = np.diag(np.einsum("gi,gi->g", scores, left_out)) - 2 * seen @ scores.T
        M += seen @ own.sum(axis=0) @ seen.T
        M += M.mean() - M.mean(axis=0) - M.mean(axis=1)[:, None]
        degrees = (
            np.trace(M) ** 2 / np.sum(M**2) * (direction @ self.covariance @ direction / part) ** 2
        )
        return float(stats.t.ppf(0.975, np.clip(degrees, 1.0, most)))


def covariance_of(
    simulated: Simulated, fit: OutputError, prior: Prior, cluster: Indices, zero: Array
) -> Spread:
    """The covariance of the parameters, and their change by offsets `zero` (n,) and by play.

    The covariance is that of the jackknife over clusters, each left out by one Gauss–Newton step,
    plus the prior's part A⁻¹ P A⁻¹, plus that of the zeros. Residuals of a simulation are
    correlated over seconds, and model errors persist throughout a log: treating residuals as
    independent would make intervals many times too narrow. Play is not included: it causes no
    residual, and hardly moves joints whose load keeps its sign.
    """
    weight = weights(simulated, fit.residual, fit.sigma)
    free, P = prior.free, np.diag(prior.deviation[prior.free] ** -2.0)
    weighted = fit.jacobian * weight[:, None]
    count, H, shifts = int(cluster.max()) + 1, weighted.T @ fit.jacobian + P, []
    information = np.empty((count, *H.shape))
    for k in range(count):
        own = cluster == k
        information[k] = weighted[own].T @ fit.jacobian[own]
        score = weighted[own].T @ fit.residual[own]
        shifts.append(np.linalg.solve(H - information[k], score))
    A: Array = np.asarray(np.linalg.inv(H), dtype=np.float64)
    apart = np.array(shifts) - np.mean(shifts, axis=0)
    jackknife = apart.T @ apart * max(count - 1, 1) / count
    out, offset = np.zeros((len(fit.x), len(fit.x))), simulated.moved(fit.x, zero)
    moved = np.zeros((len(fit.x), offset.shape[1]))
    moved[free] = A @ weighted.T @ offset
    own = _NUMERICAL**2 * np.eye(len(free))
    out[np.ix_(free, free)] = jackknife + A @ P @ A + own
    by_zero = moved[:, : len(zero)]
    return Spread(out + by_zero @ by_zero.T, moved, free, jackknife, information, A)
