"""Fits of all joints of a servo arm to its logs, and windows with external forces.

Logs without a load come first. If all masses of the model file are s times too large, the motion is
the same with kp, kv, armature and friction s times too large. The file's arm therefore fits the
free logs, and a payload of known mass m is identified as μ = m/s: μ and the payload's position are
fitted with the joints' parameters to all logs, free and loaded.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from scipy import optimize

from ...core import Array, Indices
from ...robots import RobotModel
from ..identify.links import carrier, with_mass
from ..identify.loads import Load
from ..logs import signals
from .fit import (
    ARMATURE,
    DAMPING,
    DELAY,
    JointFit,
    OutputError,
    ServoPrior,
    minimise,
    undisturbed,
    weights,
)
from .logs import ServoLog, ServoLogs, coupled, settled, weighed, without_armature
from .simulation import JointLog

_DELAY = 0.015  # before the log [s]
_SPREAD = np.array([3.0, 3.0, 3.0, 2.5, 1.5])
# standard deviations of ln θ before the log: T, f and g nearly free; a within a factor of 130 of
# that of a critically damped servo, T²/4, and delays of serial buses within 20
_ALIKE = np.array([1.0, 3.0, 3.0, 2.5, 0.5])
# the same about T and d that the joints have in common, within factors of 7 and 2.7
_SWEEPS = 8  # at most, over all joints, with the loads of the others' simulated motion
_SETTLED = 0.2  # change of that motion, over the residual, at which they end
_LOWER = 0.97  # largest robust residual with a limit of force over that without, to accept it
_CUT = 5.0  # of the start's filter on both sides [Hz]
_MOVING = 0.05  # slower samples stick, where friction has no sign [rad/s]
_SMOOTH = 0.02  # s of tanh(v/s) [rad/s]
_DELAYS = np.arange(0.005, 0.125, 0.01)  # tried [s]
_ROUNDS = 5  # of reweighting
LEAST = (1e-3, 1e-5, 1e-6, 1e-6)
"""Of T, f, g, a: a logarithm needs more than 0."""


class JointFits(NamedTuple):
    """Fits of every joint to the free logs."""

    logs: list[ServoLog]  # with the loads of their simulated motion
    fits: list[OutputError[JointFit]]  # of every joint
    used: Array  # (N,) 1 of samples in use

    def simulated(self, j: int) -> JointFit:
        """The simulation of a joint."""
        return JointFit([log.joint(j) for log in self.logs], self.used)

    def refitted(self, logs: list[ServoLog]) -> JointFits:
        """Fits to the logs with other loads or limits."""
        found = self._replace(logs=logs)
        fits = [minimise(found.simulated(j), fit.x, fit.prior) for j, fit in enumerate(self.fits)]
        return found._replace(fits=fits)


def fit_free(logs: list[ServoLog], limits: Array, report: Callable[[str], None]) -> JointFits:
    """Fits of all joints to the free logs, without windows of external forces.

    limits (n,) of the servos' forces [N·m or N] are inf, or those of the model file, which apply
    where the logs show them.
    """
    report("fitting every servo alone")
    found = JointFits(logs, [], settled(logs))
    for j in range(len(limits)):
        own = found.simulated(j)
        found.fits.append(minimise(own, *alone(own.logs)))
    used = found.used
    for j, fit in enumerate(found.fits):
        counted = found.used * fit.residual
        used = used * undisturbed(found.simulated(j).logs, counted, fit.sigma)
    report("fitting all servos together, without external forces")
    found = _together(logs, _alike(found._replace(used=used)))
    # model files state limits that the servo does not have, so a limit must lower the residual
    limited = found._replace(logs=[log._replace(limit=limits) for log in found.logs])
    shown = np.full(len(limits), np.inf)
    for j, fit in enumerate(found.fits):
        own = limited.simulated(j)
        if np.isinf(limits[j]) or np.array_equal(own.residual(fit.x), fit.residual):
            continue
        if minimise(own, fit.x, fit.prior).sigma < _LOWER * fit.sigma:
            shown[j] = limits[j]
    if np.isfinite(shown).any():
        found = _together([log._replace(limit=shown) for log in logs], found)
    return found


def alone(logs: Sequence[JointLog]) -> tuple[Array, ServoPrior]:
    """(5,) initial ln θ, and the uninformative prior of a joint."""
    first = np.log(start(logs))
    return first, ServoPrior(np.r_[first[:3], _critical(first[0]), np.log(_DELAY)], _SPREAD)


def _alike(found: JointFits) -> JointFits:
    """Priors of T, a and d about the joints' common values.

    Slow motion determines only the sum of a joint's T and d, so the other joints serve as prior:
    servos of one arm are alike, and one bus carries their targets.
    """
    at = np.array([DAMPING, DELAY])
    x = np.array([fit.x[at] for fit in found.fits])
    variances = np.empty_like(x)
    for j, fit in enumerate(found.fits):
        rows = weights(found.simulated(j), fit.residual, fit.sigma)
        H = (fit.jacobian.T * rows) @ fit.jacobian + np.diag(fit.prior.deviation**-2.0)
        variances[j] = np.diag(np.linalg.inv(H))[at]
    weight = 1 / (_ALIKE[at] ** 2 + variances)
    (T, d), deviation = np.average(x, axis=0, weights=weight), _ALIKE.copy()
    deviation[at] = np.sqrt(_ALIKE[at] ** 2 + 1 / weight.sum(axis=0))  # the mean is uncertain, too
    fits = []
    for fit in found.fits:
        mean = fit.prior.mean.copy()
        mean[[DAMPING, ARMATURE, DELAY]] = T, _critical(T), d
        fits.append(fit._replace(prior=ServoPrior(mean, deviation)))
    return found._replace(fits=fits)


def _critical(T: float) -> float:
    """ln a of a critically damped servo, T²/4, from ln T."""
    return 2 * T - float(np.log(4))


def _together(logs: Sequence[ServoLog], found: JointFits) -> JointFits:
    """The fits with the loads of all joints' simulated motion, until that settles.

    The logs are without the loads of accelerations; `found` are fits to start from.
    """
    before = np.inf
    for _ in range(_SWEEPS):
        theta = np.exp([fit.x for fit in found.fits])
        moved, exerting = zip(*(coupled(log, theta) for log in logs), strict=True)
        now = np.concatenate(moved)
        change = np.sqrt(np.mean((now - before) ** 2, axis=0))
        if np.all(change < [_SETTLED * fit.sigma for fit in found.fits]):
            break
        before = now
        found = found.refitted(list(exerting))
    return found


def start(logs: Sequence[JointLog]) -> Array:
    """(5,) θ by robust non-negative regression of u(t − d) − q on q̇, sgn q̇, Γ + M_jj q̈ and q̈.

    Velocity and acceleration are derivatives of the low-passed position; the target is low-passed
    alike. The delay is the one with the least residual. The logs are those of one joint, not empty.
    """
    best = np.inf
    found = np.array([0.1, 0.01, 0.1, 2e-3, 0.015])
    moving = [_Moving(log) for log in logs]
    A = np.concatenate([part.columns for part in moving])
    if len(A) < 20:
        return found
    for delay in _DELAYS:
        y = np.concatenate([part.left(delay) for part in moving])
        theta, error = _robust(A, y)
        if error < best:
            best = error
            found = np.r_[np.maximum(theta, LEAST), delay]
    return found


class _Moving:
    """The samples of a log that move, on an even grid; `columns` are (N, 4) at these samples."""

    def __init__(self, log: JointLog):
        step = float(np.median(np.diff(log.t)))
        cut = min(0.8, 2 * _CUT * step)
        t = np.arange(log.t[0], log.t[-1], step)
        self._t = t if len(t) >= 20 else t[:0]
        self.columns = np.zeros((0, 4))
        if not len(self._t):
            return
        held = log.target[np.searchsorted(log.t, t, side="right") - 1]
        self._u = signals.low_pass(held, cut)
        self._q = signals.low_pass(np.interp(t, log.t, log.position), cut)
        v = np.gradient(self._q, step)
        acceleration = np.gradient(v, step)
        gravity, inertia = (np.interp(t, log.t, x) for x in (log.load, log.inertia))
        load = gravity + inertia * acceleration
        self._used = np.abs(v) > _MOVING
        every = np.column_stack([v, np.tanh(v / _SMOOTH), load, acceleration])
        self.columns = every[self._used] / log.stiffer

    def left(self, delay: float) -> Array:
        """(N,) left sides u(t − d) − q, for a delay d [s]."""
        if not len(self._t):
            return np.zeros(0)
        u = np.interp(self._t - delay, self._t, self._u)
        return np.asarray((u - self._q)[self._used], dtype=np.float64)


def _robust(A: Array, y: Array) -> tuple[Array, float]:
    """(4,) non-negative coefficients by reweighting of absolute residuals, and their mean."""
    weight = np.ones(len(y))
    theta = np.zeros(4)
    error = np.inf
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        theta = optimize.nnls(A / size * root[:, None], y * root)[0] / size
        residual = np.abs(y - A @ theta)
        error = float(residual.mean())
        weight = 1 / np.maximum(residual, 0.1 * error + 1e-12)
    return theta, error


_OWN = 5  # parameters of a joint
_UNSURE = 1.0  # standard deviation of ln s before the log
_REACH = 0.15  # of each coordinate of a load whose place is not known [m]
_LIGHTER = 0.04  # of central differences of ln μ
_SHIFT = 5e-3  # and of the place [m]

_PLACES = 0.1 * np.array(
    [np.zeros(3), *np.eye(3), *-np.eye(3), *(1 - np.eye(3))]
)  # of 1 kg that tell what it does anywhere: its inertia is quadratic in its place [m]


def _quadratic(place: Array) -> Array:
    """(..., 10) products of 1, x, y and z of places (..., 3), of degree two at most."""
    one = np.concatenate([np.ones_like(place[..., :1]), place], axis=-1)
    first, second = np.triu_indices(4)
    return np.asarray(one[..., first] * one[..., second], dtype=np.float64)


def _with_share(alone: ServoLog, others: Sequence[ServoLog], shares: Array) -> ServoLog:
    """The log of an arm that carries shares (10,) [kg] of the unit loads of other logs."""
    found = {}
    for name in ("load", "mass"):
        base = getattr(alone, name)
        found[name] = base + sum(
            share * (getattr(one, name) - base) for share, one in zip(shares, others, strict=True)
        )
    return alone._replace(**found)


def _blocks(parts: Sequence[Array]) -> Array:
    return np.asarray(scipy.linalg.block_diag(*parts), dtype=np.float64)


class Arm:
    """Simulations of all joints together, each in units of its own residual.

    The parameters x are (n, 5) ln θ of the joints in a row, ln μ, and the load's place (3,) in the
    frame of the joint that carries it [m]. The logs are free, then loaded ones, with loads that do
    not include accelerations; unit (n,) are robust rms of the joints' residuals [rad or m], and
    used (N,) is 1 of samples that count.
    """

    def __init__(
        self, robot: RobotModel, logs: Sequence[ServoLog], load: Load, unit: Array, used: Array
    ):
        self.joint, alone = carrier(robot.model, load)[0], without_armature(robot.model)
        models = [alone, *(with_mass(alone, self.joint, 1.0, at) for at in _PLACES)]
        self._logs = [[weighed(m, log) for m in models] if log.loaded else [log] for log in logs]
        self.unit, self.used = unit, np.tile(used, len(unit))  # (n,), (n N,)
        own = np.concatenate([np.gradient(log.t) for log in logs])
        self.spacing: Array = np.tile(own, len(unit))

    def logs(self, x: Array) -> list[ServoLog]:
        """The logs, loaded ones with the loads that μ and the place in x make."""
        shares = np.exp(x[-4]) * np.linalg.solve(_quadratic(_PLACES).T, _quadratic(x[-3:]))
        return [_with_share(log, own, shares) if own else log for log, *own in self._logs]

    def _residual(self, x: Array, logs: Sequence[ServoLog]) -> Array:
        theta = np.exp(x[:-4]).reshape(-1, _OWN)
        apart = np.concatenate([coupled(log, theta)[0] - log.position for log in logs])
        return np.asarray(apart / self.unit, dtype=np.float64).T.ravel()

    def joints(self, x: Array) -> list[tuple[JointFit, Array]]:
        """Every joint's simulation with the loads that the others' motion exerts, and its ln θ."""
        own = x[:-4].reshape(-1, _OWN)
        logs = [coupled(log, np.exp(own))[1] for log in self.logs(x)]
        used = self.used.reshape(len(own), -1)[0]
        return [(JointFit([log.joint(j) for log in logs], used), of) for j, of in enumerate(own)]

    def moved(self, x: Array, zero: Array) -> Array:
        """(n N, 7 n) change of the residual by offsets `zero` (n,) of the targets, and by play."""
        each = zip(self.joints(x), zero, self.unit, strict=True)
        found = [joint.moved(own, one) / unit for (joint, own), one, unit in each]
        shifts = np.stack(found).transpose(2, 0, 1)[..., None]  # (7, n, N, 1)
        return np.hstack([_blocks(own) for own in shifts])

    def linear(self, x: Array, free: Indices) -> tuple[Array, Array]:
        """(n N,) residuals over `unit`, joint after joint, and (n N, k) derivatives.

        A joint's own parameters change its own rows alone; those of the load are differentiated by
        central differences.
        """
        every = np.arange(_OWN)
        own = [
            joint.linear(theta, every)[1] / unit
            for (joint, theta), unit in zip(self.joints(x), self.unit, strict=True)
        ]
        columns = [_blocks(own)]
        for i, step in zip(range(len(x) - 4, len(x)), (_LIGHTER, *3 * (_SHIFT,)), strict=True):
            sides = []
            for y in (x.copy(), x.copy()):
                y[i] += step * (1 - 2 * len(sides))
                sides.append(self._residual(y, [log for log in self.logs(y) if log.loaded]))
            change = ((sides[0] - sides[1]) / (2 * step)).reshape(len(self.unit), -1)
            alone = len(own[0]) - change.shape[1]  # samples without the load come first
            columns.append(np.pad(change, ((0, 0), (alone, 0))).reshape(-1, 1))
        return self._residual(x, self.logs(x)), np.hstack(columns)[:, free]


def weigh(given: ServoLogs, fitted: JointFits) -> tuple[OutputError[Arm], Array]:
    """Fits all joints and the payload to free and loaded logs, again without external forces.

    `fitted` are the joints' fits to the free logs. Also returns (N,) 1 of samples in use.
    """
    load = given.load
    logs = [log._replace(limit=fitted.logs[0].limit) for log in given.logs]
    assert load is not None
    used = settled(logs)
    used[: len(fitted.used)] = fitted.used
    _, centre, known = carrier(given.robot.model, load)
    mean = np.concatenate([f.prior.mean for f in fitted.fits] + [[np.log(load.mass)], centre])
    place = np.full(3, 0.0 if known else _REACH)
    spread = np.concatenate([f.prior.deviation for f in fitted.fits] + [[_UNSURE], place])
    x = np.concatenate([f.x for f in fitted.fits] + [mean[-4:]])
    prior = ServoPrior(mean, spread)
    sigma = np.array([f.sigma for f in fitted.fits])
    arm = Arm(given.robot, logs, load, sigma, used)
    fit = minimise(arm, x, prior)
    rest = used
    for j, residual in enumerate(fit.residual.reshape(len(sigma), -1)):
        joint = [log.joint(j) for log in logs]
        rest = rest * undisturbed(joint, used * sigma[j] * residual, float(sigma[j]))
    if not np.array_equal(rest, used):
        arm.used = np.tile(rest, len(sigma))
        fit = minimise(arm, fit.x, prior)
    return fit, rest
