"""All joints of an arm together with a weighed load, which determines the common scale.

If all masses of the model file are s times too large, every motion stays the same with kp, kv,
armature and friction s times too large. The file's arm therefore fits its logs, and a load of known
mass m acts on it as μ = m/s: μ and the load's place are fitted with the joints' own parameters to
all logs, free and loaded ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ...parameters import Array, Indices
from ..data import RobotModel
from ..payloads import Load, carrier, with_mass
from .fit import GRAVITY, SHIFTS, STEP, OutputError, Prior, minimise, undisturbed
from .logs import ServoLog, weighed, without_armature
from .simulation import simulate

_OWN = 5  # parameters of a joint
_UNSURE = 1.0  # standard deviation of ln s before the log
_REACH = 0.15  # of each coordinate of a load whose place is not known [m]
_SHIFT = 5e-3  # of central differences of the place [m]

_PLACES = 0.1 * np.array(
    [np.zeros(3), *np.eye(3), *-np.eye(3), *(1 - np.eye(3))]
)  # of 1 kg that tell what it does anywhere: its inertia is quadratic in its place [m]

Shift = Callable[[ServoLog], Array]


def _quadratic(place: Array) -> Array:
    """(..., 10) products of 1, x, y and z of places (..., 3), of degree two at most."""
    one = np.concatenate([np.ones_like(place[..., :1]), place], axis=-1)
    first, second = np.triu_indices(4)
    return np.asarray(one[..., first] * one[..., second], dtype=np.float64)


def _with_share(log: ServoLog, unit_loads: Sequence[ServoLog], shares: Array) -> ServoLog:
    """The log of an arm that carries shares (10,) [kg] of the unit loads."""
    alone, *others = unit_loads
    found = {}
    for name in ("load", "mass"):
        base = getattr(alone, name)
        found[name] = base + sum(
            share * (getattr(one, name) - base) for share, one in zip(shares, others, strict=True)
        )
    return log._replace(**found)


class Arm:
    """Simulations of all joints, each in units of its own residual.

    The parameters x are (n, 5) ln θ of the joints in a row, ln μ, and the load's place (3,) in the
    frame of the joint that carries it [m].

    Args:
        robot: the model.
        logs: free and loaded ones.
        load: of the loaded ones.
        sigma: (n,) robust rms of each joint's residual [rad or m].
        used: (N,) 1 of samples that count.
        motions: (N, n) simulated positions of each loaded log, at which it is weighed; None for the
            measured ones.
    """

    def __init__(
        self, robot: RobotModel, logs: Sequence[ServoLog], load: Load, sigma: Array, used: Array,
        motions: Sequence[Array] | None = None,
    ):  # fmt: skip
        self.joint = carrier(robot.model, load)[0]
        self._model, self._logs, self._motions = without_armature(robot.model), logs, motions
        self.sigma, self.used = sigma, np.tile(used, len(sigma))  # (n,), (n N,)
        own = np.concatenate([np.gradient(log.t) for log in logs])
        self.spacing: Array = np.tile(own, len(sigma))

    def logs(self, x: Array) -> Sequence[ServoLog]:
        """The logs, loaded ones with the loads that μ and the place in x make."""
        shares = np.exp(x[-4]) * np.linalg.solve(_quadratic(_PLACES).T, _quadratic(x[-3:]))
        own = iter(self._unit_loads)
        return [_with_share(log, next(own), shares) if log.loaded else log for log in self._logs]

    @cached_property
    def _unit_loads(self) -> list[list[ServoLog]]:
        """Each loaded log of the arm alone, and of the arm with 1 kg at every one of `_PLACES`."""
        models = [self._model, *(with_mass(self._model, self.joint, 1.0, at) for at in _PLACES)]
        logs = [log for log in self._logs if log.loaded]
        motions = self._motions or [None] * len(logs)
        return [
            [weighed(model, log, q) for model in models]
            for log, q in zip(logs, motions, strict=True)
        ]

    def positions(self, x: Array, shift: Shift = lambda log: log.target) -> list[Array]:
        """(N, n) simulated positions of every log [rad or m], with shifted targets (N, n)."""
        theta, found = np.exp(x[:-4]).reshape(-1, _OWN), []
        for log in self.logs(x):
            moved = log._replace(target=shift(log))
            each = ((moved.joint(j), own) for j, own in enumerate(theta))
            found.append(np.column_stack([simulate(joint, own) for joint, own in each]))
        return found

    def residual(self, x: Array, shift: Shift = lambda log: log.target) -> Array:
        """(n N,) residuals over `sigma`, joint after joint; with shifted targets (N, n)."""
        found = zip(self.positions(x, shift), self._logs, strict=True)
        apart = np.concatenate([q - log.position for q, log in found])
        return np.asarray(apart / self.sigma, dtype=np.float64).T.ravel()

    def moved(self, x: Array, zero: Array) -> Array:
        """(n N, 2 n) change of the residual by offsets `zero` (n,) of the targets, and by play."""
        blocks, before, g = [], self.residual(x), np.exp(x[GRAVITY:-4:_OWN])
        for shift in SHIFTS:
            change = self.residual(x, lambda log, own=shift: own(log, zero, g)) - before
            blocks.append(scipy.linalg.block_diag(*change.reshape(len(self.sigma), -1)).T)
        return np.hstack(blocks)

    def jacobian(self, x: Array, free: Indices) -> Array:
        """(n N, k) central differences; a joint's own parameters change its own rows alone."""
        n = len(self.sigma)
        count = len(self.used) // n
        columns = np.zeros((n, count, len(x)))
        for i in range(_OWN):
            own = np.arange(i, _OWN * n, _OWN)
            change = self._difference(x, own, STEP)
            columns[np.arange(n), :, own] = change
        for i in range(len(x) - 4, len(x)):
            step = STEP if i == len(x) - 4 else _SHIFT
            columns[:, :, i] = self._difference(x, np.array([i]), step)
        return columns.reshape(n * count, -1)[:, free]

    def _difference(self, x: Array, at: Indices, step: float) -> Array:
        """(n, N) change of the residuals by a step of some parameters, over it."""
        delta = np.zeros(len(x))
        delta[at] = step
        change = (self.residual(x + delta) - self.residual(x - delta)) / (2 * step)
        return change.reshape(len(self.sigma), -1)


class Weighed(NamedTuple):
    """An arm that was fitted with its load.

    Attributes:
        arm: the simulations at the minimum.
        fit: the minimiser and its residual, see `Arm`.
        prior: of its parameters.
        used: (N,) 1 of samples in use.
    """

    arm: Arm
    fit: OutputError
    prior: Prior
    used: Array

    def joint(self, j: int) -> tuple[OutputError, Prior]:
        """The fit of one joint [rad or m], without derivatives, and its prior."""
        own, sigma = slice(_OWN * j, _OWN * (j + 1)), self.arm.sigma[j]
        residual = self.fit.residual.reshape(len(self.arm.sigma), -1)[j] * sigma
        fit = OutputError(self.fit.x[own].copy(), residual, sigma, np.zeros((len(residual), 0)))
        return fit, Prior(self.prior.mean[own], self.prior.deviation[own])


def weigh(
    robot: RobotModel,
    logs: Sequence[ServoLog],
    load: Load,
    fits: Sequence[OutputError],
    priors: Sequence[Prior],
    used: Array,
) -> Weighed:
    """Fits all joints and the load to free and loaded logs.

    Args:
        robot: the model.
        logs: all, free ones with the loads of their simulated motion.
        load: of the loaded ones.
        fits: of the joints to the free logs.
        priors: of the joints' parameters.
        used: (N,) 1 of samples that count, of all logs.
    """
    _, centre, known = carrier(robot.model, load)
    mean = np.concatenate([p.mean for p in priors] + [[np.log(load.mass)], centre])
    place = np.full(3, 0.0 if known else _REACH)
    prior = Prior(mean, np.concatenate([p.deviation for p in priors] + [[_UNSURE], place]))
    x = np.concatenate([f.x for f in fits] + [mean[-4:]])
    sigma = np.array([f.sigma for f in fits])
    moved: list[Array] | None = None
    for last in (False, False, True):
        arm = Arm(robot, logs, load, sigma, used, moved)
        fit = minimise(arm, x, prior)
        if last:
            break
        found, x = arm.positions(fit.x), fit.x
        if moved is not None:  # before, the joints' effects on each other are missing
            for j, residual in enumerate(fit.residual.reshape(len(sigma), -1)):
                joint = [log.joint(j) for log in logs]
                used = used * undisturbed(joint, sigma[j] * residual, float(sigma[j]))
        moved = [q for q, log in zip(found, logs, strict=True) if log.loaded]
    return Weighed(arm, fit, prior, used)
