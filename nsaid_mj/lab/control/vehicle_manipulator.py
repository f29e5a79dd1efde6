"""Vehicles with an arm: the base swims or hovers while the arm tracks a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...base import Positive, PositiveShare, config
from ...core import Array
from ..fields import Tones
from .driver import Driver, DriverConfig, Feedback, tree
from .multisine import pushes

if TYPE_CHECKING:
    from ...core import JointTree, SecondOrderSystem
    from .signals import FourierTrajectory, Multisine


@config
class SwimAndReach(DriverConfig):
    """Every thruster plays a multisine; the joints track a Fourier trajectory based on the prior.

    Attributes:
        low: lowest frequency of the thrusters' commands [Hz].
        high: highest frequency of the thrusters' commands [Hz].
        tones: number of sines in each thruster's command.
        amplitude: bound on each thruster's command.
        fundamental: frequency of the joints' first harmonic [Hz].
        harmonics: number of harmonics of the joints' trajectory.
        reach: share of each joint's range that the trajectory uses, in (0, 1].
        speed: peak speed of every joint [rad/s or m/s].
        bandwidth: bandwidth of the joints' tracking loop [Hz].
    """

    low: Positive = 0.05
    high: Positive = 0.5
    tones: Tones = 8
    amplitude: PositiveShare = 0.8
    fundamental: Positive = 0.05
    harmonics: Tones = 10
    reach: PositiveShare = 0.8
    speed: Positive = 1.5
    bandwidth: Positive = 2.0

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless an underwater vehicle carries an arm."""
        from .signals import FourierTrajectory, Multisine

        remedy = "Use MultisineCommand or FourierTracking."
        arm = tree(system, "an underwater vehicle with an arm", remedy, "thruster")
        count = len(arm.joints)
        omega = 2 * np.pi * self.bandwidth
        signal = Multisine(arm.n_u - count, self.low, self.high, self.tones, self.amplitude, rng)
        path = FourierTrajectory.within(self, arm, rng)

        def begin() -> tuple[Array, Array]:
            position, rate, _ = path(0.0)
            return np.r_[np.zeros(6), position], np.r_[np.zeros(6), rate]

        def command(t: float, q: Array, v: Array) -> Array:
            thrust = signal(t)
            position, rate, acceleration = path(t)
            free = arm.evaluate_at(t, q, v, np.r_[np.zeros(count), thrust], v, prior).a
            M = arm.mass_matrix(np.concatenate([q, v]), prior)
            error = arm.joint_errors(q, position)
            desired = acceleration + 2 * omega * (rate - v[6:]) + omega**2 * error
            # the joints' accelerations are those without motors plus (M⁻¹)_jj τ
            torque = np.linalg.solve(np.linalg.inv(M)[6:, 6:], desired - free[6:])
            return np.r_[np.clip(torque / prior[arm.space["motor gain"]], -1, 1), thrust]

        return Feedback(begin, command)


@config
class HoverAndReach(DriverConfig):
    """The base of a flying arm and its joints follow Fourier trajectories.

    Computed torque based on the prior with integral action, plus a multisine on every rotor.

    Attributes:
        travel: bound on the base's displacement along each axis [m].
        turn: bound on the base's heading [rad].
        fundamental: frequency of the first harmonic of base and joints [Hz].
        harmonics: number of harmonics.
        reach: share of each joint's range that the trajectory uses, in (0, 1].
        speed: peak speed of every joint [rad/s or m/s].
        dither: bound on each rotor's multisine, as a share of full thrust.
        low: lowest frequency of the dither [Hz].
        high: highest frequency of the dither [Hz].
        tones: number of sines in each rotor's dither.
        position_bandwidth: bandwidth of the base's position loop [Hz].
        attitude_bandwidth: bandwidth of the base's attitude loop and of the joints' loops [Hz].
    """

    travel: Positive = 0.6
    turn: Positive = 0.6
    fundamental: Positive = 0.1
    harmonics: Tones = 4
    reach: PositiveShare = 0.8
    speed: Positive = 3.0
    dither: PositiveShare = 0.1
    low: Positive = 0.5
    high: Positive = 3.0
    tones: Tones = 8
    position_bandwidth: Positive = 0.3
    attitude_bandwidth: Positive = 2.0

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless the system is a flying arm."""
        from .signals import FourierTrajectory, Multisine

        arm = tree(system, "a flying arm", "Use another driver.", "rotor")
        bound = np.r_[np.full(3, self.travel), self.turn]
        path = FourierTrajectory.within(self, arm, rng, bound)
        rotors = arm.n_u - len(arm.joints)
        dither = Multisine(rotors, self.low, self.high, self.tones, self.dither, rng)
        return _HoverAndReach(self, arm, prior, path, dither)


class _HoverAndReach(Driver):
    """Minimum-norm commands for desired accelerations of height, attitude and joints.

    A rotor's input is u², its thrust as a share of full thrust.
    """

    def __init__(
        self,
        config: HoverAndReach,
        system: JointTree,
        prior: Array,
        path: FourierTrajectory,
        dither: Multisine,
    ):
        self._system = system
        self._prior = prior
        self._path = path
        self._dither = dither
        self._place = 2 * np.pi * config.position_bandwidth
        self._turn = 2 * np.pi * config.attitude_bandwidth
        self._rows = np.arange(2, system.n)  # height, attitude, joints: all but x and y
        self._g = float(np.linalg.norm(system.model.gravity.linear))
        self._inputs = pushes(system, prior)  # of a rotor per unit of u²
        self.start()

    def start(self) -> tuple[Array, Array]:
        from ...core import quaternion_of, unrotate

        self._then = 0.0
        self._integral = np.zeros(self._system.n)  # of position, attitude and joint errors
        position, rate, _ = self._path(0.0)
        level = np.r_[position[:3], 0.0, 0.0, position[3], position[4:]]
        twist = np.r_[unrotate(quaternion_of(level[3:6]), rate[:3]), 0.0, 0.0, rate[3]]
        return level, np.r_[twist, rate[4:]]

    def command(self, t: float, q: Array, v: Array) -> Array:
        system = self._system
        prior = self._prior
        rest = np.zeros(system.n_u)
        free = system.evaluate_at(t, q, v, rest, v, prior).a
        M = system.mass_matrix(np.concatenate([q, v]), prior)
        effect = np.linalg.solve(M, self._inputs)[self._rows]
        rest[len(system.joints) :] = self._dither(t)
        missing = (self._desired(t, q, v) - free)[self._rows] - effect @ rest
        push = rest + effect.T @ np.linalg.solve(effect @ effect.T, missing)
        push[len(system.joints) :] = np.sqrt(np.clip(push[len(system.joints) :], 0.01, 1.0))
        return push

    def _desired(self, t: float, q: Array, v: Array) -> Array:
        """(n,) desired accelerations: feedforward plus PID feedback; updates the integrals."""
        from ...core import rotate, unrotate

        step = t - self._then
        self._then = t
        position, rate, acceleration = self._path(t)
        error = np.empty(self._system.n)
        integral = self._integral
        error[:3] = position[:3] - q[:3]
        a = acceleration[:3]
        w = self._place
        slip = rate[:3] - rotate(q[3:7], v[:3])
        pull = a + 2 * w * slip + w**2 * error[:3] + 0.3 * w**3 * integral[:3]
        pull[2] += self._g
        error[3:6] = self._attitude_error(q[3:7], pull, position[3])
        error[6:] = self._system.joint_errors(q, position[4:])
        integral += step * error
        desired = np.zeros(self._system.n)
        w = self._turn
        pull[2] -= self._g
        desired[:3] = unrotate(q[3:7], pull) - np.cross(v[3:6], v[:3])
        moving = np.r_[0.0, 0.0, rate[3], rate[4:]] - v[3:]
        desired[3:] = 2 * w * moving + w**2 * error[3:] + 0.3 * w**3 * integral[3:]
        desired[6:] += acceleration[4:]
        return desired

    def _attitude_error(self, attitude: Array, pull: Array, heading: float) -> Array:
        """(3,) rotation vector, in body axes [rad], to the attitude of a heading, z along `pull`.

        The attitude is a quaternion x, y, z, w; `pull` (3,) the desired specific force, world
        [m/s²].
        """
        from ...core import product, quaternion_of, rotation_vector

        z = pull / np.linalg.norm(pull)
        z[2] = max(z[2], 0.5)  # at most 60° of tilt
        z /= np.linalg.norm(z)
        tilt = np.array([-z[1], z[0], 0.0, 1.0 + z[2]])  # turns the world's z into z
        desired = product(tilt / np.linalg.norm(tilt), quaternion_of(np.array([0, 0, heading])))
        inverse = attitude * np.array([-1.0, -1.0, -1.0, 1.0])
        return rotation_vector(product(inverse, desired))
