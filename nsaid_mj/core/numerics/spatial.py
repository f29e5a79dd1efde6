"""Poses and their tangents, compiled: rotations in space, poses in space and in the plane.

A pose in space is [p, quaternion] (7,): the position of the body's frame in the world [m] and its
attitude x, y, z, w, body to world. A pose in the plane is [x, y, ψ] (3,). Velocities are body
twists, [v, ω] (6,) or [u, v, r] (3,). A tangent step is the twist that, held for one second, leads
from one pose to the other (the group's exponential map), as in Pinocchio's free flyer.
"""

import numpy as np

from ..parameters import Array
from .kernels import kernel

_SMALL = 1e-2  # angle below which three terms of the series are exact in double precision [rad]


@kernel(error_model="numpy")
def cross(a, b):
    """a × b of two (3,) vectors."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


@kernel(error_model="numpy")
def rotation(quaternion):
    """(3, 3) matrix, body to world, of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@kernel(error_model="numpy")
def rotate(quaternion, vector):
    """(3,) a vector in world axes, from its components in body axes (3,)."""
    x, y, z, w = quaternion
    a, b, c = vector
    i = 2 * (y * c - z * b)
    j = 2 * (z * a - x * c)
    k = 2 * (x * b - y * a)
    return np.array(
        [a + w * i + y * k - z * j, b + w * j + z * i - x * k, c + w * k + x * j - y * i]
    )


@kernel(error_model="numpy")
def unrotate(quaternion, vector):
    """(3,) a vector in body axes, from its components in world axes (3,)."""
    x, y, z, w = quaternion
    return rotate((-x, -y, -z, w), vector)


@kernel(error_model="numpy")
def product(one, other):
    """(4,) the quaternion product one ⊗ other, normalised."""
    a = one[0]
    b = one[1]
    c = one[2]
    d = one[3]
    i = other[0]
    j = other[1]
    k = other[2]
    w = other[3]
    q = np.empty(4)
    q[0] = d * i + w * a + (b * k - c * j)
    q[1] = d * j + w * b + (c * i - a * k)
    q[2] = d * k + w * c + (a * j - b * i)
    q[3] = d * w - a * i - b * j - c * k
    size = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for r in range(4):
        q[r] /= size
    return q


@kernel(error_model="numpy")
def quaternion_of(vector):
    """(4,) unit quaternion (x, y, z, w) of a rotation vector (3,) [rad]."""
    angle = np.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    square = angle * angle
    half = np.sin(angle / 2) / angle if angle > _SMALL else 0.5 - square / 48 + square**2 / 3840
    q = np.empty(4)
    for i in range(3):
        q[i] = half * vector[i]
    q[3] = np.cos(angle / 2)
    return q


@kernel(error_model="numpy")
def rotation_vector(quaternion):
    """(3,) rotation vector [rad], at most π long, of a unit quaternion (x, y, z, w)."""
    q = -quaternion if quaternion[3] < 0 else quaternion
    sine = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    if sine > _SMALL:
        return q[:3] * (2.0 * np.arctan2(sine, q[3]) / sine)
    square = (sine / q[3]) ** 2
    return q[:3] * (2.0 / q[3] * (1 - square / 3 + square**2 / 5 - square**3 / 7))


@kernel(error_model="numpy")
def pose_jacobian(q):
    """(7, 6) J of q̇ = J v at a pose q (7,): ṗ = R v, and half the quaternion times ω."""
    x = 0.5 * q[3]
    y = 0.5 * q[4]
    z = 0.5 * q[5]
    w = 0.5 * q[6]
    J = np.zeros((7, 6))
    R = rotation(q[3:7])
    for i in range(3):
        for j in range(3):
            J[i, j] = R[i, j]
    J[3, 3] = w
    J[3, 4] = -z
    J[3, 5] = y
    J[4, 3] = z
    J[4, 4] = w
    J[4, 5] = -x
    J[5, 3] = -y
    J[5, 4] = x
    J[5, 5] = w
    J[6, 3] = -x
    J[6, 4] = -y
    J[6, 5] = -z
    return J


@kernel(error_model="numpy")
def bracket(group, a, b):
    """(n,) the Lie bracket [a, b] of two velocities (n,).

    Their first `group` components are a twist: 6 for rigid motions, 3 for planar ones, 0 where
    velocities commute.
    """
    c = np.zeros(a.shape[0])
    if group == 6:
        c[0] = a[4] * b[2] - a[5] * b[1] + a[1] * b[5] - a[2] * b[4]
        c[1] = a[5] * b[0] - a[3] * b[2] + a[2] * b[3] - a[0] * b[5]
        c[2] = a[3] * b[1] - a[4] * b[0] + a[0] * b[4] - a[1] * b[3]
        c[3] = a[4] * b[5] - a[5] * b[4]
        c[4] = a[5] * b[3] - a[3] * b[5]
        c[5] = a[3] * b[4] - a[4] * b[3]
    elif group == 3:
        c[0] = a[1] * b[2] - a[2] * b[1]
        c[1] = a[2] * b[0] - a[0] * b[2]
    return c


def continuous_signs(quaternions: Array) -> Array:
    """(N,) signs, 1 or −1, with which quaternions (N, 4) are continuous in time."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0
    return np.cumprod(np.r_[1.0, np.where(flips, -1.0, 1.0)])
