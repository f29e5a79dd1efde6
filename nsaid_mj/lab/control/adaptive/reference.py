"""Reference motions, and the gains of the adaptive laws along them, from the prior's own dynamics.

With the tracking error e from the measured to the desired position, v_r = v_d + Λ e and
s = v − v_r = −(ė + Λ e): where s vanishes, e decays at the rate Λ. v̇_r is the exact derivative of
v_r along the motion and needs no acceleration.

Shape: the parameters are normalised by their mean effect on the forces, with E over the desired
motion and S = diag(scale),

    Γ = γ S D⁻¹ S,    D = diag(E[S Wᵀ K_d⁻¹ W S]) / largest entry + floor.

Size: while θ̂ − θ is small, s and the adaptation form a loop, M s̈ + K_d ṡ + W (∇²ψ)⁻¹ Wᵀ s ≈ 0. Its
fastest natural frequency ω is limited by sampling and unmodelled dynamics: a delay δ takes ω² δ
from the loop's damping K_d/M. γ gives it a chosen value at the prior, for every law.
"""

from typing import NamedTuple

import numpy as np

from ....core import (
    Array,
    SecondOrderSystem,
    cross,
    kernel,
    product,
    rotate,
    rotation_vector,
    unrotate,
)
from ..signals import FourierTrajectory
from .actuation import Actuation


class Reference:
    """The pose of a body in space, and the joints it carries; or the joints of an arm alone.

    The body's frame is desired at p_d with roll, pitch and yaw (Z-Y-X), all Fourier series in world
    axes. With R the attitude and q_e the vector part of the quaternion of Rᵀ R_d, in body axes

        v_r = [Rᵀ (ṗ_d + Λ (p_d − p)), Rᵀ R_d ω_d + 2 Λ q_e, q̇_d + Λ (q_d − q)].

    The trajectory is that of x, y, z [m], roll, pitch, yaw [rad] and the joints; an arm alone is on
    a fixed base. `rate` is Λ [1/s].
    """

    def __init__(self, system: SecondOrderSystem, trajectory: FourierTrajectory, rate: float):
        self._system = system
        self._trajectory = trajectory
        self._rate = rate

    def desired(self, t: float) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities at time t [s]."""
        position, velocity, acceleration = self._trajectory(t)
        numbers = position.copy()
        twist = velocity.copy()
        if self._system.group:
            attitude, turning, _ = attitude_of(position[3:6], velocity[3:6], acceleration[3:6])
            numbers[3:6] = rotation_vector(attitude)
            twist[:3] = unrotate(attitude, velocity[:3])
            twist[3:6] = turning
        return numbers, twist

    def __call__(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """(n,) v_r and (n,) v̇_r at time t [s] and a measured state q (m,), v (n,)."""
        motion = np.column_stack(self._trajectory(t))
        first = self._system.group
        v_r = np.empty(len(v))
        a_r = np.empty(len(v))
        if first:
            follow_pose(motion, q, v, self._rate, v_r, a_r)
        if len(v) > first:
            rates = motion[first:, 1]
            error = self._system.joint_errors(q, motion[first:, 0])
            v_r[first:] = rates + self._rate * error
            a_r[first:] = motion[first:, 2] + self._rate * (rates - v[first:])
        return v_r, a_r


@kernel()
def attitude_of(angles, rates, accelerations):
    """Attitude and its derivatives from roll φ, pitch θ and yaw ψ [rad], R = R_z(ψ) R_y(θ) R_x(φ).

    Returns:
        (4,) quaternion x, y, z, w; (3,) ω in body axes [rad/s]; (3,) ω̇ in body axes [rad/s²].
    """
    half = 0.5 * angles
    c = np.cos(half)
    s = np.sin(half)
    roll = np.array([s[0], 0.0, 0.0, c[0]])
    pitch = np.array([0.0, s[1], 0.0, c[1]])
    yaw = np.array([0.0, 0.0, s[2], c[2]])
    quaternion = product(yaw, product(pitch, roll))
    sr = np.sin(angles[0])
    cr = np.cos(angles[0])
    sp = np.sin(angles[1])
    cp = np.cos(angles[1])
    p, q, r = rates
    turning = np.array([p - sp * r, cr * q + sr * cp * r, -sr * q + cr * cp * r])
    a, b, d = accelerations
    change = np.array(
        [
            a - sp * d - cp * q * r,
            cr * b + sr * cp * d + p * (-sr * q + cr * cp * r) - sr * sp * q * r,
            -sr * b + cr * cp * d - p * (cr * q + sr * cp * r) - cr * sp * q * r,
        ]
    )
    return quaternion, turning, change


@kernel()
def follow_pose(motion, q, v, rate, v_r, a_r):
    """Writes the first six entries of v_r (n,) and v̇_r (n,); see `Reference`.

    `motion` (n, 3) holds positions and angles, velocities, accelerations of the desired motion; q
    (m,) begins with the measured pose [p, quaternion], v (n,) with the body twist; `rate` is Λ
    [1/s].
    """
    attitude = q[3:7]
    omega = v[3:6]
    slip = motion[:3, 1] - rotate(attitude, v[:3])
    v_r[:3] = unrotate(attitude, motion[:3, 1] + rate * (motion[:3, 0] - q[:3]))
    a_r[:3] = unrotate(attitude, motion[:3, 2] + rate * slip) - cross(omega, v_r[:3])
    aim, turning, change = attitude_of(motion[3:6, 0], motion[3:6, 1], motion[3:6, 2])
    inverse = attitude.copy()
    inverse[:3] *= -1
    turn = product(inverse, aim)
    if turn[3] < 0:
        turn = -turn
    feed = rotate(turn, turning)  # ω_d in the body's axes
    lag = feed - omega
    v_r[3:6] = feed + 2 * rate * turn[:3]
    a_r[3:6] = cross(lag, feed) + rotate(turn, change)
    a_r[3:6] += rate * (turn[3] * lag + cross(lag, turn[:3]))


_SAMPLES = 100  # along one period of the desired motion
_PROBES = 20  # configurations over which the prior's inertia is averaged


class PriorMotion(NamedTuple):
    """The prior's W (k, n, p), by its own commands, and M (k, n, n) along the desired motion."""

    W: Array
    M: Array


def prior_motion(
    system: SecondOrderSystem,
    prior: Array,
    reference: Reference,
    actuation: Actuation,
    period: float,
) -> PriorMotion:
    """Evaluates the prior's dynamics along a period [s] of the desired motion."""
    W = []
    M = []
    for t in np.linspace(0, period, _SAMPLES, endpoint=False).tolist():
        numbers, v = reference.desired(t)
        q = system.position(numbers)
        v_r, a_r = reference(t, q, v)
        idle = system._W(t, q, v, v_r, a_r, np.zeros(system.n_u))
        u = actuation.command(prior, idle @ prior)
        W.append(system._W(t, q, v, v_r, a_r, u))
        M.append(system.mass_matrix(np.concatenate([q, v]), prior))
    return PriorMotion(np.array(W), np.array(M))


def stiffness(motion: PriorMotion, scale: Array, damping: Array, floor: float) -> Array:
    """(p,) the diagonal of Γ⁻¹ at γ = 1 [J], with K_d (n,) and the least entry of D."""
    effect = np.mean((motion.W * scale) ** 2 / damping[:, None], axis=0).sum(axis=0)
    return np.asarray((effect / effect.max() + floor) / scale**2)


def loop_frequency(motion: PriorMotion, mobility: Array) -> float:
    """Largest natural frequency ω [rad/s] of the adaptation's loop along the desired motion.

    `mobility` (p, p) is (∇²ψ)⁻¹ at the prior.
    """
    stiffness = motion.W @ mobility @ motion.W.transpose(0, 2, 1)
    squares = np.linalg.eigvals(np.linalg.solve(motion.M, stiffness)).real
    return float(np.sqrt(squares.max()))


def mean_inertia(system: SecondOrderSystem, prior: Array) -> Array:
    """(n,) diagonal of the prior's mass matrix, averaged over random configurations."""
    rng = np.random.default_rng(0)
    total = np.zeros(system.n)
    for _ in range(_PROBES):
        q, v, _ = system.random_state(rng)
        total += np.diag(system.mass_matrix(np.concatenate([q, v]), prior))
    return total / _PROBES
