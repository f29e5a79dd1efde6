"""Geometric control of a quadrotor along an epicycle, based on the prior.

Lee, Leok, McClamroch: Geometric tracking control of a quadrotor UAV on SE(3), CDC 2010; with
integral action (Goodarzi, Lee, Lee, ECC 2013) against the errors of a wrong prior, and tilt
controlled separately from heading (Brescianini, D'Andrea, IEEE TCST 28(2), 2020), because four
rotors have little authority about z.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import f8, types, u4, void

from ...core import GRAVITY, Array, SingleBody, kernel, routine, write_rotation
from .driver import Driver
from .signals import Multisine

_SLOWEST = 0.1  # smallest rotor speed, as a share of the largest
_HEADING = 0.25  # bandwidth of the heading loop over that of the tilt loops
_TRIM = 0.3  # bandwidth of the integral action over that of its loop
_LIFT = np.array([0.3, 2.5])  # bounds on the commanded thrust, over the prior's weight
_FALL = 0.4 * GRAVITY  # bounds on the commanded vertical specific force [m/s²]
_RISE = 2.0 * GRAVITY
_PLACE_TRIM = np.array([0.5, 0.5, 0.9]) * GRAVITY  # bound on the position integrator [m/s²]
_TILT_TRIM = 0.3  # bound on the tilt integrator's torque, over weight times arm
_YAW = 0.5  # bound on the commanded torque about z, over the rotors' total torque in hover
_TONES = 8


class _Control(NamedTuple):
    """The controller's model of the quadrotor, its bandwidths [rad/s] and bounds."""

    mass: float  # [kg]
    inertia: Array  # (3, 3) about the centre of mass [kg·m²]
    mixer: Array  # (4, 4) maps thrust [N] and torques [N·m] to squared rotor speeds
    trim: Array  # (3,) bounds on the attitude integrators [rad/s²]
    yaw: float  # bound on the torque about z [N·m]
    place: float  # bandwidth of the position loop
    attitude: Array  # (3,) bandwidths of the attitude loops
    slope: float  # tangent of the largest tilt
    least: float  # lower bound on the squared rotor speeds, before dither
    most: float  # upper bound


class Flight(Driver):
    """Geometric tracking controller; rotor commands are speeds as shares of the top speed.

    `config` is a `QuadrotorFlight`.
    """

    def __init__(self, config: Any, system: SingleBody, prior: Array, rng: np.random.Generator):
        self._path = _Path(config, rng)
        self._dither = Multisine(4, config.low, config.high, _TONES, config.dither, rng)
        loops = config.attitude_bandwidth * np.array([1.0, 1.0, _HEADING])
        self._control = _Control(
            *_body_model(system, prior),
            2 * np.pi * config.bandwidth,
            2 * np.pi * loops,
            float(np.tan(config.tilt)),
            _SLOWEST**2,
            (1 + config.dither / 2) ** -2,  # leaves a margin for most of the dither
        )
        self.start()

    def start(self) -> tuple[Array, Array]:
        """Resets the integrators; the quadrotor starts on the path, level."""
        self._t, self._sums = 0.0, np.zeros(6)
        place, velocity, _, _ = self._path(0.0)
        c = np.cos(place[3])
        s = np.sin(place[3])
        x, y, z, r = velocity
        return (
            np.array([*place[:3], 0, 0, place[3]]),
            np.array([c * x + s * y, c * y - s * x, z, 0, 0, r]),
        )

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(4,) rotor speeds for the measured state."""
        squares = np.empty(4)
        step = t - self._t
        own = (self._sums, self._control)
        state = (np.require(x, np.float64, ["C", "W"]) for x in (q, v))
        _mix(*state, self._path(t), step, *own, np.empty(9), np.empty(30), squares)
        self._t = t
        return np.clip(np.sqrt(squares) * (1 + self._dither(t)), _SLOWEST, 1.0)


class _Path:
    """x, y, z [m] and heading [rad] as sums of sines with random phases and frequencies ±10 %."""

    def __init__(self, config: Any, rng: np.random.Generator):
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
        speed = self._speed
        omega = self._omega
        s = np.sin(omega * t + self._phase)
        c = np.cos(omega * t + self._phase)
        terms = (-speed / omega * c, speed * s, speed * omega * c, -speed * omega**2 * s)
        path = np.array(terms).sum(axis=2)
        path[0] += self._centre
        return path


def _body_model(system: SingleBody, theta: Array) -> tuple[float, Array, Array, Array, float]:
    """The first five fields of `_Control` from θ (24,)."""
    mass = float(theta[0])
    centre = theta[1:4] / theta[0]
    Ixx, Ixy, Iyy, Ixz, Iyz, Izz = theta[4:10]
    inertia = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
    inertia -= mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    thrust = theta[system.space["rotor thrust gain"]]
    spin = system.constants("rotor_torque", "direction")[:, 2]
    torque = spin * theta[system.space["rotor torque gain"]]
    arm = system.constants("rotor", "point") - centre
    wrench = np.array([thrust, arm[:, 1] * thrust, -arm[:, 0] * thrust, torque])
    yaw = _YAW * float(np.abs(torque).sum() * mass * GRAVITY / thrust.sum())
    x, y, _ = np.abs(arm).mean(axis=0)
    tilt = _TILT_TRIM * mass * GRAVITY
    trim = np.array([tilt * y, tilt * x, yaw]) / np.diag(inertia)
    return mass, inertia, np.linalg.inv(wrench).astype(np.float64), trim, yaw


CONTROL = types.NamedTuple(
    (f8, f8[:, ::1], f8[:, ::1], f8[::1], f8, f8, f8[::1], f8, f8, f8), _Control
)


@routine(f8(f8[::1], u4, f8[::1], u4))
def _dot(a, i, b, j):
    """a · b of 3-vectors that begin at a[i] and b[j]."""
    return a[i] * b[j] + a[i + 1] * b[j + 1] + a[i + 2] * b[j + 2]


@routine(void(f8[::1], u4, f8[::1], u4, f8[::1], u4))
def _cross(a, i, b, j, c, k):
    """Writes a × b, 3-vectors that begin at a[i] and b[j], into c[k :]."""
    c[k] = a[i + 1] * b[j + 2] - a[i + 2] * b[j + 1]
    c[k + 1] = a[i + 2] * b[j] - a[i] * b[j + 2]
    c[k + 2] = a[i] * b[j + 1] - a[i + 1] * b[j]


@kernel(f8(f8[::1], f8[::1], f8[:, ::1], f8, f8[::1], CONTROL, f8[::1], f8[::1]), inner=True)
def _aim(q, v, path, dt, sums, own, R, x):
    """Writes the desired specific force a (3,) into x[9:12], its axes y and z into x[12:18].

    x[18:21] receives z × jerk/|a|. Returns |a|.
    """
    w = own.place
    holding = _TRIM * own.place**3
    for i in range(3):
        off = path[0, i] - q[i]
        most = _PLACE_TRIM[i] / holding
        sums[i] = min(max(sums[i] + dt * off, -most), most)
        ground = R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2]
        x[9 + i] = path[2, i] + w**2 * off + 2.0 * w * (path[1, i] - ground) + holding * sums[i]
    x[11] = min(max(x[11] + GRAVITY, _FALL), _RISE)
    flat = min(1.0, own.slope * x[11] / max(np.sqrt(x[9] ** 2 + x[10] ** 2), 1e-9))
    x[9], x[10] = flat * x[9], flat * x[10]
    size = np.sqrt(_dot(x, 9, x, 9))
    x[0], x[1], x[2] = np.cos(path[0, 3]), np.sin(path[0, 3]), 0.0
    for i in range(3):
        x[15 + i] = x[9 + i] / size
        x[3 + i] = path[3, i] / size
    _cross(x, 15, x, 0, x, 12)
    length = np.sqrt(_dot(x, 12, x, 12))
    for i in range(3):
        x[12 + i] /= length
    _cross(x, 15, x, 3, x, 18)
    return size


@kernel(void(f8[::1], f8[::1], f8[:, ::1], f8, f8[::1], CONTROL, f8[::1], f8[::1], f8[::1]))
def _mix(q, v, path, dt, sums, own, R, x, squares):
    """Writes the squared rotor speeds (4,) that track the path.

    `path` (4, 4) holds desired position [m] and heading [rad], and their first three derivatives;
    `sums` (6,) the integrals of position [m·s] and attitude [rad·s] errors, updated in place over
    dt [s]. q is the pose (7,), v the body twist (6,); R (9,) and x (30,) are workspaces.
    """
    for i in range(3):
        x[i] = -q[3 + i]
    x[3] = q[6]
    write_rotation(x, 0, R, 0)  # of the inverse: R holds the body's axes, one after another
    _aim(q, v, path, dt, sums, own, R, x)
    _cross(x, 12, x, 15, x, 0)  # the desired x-axis
    x[20] += path[1, 3]  # the desired angular velocity, in the world

    # attitude error in body axes: shortest rotation of the tilt, and the heading's
    heading = np.arctan2(_dot(R, 3, x, 0) - _dot(R, 0, x, 12), _dot(R, 0, x, 0) + _dot(R, 3, x, 12))
    x[3], x[4], x[5] = -_dot(R, 3, x, 15), _dot(R, 0, x, 15), heading
    if _dot(R, 6, x, 15) < 0.0:  # tilt error above 90°
        length = max(np.sqrt(x[3] ** 2 + x[4] ** 2), 1e-9)
        x[3], x[4] = x[3] / length, x[4] / length
    for i in range(3):
        w = own.attitude[i]
        holding = _TRIM * own.attitude[i] ** 3
        most = own.trim[i] / holding
        sums[3 + i] = min(max(sums[3 + i] + dt * x[3 + i], -most), most)
        rate = _dot(R, 3 * i, x, 18) - v[3 + i]
        x[21 + i] = w**2 * x[3 + i] + 2.0 * w * rate + holding * sums[3 + i]
    for i in range(3):
        x[24 + i] = 0.0
        x[27 + i] = 0.0
        for j in range(3):
            x[24 + i] += own.inertia[i, j] * v[3 + j]
            x[27 + i] += own.inertia[i, j] * x[21 + j]
    _cross(v, 3, x, 24, x, 0)
    weight = own.mass * GRAVITY
    x[3] = min(max(own.mass * _dot(x, 9, R, 6), _LIFT[0] * weight), _LIFT[1] * weight)
    x[4], x[5] = x[27] + x[0], x[28] + x[1]
    x[6] = min(max(x[29] + x[2], -own.yaw), own.yaw)
    largest = -np.inf
    least = np.inf
    for i in range(4):
        squares[i] = 0.0
        for j in range(4):
            squares[i] += own.mixer[i, j] * x[3 + j]
        largest = max(largest, squares[i])
    lower = max(0.0, largest - own.most)  # when saturated, keep the torques, give up thrust
    for i in range(4):
        squares[i] -= lower
        least = min(least, squares[i])
    for i in range(4):
        squares[i] = min(squares[i] + max(0.0, own.least - least), own.most)
