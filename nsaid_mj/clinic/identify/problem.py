"""A fitting problem: rows of W θ = 0, and prior knowledge of θ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core import Array, Indices, ParameterSpace

_IDLE = 1e-6  # ratio of actuators' to inertial forces below which a velocity is not actuated
_TRIFLE = 0.1  # of the largest force: below it, an undriven velocity is not judged
_RIDGE = 1e-9  # of the trace of a velocity's information, for directions that it does not excite
_REWEIGHTED = 5  # times of weighted least squares
Mask = NDArray[np.bool_]


class Size(NamedTuple):
    """Prior knowledge of the common scale of θ, which no motion reveals.

    Limbs that only the fixed base connects, such as a quadruped's legs on a stand, each have one.
    """

    weights: Array  # (s, p) w_k of the sizes w_kᵀθ of the bodies of every limb k
    limb: Indices  # (p,) the limb of every parameter
    deviation: float  # standard deviation of log(w_kᵀθ / w_kᵀθ̂(0))
    stated: Mask  # (p,) whether a prior value is absolute; others are relative to their limb's size
    # (p,) index of the gain to which a prior value is relative instead, −1 of none; None: all are
    # not. Friction guessed from a command is wrong by the factor by which the command's gain is.
    gain: Indices | None = None

    def slopes(self, theta: Array) -> Array:
        """(s, p) derivatives of the logarithms of the sizes at θ (p,)."""
        return self.weights / (self.weights @ theta)[:, None]

    def by_gain(self) -> tuple[Indices, Indices]:
        """Indices of the parameters whose prior values are relative to a gain, and of the gains."""
        if self.gain is None:
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        at = np.flatnonzero(self.gain >= 0)
        return at, self.gain[at]


def size_weights(columns: Array, theta: Array) -> Array:
    """(p,) w of least squares: columns (K, p) times any θ are near wᵀθ times those of a θ (p,)."""
    force = columns @ theta
    return force @ columns / max(float(force @ force), 1e-300)


@dataclass(frozen=True)
class FitProblem:
    """Rows and prior."""

    space: ParameterSpace  # names, units, scale and geometry of θ
    Y: Array  # (N, n, p) rows, Y θ = 0 up to noise: inertia, weight, friction minus actuators
    usable: Mask  # (N, n) whether a row is used
    t: Array  # (N,) time of each row [s]
    segment: Indices  # (N,) number of the segment of each row
    prior: Array  # (p,) θ̂(0), inside the cone
    # (p,) standard deviation of the prior: of log θ for `positive` parameters, of θ for `free`
    # ones; not used for matrices, whose prior is the barrier's divergence
    spread: Array
    known: Mask  # (p,) whether a parameter is known and keeps the prior's value
    size: Size  # prior of the common scales
    # (n, p) m_i with m_iᵀθ the inertial force at a velocity's own rms acceleration; None unless
    # some joints are passive
    inertia: Array | None = None
    # (p,) whether a parameter is that of an actuator whose command never changes; None if none is
    steady: Mask | None = None
    # (n, p) w_i with w_iᵀθ the force of a velocity's actuators over the whole log, if its rows are
    # of a part in which they do little, such as a leg's in swing; 0 for others, None without any
    whole: Array | None = None

    def select(self, rows: Indices | Mask) -> FitProblem:
        """The problem of some of the rows (N,), as indices or a mask."""
        parts = {name: getattr(self, name)[rows] for name in ("Y", "usable", "t", "segment")}
        return replace(self, **parts)

    def actuation(self, theta: Array) -> Array:
        """(N, n) forces of the actuators under θ (p,), with the sign they have in Y."""
        at = self.space.actuators
        return self.Y[:, :, at] @ theta[at]

    def residual(self, theta: Array) -> Array:
        """(N, n) Y θ."""
        return self.Y @ theta

    def nrmse(self, theta: Array, whole: FitProblem | None = None) -> Array:
        """(n,) rms of Y θ over the standard deviation of the actuators' forces, per velocity.

        Predicting the mean command gives 1. For velocities without an actuator, the forces of
        inertia and weight replace the actuators'. NaN where no row is usable. If these rows are
        part of a `whole` problem, its forces are used, as they may hardly vary within a part.
        """
        size = (self if whole is None else whole).forces(theta)
        residual = np.sqrt(mean_squares(self.residual(theta), self.usable))
        judged = self.usable.any(axis=0) & (size > 0)
        return np.where(judged, residual / np.where(size > 0, size, 1), np.nan)

    def forces(self, theta: Array) -> Array:
        """(n,) standard deviations of the forces with which `nrmse` compares residuals.

        0 for a velocity with fewer than two rows.
        """
        acting, inertial = self._deviations(theta)
        if self.whole is not None:
            acting = np.where(acting > 0, np.fmax(acting, self.whole @ theta), acting)
        return np.where(acting > _IDLE * inertial, acting, inertial)

    def hardly_moved(self, theta: Array, units: Sequence[str]) -> Mask:
        """(n,) mask of velocities without an actuator and with forces far below the others'.

        Such as a hovering quadrotor's surge: weight and inertia cancel, and only noise remains.
        Forces are compared with actuated ones of the same unit, of `units` (n,).
        """
        acting, inertial = self._deviations(theta)
        same = np.array([[a == b for b in units] for a in units])
        largest = np.max(np.where(same, acting, 0.0), axis=1)
        return (acting <= _IDLE * inertial) & (inertial < _TRIFLE * largest)

    def _deviations(self, theta: Array) -> tuple[Array, Array]:
        """(n,) standard deviations of the actuators' forces, and of those of inertia and weight."""
        used = self.usable
        counts = self.usable.sum(axis=0)

        def deviation(force: Array) -> Array:
            mean = np.sum(np.where(used, force, 0.0), axis=0) / np.maximum(counts, 1)
            return np.where(counts > 1, np.sqrt(mean_squares(force - mean, used)), 0.0)

        matrices = ~np.isin(self.space.geometries, ("positive", "free"))
        inertial = self.Y @ np.where(matrices, theta, 0.0)
        moving = theta if self.steady is None else np.where(self.steady, 0.0, theta)
        return deviation(self.actuation(moving)), deviation(inertial)


def mean_squares(x: Array, usable: Mask) -> Array:
    """Mean squares of x (N, ...) along its first axis, over the usable rows; 0 if there is none."""
    return np.sum(np.where(usable, x, 0.0) ** 2, axis=0) / np.maximum(usable.sum(axis=0), 1)


def folds(problem: FitProblem, count: int) -> list[tuple[FitProblem, FitProblem]]:
    """Splits a problem into `count` parts: pairs of the problem without a part, and that part.

    A part is contiguous in time and has an equal share of the information in the rows of every
    velocity; otherwise a joint's only motion might have to be predicted from rows at rest.
    """
    leverages = np.zeros(problem.usable.shape)  # of the usable rows in least squares of a velocity
    for i in range(problem.Y.shape[1]):
        X = problem.Y[:, i] * problem.usable[:, i, None] * problem.space.scale
        A = X.T @ X
        A[np.diag_indices_from(A)] += max(_RIDGE * float(np.trace(A)), 1e-300)
        leverages[:, i] = np.einsum("np,np->n", X @ np.linalg.inv(A), X)
    sums = np.cumsum(leverages, axis=0)
    number = np.minimum((count * sums / np.maximum(sums[-1], 1e-300)).astype(int), count - 1)
    found = []
    for k in range(count):
        own = problem.usable & (number == k)
        rest = replace(problem, usable=problem.usable & ~own)
        found.append((rest, replace(problem, usable=own).select(own.any(axis=1))))
    return found


def least_squares(problem: FitProblem, gain: Array) -> Array:
    """(p,) θ of weighted least squares, the baseline: no prior, no physical bounds.

    Its norm is least in θ/scale. The actuator parameters gain (k,) are given, not estimated.
    """
    at = problem.space.actuators
    rest = np.setdiff1d(np.arange(len(problem.space)), at)
    scale = problem.space.scale[rest]
    counts = np.maximum(problem.usable.sum(axis=0), 1)
    factors = []  # (n, ·, p − k + 1) R of [X, y] = Q R of every velocity, as good as its rows
    for Y, usable in zip(problem.Y.transpose(1, 0, 2), problem.usable.T, strict=True):
        rows = np.column_stack([Y[usable][:, rest] * scale, -(Y[usable][:, at] @ gain)])
        factors.append(np.linalg.qr(rows, mode="r"))
    x = np.zeros(len(rest))
    deviation = np.ones(len(factors))
    for _ in range(_REWEIGHTED):
        rows = np.vstack([R / d for R, d in zip(factors, deviation, strict=True)])
        x = np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=1e-8)[0]
        errors = [np.linalg.norm(R @ np.append(x, -1.0)) for R in factors]
        deviation = np.array(errors) / np.sqrt(counts)
        deviation = np.maximum(deviation, 1e-6 * max(float(deviation.max()), 1e-300))
    theta = np.empty(len(problem.space))
    theta[rest] = x * scale
    theta[at] = gain
    return theta
