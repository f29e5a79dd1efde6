"""Quadrotors fly a Fourier trajectory by geometric control under the prior, never the truth.

Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010; with the
integral action of Goodarzi, Lee, Lee, ECC 2013, which trims what a wrong prior leaves.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from ..errors import InvalidInput
from ..excitation import FourierTrajectory, Multisine
from ..parameters import Array
from ..spatial import cross, rotation
from ..system import SecondOrderSystem
from ..systems.aerial import GRAVITY, Quadrotor
from .driver import Driver, DriverConfig

_SLOWEST, _FASTEST = 0.1, 1.0  # rotor speed, as a share of the largest
_THRUST = (0.4, 1.6)  # thrust that is demanded, as a share of the weight
_YAW = 0.3  # torque about z that is demanded at most, as a share of what all rotors make in hover
_SLOW_DOWN = 0.3  # integral action is that much slower than its loop


@dataclass(frozen=True)
class QuadrotorFlight(DriverConfig):
    """Place and heading track random finite Fourier series; every rotor's speed is dithered too.

    Attributes:
        reach: half the edge of the cube that is flown in [m].
        speed: largest along each axis of the world; half of it vertically [m/s].
        yaw_rate: largest [rad/s].
        fundamental: frequency of the first harmonic [Hz].
        harmonics: number of harmonics.
        bandwidth: of the position loop [Hz].
        attitude_bandwidth: of the attitude loop [Hz].
        dither: of each rotor's speed, as a share of it.
        dither_low: lowest frequency of the dither [Hz].
        dither_high: highest frequency of the dither [Hz].
    """

    reach: float = 6.0
    speed: float = 6.0
    yaw_rate: float = 2.0
    fundamental: float = 0.05
    harmonics: int = 5
    bandwidth: float = 0.3
    attitude_bandwidth: float = 1.5
    dither: float = 0.1
    dither_low: float = 0.5
    dither_high: float = 3.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(
                    f"excitation.{field.name}", "a finite number > 0", value, "The default flies."
                )

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system is no quadrotor.
        """
        if not isinstance(system, Quadrotor):
            raise InvalidInput(
                "excitation", "a quadrotor to fly", type(system).__name__, "Use another driver."
            )
        return _Flight(self, system, prior, rng)


class _Flight(Driver):
    def __init__(
        self, config: QuadrotorFlight, system: Quadrotor, prior: Array, rng: np.random.Generator
    ):
        reach, speed = np.full(4, config.reach), np.array([1, 1, 0.5, 0]) * config.speed
        reach[3], speed[3] = np.pi, config.yaw_rate
        middle = np.array([0, 0, config.reach + 1.0, 0])  # above the ground
        self._trajectory = FourierTrajectory(
            middle - reach, middle + reach, speed, config.fundamental, config.harmonics, rng
        )
        self._dither = Multisine(4, config.dither_low, config.dither_high, 8, config.dither, rng)
        self._loops = 2 * np.pi * np.array([config.bandwidth, config.attitude_bandwidth])
        self._mass = prior[0]
        centre = prior[1:4] / prior[0]
        Ixx, Ixy, Iyy, Ixz, Iyz, Izz = prior[4:10]
        origin = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
        self._inertia = origin - prior[0] * (
            centre @ centre * np.eye(3) - np.outer(centre, centre)
        )
        thrust = prior[system.space["rotor thrust gain"]]
        torque = system.spin * prior[system.space["rotor torque gain"]]
        arm = system.rotors - centre
        self._mixer = np.linalg.inv([thrust, arm[:, 1] * thrust, -arm[:, 0] * thrust, torque])
        self._yaw = _YAW * np.abs(torque).sum() * prior[0] * GRAVITY / thrust.sum()
        self._settle()

    def _settle(self) -> None:
        self._t, self._errors = 0.0, np.zeros(6)

    def start(self) -> tuple[Array, Array]:
        """On the trajectory, level."""
        self._settle()
        place, velocity, _ = self._trajectory(0.0)
        c, s = np.cos(place[3]), np.sin(place[3])
        u, v, w, r = velocity
        return (
            np.array([*place[:3], 0, 0, place[3]]),
            np.array([c * u + s * v, c * v - s * u, w, 0, 0, r]),
        )

    def command(self, t: float, q: Array, v: Array) -> Array:
        place, velocity, acceleration = self._trajectory(t)
        squares = _rotor_speeds_squared(
            q, v, place, velocity, acceleration, t - self._t, self._errors, *self._loops,
            self._mass, self._inertia, self._mixer, self._yaw,
        )  # fmt: skip
        self._t = t
        speeds = np.sqrt(np.clip(squares, _SLOWEST**2, _FASTEST**2)) * (1 + self._dither(t))
        return np.clip(speeds, _SLOWEST, _FASTEST)


@njit(cache=True)
def _rotor_speeds_squared(
    q, v, place, velocity, acceleration, h, errors, slow, fast, mass, inertia, mixer, yaw
):
    """(4,) what the rotors should do, as shares of their largest speed squared.

    Args:
        q: (7,) pose.
        v: (6,) twist.
        place: (4,) x, y, z [m] and heading [rad] to be at.
        velocity: (4,) its first derivative.
        acceleration: (4,) its second.
        h: time since the last command [s].
        errors: (6,) integrals of the errors of place [m·s] and attitude [rad·s], kept here.
        slow: natural frequency of the position loop [rad/s].
        fast: natural frequency of the attitude loop [rad/s].
        mass: [kg].
        inertia: (3, 3) about the centre of mass [kg·m²].
        mixer: (4, 4) squares of rotor speeds from thrust [N] and torque [N·m].
        yaw: largest torque about z [N·m].
    """
    R = rotation(q[3:])
    off = place[:3] - q[:3]
    errors[:3] = np.minimum(np.maximum(errors[:3] + h * off, -5.0), 5.0)
    a = acceleration[:3] + slow**2 * off + 2 * slow * (velocity[:3] - np.dot(R, v[:3]))
    a += _SLOW_DOWN * slow**3 * errors[:3]
    level = np.sqrt(a[0] ** 2 + a[1] ** 2)
    a[2] = min(max(a[2], -0.5 * GRAVITY), 0.8 * GRAVITY) + GRAVITY
    a[:2] *= min(1.0, 1.2 * a[2] / max(level, 1e-9))  # 50° of tilt at most

    z = a / np.sqrt(np.sum(a * a))
    y = cross(z, np.array([np.cos(place[3]), np.sin(place[3]), 0.0]))
    y /= np.sqrt(np.sum(y * y))
    wanted = np.column_stack((cross(y, z), y, z))
    E = np.dot(R.T, wanted)
    turn = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
    errors[3:] = np.minimum(np.maximum(errors[3:] + h * turn, -0.5), 0.5)
    rate = R[2] * velocity[3]  # about the vertical, in the body's axes
    alpha = fast**2 * turn + 2 * fast * (rate - v[3:]) + _SLOW_DOWN * fast**3 * errors[3:]

    torque = np.dot(inertia, alpha) + cross(v[3:], np.dot(inertia, v[3:]))
    lift = mass * min(max(np.sum(a * R[:, 2]), _THRUST[0] * GRAVITY), _THRUST[1] * GRAVITY)
    about_z = min(max(torque[2], -yaw), yaw)
    return np.dot(mixer, np.array([lift, torque[0], torque[1], about_z]))
