"""Logs that have what those of real arms have, for tests and `scripts/calibration.py`.

`Simulated`: MuJoCo moves an arm with hidden gains (± 30 %), frictions and inertias (± 20 %). The
commands are recorded in A with a quantised current, load-dependent friction and a constant offset
are added to them, they precede the motion by 15 ms, rows come at 500 Hz with jittered times and one
gap, and positions alone are measured. `nominal_model` is the model file, its inertias off.

`HeavyWrist`: inverse dynamics move an arm along random multisines. Its links are up to 25 % off the
file's, each by its own factor; the friction of the last three joints is 20 times a fifth of the
torque that the file's links need, that of the others once; rotors are a third of the joints'
inertia, or thrice it at a wrist. Currents are quantised, 10 ms early, and their constants unknown;
positions have noise.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.core import JointTree
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.arm import true_model
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.model import RobotModel

Array = np.ndarray


def _rms(values: Array) -> Array:
    return np.sqrt(np.mean(values**2, axis=0))


def _write(path: Path, joints: Sequence[str], t: Array, q: Array, u: Array) -> Path:
    """Writes times (N,), positions (N, n) and currents (N, n) as CSV."""
    names = [f"{joint}_{what}" for what in ("position", "current") for joint in joints]
    table = np.column_stack([t, q, u])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *names]), comments="")
    return path


class Simulated:
    """A log of an arm with its hidden gains, by MuJoCo.

    Args:
        name: of the scenario.
        seed: of plant, motion and noise.
        duration: [s].
        plain: leave out everything but noise.
        rate: rows per second.
    """

    delay, jitter = 0.015, 2e-4  # [s]

    def __init__(
        self, name: str, seed: int, duration: float, plain: bool = False, rate: float = 500.0
    ):
        self.setup = Setup.of(replace(load(name), duration=duration, seed=seed, sensors="ideal"))
        with self.setup.plant.running():
            log = self.setup.simulate()
        rng, true, t = np.random.default_rng([seed, 13]), self.setup.plant.truth, log.t
        model = true_model(self.setup.system.model, true)
        n, names = model.nv, [str(joint) for joint in list(model.names)[1:]]
        force = true[self.setup.system.space["motor gain"]] * log.u  # torque of the motors
        constant = rng.uniform(0.7, 1.3, n) * _rms(force) / 5.0  # N·m/A: about 5 A
        if not plain:
            data = model.createData()
            weight = np.array([pin.computeGeneralizedGravity(model, data, q) for q in log.q])
            force = force + 0.05 * np.tanh(log.v / 0.02) * np.abs(weight)
            force = force + 0.02 * _rms(force) * rng.uniform(-1, 1, n)
        current = force / constant
        times = t[0] + np.arange(0, t[-1] - t[0], 1 / rate)
        jitter, delay, keep = 0.0, 0.0, np.ones(len(times), dtype=bool)
        if not plain:
            current = np.round(current / 0.004) * 0.004
            jitter, delay = self.jitter * rng.uniform(-1, 1, len(times)), self.delay
            keep[int(0.4 * len(times)) : int(0.4 * len(times) + 1.5 * rate)] = False
        angles = np.unwrap(self.setup.system.angles(log.q), axis=0)
        q = np.column_stack([np.interp(times + jitter, t, angle) for angle in angles.T])
        q = q + 1e-4 * rng.standard_normal(q.shape)
        held = np.clip(np.searchsorted(t, times + delay, side="right") - 1, 0, len(t) - 1)
        arm = [j for j, joint in enumerate(names) if "finger" not in joint]  # they are locked
        self.t, self.q, self.u = (
            (times + jitter)[keep],
            q[keep][:, arm],
            current[held][keep][:, arm],
        )
        self.gain, self.joints = constant[arm], [names[j] for j in arm]

    def write(self, path: Path, **changes: Array) -> Path:
        """Writes the log as CSV; `changes` may replace q or u."""
        return _write(path, self.joints, self.t, **{"q": self.q, "u": self.u} | changes)


def nominal_model(simulated: Simulated, seed: int) -> RobotModel:
    """The model file's robot, its inertias off by up to 20 % from the plant's."""
    robot = load_robot_model(simulated.setup.scenario.plant.robot, joints=simulated.joints)
    rng = np.random.default_rng([seed, 14])
    for i in range(1, robot.model.njoints):
        phi = (1 + 0.2 * rng.uniform(-1, 1)) * robot.model.inertias[i].toDynamicParameters()
        robot.model.inertias[i] = pin.Inertia.FromDynamicParameters(phi)
    return robot


# -- wrists of much friction -----------------------------------------------------------------------

RATE, DELAY, NOISE, STEPS = 250.0, 0.010, 5e-5, 4000  # Hz, s, rad, steps of the largest current
OFF, WRIST = 0.25, 20.0  # of links' inertias; of the friction of the last three joints


class Motion:
    """A random multisine of all joints: 0.1 to 0.8 Hz, inside their ranges and speeds."""

    def __init__(self, model: pin.Model, rng: np.random.Generator):
        low, high = (
            np.array([limit[j.idx_q] if j.nq == 1 else end for j in list(model.joints)[1:]])
            for limit, end in ((model.lowerPositionLimit, -2.0), (model.upperPositionLimit, 2.0))
        )
        low, high = np.maximum(low, -2.0), np.minimum(high, 2.0)
        self._centre = (low + high) / 2
        self._rate = 2 * np.pi * 0.1 * np.arange(1, 9)
        waves = rng.standard_normal((2, 8, model.nv)) / np.arange(1, 9)[:, None]
        t = np.arange(0, 10, 0.01)
        q, v = self._sum(waves, t, 0), self._sum(waves, t, 1)
        most = 0.6 * np.minimum(model.velocityLimit, 3.0)
        size = np.maximum(np.abs(q).max(0) / (0.45 * (high - low)), np.abs(v).max(0) / most)
        self._waves = waves / size

    def _sum(self, waves: Array, t: Array, order: int) -> Array:
        phase = t[:, None] * self._rate + order * np.pi / 2
        rate = self._rate**order
        return (np.cos(phase) * rate) @ waves[0] + (np.sin(phase) * rate) @ waves[1]

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """(N, n) angles, velocities and accelerations."""
        q, v, a = (self._sum(self._waves, t, order) for order in range(3))
        return q + self._centre, v, a


class HeavyWrist:
    """A log of an arm that differs from its file.

    Args:
        name: of the robot.
        seed: of links, joints, motion and noise.
        duration: [s].
    """

    def __init__(self, name: str, seed: int, duration: float):
        joints = load_robot_model(name).joints
        fingers = [j for j in joints if "finger" in j.lower() or "gripper" in j.lower()]
        self.robot = load_robot_model(name, lock=fingers)
        rng = np.random.default_rng([seed, 21])
        model, n = self.robot.model, len(self.robot.joints)
        self.true = true = pin.Model(model)
        for i in range(1, true.njoints):
            phi = (1 + OFF * rng.uniform(-1, 1)) * model.inertias[i].toDynamicParameters()
            true.inertias[i] = pin.Inertia.FromDynamicParameters(phi)
        self.t = np.arange(round(duration * RATE)) / RATE
        motion = Motion(model, rng)
        q, v, a = motion.at(self.t + DELAY)
        wrist = np.arange(n) >= n - 3
        share = 0.2 * _rms(_torques(model, q, v, a)) * np.where(wrist, WRIST, 1.0)
        viscous = share * rng.uniform(0.5, 1.5, n) / _rms(v)
        coulomb = share * rng.uniform(0.5, 1.5, n)
        data, poses = true.createData(), JointTree.links(true).position(q[::250])
        inertia = np.mean([np.diag(pin.crba(true, data, pose)) for pose in poses], axis=0)
        rotor = inertia * np.where(wrist, 3.0, 0.3) * rng.uniform(0.5, 1.5, n)
        self._joint = rotor, viscous, coulomb
        force = self._force(q, v, a)
        self.gain = rng.uniform(0.5, 2.0, n) * _rms(force) / 3.0
        self._record(motion, force, rng)

    def _force(self, q: Array, v: Array, a: Array) -> Array:
        rotor, viscous, coulomb = self._joint
        return _torques(self.true, q, v, a) + (
            rotor * a + viscous * v + coulomb * np.tanh(v / 0.02)
        )

    def _record(self, motion: Motion, force: Array, rng: np.random.Generator) -> None:
        u = force / self.gain
        self.u = np.round(u * STEPS / np.abs(u).max(axis=0)) * np.abs(u).max(axis=0) / STEPS
        q = motion.at(self.t)[0]
        self.q = q + NOISE * rng.standard_normal(q.shape)

    def loaded(self, seed: int, mass: float, centre: Array) -> HeavyWrist:
        """Another log of the same arm, with a small ball fixed to its last link.

        Args:
            seed: of motion and noise.
            mass: of the ball [kg].
            centre: (3,) of the ball in the frame of the last joint [m].
        """
        other, rng = copy.copy(self), np.random.default_rng([seed, 22])
        motion = Motion(self.robot.model, rng)
        other.true = pin.Model(self.true)
        ball = pin.Inertia.FromSphere(mass, 0.03)
        other.true.inertias[other.true.njoints - 1] += pin.Inertia(mass, centre, ball.inertia)
        other._record(motion, other._force(*motion.at(self.t + DELAY)), rng)
        return other

    def write(self, path: Path) -> Path:
        """Writes the log as CSV."""
        return _write(path, self.robot.joints, self.t, self.q, self.u)


def _torques(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """(N, n) torques of inertia and weight."""
    data = model.createData()
    rows = zip(JointTree.links(model).position(q), v, a, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows])
