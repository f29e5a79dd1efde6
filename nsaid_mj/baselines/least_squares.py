"""Batch least squares: ordinary, and filtered and weighted as in common practice."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ..errors import InvalidInput
from ..log import Log
from ..parameters import Array
from ..system import SecondOrderSystem
from .base import Estimate, Problem
from .filters import low_passed, smoothed
from .regression import Gauge, central_rows, condense

SMOOTHING = 30.0  # cut-off of the filter on q and v [Hz]
_FOLDS = 4  # of the cross-validation, contiguous in time
_STEPS, _HALVINGS = 12, 8  # largest numbers of Gauss–Newton steps and of halvings of a step
_CONVERGED = 1e-2  # change of the log-likelihood at convergence
_IDLE = 1e-9  # ratio of actuator columns to row below which the velocity is not actuated


def ordinary(problem: Problem) -> Estimate:
    """Least squares on raw central differences: min ‖W θ‖² with equal weights."""
    gauge = Gauge(problem.system, problem.prior)
    factors = condense(central_rows(problem.system, problem.log))
    return Estimate(gauge.scale * gauge.solve(factors.reshape(-1, problem.system.p)))


def weighted(gauge: Gauge, W: Array) -> Array:
    """(p,) θ/scale of iteratively reweighted least squares, with residuals in units of command.

    The residual r_i of velocity i is W_i θ over the rms of its actuator forces under θ, so that
    shrinking a gain does not reduce it. Weights follow from the residuals themselves: this is the
    maximum-likelihood estimate under Gaussian noise of unknown variance in every velocity, the
    minimum of N Σ_i log‖r_i‖ + ½ ‖θ_s − θ̂_s(0)‖². The second term is a prior of standard deviation
    1 in θ/scale; it regularises poorly excited directions. Solved by Gauss–Newton steps, halved
    until the cost decreases.

    Args:
        gauge: scale and unobserved directions, from the prior.
        W: (N, n, p) rows of W·diag(scale).
    """
    factors = condense(W)
    forces = factors * gauge.normal  # actuator columns only
    driven = np.linalg.norm(forces, axis=(1, 2)) > _IDLE * np.linalg.norm(factors, axis=(1, 2))
    trial = _Residuals(gauge, factors, forces, driven, gauge.start, len(W))
    theta_s = gauge.solve(trial.scaled)
    trial = _Residuals(gauge, factors, forces, driven, theta_s, len(W))
    for _ in range(_STEPS):
        here = trial
        step = here.step()
        for _ in range(_HALVINGS):
            trial = _Residuals(gauge, factors, forces, driven, theta_s + step, len(W))
            if trial.cost < here.cost:
                break
            step = 0.5 * step
        else:
            return theta_s
        theta_s = theta_s + step
        if here.cost - trial.cost < _CONVERGED:
            break
    return theta_s


class _Residuals:
    """Residuals of all velocities in units of command, at one θ/scale.

    Args:
        gauge: scale and unobserved directions, from the prior.
        factors: (n, p, p) of `condense`.
        forces: (n, p, p) their actuator columns; the others are 0.
        driven: (n,) whether an actuator acts on the velocity.
        theta_s: (p,) θ/scale.
        rows: N, the number of samples.

    Attributes:
        cost: the objective that `weighted` minimises.
    """

    def __init__(
        self, gauge: Gauge, factors: Array, forces: Array, driven: Array, theta_s: Array, rows: int
    ):
        self._gauge, self._factors, self._forces = gauge, factors, forces
        self._off = theta_s - gauge.start
        acting = forces @ theta_s
        self._acting = np.where(driven[:, None], acting, 0.0)
        self._force = np.where(driven, np.linalg.norm(acting, axis=1), 1.0)
        self._residual = (factors @ theta_s) / self._force[:, None]
        size = np.linalg.norm(self._residual, axis=1)
        self._size = np.maximum(size, 1e-6 * size.max())
        self.cost = float(rows * np.log(self._size).sum() + 0.5 * self._off @ self._off)
        self._weight = np.sqrt(rows) / self._size

    @property
    def scaled(self) -> Array:
        """(k, p) rows in units of command under the current actuator forces, not weighted."""
        rows = self._factors / self._force[:, None, None]
        return rows.reshape(-1, rows.shape[2])

    def step(self) -> Array:
        """(p,) the Gauss–Newton step."""
        gradient = np.einsum("iap,ia->ip", self._forces, self._acting) / self._force[:, None]
        J = self._factors - self._residual[:, :, None] * gradient[:, None, :]
        J *= (self._weight / self._force)[:, None, None]
        tangent = self._gauge.tangent
        A = np.vstack([J.reshape(-1, J.shape[2]) @ tangent, tangent])
        b = np.concatenate([(self._residual * self._weight[:, None]).ravel(), self._off])
        R = np.asarray(np.linalg.qr(np.hstack([A, b[:, None]]), mode="r"))
        return -tangent @ scipy.linalg.solve_triangular(R[:-1, :-1], R[:-1, -1])


def practitioners(problem: Problem) -> Estimate:
    """Filtered weighted least squares with a cut-off chosen by cross-validation.

    q and v pass through a zero-phase Butterworth filter, and v̇ is the central difference of v. All
    columns of W, those of u included, pass through one low-pass filter and are decimated. The rows
    of each velocity are weighted by their residuals, iteratively.

    Raises:
        InvalidInput: the log is too short for any cut-off.
    """
    W, rate, cutoff = filtered(problem)
    gauge = Gauge(problem.system, problem.prior)
    theta_s = weighted(gauge, low_passed(W, rate, cutoff))
    return Estimate(gauge.scale * theta_s, f"cut-off {cutoff:.3g} Hz")


def filtered(problem: Problem) -> tuple[Array, float, float]:
    """(N, n, p) rows of W·diag(scale) of the smoothed log, their rate and the chosen cut-off [Hz].

    Raises:
        InvalidInput: the log is too short for any cut-off.
    """
    rate = 1 / problem.log.step
    log = smoothed(problem.system, problem.log, SMOOTHING)
    W = central_rows(problem.system, log)
    return W, rate, choose_cutoff(problem, log, W, rate)


def choose_cutoff(problem: Problem, log: Log, W: Array, rate: float) -> float:
    """The cut-off [Hz] whose estimates best predict velocity changes in held-out data.

    The log is split into contiguous folds. An estimate from all folds but one predicts the changes
    of v over short windows of the remaining one, with error M̂⁻¹ Σ W θ̂ dt. As Σ v̇ dt is the
    difference of two velocities, its noise does not depend on the candidate; a residual of W θ̂
    would favour estimates that are biased towards zero by noisy regressors. The score is the sum
    over velocities of the log of the mean squared error, the likelihood of Gaussian errors of
    unknown variance.

    Args:
        problem: whose structure and prior are used.
        log: N samples, smoothed.
        W: (N−2, n, p) its rows of W·diag(scale).
        rate: sampling rate [Hz].

    Raises:
        InvalidInput: the log is too short for any cut-off.
    """
    system = problem.system
    gauge = Gauge(system, problem.prior)
    windows = _Windows(system, log, W, 1 / rate)
    best, chosen = np.inf, 0.0
    for cutoff in candidates(rate, len(W), system):
        half = int(np.ceil(1.5 * rate / cutoff))
        errors = []
        for k in range(_FOLDS):
            first, last = k * len(W) // _FOLDS, (k + 1) * len(W) // _FOLDS
            seen = [part for part in (W[:first], W[last:]) if len(part) > 2 * half]
            theta_s = weighted(gauge, np.concatenate([low_passed(p, rate, cutoff) for p in seen]))
            errors.append(windows.errors(theta_s, first, last))
        score = float(np.sum(np.log(np.mean(np.concatenate(errors) ** 2, axis=0) + 1e-300)))
        if score < best:
            best, chosen = score, cutoff
    if not chosen:
        raise InvalidInput(
            "log", "a log long enough to be filtered", f"{len(W) / rate:.3g} s", "Record longer."
        )
    return chosen


def candidates(rate: float, samples: int, system: SecondOrderSystem) -> list[float]:
    """Candidate cut-offs [Hz], half an octave apart.

    At each, three of four folds give at least twice as many rows as parameters, and the filter is
    no longer than a fold.
    """
    duration = samples / rate
    lowest = max(2 * system.p / (3 * duration * system.n), 3.5 * _FOLDS / duration)
    return [float(c) for c in 2.0 ** np.arange(-5, 6, 0.5) if lowest <= c <= 0.1 * rate]


class _Windows:
    """Summed rows of W and mass matrices over short windows, to predict velocity changes.

    Args:
        system: the structure.
        log: N samples.
        W: (N−2, n, p) its rows of W·diag(scale).
        dt: time between samples [s].
    """

    def __init__(self, system: SecondOrderSystem, log: Log, W: Array, dt: float):
        self.width = window(log)
        count = len(W) // self.width
        whole = W[: count * self.width].reshape(count, self.width, *W.shape[1:])
        self.rows = whole.sum(axis=1) * dt
        self.start = np.arange(count) * self.width
        middle = self.start + self.width // 2 + 1
        x = np.hstack([log.q, log.v])[middle]
        self.columns = [
            system.W_M(x, np.broadcast_to(e, (count, system.n))) * system.space.scale
            for e in np.eye(system.n)
        ]

    def errors(self, theta_s: Array, first: int, last: int) -> Array:
        """(k, n) errors of the predicted changes of v, in windows within [first, last)."""
        inside = (self.start >= first) & (self.start + self.width <= last)
        M = np.stack([column[inside] @ theta_s for column in self.columns], axis=-1)
        return np.linalg.solve(M, (self.rows[inside] @ theta_s)[..., None])[..., 0]


def window(log: Log) -> int:
    """Number of samples, a power of two, in which v changes by about its standard deviation."""
    spread = np.maximum(log.v.std(axis=0), 1e-12)
    width = 1
    while width < len(log.t) // 40:
        change = (log.v[width:] - log.v[:-width]) / spread
        if np.mean(change**2) >= 0.5:
            break
        width *= 2
    return width
