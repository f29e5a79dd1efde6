"""Quadrotors fly circles upon circles by geometric control under the prior, never the truth.

Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010; with
integral action (Goodarzi, Lee, Lee, ECC 2013) that trims what a wrong prior leaves, and the tilt
apart from the heading (Brescianini, D'Andrea, IEEE TCST 28(2), 2020): four rotors turn a
quadrotor about z too slowly to wait for.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from ..bounds import Positive, config
from ..errors import InvalidInput
from ..numerics.spatial import cross, rotation
from ..parameters import Array
from ..system import SecondOrderSystem
from ..systems.aerial import GRAVITY, Quadrotor
from .driver import Driver, DriverConfig
from .signals import Multisine

_SLOWEST = 0.1  # rotor speed, as a share of the largest
_HEADING = 0.25  # the loop about z is that much slower than those of the tilt
_TRIM = 0.3  # integral action is that much slower than its loop
_LIFT = np.array([0.3, 2.5])  # thrust demanded, as a share of what would hold the prior's weight
_FALL, _RISE = 0.4 * GRAVITY, 2.0 * GRAVITY  # acceleration demanded along the vertical [m/s²]
_PLACE_TRIM = np.array([0.5, 0.5, 0.9]) * GRAVITY  # most that trims the place [m/s²]
_TILT_TRIM = 0.3  # most torque that trims the tilt, as a share of weight times arm
_YAW = 0.5  # most torque about z demanded, as a share of what all rotors make in hover
_TONES = 8


@config
class QuadrotorFlight(DriverConfig):
    """Place and heading follow smooth closed paths; every rotor's speed is dithered too.

    The path is a circle upon a circle, flown fast and slow, up and down. Drag on the body shows in
    how it grows with speed, its axes in how the heading turns against the way, and the rotors'
    torques in what a dither about the roll and pitch axes does about z.

    Attributes:
        radius: of the greater circle [m].
        speed: largest horizontally; a third of it is the least [m/s].
        climb: largest vertically [m/s].
        yaw_rate: largest [rad/s].
        tilt: largest that is asked for [rad].
        bandwidth: of the position loop [Hz].
        attitude_bandwidth: of the attitude loop [Hz].
        dither: bound of what is added to each rotor's speed, as a share of it.
        low: lowest frequency of the dither [Hz].
        high: highest frequency of the dither [Hz].
    """

    radius: Positive = 6.0
    speed: Positive = 8.0
    climb: Positive = 5.0
    yaw_rate: Positive = 5.0
    tilt: Annotated[float, Field(strict=True, gt=0, lt=1.4)] = 0.95
    bandwidth: Positive = 0.3
    attitude_bandwidth: Positive = 2.0
    dither: Annotated[float, Field(strict=True, gt=0, lt=1)] = 0.5
    low: Positive = 3.0
    high: Positive = 9.0

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


class _BodyModel(NamedTuple):
    """What the controller takes a quadrotor for.

    Attributes:
        mass: [kg].
        inertia: (3, 3) about the centre of mass [kg·m²].
        mixer: (4, 4) squares of rotor speeds from thrust [N] and torques [N·m].
        trim: (3,) most that trims the attitude [rad/s²].
        yaw: most torque about z [N·m].
    """

    mass: float
    inertia: Array
    mixer: Array
    trim: Array
    yaw: float


class _Loops(NamedTuple):
    """What the controller is after.

    Attributes:
        place: natural frequency of the position loop [rad/s].
        attitude: (3,) natural frequencies of the attitude loops [rad/s].
        slope: tangent of the largest tilt.
        least: square of the slowest rotor's speed.
        most: square of the fastest rotor's speed.
    """

    place: float
    attitude: Array
    slope: float
    least: float
    most: float


class _Flight(Driver):
    def __init__(
        self, config: QuadrotorFlight, system: Quadrotor, prior: Array, rng: np.random.Generator
    ):
        self._path = _Path(config, rng)
        self._dither = Multisine(4, config.low, config.high, _TONES, config.dither, rng)
        self._model = _body_model(system, prior)
        loops = config.attitude_bandwidth * np.array([1.0, 1.0, _HEADING])
        self._loops = _Loops(
            2 * np.pi * config.bandwidth,
            2 * np.pi * loops,
            float(np.tan(config.tilt)),
            _SLOWEST**2,
            (1 + config.dither / 2) ** -2,  # room for most of the dither
        )
        self._settle()

    def _settle(self) -> None:
        self._t, self._sums = 0.0, np.zeros(6)

    def start(self) -> tuple[Array, Array]:
        """On the path, level."""
        self._settle()
        place, velocity, _, _ = self._path(0.0)
        c, s = np.cos(place[3]), np.sin(place[3])
        x, y, z, r = velocity
        return (
            np.array([*place[:3], 0, 0, place[3]]),
            np.array([c * x + s * y, c * y - s * x, z, 0, 0, r]),
        )

    def command(self, t: float, q: Array, v: Array) -> Array:
        squares = _mix(q, v, self._path(t), t - self._t, self._sums, self._loops, self._model)
        self._t = t
        return np.clip(np.sqrt(squares) * (1 + self._dither(t)), _SLOWEST, 1.0)

    def compiled(self, t: Array) -> None:
        return None


class _Path:
    """x, y, z [m] and heading [rad] as sums of sines, which differ a little from seed to seed."""

    def __init__(self, config: QuadrotorFlight, rng: np.random.Generator):
        turn = 2 / 3 * config.speed / config.radius
        great, small, climb, slow, fast = (
            turn * np.array([1.0, 1.7, 0.8, 0.6, 1.5]) * (1 + 0.1 * rng.uniform(-1, 1, 5))
        )
        a, b, c, d, e = rng.uniform(0, 2 * np.pi, 5)
        quarter = np.pi / 2
        self._omega = np.array([[great, small], [great, small], [climb, climb], [slow, fast]])
        self._phase = np.array([[a, b], [a + quarter, b - quarter], [c, c], [d, e]])
        self._speed = np.array(
            [[2 / 3 * config.speed, 1 / 3 * config.speed]] * 2
            + [[config.climb / 2] * 2, [config.yaw_rate / 2] * 2]
        )
        self._centre = np.array([0, 0, 1 + config.climb / climb, 0])  # above the ground

    def __call__(self, t: float) -> Array:
        """(4, 4) position, velocity, acceleration and jerk of x, y, z and heading."""
        speed, omega = self._speed, self._omega
        s, c = np.sin(omega * t + self._phase), np.cos(omega * t + self._phase)
        terms = (-speed / omega * c, speed * s, speed * omega * c, -speed * omega**2 * s)
        path = np.array(terms).sum(axis=2)
        path[0] += self._centre
        return path


def _body_model(system: Quadrotor, theta: Array) -> _BodyModel:
    """What a controller needs of θ."""
    mass, centre = float(theta[0]), theta[1:4] / theta[0]
    Ixx, Ixy, Iyy, Ixz, Iyz, Izz = theta[4:10]
    inertia = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
    inertia -= mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    thrust = theta[system.space["rotor thrust gain"]]
    torque = system.spin * theta[system.space["rotor torque gain"]]
    arm = system.rotors - centre
    wrench = np.array([thrust, arm[:, 1] * thrust, -arm[:, 0] * thrust, torque])
    yaw = _YAW * float(np.abs(torque).sum() * mass * GRAVITY / thrust.sum())
    x, y, _ = np.abs(arm).mean(axis=0)
    tilt = _TILT_TRIM * mass * GRAVITY
    trim = np.array([tilt * y, tilt * x, yaw]) / np.diag(inertia)
    return _BodyModel(mass, inertia, np.linalg.inv(wrench).astype(np.float64), trim, yaw)


@njit(cache=True)
def _mix(q, v, path, dt, sums, loops, model):
    """(4,) squares of the rotors' speeds that lead back to the path.

    Args:
        q: (7,) pose.
        v: (6,) twist.
        path: (4, 4) place [m] and heading [rad] to be at, and three derivatives.
        dt: time since the last command [s].
        sums: (6,) integrals of the errors of place [m·s] and attitude [rad·s], kept here.
        loops: what the controller is after.
        model: what it takes the quadrotor for.
    """
    place, velocity, acceleration, jerk = path
    R = rotation(q[3:])

    # the acceleration desired, gravity taken off: its direction is where z should point
    w, holding = loops.place, _TRIM * loops.place**3
    off = place[:3] - q[:3]
    sums[:3] = _bounded(sums[:3] + dt * off, _PLACE_TRIM / holding)
    a = acceleration[:3] + w**2 * off + 2 * w * (velocity[:3] - np.dot(R, v[:3]))
    a += holding * sums[:3]
    a[2] = min(max(a[2] + GRAVITY, _FALL), _RISE)
    a[:2] *= min(1.0, loops.slope * a[2] / max(np.sqrt(a[0] ** 2 + a[1] ** 2), 1e-9))
    size = np.sqrt(np.sum(a * a))
    z = a / size
    y = cross(z, np.array([np.cos(place[3]), np.sin(place[3]), 0.0]))
    y /= np.sqrt(np.sum(y * y))

    # the turn that is left, in the body's axes: the tilt's shortest way, and the heading's
    E = np.dot(R.T, np.column_stack((cross(y, z), y, z)))
    heading = np.arctan2(E[1, 0] - E[0, 1], E[0, 0] + E[1, 1])
    turn = np.array([-E[1, 2], E[0, 2], heading])
    if E[2, 2] < 0.0:  # more than a quarter turn off
        turn[:2] /= max(np.sqrt(turn[0] ** 2 + turn[1] ** 2), 1e-9)
    rate = cross(z, jerk[:3]) / size
    rate[2] += velocity[3]
    w3, holding3 = loops.attitude, _TRIM * loops.attitude**3
    sums[3:] = _bounded(sums[3:] + dt * turn, model.trim / holding3)
    alpha = w3**2 * turn + 2 * w3 * (np.dot(R.T, rate) - v[3:]) + holding3 * sums[3:]

    weight = model.mass * GRAVITY
    lift = model.mass * np.sum(a * R[:, 2])
    torque = np.dot(model.inertia, alpha) + cross(v[3:], np.dot(model.inertia, v[3:]))
    wrench = np.array(
        [
            min(max(lift, _LIFT[0] * weight), _LIFT[1] * weight),
            torque[0],
            torque[1],
            min(max(torque[2], -model.yaw), model.yaw),
        ]
    )
    squares = np.dot(model.mixer, wrench)
    squares -= max(0.0, squares.max() - loops.most)  # attitude comes before height
    squares += max(0.0, loops.least - squares.min())
    return np.minimum(squares, loops.most)


@njit(cache=True)
def _bounded(x, most):
    """x (n,) within ±most (n,)."""
    return np.minimum(np.maximum(x, -most), most)
