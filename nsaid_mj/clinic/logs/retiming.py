"""The clock of a log of a tree of joints without velocities, told by the model's inertia.

Weight does not depend on the clock, inertial forces do by its square. Links may differ from those
of the model file as files usually do, so that wrong masses are not taken for a wrong clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy

from ...base import pin
from ...core import Array
from ...robots import RobotModel
from .evidence import DELAYS, EXACT, LogMotion, columns_of, driven_joints, late, thinned

_LINKS = 0.25  # relative standard deviation of a file's link parameters
_NOISE = 0.2  # of a command in a row, over its deviation, against which links are bent
_CLOCKS = np.array([0.1, 0.2, 0.33, 0.5, 0.6, 0.72, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0, 3.0, 5.0, 10.0])
_WRONG = 1.25  # factor of a clock from which inertias of a file do not explain it
_FAR = 1.5  # factor between clocks that are far from each other
_BETTER = 0.95  # ratio of errors from which another clock speaks against the log's own
_FALLS = 0.8  # ratio of errors above which a clock is not told
_ALIKE = 1.05  # such a ratio to the log's own clock up to which another one fits as well
_FITS = 0.15  # error on another clock from which that does not explain the commands either
_FLAT = 1.2  # ratio of errors on neighbouring clocks below which the best one is not determined
_BESIDE = 1.5  # factor between such clocks
_TOLD = 0.2  # product of the joints' ratios of errors below which a clock is certain


class Retimed(NamedTuple):
    """The number by which all times of a log are to be multiplied, and what speaks for it."""

    scale: float
    error: float  # of the commands on that clock, geometric mean of the joints
    plain: float  # on the log's own
    alike: tuple[float, float]  # least and largest factor of clocks on which they fit as well
    beside: float  # on a clock beside the best one, whichever fits better
    joints: int  # with a motor

    @property
    def told(self) -> bool:
        """Whether the log's own clock is wrong."""
        ratio = self.error / self.plain
        apart = abs(np.log(self.scale)) > np.log(_WRONG)
        certain = ratio < _FALLS and ratio**self.joints < _TOLD and self.error < _FITS
        return bool(certain and apart and self.beside > _FLAT * self.error)

    @property
    def loose(self) -> bool:
        """Whether clocks far from the log's own fit as well: inertia hardly acts."""
        return self.alike[0] * _FAR < 1 or self.alike[1] > _FAR

    @property
    def doubted(self) -> bool:
        """Whether one of them fits better. Without anything against it, a clock is right."""
        return self.loose and self.error < _BETTER * self.plain


class BentLinks:
    """The commands' errors under the model's links, of parameters that may be off by a quarter.

    `gravity` is another than the model's, in the base's axes; None for that.
    """

    def __init__(self, robot: RobotModel, motion: LogMotion, gravity: Array | None = None):
        self._rows, few = thinned(motion)
        self._motion = motion
        self._few = few
        self.joints = driven_joints(robot, motion)
        model = pin.Model(robot.model)
        if gravity is not None:
            model.gravity = pin.Motion(gravity, np.zeros(3))
        links = [inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]]
        self._links = np.concatenate(links)
        self._spread = _LINKS * np.concatenate([_sizes(link) for link in links])
        data = model.createData()
        still = np.zeros(model.nv)
        own = zip(robot.system.position(few.q), few.v, few.a, strict=True)
        pairs = [
            # of a single joint it is a vector
            [
                np.atleast_2d(pin.computeJointTorqueRegressor(model, data, q, *rates).copy())
                for rates in each
            ]
            for q, each in ((q, ((still, still), (v, a))) for q, v, a in own)
        ]
        weight, whole = np.swapaxes(np.array(pairs), 0, 1)  # (N, n, 10 b)
        self._forces = {
            j: _Forces.of(weight[use, j], (whole - weight)[use, j], own[use])
            for j, use, own in (
                (j, few.usable[:, j], np.column_stack(columns_of(few, j))) for j in self.joints
            )
        }

    def error(self, scale: float = 1.0) -> float:
        """The geometric mean of the joints' errors, with all times multiplied by a number."""
        errors = [max(self._of_joint(j, scale), EXACT) for j in self.joints]
        return float(np.exp(np.mean(np.log(errors))))

    def _of_joint(self, j: int, scale: float) -> float:
        """The least error of a joint's command, of either sign and any delay."""
        basis, weight, inertia, own = self._forces[j]
        W = weight + inertia / scale**2
        columns = np.column_stack([W @ self._links, own])
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        columns = columns / size
        directions, strength, _ = np.linalg.svd(W * self._spread / size[0], full_matrices=False)
        slower = replace(self._motion, rate=self._motion.rate / scale)
        best = 1.0
        for delay in DELAYS:
            y = late(slower, j, delay, self._rows[self._few.usable[:, j]])
            y = y - y.mean()
            y = y / max(float(np.linalg.norm(y)), 1e-300)
            explicable = basis.T @ y
            beyond = max(1 - float(explicable @ explicable), 0.0)
            for u in (explicable, -explicable):
                force = scipy.optimize.nnls(columns, u)[0][0]
                bent = force * strength * np.sqrt(len(y)) / _NOISE
                shrink = 1 / np.sqrt(1 + bent**2) - 1

                def unbent(x: Array, shrink: Array = shrink) -> Array:
                    along = directions.T @ x
                    return np.asarray(x + directions @ (shrink * along.T).T)

                error = scipy.optimize.nnls(unbent(columns), unbent(u))[1]
                best = min(best, float(np.hypot(error, np.sqrt(beyond))))
        return best


class _Forces(NamedTuple):
    """A joint's forces in rows without their means, in a basis of all that they may be.

    Attributes:
        basis: (N, r) orthonormal columns.
        weight: (r, 10 b) of a unit of each parameter of the links.
        inertia: (r, 10 b).
        own: (r, 3) of rotor and friction.
    """

    basis: Array
    weight: Array
    inertia: Array
    own: Array

    @staticmethod
    def of(weight: Array, inertia: Array, own: Array) -> _Forces:
        """Of regressors (N, 10 b), and columns (N, 3) of rotor and friction."""
        parts = [weight, inertia, own]
        rows = np.column_stack(parts)
        rows = rows - rows.mean(axis=0)
        basis = np.linalg.qr(rows[:, np.any(rows != 0, axis=0)])[0]
        ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        return _Forces(basis, *np.split(basis.T @ rows, ends, axis=1))


def retimed(links: BentLinks) -> Retimed:
    """The clock on which the commands fit best, beside the log's own."""
    errors = [links.error(float(scale)) for scale in _CLOCKS]
    best = int(np.argmin(errors))
    grid = np.log(_CLOCKS)
    around = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    found = scipy.optimize.minimize_scalar(
        lambda x: links.error(float(np.exp(x))), bounds=around, options={"maxiter": 12}
    )
    plain = errors[_CLOCKS.tolist().index(1.0)]
    alike = _CLOCKS[np.array(errors) <= _ALIKE * plain]
    ends = float(alike.min()), float(alike.max())
    scale = float(np.exp(found.x))
    beside = min(links.error(scale * _BESIDE), links.error(scale / _BESIDE))
    return Retimed(scale, float(found.fun), plain, ends, beside, len(links.joints))


def _sizes(link: Sequence[float]) -> Array:
    """(10,) sizes of a link's mass, first moments and inertias."""
    moments = float(np.linalg.norm(link[1:4]))
    inertia = link[4] + link[6] + link[9]  # xx, xy, yy, xz, yz, zz
    return np.array([link[0], *[moments] * 3, *[inertia] * 6])
