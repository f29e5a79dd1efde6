"""Drawn twins of what users' logs hold, by inverse dynamics: gentle motion, loads, and rests.

A twin is a robot, logs of it as columns of a table, and its true parameters. The motion is a sum
of sines whose rms speed is drawn; links, rotors and friction are drawn about the model file's;
currents and positions have noise; what else the robot does is in the arguments.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.ndimage import uniform_filter1d

from nsaid_mj.core import JointTree
from nsaid_mj.robots.model import RobotModel
from tests.support.robot_logs import write_csv

Array = np.ndarray
_RATE = 200.0  # rows per second
_COULOMB_SPEED = 0.02  # [rad/s]


@dataclass(frozen=True)
class Weight:
    """A payload on a body.

    Attributes:
        mass: [kg].
        joint: number of the joint that moves the body, from 1.
        place: its centre in the frame of that joint [m].
    """

    mass: float
    joint: int
    place: tuple[float, float, float]


@dataclass(frozen=True)
class Twin:
    """A robot that differs from its model file as real ones do, and its logs.

    Attributes:
        robot: the model file.
        seed: of links, friction, gains.
        off: largest relative error of the file's links, each of its own.
        speed: rms speed of every joint in its logs [rad/s].
        fastest: highest frequency of the motion [Hz].
        noise: of the currents, over their rms.
        coloured: noise of the currents that lasts some tenths of a second, over their rms.
        step: of the encoders [rad].
        delay: of the motion after the command [s].
        spring: of the joints [N·m/rad], over the weight's torque per radian.
        force: further torque on the joints by position and velocity (N, n), of (N, n) typical ones.
    """

    robot: RobotModel
    seed: int
    off: float = 0.15
    speed: float = 0.5
    fastest: float = 1.0
    noise: float = 0.01
    coloured: float = 0.0
    step: float = 1e-4
    delay: float = 0.01
    force: Callable[[Array, Array], Array] | None = None
    parameters: dict[str, Array] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        rng = np.random.default_rng([self.seed, 31])
        model, n = self.robot.model, len(self.robot.joints)
        shares = 1 + self.off * rng.uniform(-1, 1, n)
        friction = rng.uniform(0.5, 1.5, (3, n)) * np.array([[0.15], [0.2], [0.02]])
        q, v, a = self._motion(np.arange(0, 20, 0.05), 0)
        true = pin.Model(model)
        for i in range(1, true.njoints):
            phi = shares[i - 1] * model.inertias[i].toDynamicParameters()
            true.inertias[i] = pin.Inertia.FromDynamicParameters(phi)
        force = np.sqrt(np.mean(_torques(true, q, v, a) ** 2, axis=0))
        force = np.maximum(force, 0.05 * force.max())
        data = true.createData()
        inertia = [
            np.diag(pin.crba(true, data, x)) for x in JointTree.links(true).position(q[::20])
        ]
        viscous, coulomb, _ = friction * force
        gain = rng.uniform(0.5, 2.0, n) * force / 5.0
        rotor = np.mean(inertia, axis=0) * rng.uniform(0.2, 1.0, n)
        own = {
            "gain": gain,
            "rotor": rotor,
            "viscous": viscous,
            "coulomb": coulomb,
            "typical": force,
        }
        self.parameters.update(own)
        object.__setattr__(self, "_true", true)

    @property
    def true(self) -> dict[str, float]:
        """The true parameters by name."""
        kinds = ("gain", "rotor", "viscous", "coulomb")
        n = len(self.robot.joints)
        return {f"{k}_{j + 1}": float(self.parameters[k][j]) for k in kinds for j in range(n)}

    def _motion(self, t: Array, number: int) -> tuple[Array, Array, Array]:
        """(N, n) positions, velocities and accelerations of the log of a number at times (N,)."""
        model, n = self.robot.model, len(self.robot.joints)
        rng = np.random.default_rng([self.seed, 32, number])
        rates = 2 * np.pi * rng.uniform(0.1, self.fastest, (6, n))
        phases = rng.uniform(0, 2 * np.pi, (6, n))
        size = rng.uniform(0.3, 1.0, (6, n)) / rates
        size *= self.speed * np.sqrt(2) / np.sqrt(np.sum((size * rates) ** 2, axis=0))
        ends = [np.asarray(e) for e in (model.lowerPositionLimit, model.upperPositionLimit)]
        finite = model.nq == n and np.isfinite(ends).all()
        middle = 0.5 * (ends[0] + ends[1]) if finite else np.zeros(n)
        angle = t[:, None, None] * rates + phases
        q = middle + np.sum(size * np.sin(angle), axis=1)
        v = np.sum(size * rates * np.cos(angle), axis=1)
        return q, v, -np.sum(size * rates**2 * np.sin(angle), axis=1)

    def log(
        self,
        number: int = 0,
        duration: float = 20.0,
        weight: Weight | None = None,
        moved: Mapping[int, float] | None = None,
    ) -> dict[str, Array]:
        """The columns of a log, of a number that draws motion and noise; `weight` is carried.

        `moved` gives the size of the motion of some joints, by number from 0; others have 1.
        """
        rng = np.random.default_rng([self.seed, 33, number])
        t = np.arange(round(duration * _RATE)) / _RATE
        model = pin.Model(self._true)  # type: ignore[attr-defined]
        if weight is not None:
            ball = pin.Inertia.FromSphere(weight.mass, 0.03)
            place = np.array(weight.place)
            model.inertias[weight.joint] += pin.Inertia(weight.mass, place, ball.inertia)
        own = self.parameters

        size = np.ones(len(self.robot.joints))
        for j, share in (moved or {}).items():
            size[j] = share
        q, v, a = (size * x for x in self._motion(t + self.delay, number))
        force = _torques(model, q, v, a) + own["rotor"] * a + own["viscous"] * v
        force += own["coulomb"] * np.tanh(v / _COULOMB_SPEED)
        if self.force is not None:
            force += self.force(q, v) * own["typical"]
        typical = own["typical"]
        force += self.noise * typical * rng.standard_normal(force.shape)
        slow = uniform_filter1d(rng.standard_normal(force.shape), round(0.2 * _RATE), axis=0)
        force += self.coloured * typical * slow / slow.std(axis=0)
        q = size * self._motion(t, number)[0] + 0.3 * self.step * rng.standard_normal(force.shape)
        found = {"time": t}
        for j, name in enumerate(self.robot.joints):
            found[f"{name}_position"] = np.round(q[:, j] / self.step) * self.step
            found[f"{name}_current"] = force[:, j] / own["gain"][j]
        return found

    def write(self, path: Path, **options: object) -> Path:
        """Writes the log that `log` makes as CSV."""
        return write_csv(path, self.log(**options))  # type: ignore[arg-type]


def _torques(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """(N, n) torques of inertia and weight."""
    data = model.createData()
    rows = zip(JointTree.links(model).position(q), v, a, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows])


def healthy(robot: RobotModel, seed: int) -> Twin:
    """A twin that is what its model file says but for its numbers, with gentle motion."""
    rng = np.random.default_rng([seed, 34])
    return Twin(
        robot,
        seed,
        speed=float(np.exp(rng.uniform(*np.log([0.1, 1.0])))),
        fastest=float(rng.uniform(0.3, 1.5)),
        noise=float(np.exp(rng.uniform(*np.log([0.003, 0.1])))),
        coloured=float(np.exp(rng.uniform(*np.log([0.003, 0.1])))),
        step=float(np.exp(rng.uniform(*np.log([2e-5, 2e-3])))),
    )
