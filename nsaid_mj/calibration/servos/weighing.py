"""Joint fit of an arm and a weighed payload, which determines the common scale.

If all masses of the model file are s times too large, the motion is the same with kp, kv, armature
and friction s times too large. The file's arm therefore fits the free logs, and a payload of known
mass m is identified as μ = m/s: μ and the payload's position are fitted with the joints' parameters
to all logs, free and loaded.
"""

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from ...parameters import Array, Indices
from ...robot.model import RobotModel
from ..payloads import Load, carrier, with_mass
from .fit import STEP, JointFit, OutputError, Prior, minimise, undisturbed
from .joint_fits import Fitted
from .logs import ServoLog, ServoLogs, coupled, weighed, without_armature

_OWN = 5  # parameters of a joint
_UNSURE = 1.0  # standard deviation of ln s before the log
_REACH = 0.15  # of each coordinate of a load whose place is not known [m]
_SHIFT = 5e-3  # of central differences of the place [m]

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
    not include accelerations; sigma (n,) are robust rms of the joints' residuals [rad or m], and
    used (N,) is 1 of samples that count.
    """

    def __init__(
        self, robot: RobotModel, logs: Sequence[ServoLog], load: Load, sigma: Array, used: Array
    ):
        self.joint, alone = carrier(robot.model, load)[0], without_armature(robot.model)
        models = [alone, *(with_mass(alone, self.joint, 1.0, at) for at in _PLACES)]
        self._logs = [[weighed(m, log) for m in models] if log.loaded else [log] for log in logs]
        self.sigma, self.used = sigma, np.tile(used, len(sigma))  # (n,), (n N,)
        own = np.concatenate([np.gradient(log.t) for log in logs])
        self.spacing: Array = np.tile(own, len(sigma))

    def logs(self, x: Array) -> list[ServoLog]:
        """The logs, loaded ones with the loads that μ and the place in x make."""
        shares = np.exp(x[-4]) * np.linalg.solve(_quadratic(_PLACES).T, _quadratic(x[-3:]))
        return [_with_share(log, own, shares) if own else log for log, *own in self._logs]

    def residual(self, x: Array) -> Array:
        """(n N,) residuals over `sigma`, joint after joint."""
        return self._residual(x, self.logs(x))

    def _residual(self, x: Array, logs: Sequence[ServoLog]) -> Array:
        theta = np.exp(x[:-4]).reshape(-1, _OWN)
        apart = np.concatenate([coupled(log, theta)[0] - log.position for log in logs])
        return np.asarray(apart / self.sigma, dtype=np.float64).T.ravel()

    def joints(self, x: Array) -> list[tuple[JointFit, Array]]:
        """Every joint's simulation with the loads that the others' motion exerts, and its ln θ."""
        own = x[:-4].reshape(-1, _OWN)
        logs = [coupled(log, np.exp(own))[1] for log in self.logs(x)]
        used = self.used.reshape(len(own), -1)[0]
        return [(JointFit([log.joint(j) for log in logs], used), of) for j, of in enumerate(own)]

    def moved(self, x: Array, zero: Array) -> Array:
        """(n N, 2 n) change of the residual by offsets `zero` (n,) of the targets, and by play."""
        each = zip(self.joints(x), zero, self.sigma, strict=True)
        found = [joint.moved(own, one) / sigma for (joint, own), one, sigma in each]
        shifts = np.stack(found).transpose(2, 0, 1)[..., None]  # (2, n, N, 1)
        return np.hstack([_blocks(own) for own in shifts])

    def jacobian(self, x: Array, free: Indices) -> Array:
        """(n N, k) central differences; a joint's own parameters change its own rows alone."""
        every = np.arange(_OWN)
        own = [
            joint.jacobian(theta, every) / sigma
            for (joint, theta), sigma in zip(self.joints(x), self.sigma, strict=True)
        ]
        columns = [_blocks(own)]
        for i, step in zip(range(len(x) - 4, len(x)), (STEP, *3 * (_SHIFT,)), strict=True):
            sides = []
            for y in (x.copy(), x.copy()):
                y[i] += step * (1 - 2 * len(sides))
                sides.append(self._residual(y, [log for log in self.logs(y) if log.loaded]))
            change = ((sides[0] - sides[1]) / (2 * step)).reshape(len(self.sigma), -1)
            alone = len(own[0]) - change.shape[1]  # samples without the load come first
            columns.append(np.pad(change, ((0, 0), (alone, 0))).reshape(-1, 1))
        return np.hstack(columns)[:, free]


def weigh(given: ServoLogs, fitted: Fitted) -> tuple[OutputError[Arm], Array]:
    """Fits all joints and the payload to free and loaded logs, again without external forces.

    `fitted` are the joints' fits to the free logs. Also returns (N,) 1 of samples in use.
    """
    load, logs = given.load, [log._replace(limit=fitted.logs[0].limit) for log in given.logs]
    assert load is not None
    rest = np.ones(sum(len(log.t) for log in logs) - len(fitted.used))
    used = np.append(fitted.used, rest)
    _, centre, known = carrier(given.robot.model, load)
    mean = np.concatenate([f.prior.mean for f in fitted.fits] + [[np.log(load.mass)], centre])
    place = np.full(3, 0.0 if known else _REACH)
    spread = np.concatenate([f.prior.deviation for f in fitted.fits] + [[_UNSURE], place])
    x, prior = np.concatenate([f.x for f in fitted.fits] + [mean[-4:]]), Prior(mean, spread)
    sigma = np.array([f.sigma for f in fitted.fits])
    arm = Arm(given.robot, logs, load, sigma, used)
    fit, rest = minimise(arm, x, prior), used
    for j, residual in enumerate(fit.residual.reshape(len(sigma), -1)):
        joint = [log.joint(j) for log in logs]
        rest = rest * undisturbed(joint, sigma[j] * residual, float(sigma[j]))
    if not np.array_equal(rest, used):
        arm.used = np.tile(rest, len(sigma))
        fit = minimise(arm, fit.x, prior)
    return fit, rest
