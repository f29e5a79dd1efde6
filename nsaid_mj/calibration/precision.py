"""How precisely a log determines θ: correlated residuals, structural error, what is observable.

Residuals of a real log are neither white nor sensor noise: they are unmodelled friction and
flexibility, correlated over tenths of a second. Their effective number is estimated from the log,
and so are the changes of θ̂ between parts of the log and between plausible sets of columns. The
stated standard deviation is the largest of the three.
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg

from ..parameters import Array
from ..quotient.gramians import Sums
from ..quotient.matrices import inverse_on
from .fit import Fit, gramians, minimise, posterior
from .problem import Problem, folds

_BLOCKS = 20  # of the rows, for the long-run variance of the scores
_DIRECTIONS = 12  # leading directions of a row's columns over which scores are averaged
_PARTS = 8  # of the log, left out in turn
_LEAST = 0.005  # least relative deviation: no log's clocks, filters and structure are more exact
_NEGLIGIBLE = 1e-6  # weight in θ/scale below which a parameter is left out of a combination
_DEPENDENT = 1e-7  # residual share below which a column is a combination of earlier ones


def inflation(problem: Problem, theta: Array) -> Array:
    """(n,) rows per effectively independent row: long-run over white variance of the scores.

    The score of a residual along a column is summed over blocks in time; for white residuals the
    blocks' variances add up to the residuals' own (batch means; Newey and West's estimator has the
    same aim). The mean over the leading directions of the columns is at least 1.
    """
    residual = problem.residual(theta)
    found = np.ones(residual.shape[1])
    for i in range(len(found)):
        rows = np.flatnonzero(problem.usable[:, i])
        if len(rows) < 4 * _BLOCKS:
            continue
        e = residual[rows, i]
        X = problem.Y[rows, i] * problem.space.scale
        basis = np.linalg.svd(X, full_matrices=False)[0][:, :_DIRECTIONS]
        scores = basis * (e / max(float(np.sqrt(np.mean(e**2))), 1e-300))[:, None]
        blocks = np.add.reduceat(scores, np.arange(0, len(rows), -(-len(rows) // _BLOCKS)), axis=0)
        blocks -= blocks.mean(axis=0)
        found[i] = max(1.0, float(np.mean(np.sum(blocks**2, axis=0))))
    return found


def tempered(problem: Problem, share: Array) -> Sums:
    """The Gramians of the rows, weighted as effectively independent ones."""
    parts = gramians(problem)
    return Sums(parts.sums / share[:, None, None], parts.counts / share)


class Precision(NamedTuple):
    """Precision of an estimate."""

    theta: Array  # (p,) θ̂
    covariance: Array  # (p, p) covariance of θ̂ from data and prior, under correlated residuals
    data: Array  # (p, p) information of the data alone
    # (K, p) changes of θ̂ without one part of the log, scaled as the jackknife's variance: the
    # deviation of wᵀθ̂ between parts of the log is ‖parts w‖
    parts: Array
    structure: Array  # (A, p) changes under other plausible structures, one standard deviation each
    prior: Array  # (p,) standard deviations of the prior

    def of(self, weights: Array) -> float:
        """Stated standard deviation of wᵀθ̂ for weights w (p,)."""
        own = float(np.sqrt(max(weights @ self.covariance @ weights, 0.0)))
        own = float(np.hypot(own, np.linalg.norm(self.structure @ weights)))
        least = _LEAST * float(np.linalg.norm(self.theta * weights))
        return max(own, float(np.linalg.norm(self.parts @ weights)), least)

    @property
    def deviation(self) -> Array:
        """(p,) stated standard deviations of θ̂."""
        return np.array([self.of(e) for e in np.eye(len(self.prior))])


def precision(problem: Problem, fit: Fit, share: Array) -> Precision:
    """The precision of a fit to rows tempered by share (n,), see `inflation`."""
    total = tempered(problem, share)
    data, prior = information(problem, total, fit.theta)
    free, scale = np.flatnonzero(~problem.known), problem.space.scale
    covariance = inverse_on(data + prior, free, scale)
    estimates = []
    for _, part in folds(problem, _PARTS):
        rest = total - tempered(part, share)
        if (rest.counts > 0)[total.counts > 0].all():  # some joints may be at rest throughout
            estimates.append(minimise(problem, rest, fit.theta).theta)
    apart = np.zeros((1, len(scale)))
    if len(estimates) > 1:
        apart = np.array(estimates) - np.mean(estimates, axis=0)
        apart *= np.sqrt((len(estimates) - 1) / len(estimates))
    before = np.zeros(len(scale))
    held = np.flatnonzero(np.diag(prior) > 0)
    unit = 1 / np.sqrt(np.diag(prior)[held])
    inner = prior[np.ix_(held, held)] * np.outer(unit, unit)
    before[held] = unit * np.sqrt(np.diag(scipy.linalg.inv(inner)))
    return Precision(
        fit.theta * ~problem.known, covariance, data, apart, np.zeros((1, len(scale))), before
    )


def information(problem: Problem, parts: Sums, theta: Array) -> tuple[Array, Array]:
    """(p, p) information of rows and (p, p) of the prior at θ (p,)."""
    J = posterior(problem, parts)
    return J.likelihood(theta).curvature(theta), J.prior.derivatives(theta)[1]


class Combinations(NamedTuple):
    """Parameters that affect the motion only in combination with others."""

    independent: list[int]  # indices of parameters whose columns are linearly independent, in order
    # (independent, p) only these combinations are visible, each of one independent parameter, with
    # weight 1, and of others: their column is the sum of these times the independent ones
    weights: Array

    def expression(self, index: int) -> dict[int, float]:
        """Coefficients, by index, of the combination that an independent parameter represents."""
        row = self.weights[self.independent.index(index)]
        return {index: 1.0} | {other: float(row[other]) for other in np.flatnonzero(row).tolist()}

    def members(self, index: int) -> list[int]:
        """The independent parameters in whose combinations a parameter takes part."""
        return [self.independent[row] for row in np.flatnonzero(self.weights[:, index])]


def combinations(problem: Problem) -> Combinations:
    """The base parameters of the log: columns in order, each kept if it is independent.

    Actuator parameters are left out: with the gains known, the rest is determined up to these
    combinations (Gautier and Khalil, IEEE Trans. Robotics and Automation 6(3), 1990).
    """
    rest = np.setdiff1d(np.arange(len(problem.space)), problem.space.actuators)
    masked = (problem.Y * problem.usable[:, :, None])[:, :, rest]
    size = np.maximum(np.sqrt(np.mean(masked**2, axis=(0, 2))), 1e-300)
    stack = (masked / size[None, :, None]).reshape(-1, len(rest)) * problem.space.scale[rest]
    R = np.asarray(np.linalg.qr(stack, mode="r"))
    norms = np.linalg.norm(R, axis=0)
    kept: list[int] = []
    basis = np.zeros((R.shape[0], 0))
    dependent: list[int] = []
    for j in range(len(rest)):
        if norms[j] <= 1e-10 * norms.max():  # 0 in the whole log
            continue
        left = R[:, j] - basis @ (basis.T @ R[:, j])
        left -= basis @ (basis.T @ left)
        if np.linalg.norm(left) > _DEPENDENT * norms[j]:
            kept.append(j)
            basis = np.hstack([basis, (left / np.linalg.norm(left))[:, None]])
        else:
            dependent.append(j)
    weights = np.linalg.lstsq(R[:, kept], R[:, dependent], rcond=None)[0]
    weights[np.abs(weights) < _NEGLIGIBLE] = 0.0
    own, others, scale = rest[kept], rest[dependent], problem.space.scale
    found = np.zeros((len(own), len(scale)))
    found[np.arange(len(own)), own] = 1.0
    found[:, others] = weights * (scale[own][:, None] / scale[others])
    return Combinations(own.tolist(), found)
