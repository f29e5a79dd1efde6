"""Batch least squares: ordinary (OLS), filtered and reweighted (WLS), and total (TLS).

All regressors, rows of W θ = 0 (13), are those of θ/scale. A log contains no information on the
common scale of θ; the prior fixes it: Σ k_i/scale_i over the actuator gains keeps its value.
Unobserved directions keep the prior's values: of all minimisers, the methods return the one nearest
to the prior in θ/scale.
"""

import numpy as np
import scipy.linalg

from ...base import InvalidInput, NoEstimate
from ...core import Array, Log, LowPass, Nullspace, Posterior, Quotient, SecondOrderSystem
from .base import MethodEstimate, Problem


def low_passed(W: Array, rate: float, cutoff: float) -> Array:
    """(K, n, p) rows of W (N, n, p), low-pass filtered and decimated to 4·cutoff [Hz].

    The filter is a symmetric FIR filter with half amplitude at the cut-off; rows where it would
    extend beyond the data are dropped.
    """
    return LowPass(cutoff, rate).every(max(1, int(rate / (4 * cutoff))), W)


def central_rows(system: SecondOrderSystem, log: Log) -> Array:
    """(N−2, n, p) W(t, x, v, v̇, u)·diag(scale) of (10) at the inner samples.

    v̇ is the central difference of the measured velocities: the mean acceleration over the two time
    steps next to a sample. F is therefore averaged over the two commands held during these steps;
    a misalignment of half a time step would increase the error several hundred times.

    Raises:
        InvalidInput: the log has fewer than three samples.
    """
    t, q, v, u = log
    if len(t) < 3:
        raise InvalidInput("log", "at least 3 samples", len(t), "Record longer.")
    before = t[1:-1] - t[:-2]
    after = t[2:] - t[1:-1]
    both = (before + after)[:, None]
    here = t[1:-1]
    x = np.hstack([q, v])[1:-1]
    w = v[1:-1]
    a = (v[2:] - v[:-2]) / both
    share = (before[:, None] / both)[:, :, None]
    W = system.regressor(here, x, w, a, u[:-2])
    W *= share
    W += (1 - share) * system.regressor(here, x, w, a, u[1:-1])
    W *= system.space.scale
    return W


def condense(W: Array) -> Array:
    """(n, p, p) triangular R_i with ‖R_i θ‖ = ‖W_i θ‖ for every velocity i of W (N, n, p)."""
    N, _, p = W.shape
    if p > N:
        W = np.concatenate([W, np.zeros((p - N, *W.shape[1:]))])
    return np.stack([np.linalg.qr(W[:, i], mode="r") for i in range(W.shape[1])])


class Gauge:
    """Fixes the free scale and the unobserved directions of θ by the prior.

    Attributes:
        scale: (p,) scale of θ.
        start: (p,) the prior over the scale.
        normal: (p,) 1 at actuator gains, else 0; estimates keep normal · θ/scale.
        tangent: (p, p−1) orthonormal basis of the directions that keep it.
    """

    def __init__(self, system: SecondOrderSystem, prior: Array):
        self.scale = system.space.scale
        self.start = prior / self.scale
        normal = np.zeros((system.p, 1))
        normal[system.space.actuators] = 1.0
        self.normal = normal[:, 0]
        self.tangent = scipy.linalg.null_space(normal.T)  # (p, p−1)

    def solve(self, rows: Array) -> Array:
        """(p,) the minimiser θ/scale of ‖rows·θ/scale‖ that is nearest to the prior.

        `rows` (N, p) are of W·diag(scale); singular values below `TOLERANCE` of the largest count
        as 0.
        """
        target = -rows @ self.start
        y = np.linalg.lstsq(rows @ self.tangent, target, rcond=Nullspace.TOLERANCE)[0]
        return self.start + self.tangent @ y


SMOOTHING = 30.0  # cut-off of the filter on q and v [Hz]
_FOLDS = 4  # of the cross-validation, contiguous in time
_LIMITS = {"steps": 12, "halvings": 8, "done": 0.0, "fall": 1e-2, "reach": np.inf}
_IDLE = 1e-9  # ratio of actuator columns to row below which the velocity is not actuated


def ordinary(problem: Problem) -> MethodEstimate:
    """Least squares on raw central differences: min ‖W θ‖² with equal weights."""
    gauge = Gauge(problem.system, problem.prior)
    factors = condense(central_rows(problem.system, problem.log))
    return MethodEstimate(gauge.scale * gauge.solve(factors.reshape(-1, problem.system.p)))


def weighted(gauge: Gauge, W: Array) -> Array:
    """(p,) θ/scale of iteratively reweighted least squares, with residuals in units of command.

    The residual r_i of velocity i is W_i θ over the rms of its actuator forces under θ, so that
    shrinking a gain does not reduce it. Weights follow from the residuals themselves: this is the
    maximum-likelihood estimate under Gaussian noise of unknown variance in every velocity, the
    minimum of N Σ_i log‖r_i‖ + ½ ‖θ_s − θ̂_s(0)‖². The second term is a prior of standard deviation
    1 in θ/scale; it regularises poorly excited directions. W (N, n, p) holds rows of W·diag(scale).
    """
    factors = condense(W)
    forces = factors * gauge.normal  # actuator columns only
    driven = np.linalg.norm(forces, axis=(1, 2)) > _IDLE * np.linalg.norm(factors, axis=(1, 2))
    forces[~driven] = 0.0
    gramian, effort = (part.transpose(0, 2, 1) @ part for part in (factors, forces))
    counts = np.full(len(driven), float(len(W)))
    quotient = Quotient(gramian, effort, counts, np.where(driven, 0.0, 1.0))
    force = np.sqrt(quotient.efforts(gauge.start))
    start = gauge.solve((factors / force[:, None, None]).reshape(-1, W.shape[2]))
    J = Posterior(quotient, _Near(gauge.start))
    return J.minimised(start, gauge.tangent, **_LIMITS)[0]


class _Near:
    """½ ‖θ − θ̂(0)‖² from `start`, θ̂(0) (p,), without a cone: no step is too long."""

    def __init__(self, start: Array):
        self.start = start

    def value(self, theta: Array) -> float:
        """The cost at θ (p,)."""
        return 0.5 * float(np.sum((theta - self.start) ** 2))

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """(p,) gradient and (p, p) Hessian."""
        return theta - self.start, np.eye(len(theta))

    def length(self, theta: Array, step: Array) -> float:
        """1 for any step (p,) at θ (p,)."""
        return 1.0


def practitioners(problem: Problem) -> MethodEstimate:
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
    return MethodEstimate(gauge.scale * theta_s, f"cut-off {cutoff:.3g} Hz")


def filtered(problem: Problem) -> tuple[Array, float, float]:
    """(N, n, p) rows of W·diag(scale) of the smoothed log, their rate and the chosen cut-off [Hz].

    Raises:
        InvalidInput: the log is too short for any cut-off.
    """
    rate = 1 / problem.log.step
    log = problem.system.smoothed(problem.log, SMOOTHING)
    W = central_rows(problem.system, log)
    return W, rate, choose_cutoff(problem, log, W, rate)


def choose_cutoff(problem: Problem, log: Log, W: Array, rate: float) -> float:
    """The cut-off [Hz] whose estimates best predict velocity changes in held-out data.

    The log of N samples is smoothed, and W (N−2, n, p) holds its rows of W·diag(scale). It is split
    into contiguous folds. An estimate from all folds but one predicts the changes
    of v over short windows of the remaining one, with error M̂⁻¹ Σ W θ̂ dt. As Σ v̇ dt is the
    difference of two velocities, its noise does not depend on the candidate; a residual of W θ̂
    would favour estimates that are biased towards zero by noisy regressors. The score is the sum
    over velocities of the log of the mean squared error, the likelihood of Gaussian errors of
    unknown variance.

    Raises:
        InvalidInput: the log is too short for any cut-off.
    """
    system = problem.system
    gauge = Gauge(system, problem.prior)
    windows = _Windows(system, log, W, 1 / rate)
    best = np.inf
    chosen = 0.0
    for cutoff in candidates(rate, len(W), system):
        half = int(np.ceil(1.5 * rate / cutoff))
        errors = []
        for k in range(_FOLDS):
            first = k * len(W) // _FOLDS
            last = (k + 1) * len(W) // _FOLDS
            seen = [part for part in (W[:first], W[last:]) if len(part) > 2 * half]
            theta_s = weighted(gauge, np.concatenate([low_passed(p, rate, cutoff) for p in seen]))
            errors.append(windows.errors(theta_s, first, last))
        score = float(np.sum(np.log(np.mean(np.concatenate(errors) ** 2, axis=0) + 1e-300)))
        if score < best:
            best = score
            chosen = cutoff
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

    `W` (N−2, n, p) are a log's rows of W·diag(scale), at intervals of dt [s].
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


def total(problem: Problem) -> MethodEstimate:
    """θ/scale along the smallest right singular vector of W·diag(scale).

    This is consistent only if the noise of all columns has the same variance, which does not hold
    here. W is filtered as in `least_squares.practitioners`, with the same choice of the cut-off,
    and the rows of each velocity are scaled to the same norm. Unobserved directions are excluded;
    they keep the prior's values.

    Raises:
        InvalidInput: the log is too short for any cut-off.
        NoEstimate: the actuator gains of the vector sum to 0.
    """
    W, rate, cutoff = filtered(problem)
    gauge = Gauge(problem.system, problem.prior)
    factors = condense(low_passed(W, rate, cutoff))
    factors /= np.linalg.norm(factors, axis=(1, 2), keepdims=True)
    _, s, Vt = np.linalg.svd(factors.reshape(-1, problem.system.p))
    seen = int(np.count_nonzero(s > Nullspace.TOLERANCE * s[0]))
    shortest = Vt[seen - 1]
    unseen = Vt[seen:]
    rest = unseen.T @ (unseen @ gauge.start)
    gains = gauge.normal @ shortest
    if not abs(gains) > Nullspace.TOLERANCE:
        raise NoEstimate("the gains in the smallest singular vector sum to 0", "Record longer.")
    theta_s = rest + shortest * (gauge.normal @ (gauge.start - rest)) / gains
    return MethodEstimate(gauge.scale * theta_s, f"cut-off {cutoff:.3g} Hz")
