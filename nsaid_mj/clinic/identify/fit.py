"""The batch fit: the memory's scale-invariant cost of all rows, minimised inside the cone.

    J(θ) = ½ Σ_i N_i log λ_i(θ) + D(θ, θ̂(0)),     λ_i(θ) = θᵀ G_i θ / θᵀ Σ_i θ

with G_i the mean Gramian of the rows of velocity i and Σ_i that of the actuators' effort in them
(`quotient.cost`): the negative log-likelihood of Gaussian residuals relative to the command, with
unknown variance for every velocity. The first sum is the same for θ and 2 θ, so the prior D fixes
the scale of θ. With σ(θ) = wᵀθ / wᵀθ̂(0) the size of the bodies, such as the links' weight along
the log,

    D(θ, θ̂(0)) = D₀(θ/σ, θ̂(0)) + ½ (log σ / δ)²,

where D₀ is the log-determinant divergence for links and other matrices, a normal density of log θ
for positive parameters, and of θ for free ones. D₀(θ, ·) itself would bias the scale: it contains
tr P₀⁻¹P − log det P₀⁻¹P, which over all multiples of P is minimal where tr P₀⁻¹P = 4. A link whose
shape is changed by the log has eigenvalues of P₀⁻¹P on both sides of 1, whose mean grows with the
change; the scale would therefore decrease with the information on shapes. D₀(θ/σ) is the same for
all multiples of θ, so that σ = 1 at the minimum for any rows, unless a known value or a stated
command determines it. Those are not divided by σ. Friction that was guessed from a command whose
gain is a guess, too, is divided by that gain's change instead: it is no evidence of the gain.

Gauss–Newton steps, each within half a Dikin ellipsoid and halved until J falls,
keep every estimate physical.

Residuals of a real log are neither white nor sensor noise: they are unmodelled friction and
flexibility, correlated over tenths of a second. Their effective number is estimated from the log,
and so are the changes of θ̂ between parts of the log and between plausible sets of columns. The
stated standard deviation of θ̂ is the largest of the three.
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg

from ...base import NoEstimate
from ...core import (
    Array,
    Cone,
    ParameterSpace,
    Posterior,
    Quotient,
    Sums,
)
from .problem import FitProblem, folds

_LIMITS = {"steps": 200, "halvings": 12, "done": 1e-2}  # of the search for the minimum


class Fit(NamedTuple):
    """A minimiser of J."""

    theta: Array  # (p,) θ̂
    levels: Array  # (n,) λ_i, mean squared residuals relative to the actuators' effort
    hessian: Array  # (p, p) Gauss–Newton Hessian of J
    cost: float  # J


class ConePrior:
    """D(θ, θ̂(0)) of a problem, from its `space`, `prior`, `spread`, `known` and `size`."""

    def __init__(self, problem: FitProblem):
        space = problem.space
        self._size = problem.size
        self._cone = None
        kinds = space.geometries
        self._start = problem.prior
        self._matrix = np.flatnonzero((kinds != "positive") & (kinds != "free"))
        self.positive = np.flatnonzero(kinds == "positive")
        self._free = np.flatnonzero(kinds == "free")
        self._precision = np.where(problem.known, 0.0, 1 / problem.spread)
        self._precision[self._matrix] = 0.0
        blocks = tuple(b for b in space.blocks if b.geometry not in ("positive", "free"))
        if blocks:
            self._cone = Cone.of(ParameterSpace(blocks))
            start = self._start[self._matrix]
            self._slope = self._cone.derivatives(start)[0]
            self._level, self._pull = self._cone.barrier(start), -self._slope * start

    def _scales(self, theta: Array) -> tuple[Array, Array]:
        """(s,) logarithms of the sizes of θ over those of θ̂(0); (p,) that of each prior value."""
        weights = self._size.weights
        sizes = np.log(weights @ theta / (weights @ self._start))
        change = np.where(self._size.stated, 0.0, sizes[self._size.limb])
        at, gain = self._size.by_gain()
        change[at] = np.log(theta[gain] / self._start[gain])
        return sizes, change

    def _deviations(self, theta: Array) -> Array:
        """(p + s,) standardised deviations of single parameters and of the sizes."""
        (sizes, change), off = self._scales(theta), np.zeros(len(theta))
        at = self.positive
        off[at] = np.log(theta[at] / self._start[at]) - change[at]
        at = self._free
        off[at] = np.exp(-change[at]) * theta[at] - self._start[at]
        return np.append(self._precision * off, sizes / self._size.deviation)

    def value(self, theta: Array) -> float:
        """D(θ, θ̂(0)); infinite outside the cone."""
        if not ((theta[self.positive] > 0).all() and (self._size.weights @ theta > 0).all()):
            return np.inf
        off = self._deviations(theta)
        total = 0.5 * float(off @ off)
        if self._cone is not None:
            own = theta[self._matrix]
            change = self._scales(theta)[1][self._matrix]
            total += self._cone.barrier(own) - self._level
            total += self._pull @ (change - 1) - self._slope @ (own / np.exp(change))
        return float(total)

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """(p,) gradient and (p, p) positive semidefinite Gauss–Newton Hessian of D at θ (p,).

        Only the sizes and stated values have a part along θ.
        """
        off = self._deviations(theta)
        change = self._scales(theta)[1]
        slopes = self._size.slopes(theta)
        # (p, p) derivatives of the logarithms of the sizes to which prior values are relative
        changes = np.where(self._size.stated[:, None], 0.0, slopes[self._size.limb])
        at, gain = self._size.by_gain()
        changes[at] = 0.0
        changes[at, gain] = 1 / theta[gain]
        at = self.positive
        rows = -changes
        rows[at, at] += 1 / theta[at]
        at = self._free
        share = np.exp(-change[at])
        rows[at] *= (share * theta[at])[:, None]
        rows[at, at] += share
        rows = np.vstack([self._precision[:, None] * rows, slopes / self._size.deviation])
        gradient = rows.T @ off
        hessian = rows.T @ rows
        if self._cone is not None:
            at = self._matrix
            own = theta[at]
            size = np.exp(change[at])
            weights = changes[at]
            slope, curvature = self._cone.derivatives(own)
            gradient[at] += slope - self._slope / size
            gradient += (self._pull + self._slope * own / size) @ weights
            shape = -own[:, None] * weights
            shape[np.arange(len(at)), at] += 1.0
            hessian += shape.T @ curvature @ shape
        return gradient, hessian

    def length(self, theta: Array, step: Array) -> float:
        """Length of a step (p,) in the cone's metric at θ: shorter than 1, it stays inside."""
        total = float(np.sum((step[self.positive] / theta[self.positive]) ** 2))
        if self._cone is not None:
            total += self._cone.length(theta[self._matrix], step[self._matrix]) ** 2
        return float(np.sqrt(total))


def gramians(problem: FitProblem) -> Sums:
    """The Gramians of a problem's usable rows."""
    return Sums.of(problem.Y, problem.usable)


def cost_of(problem: FitProblem, parts: Sums) -> Quotient:
    """R with weights N_i; raises `NoEstimate` if no command affects the motion.

    Residuals of a passive joint are relative to its inertial force at its rms acceleration:
    relative to the other joints' commands, they could be made 0 by a massless link.
    """
    means = parts.means
    space = problem.space
    inertia = problem.inertia
    moving = means
    if problem.steady is not None:
        # a force that never changes is no measure: another constant one could cancel it at any size
        moving = means.copy()
        moving[:, problem.steady, problem.steady] = 0.0
    effort = Quotient.reference(moving, space)
    if effort is None and inertia is not None and means[:, space.actuators].any():
        effort = np.zeros(means.shape[:2])
    if effort is None:
        raise NoEstimate("No command has an effect on the motion", "Check the columns of u.")
    if inertia is not None:
        passive = ~moving[:, space.actuators, space.actuators].any(axis=1)
        effort = effort[:, :, None] * np.eye(len(space))
        effort[passive] = inertia[passive, :, None] * inertia[passive, None]
    return Quotient(means, effort, parts.counts)


def posterior(problem: FitProblem, parts: Sums) -> Posterior:
    """J of a problem with the given Gramians of its rows."""
    return Posterior(cost_of(problem, parts), ConePrior(problem))


def minimise(problem: FitProblem, parts: Sums | None = None, start: Array | None = None) -> Fit:
    """Minimises J from `start` (p,), by default the prior, with the Gramians `parts` or all rows.

    Raises:
        NoEstimate: there are no usable rows, or the prior is not physical.
    """
    parts = gramians(problem) if parts is None else parts
    if not parts.counts.any():
        raise NoEstimate("The log has no row in which the robot moves", "Record a motion.")
    J = posterior(problem, parts)
    theta = problem.prior.copy() if start is None else start.copy()
    if not np.isfinite(J.value(theta)):
        raise NoEstimate("The prior is not physically consistent", "Check the model's inertias.")
    free = np.diag(np.abs(problem.space.scale))[:, ~problem.known]
    theta, hessian = J.minimised(theta, free, **_LIMITS)
    return Fit(theta, J.quotient.levels(theta), hessian, J.value(theta))


_BLOCKS = 20  # of the rows, for the long-run variance of the scores
_DIRECTIONS = 12  # leading directions of a row's columns over which scores are averaged
_PARTS = 8  # of the log, left out in turn
_LEAST = 0.005  # least relative deviation: no log's clocks, filters and structure are more exact
_NEGLIGIBLE = 1e-6  # weight in θ/scale below which a parameter is left out of a combination
_DEPENDENT = 1e-7  # residual share below which a column is a combination of earlier ones


def inflation(problem: FitProblem, theta: Array) -> Array:
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


def tempered(problem: FitProblem, share: Array) -> Sums:
    """The Gramians of the rows, weighted as effectively independent ones."""
    parts = gramians(problem)
    return Sums(parts.sums / share[:, None, None], parts.counts / share)


def tempered_fit(problem: FitProblem, start: Array | None = None) -> tuple[Fit, Array]:
    """The fit weighted by the effective number of independent rows, and (n,) rows per such row.

    `start` (p,) is where the search begins, by default the prior.
    """
    fit = minimise(problem, start=start)
    share = inflation(problem, fit.theta)
    return minimise(problem, tempered(problem, share), fit.theta), share


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

    def knowing(self, index: int) -> "Precision":
        """The precision that a parameter's known value would leave, to first order.

        Every change of θ̂ is then followed by the refit that takes that parameter back.
        """
        C = self.covariance
        refit = C[index] / C[index, index]
        found = [C - np.outer(C[index], refit)]
        found += [each - np.outer(each[:, index], refit) for each in (self.parts, self.structure)]
        covariance, parts, structure = found
        return self._replace(covariance=covariance, parts=parts, structure=structure)

    @property
    def deviation(self) -> Array:
        """(p,) stated standard deviations of θ̂."""
        return np.array([self.of(e) for e in np.eye(len(self.prior))])


def precision(problem: FitProblem, fit: Fit, share: Array) -> Precision:
    """The precision of a fit to rows tempered by share (n,), see `inflation`."""
    total = tempered(problem, share)
    data, prior = information(problem, total, fit.theta)
    free = np.flatnonzero(~problem.known)
    scale = problem.space.scale
    covariance = problem.space.inverse(data + prior, free)
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
    told = problem.known & np.isin(np.arange(len(scale)), problem.space.actuators)
    held = np.flatnonzero((np.diag(prior) > 0) & ~told)
    unit = 1 / np.sqrt(np.diag(prior)[held])
    inner = prior[np.ix_(held, held)] * np.outer(unit, unit)
    before[held] = unit * np.sqrt(np.diag(scipy.linalg.inv(inner)))
    return Precision(
        fit.theta * ~problem.known, covariance, data, apart, np.zeros((1, len(scale))), before
    )


def information(problem: FitProblem, parts: Sums, theta: Array) -> tuple[Array, Array]:
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


def combinations(problem: FitProblem) -> Combinations:
    """The base parameters of the log: columns in order, each kept if it is independent.

    Actuator parameters are left out: with the gains known, the rest is determined up to these
    combinations (Gautier and Khalil, IEEE Trans. Robotics and Automation 6(3), 1990).
    """
    rest = np.setdiff1d(np.arange(len(problem.space)), problem.space.actuators)
    stack = []
    for i, used in enumerate(problem.usable.T):
        own = problem.Y[used, i][:, rest]
        size = np.sqrt(np.sum(own**2) / own.shape[1] / len(used))
        stack.append(own / max(float(size), 1e-300) * problem.space.scale[rest])
    stack = np.concatenate(stack)
    R = np.asarray(np.linalg.qr(stack, mode="r"))
    norms = np.linalg.norm(R, axis=0)  # of each column, of its rest
    new = np.abs(np.diagonal(R))
    seen = np.flatnonzero(norms > 1e-10 * norms.max())  # others are 0 in the whole log
    kept = np.intersect1d(seen, np.flatnonzero(new > _DEPENDENT * norms[: len(new)]))
    dependent = np.setdiff1d(seen, kept)
    weights = np.linalg.lstsq(R[:, kept], R[:, dependent], rcond=None)[0]
    weights[np.abs(weights) < _NEGLIGIBLE] = 0.0
    own = rest[kept]
    others = rest[dependent]
    scale = problem.space.scale
    found = np.zeros((len(own), len(scale)))
    found[np.arange(len(own)), own] = 1.0
    found[:, others] = weights * (scale[own][:, None] / scale[others])
    return Combinations(own.tolist(), found)
