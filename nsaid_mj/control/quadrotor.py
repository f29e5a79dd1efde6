"""Quadrotors fly circles upon circles by geometric control under the prior, never the truth.

Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010; with the
integral action of Goodarzi, Lee, Lee, ECC 2013, which trims what a wrong prior leaves.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numba import njit

from ..errors import InvalidInput
from ..excitation import Multisine
from ..parameters import Array
from ..spatial import cross, rotation
from ..system import SecondOrderSystem
from ..systems.aerial import GRAVITY, Quadrotor
from .driver import Driver, DriverConfig

_SLOWEST = 0.1  # rotor speed, as a share of the largest
_LEAST, _MOST = 0.3, 2.5  # thrust demanded, as a share of what would hold the prior's weight
_YAW_SLOWER = 0.25  # the loop about z has little torque to work with
_YAW = 0.5  # torque about z demanded at most, as a share of what all rotors make in hover
_TILT = 0.3  # torque that trims roll and pitch at most, as a share of weight times arm
_TRIM = 0.3  # integral action is that much slower than its loop


@dataclass(frozen=True)
class QuadrotorFlight(DriverConfig):
    """Place and heading follow smooth closed paths; every rotor's speed is dithered too.

    The path is a circle upon a circle, flown fast and slow, up and down: drag on the body shows in
    how it grows with speed, and its axes in how the heading turns against the way.

    Attributes:
        radius: of the greater circle [m].
        speed: largest horizontally, a third of it the least; vertically half of it [m/s].
        yaw_rate: largest [rad/s].
        bandwidth: of the position loop [Hz].
        attitude_bandwidth: of the attitude loop [Hz].
        dither: of each rotor's speed, as a share of it.
        low: lowest frequency of the dither [Hz].
        high: highest frequency of the dither [Hz].
    """

    radius: float = 8.0
    speed: float = 8.0
    yaw_rate: float = 1.5
    bandwidth: float = 0.3
    attitude_bandwidth: float = 1.5
    dither: float = 0.3
    low: float = 0.5
    high: float = 3.0
    climb: float = 0.5
    tilt: float = 0.95

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
        self._path = _Path(config, rng)
        self._dither = Multisine(4, config.low, config.high, 8, config.dither, rng)
        self._slow = 2 * np.pi * config.bandwidth
        self._fast = 2 * np.pi * config.attitude_bandwidth * np.array([1, 1, _YAW_SLOWER])
        self._mass = prior[0]
        centre = prior[1:4] / prior[0]
        Ixx, Ixy, Iyy, Ixz, Iyz, Izz = prior[4:10]
        origin = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
        self._inertia = origin - prior[0] * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        thrust = prior[system.space["rotor thrust gain"]]
        torque = system.spin * prior[system.space["rotor torque gain"]]
        arm = system.rotors - centre
        self._mixer = np.linalg.inv([thrust, arm[:, 1] * thrust, -arm[:, 0] * thrust, torque])
        self._yaw = _YAW * np.abs(torque).sum() * prior[0] * GRAVITY / thrust.sum()
        most = _TILT * prior[0] * GRAVITY * np.abs(arm).mean(axis=0)
        self._turning = np.array([most[1], most[0], self._yaw]) / np.diag(self._inertia)
        self._limits = np.tan(config.tilt), _SLOWEST**2, (1 + config.dither / 2) ** -2
        self._settle()

    def _settle(self) -> None:
        self._t, self._errors = 0.0, np.zeros(6)

    def start(self) -> tuple[Array, Array]:
        """On the path, level."""
        self._settle()
        place, velocity, _, _ = self._path(0.0)
        c, s = np.cos(place[3]), np.sin(place[3])
        u, v, w, r = velocity
        return (
            np.array([*place[:3], 0, 0, place[3]]),
            np.array([c * u + s * v, c * v - s * u, w, 0, 0, r]),
        )

    def command(self, t: float, q: Array, v: Array) -> Array:
        squares = _rotor_speeds_squared(
            q, v, self._path(t), t - self._t, self._errors, self._slow, self._fast,
            self._mass, self._inertia, self._mixer, self._yaw, self._turning, *self._limits,
        )  # fmt: skip
        self._t = t
        return np.clip(np.sqrt(squares) * (1 + self._dither(t)), _SLOWEST, 1.0)


class _Path:
    """x, y, z [m] and heading [rad] as sums of sines, which differ a little from seed to seed."""

    def __init__(self, config: QuadrotorFlight, rng: np.random.Generator):
        turn = config.speed * 2 / 3 / config.radius
        great, small, climb, slow, fast = (
            turn * np.array([1, 1.7, 0.8, 0.6, 1.5]) * (1 + 0.1 * rng.uniform(-1, 1, 5))
        )
        a, b, c, d, e = rng.uniform(0, 2 * np.pi, 5)
        quarter = np.pi / 2
        self._omega = np.array([[great, small], [great, small], [climb, climb], [slow, fast]])
        self._phase = np.array([[a, b], [a + quarter, b - quarter], [c, c], [d, e]])
        share = (
            np.array([[2, 1], [2, 1], [3 * config.climb / 2, 3 * config.climb / 2], [0, 0]])
            / 3
            * config.speed
        )
        share[3] = config.yaw_rate / 2
        self._speed = share
        self._centre = np.array([0, 0, 1 + self._speed[2].sum() / climb, 0])  # above the ground

    def __call__(self, t: float) -> Array:
        """(4, 4) position, velocity, acceleration and jerk of x, y, z and heading."""
        s, c = np.sin(self._omega * t + self._phase), np.cos(self._omega * t + self._phase)
        speed, omega = self._speed, self._omega
        terms = (-speed / omega * c, speed * s, speed * omega * c, -speed * omega**2 * s)
        state = np.array(terms).sum(axis=2)
        state[0] += self._centre
        return state


@njit(cache=True)
def _rotor_speeds_squared(q, v, path, h, errors, slow, fast, mass, inertia, mixer, yaw, turning, tilt, slowest, fastest):
    """(4,) what the rotors should do, as shares of their largest speed squared.

    Args:
        q: (7,) pose.
        v: (6,) twist.
        path: (4, 4) place [m] and heading [rad] to be at, and three derivatives.
        h: time since the last command [s].
        errors: (6,) integrals of the errors of place [m·s] and attitude [rad·s], kept here.
        slow: natural frequency of the position loop [rad/s].
        fast: (3,) natural frequencies of the attitude loop about the body's axes [rad/s].
        mass: [kg].
        inertia: (3, 3) about the centre of mass [kg·m²].
        mixer: (4, 4) squares of rotor speeds from thrust [N] and torque [N·m].
        yaw: largest torque about z [N·m].
        turning: (3,) largest trims of the attitude loop [rad/s²].
        tilt: tangent of the largest tilt.
        slowest: least of what the rotors may do.
        fastest: most of it.
    """
    R = rotation(q[3:])
    place, velocity, acceleration, jerk = path
    off = place[:3] - q[:3]
    trim = _TRIM * slow**3
    most = 0.5 * GRAVITY / trim
    errors[:3] = np.minimum(np.maximum(errors[:3] + h * off, -most), most)
    a = acceleration[:3] + slow**2 * off + 2 * slow * (velocity[:3] - np.dot(R, v[:3]))
    a += trim * errors[:3]
    a[2] = min(max(a[2] + GRAVITY, 0.4 * GRAVITY), 2.0 * GRAVITY)
    level = np.sqrt(a[0] ** 2 + a[1] ** 2)
    a[:2] *= min(1.0, tilt * a[2] / max(level, 1e-9))

    size = np.sqrt(np.sum(a * a))
    z = a / size
    y = cross(z, np.array([np.cos(place[3]), np.sin(place[3]), 0.0]))
    y /= np.sqrt(np.sum(y * y))
    E = np.dot(R.T, np.column_stack((cross(y, z), y, z)))
    heading = np.arctan2(E[1, 0] - E[0, 1], E[0, 0] + E[1, 1])
    turn = np.array([-E[1, 2], E[0, 2], heading])  # tilt first: it must not wait for the heading
    if E[2, 2] < 0.0:
        turn[:2] /= np.sqrt(turn[0] ** 2 + turn[1] ** 2 + 1e-9)
    holding = _TRIM * fast**3
    largest = turning / holding
    errors[3:] = np.minimum(np.maximum(errors[3:] + h * turn, -largest), largest)
    rate = cross(z, jerk[:3]) / size
    rate[2] += velocity[3]
    rate = np.dot(R.T, rate)
    alpha = fast**2 * turn + 2 * fast * (rate - v[3:]) + holding * errors[3:]

    torque = np.dot(inertia, alpha) + cross(v[3:], np.dot(inertia, v[3:]))
    lift = mass * min(max(np.sum(a * R[:, 2]), _LEAST * GRAVITY), _MOST * GRAVITY)
    about_z = min(max(torque[2], -yaw), yaw)
    squares = np.dot(mixer, np.array([lift, torque[0], torque[1], about_z]))
    squares -= max(0.0, squares.max() - fastest)  # attitude comes before height
    squares += max(0.0, slowest - squares.min())
    return np.minimum(squares, fastest)
