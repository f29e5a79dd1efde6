"""Output-error fit: parameters of the open-loop simulation closest to the log, and covariances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from scipy import stats

from ...core import Array, Indices
from .logs import ServoLog
from .simulation import NONE, Effects, JointLog, differentiated, simulate, with_play

DAMPING, FRICTION, GRAVITY, ARMATURE, DELAY = range(5)
"""Places of T, f, g, a and d in θ."""
_ROUNDS = 60  # of the fit
_ENOUGH = 0.005  # predicted decrease of the cost at which the fit ends: .07 deviations
# damping: T, a and d of an overdamped servo in slow motion trade along a curved valley, whose slope
# is below a thousandth of that of each alone
_LEAST = 1e-6
_SAME = 0.04  # change of ln θ at which the scale of the loss is that of the fit
_LONGEST = 1.0  # step of ln θ
EFFECTIVE = 1.5  # independent samples per second, since residuals of a simulation are correlated
PLAY = 2.0
"""Half the usual play of a servo's gears, over the deviation of its zero: makers of hobby servos
with steps of 1.5 mrad state up to 9 mrad of play, and fine encoders come with finer gears."""
_PULLS = 2.0  # play of simulated arms over what their residuals show of it, at most
_SURE_OF_PLAY = 3.0  # decrease of the cost by play over the dispersion, from which it is stated
_STEEPEST = 100.0  # [rad or m] by ln θ: a servo between both of its limits is chaotic
_WINDOW = 2.0  # in which external forces are detected [s]
_FAR = 6.0  # residual of such a window over the median one


class ServoPrior(NamedTuple):
    """Prior knowledge of the parameters."""

    mean: Array  # (k,) means of the parameters x, which are logarithms except for a place
    deviation: Array  # (k,) standard deviations; 0 of a parameter that is fixed

    @property
    def free(self) -> Indices:
        """Indices of the parameters that are fitted."""
        return np.flatnonzero(self.deviation > 0)


class Simulated(Protocol):
    """Open-loop simulations whose parameters are fitted."""

    used: Array  # (N,) 1 of samples that count, 0 of masked ones
    spacing: Array  # (N,) time that each sample stands for [s]
    unit: Array  # (n,) unit of the residuals of each joint [rad or m]

    def linear(self, x: Array, free: Indices) -> tuple[Array, Array]:
        """(N,) simulated minus measured position, and (N, k) derivatives by free parameters."""
        ...

    def moved(self, x: Array, zero: Array) -> Array:
        """(N, 7 n) change of the residual by what the equation lacks.

        First by offsets `zero` (n,) [rad or m] of the joints' targets. Then by backlash: a joint is
        displaced by `PLAY` times that in the direction of its load. Then by backlash at the three
        places of `_slack`, over half its width [rad or m]. Last by friction that is twice as large
        at rest, and by friction of the whole load: the two of `Effects`.
        """
        ...


_Of = TypeVar("_Of", bound=Simulated)


class OutputError(NamedTuple, Generic[_Of]):
    """A fit of simulations to logs."""

    of: _Of  # the simulations
    prior: ServoPrior
    x: Array  # (k,) minimiser; of a joint ln θ̂ of T [s], f [rad], g [rad/(N·m)], a [s²], d [s]
    residual: Array  # (N,) simulated minus measured position [rad or m], all logs in a row
    jacobian: Array  # (N, free) derivatives of the residual by the free parameters
    sigma: float  # robust rms of the residual [rad or m]; the loss is quadratic up to twice that

    def at(self, x: Array) -> OutputError[_Of]:
        """Simulations of these logs at other parameters than the fitted ones."""
        residual, jacobian = self.of.linear(x, self.prior.free)
        return self._replace(x=x, residual=residual, jacobian=jacobian)

    def cost(self) -> float:
        """Σ soft-L1(residual), and the prior's share."""
        size = 2 * self.sigma
        loss = 2 * size**2 * (np.sqrt(1 + (self.residual / size) ** 2) - 1)
        apart = (self.x - self.prior.mean) / np.maximum(self.prior.deviation, 1e-300)
        rows = weights(self.of, 0 * self.residual, self.sigma)
        return float(rows @ loss + np.sum(apart[self.prior.free] ** 2))


def _play(log: JointLog, zero: Array, g: Array) -> Array:
    """(N,) change of the target that moves a joint as play of `PLAY` times its `zero` does."""
    sunk = g * log.load / log.stiffer
    side = sunk / (np.abs(sunk) + zero / 4)  # friction holds a joint that hardly sinks
    return -PLAY * zero * (side - side.mean())  # a constant side is an offset


def _slack(log: JointLog, theta: Array, half: float) -> Array:
    """(N, 3) change of the encoder's position by play of 2 `half` in the gear, over `half`.

    Of a motor with an encoder that the play displaces its link beyond; of one whose play is between
    servo and encoder; of one within the loop, whose encoder is the servo's, behind the gear.
    """
    rigid, _ = with_play(log, theta, 0.0, behind=False)
    motor, link = with_play(log, theta, half, behind=False)
    _, within = with_play(log, theta, half, behind=True)
    return (np.column_stack([motor, link, within]) - rigid[:, None]) / half


class JointFit:
    """The simulation of one joint, in samples marked by used (N,), 1 or 0, with further effects."""

    def __init__(self, logs: Sequence[JointLog], used: Array, effects: Effects = NONE):
        self.logs = logs
        self.used = used
        self.effects = effects
        self.spacing = np.concatenate([np.gradient(log.t) for log in logs])
        self.unit = np.ones(1)

    def residual(self, x: Array) -> Array:
        """(N,) residual [rad or m] at (5,) ln θ."""
        theta = np.exp(x)
        own = self.effects
        return np.concatenate([simulate(log, theta, own) - log.position for log in self.logs])

    def moved(self, x: Array, zero: Array) -> Array:
        """(N, 7) change by an offset `zero` (1,) of the targets, by play, and by other friction."""
        theta = np.exp(x)
        changes = []
        for log in self.logs:
            before, slopes = differentiated(log, theta)
            friction = slopes[:, 5:] * [theta[FRICTION], 1.0]
            shifts = zero, _play(log, zero, theta[GRAVITY])
            own = [simulate(log._replace(target=log.target + u), theta) - before for u in shifts]
            play = _slack(log, theta, float(zero.item()))
            changes.append(np.column_stack([*own, play, friction]))
        return np.concatenate(changes)

    def linear(self, x: Array, free: Indices) -> tuple[Array, Array]:
        """(N,) residual and (N, k) derivatives by free ln θ, from 5 on by the effects."""
        theta = np.exp(x)
        found = [differentiated(log, theta, self.effects) for log in self.logs]
        residual = [q - log.position for (q, _), log in zip(found, self.logs, strict=True)]
        slopes = np.concatenate([slope for _, slope in found])[:, free]
        return np.concatenate(residual), np.clip(slopes, -_STEEPEST, _STEEPEST)


def minimise(of: _Of, x: Array, prior: ServoPrior) -> OutputError[_Of]:
    """Levenberg–Marquardt on Σ soft-L1(residual), each sample weighted by its share of the time.

    It starts from x (k,), of which `prior` is the prior.
    """
    x = np.where(prior.deviation > 0, x, prior.mean)
    fit = OutputError(of, prior, x, *of.linear(x, prior.free), 0.0)
    damping = _LEAST
    for _ in range(3):  # the scale of the loss follows the fit
        before = fit.x
        fit = fit._replace(sigma=_winsorised(fit.residual[of.used > 0]))
        fit, damping = _descend(fit, damping)
        if np.abs(fit.x - before).max() < _SAME:
            break
    return fit


def weights(simulated: Simulated, residual: Array, sigma: float) -> Array:
    """(N,) weights of squared residuals: independent samples over the robust variance."""
    rows = np.minimum(1.0, EFFECTIVE * simulated.spacing) * simulated.used
    return rows / sigma**2 / np.sqrt(1 + (residual / (2 * sigma)) ** 2)


def _descend(fit: OutputError[_Of], damping: float) -> tuple[OutputError[_Of], float]:
    """The minimum of the cost with the fit's scale of the loss, and the damping there."""
    free = fit.prior.free
    precision = fit.prior.deviation[free] ** -2.0
    value = fit.cost()
    for _ in range(_ROUNDS):
        weighted = fit.jacobian.T * weights(fit.of, fit.residual, fit.sigma)
        H = weighted @ fit.jacobian + np.diag(precision)
        slope = weighted @ fit.residual + precision * (fit.x - fit.prior.mean)[free]
        step = np.zeros(len(fit.x))
        step[free] = -np.linalg.solve(H + damping * np.diag(np.diag(H)), slope)
        if -slope @ step[free] < _ENOUGH:
            break
        trial = fit.at(fit.x + np.clip(step, -_LONGEST, _LONGEST))
        after = trial.cost()
        if after < value:
            fit = trial
            value = after
            damping = max(damping / 5, _LEAST)
        else:
            damping *= 10
    return fit, min(damping, 1.0)


def _winsorised(residual: Array) -> float:
    """Robust rms [rad or m]: residuals are clipped at twice its value."""
    size = np.abs(residual)
    sigma = float(np.sqrt(np.mean(size**2)))
    for _ in range(10):
        sigma = float(np.sqrt(np.mean(np.minimum(size, 2 * sigma) ** 2)))
    return max(sigma, 1e-6)


def _blocks(logs: Sequence[JointLog | ServoLog], length: float) -> Indices:
    """(N,) number of the block of time, of a length [s], of each sample, over all logs."""
    found = []
    count = 0
    for log in logs:
        own = ((log.t - log.t[0]) / length).astype(int) + count
        found.append(own)
        count = own[-1] + 1
    return np.concatenate(found)


def undisturbed(logs: Sequence[JointLog], residual: Array, sigma: float) -> Array:
    """(N,) 1, or 0 in windows whose residual is far above that of others with motion.

    Causes are, for example, a gripper that rests on a table or a hand that pushes the arm.
    """
    window = _blocks(logs, _WINDOW)
    count = np.bincount(window)
    rms = np.sqrt(np.bincount(window, residual**2) / np.maximum(count, 1))
    position = np.concatenate([log.position for log in logs])
    mean = np.bincount(window, position) / np.maximum(count, 1)
    travel = np.bincount(window, np.abs(position - mean[window])) / np.maximum(count, 1)
    moving = travel > sigma
    usual = np.median(rms[moving]) if moving.any() else np.inf
    return np.where(rms > max(_FAR * usual, 2 * sigma), 0.0, 1.0)[window]


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
    duration = sum(log.t[-1] - log.t[0] for log in logs)
    return _blocks(logs, max(_BLOCK, duration / _BLOCKS))


def zeros(logs: Sequence[ServoLog]) -> Array:
    """(n,) standard deviations of the zeros of targets against those of positions [rad or m].

    They are steps of the encoders, which truncate: small changes from sample to sample.
    """
    changes = np.abs(np.concatenate([np.diff(log.position, axis=0) for log in logs]))
    ticks = [np.quantile(own[own > 0], 0.05) if own.any() else np.inf for own in changes.T]
    return np.minimum(_TICKS * np.array(ticks), OFFSET)


_PRIOR_DEGREES = 4.0  # of freedom that the arm's common dispersion adds to a number's own
# of real logs, and the least where a residual is above the encoder's resolution: such a model error
# may be the same in all clusters
_DISPERSED = 10.0


class Spread(NamedTuple):
    """Uncertainty of k fitted parameters, by clusters of samples.

    Residuals of a simulation are correlated over seconds, and model errors persist throughout a
    log, so the variance between clusters is a multiple of that of independent samples: the
    dispersion. Few clusters tell it badly for one number, but servos of one arm are alike: the mean
    of all numbers counts as `_PRIOR_DEGREES` further degrees of freedom (Smyth, Statistical
    Applications in Genetics and Molecular Biology 3(1), 2004).
    """

    free: Indices  # (f,) indices of the fitted ones
    inverse: Array  # (f, f) inverse of all clusters' information and the prior's
    information: Array  # (G, f, f) information of every cluster
    scores: Array  # (G, f) slope of the cost of every cluster
    # (k, k) covariance that clusters do not tell: by the prior, the zeros, backlash within the loop
    # and the simulation's own accuracy
    rest: Array
    moved: Array  # (k, 7 n) change of the parameters by what the equation lacks: `Simulated.moved`
    size: Array  # (7 n,) of each of these that the residual shows
    gain: Array  # (7 n,) decrease of the cost by it
    without: Array  # (G, k) change of the parameters without each cluster, by a Gauss–Newton step
    common: float  # mean dispersion of all numbers of the arm, or the least for such residuals

    def own(self, direction: Array) -> tuple[float, float]:
        """Dispersion of a combination of the parameters (k,), and its degrees of freedom.

        If one log contains most of the information about it, these are fewer than clusters, and the
        log's residual is small as it was fitted to it: Satterthwaite's degrees and the expectation
        for equal dispersions correct for both (Bell and McCaffrey, Survey Methodology 28, 2002).
        """
        c = self.inverse @ direction[self.free]
        own = self.information @ c
        seen = own @ self.inverse
        M = np.diag(own @ c) - 2 * seen @ own.T
        M += seen @ self.information.sum(axis=0) @ seen.T
        M += M.mean() - M.mean(axis=0) - M.mean(axis=1)[:, None]
        expected = float(np.trace(M))
        if expected <= 1e-12 * (own @ c).sum():
            return 0.0, 0.0
        y = self.scores @ c
        return float(np.sum((y - y.mean()) ** 2)) / expected, expected**2 / float(np.sum(M**2))

    def dispersion(self, direction: Array) -> tuple[float, float]:
        """Dispersion of a combination, moderated by the common one, and degrees of freedom."""
        ratio, degrees = self.own(direction)
        total = degrees + _PRIOR_DEGREES
        return (degrees * ratio + _PRIOR_DEGREES * self.common) / total, total

    @property
    def play(self) -> tuple[int, float]:
        """Place, as in `_slack`, and width [rad or m] of a joint's play; 0 if none is certain."""
        place = int(np.argmax(self.gain[2:5]))
        certain = self.gain[2 + place] > _SURE_OF_PLAY * self.common
        return place, 2 * float(self.size[2 + place]) * certain

    @property
    def between(self) -> Array:
        """(k, k) covariance from differences between clusters."""
        k = len(self.rest)
        whole = np.zeros((k, k))
        independent = self.inverse @ self.information.sum(axis=0) @ self.inverse
        whole[np.ix_(self.free, self.free)] = independent
        deviations = np.sqrt([self.dispersion(one)[0] for one in np.eye(k)])
        return whole * np.outer(deviations, deviations)

    @property
    def covariance(self) -> Array:
        """(k, k) covariance of the parameters."""
        return self.between + self.rest

    def quantile(self, direction: Array) -> float:
        """Of Student's t, for the 95 % interval of a combination of the parameters (k,).

        More degrees of freedom where `rest` is a large part of the variance.
        """
        part = float(direction @ self.between @ direction)
        whole = part + float(direction @ self.rest @ direction)
        share = max(part, 1e-3 * whole) / max(whole, 1e-300)
        return float(stats.t.ppf(0.975, self.dispersion(direction)[1] / max(share, 1e-3) ** 2))


def spreads(
    fits: Sequence[OutputError], cluster: Indices, zero: Sequence[Array] | Array
) -> list[Spread]:
    """The uncertainty of fits of one arm, with offsets `zero` (n,) of the targets of each."""
    found = [_spread(fit, cluster, own) for fit, own in zip(fits, zero, strict=True)]
    own = np.array([s.own(one) for s in found for one in np.eye(len(s.rest))[s.free]])
    degrees = own[:, 1].sum()
    common = float(own[:, 0] @ own[:, 1] / degrees) if degrees else _DISPERSED
    return [_with_slack(one._replace(common=max(common, one.common))) for one in found]


def _spread(fit: OutputError, cluster: Indices, zero: Array) -> Spread:
    """Without backlash; `common` is the least of a residual above the encoder's resolution."""
    weight = weights(fit.of, fit.residual, fit.sigma)
    free = fit.prior.free
    P = np.diag(fit.prior.deviation[free] ** -2.0)
    weighted = fit.jacobian * weight[:, None]
    clusters = [cluster == k for k in range(int(cluster.max()) + 1)]
    information = np.array([weighted[own].T @ fit.jacobian[own] for own in clusters])
    scores = np.array([weighted[own].T @ fit.residual[own] for own in clusters])
    H = information.sum(axis=0) + P
    A = np.asarray(np.linalg.inv(H), dtype=np.float64)
    without = np.zeros((len(clusters), len(fit.x)))
    without[:, free] = np.linalg.solve(H - information, scores[..., None])[..., 0]
    effect = fit.of.moved(fit.x, zero)
    seen = weighted.T @ effect
    moved = np.zeros((len(fit.x), effect.shape[1]))
    moved[free] = A @ seen
    left = np.sum(effect**2 * weight[:, None], axis=0) - np.sum(seen * moved[free], axis=0)
    size = -(weight * fit.residual) @ effect / np.maximum(left, 1e-300)
    most = np.r_[np.tile(PLAY * zero, 3), np.ones(2 * len(zero))]
    size[2 * len(zero) :] = np.clip(size[2 * len(zero) :], 0.0, most)
    by_zero = moved[:, : len(zero)]
    rest = by_zero @ by_zero.T
    rest[np.ix_(free, free)] += A @ P @ A + _NUMERICAL**2 * np.eye(len(free))
    steps = zero / _TICKS / np.sqrt(12)  # rms of an encoder's error, or less
    unexplained = 1 - np.minimum(steps / (fit.sigma * fit.of.unit), 1.0) ** 2
    # blocks of a residual that is the encoder's steps agree better than `EFFECTIVE` samples do, but
    # the simulation is not exact to that
    least = max(_DISPERSED * float(unexplained.mean()), 1.0)
    return Spread(free, A, information, scores, rest, moved, size, size**2 * left, without, least)


def _with_slack(spread: Spread) -> Spread:
    """With the change of the parameters by what each joint's residual shows of play and friction.

    Play is at that place of `_slack` which lowers the cost most. As any further number lowers it by
    the dispersion, that share of its square is not counted.
    """
    n = spread.moved.shape[1] // 7
    places = np.arange(2 * n, 5 * n).reshape(3, n)
    play = places[np.argmax(spread.gain[places], axis=0), np.arange(n)]
    at = np.r_[play, 5 * n : 7 * n]
    shown = np.maximum(1 - spread.common / np.maximum(spread.gain[at], 1e-300), 0.0)
    pulls = np.repeat([_PULLS, 1.0, 1.0], n)
    slack = pulls * spread.moved[:, at] * spread.size[at] * np.sqrt(shown)
    return spread._replace(rest=spread.rest + slack @ slack.T)
