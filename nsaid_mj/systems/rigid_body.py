"""One body in its own frame: M(θ) ν̇ + C(ν, θ) ν = F(t, q, ν, u) θ, in space or in the plane.

In body axes M is constant, and C follows from it: C(ν) w = −ad_wᵀ M ν (Kirchhoff; the skew form of
Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2021, section 3.3.1).

In space q is [p, quaternion] (7,) and ν = [v, ω] (6,), both in the body's axes; in the plane q is
[x, y, ψ] (3,) and ν = [u, v, r] (3,). Position coordinates, as sensors give them, are [p, rotation
vector] (6,) in space.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numba import njit

from ..dynamics.forward import Body, forces_along
from ..dynamics.motions import BodyMotion, force_regressors
from ..dynamics.structures import ConstantInertia
from ..log import Log, Middle
from ..numerics.interpolation import body_midpoints
from ..numerics.linalg import evaluate
from ..numerics.spatial import (
    coadjoint,
    planar_difference,
    planar_integrate,
    pose_difference,
    pose_integrate,
    pose_jacobian,
    quaternion_of,
)
from ..parameters import Array, Block, ParameterSpace
from ..system import SecondOrderSystem, Stage

SPATIAL_UNITS = ("m/s",) * 3 + ("rad/s",) * 3
PLANAR_UNITS = ("m/s", "m/s", "rad/s")
INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
INERTIAL_LABELS = ("mass", "m·cx", "m·cy", "m·cz", *INERTIAL[4:])
INERTIAL_UNITS = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6


class RigidBody(SecondOrderSystem):
    """A body whose M is linear in θ and constant in its own frame.

    A subclass supplies its forces, a tuple with a compiled function registered by
    `dynamics.forward.force_law`, and `random_state`. As C w = −ad_wᵀ h with h = M v, an
    identifier need not form W_M and W_C.

    Args:
        space: names, units and scale of θ.
        mass_tensor: (n, n, p) with M(θ) = mass_tensor · θ, symmetric in its first two axes.
        n_u: number of commands.
        mounts: (k, 3) point of application of every actuator parameter's force, in the body's
            axes [m].
        law: of the forces.

    Attributes:
        inertia: M(θ), sparse.
    """

    inertia: ConstantInertia
    mounts: Array

    def __init__(
        self, space: ParameterSpace, mass_tensor: Array, n_u: int, mounts: Array, law: Any
    ):
        self.space, self.n_u, self.mounts = space, n_u, mounts
        self.n = self.group = len(mass_tensor)
        self.m = 7 if self.n == 6 else 3
        self.velocity_units = SPATIAL_UNITS if self.n == 6 else PLANAR_UNITS
        entries = np.argwhere(mass_tensor)
        self.inertia = ConstantInertia(entries, mass_tensor[tuple(entries.T)])
        self.forward = Body(self.inertia, self.group, law)

    def _W_M(self, q: Array, a: Array) -> Array:
        return momentum(*self.inertia, self.p, a)

    def _W_C(self, q: Array, v: Array, w: Array) -> Array:
        return turned(self.group, w, momentum(*self.inertia, self.p, v))

    def _F(self, t: float, q: Array, v: Array, u: Array) -> Array:
        return forces_along(self.forward.forces, q[None], v[None], u[None], self.p)[0]

    def forces(self, t: Array, q: Array, v: Array, u: Array) -> Array:
        """(N, n, p) F for N samples, in one compiled call."""
        return forces_along(self.forward.forces, q, v, u, self.p)

    def _W(self, t: float, q: Array, v: Array, w: Array, a: Array, u: Array) -> Array:
        return self._W_M(q, a) + self._W_C(q, v, w) - self._F(t, q, v, u)

    def _transport(self, q: Array, v: Array) -> Array:
        return -self._W_C(q, v, v)  # M is constant in the body, and C skew

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """The acceleration (29), the regressor (10, 31) and M̂'s smallest pivot at one sample."""
        return Stage(*evaluate(self._constant, self._W_C(q, v, w), self._F(t, q, v, u), theta))

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        return Middle(*body_midpoints(self.group, log.t, log.q, log.v, hermite))

    def motion(self, log: Log, hermite: bool) -> BodyMotion:
        """The body's motion along a log."""
        middle = self.midpoints(log, hermite)
        F = force_regressors(self, log, middle)
        return BodyMotion(self.inertia, self.group, log.t, log.v, middle.v, F)

    def momentum_balance(
        self, leak: float, log: Log, q: Array, v: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Terms of the filtered momentum balance, compiled but for F."""
        t, held, (entries, values), group = log.t, log.u[:-1], self.inertia, self.group
        momenta = np.zeros((*log.v.shape, self.p))
        drive = np.zeros((*log.v.shape, self.p))
        write_drive(entries, values, group, leak, log.v, momenta, drive)
        half = self.forces(0.5 * (t[:-1] + t[1:]), q, v, held)
        write_drive(entries, values, group, leak, v, np.zeros(half.shape), half)
        start = drive[:-1] + self.forces(t[:-1], log.q[:-1], log.v[:-1], held)
        end = drive[1:] + self.forces(t[1:], log.q[1:], log.v[1:], held)
        return momenta, start, half, end

    def _mass_tensor(self, q: Array) -> Array:
        return self._constant

    @cached_property
    def _constant(self) -> Array:
        return np.stack([self._W_M(np.zeros(self.m), e) for e in np.eye(self.n)])

    def integrate(self, q: Array, dq: Array) -> Array:
        """(m,) the pose reached from q by the twist dq held for one second."""
        return pose_integrate(q, dq) if self.n == 6 else planar_integrate(q, dq)

    def difference(self, q0: Array, q1: Array) -> Array:
        """(n,) the twist that, held for one second, leads from q0 to q1; the shorter rotation."""
        return pose_difference(q0, q1) if self.n == 6 else planar_difference(q0, q1)

    def J(self, q: Array) -> Array:
        """(m, n) of q̇ = J ν (3): ṗ = R v, and half the quaternion times ω; ψ̇ = r."""
        if self.n == 6:
            return pose_jacobian(q)
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def position(self, coordinates: Array) -> Array:
        """(..., m) pose of position coordinates (..., n)."""
        coordinates = np.asarray(coordinates, dtype=np.float64)
        if self.n == 3:
            return coordinates.copy()
        if coordinates.ndim == 1:
            return np.concatenate([coordinates[:3], quaternion_of(coordinates[3:])])
        poses = np.empty((*coordinates.shape[:-1], 7))
        poses[..., :3] = coordinates[..., :3]
        for numbers, pose in zip(coordinates.reshape(-1, 6), poses.reshape(-1, 7), strict=True):
            pose[3:] = quaternion_of(numbers[3:])
        return poses


@njit(cache=True)
def momentum(entries, values, p, v):
    """(n, p) regressor of M v, for the `ConstantInertia` (entries, values) of M."""
    W = np.zeros((v.shape[0], p))
    for e in range(values.shape[0]):
        i, j, k = entries[e]
        W[i, k] += values[e] * v[j]
    return W


@njit(cache=True)
def write_drive(entries, values, group, leak, v, momenta, drive):
    """Adds M v to `momenta` (N, n, p) and a M v + Cᵀ v to `drive`, as regressors, for v (N, n).

    As Cᵀ v = −C v = ad_vᵀ M v, every entry M_ij = c θ_k contributes c v_j ad_vᵀ e_i to Cᵀ v.
    """
    n = v.shape[1]
    push, unit = np.empty((n, n)), np.zeros(n)
    for s in range(v.shape[0]):
        for i in range(n):
            unit[i] = 1.0
            push[i] = coadjoint(group, v[s], unit)
            unit[i] = 0.0
        for e in range(values.shape[0]):
            i, j, k = entries[e]
            own = values[e] * v[s, j]
            momenta[s, i, k] += own
            drive[s, i, k] += leak * own
            for r in range(n):
                drive[s, r, k] += own * push[i, r]


@njit(cache=True)
def turned(group, w, W):
    """(n, p) regressor of C w = −ad_wᵀ h, from the regressor W (n, p) of the momentum h."""
    result = np.empty(W.shape)
    for k in range(W.shape[1]):
        result[:, k] = -coadjoint(group, w, np.ascontiguousarray(W[:, k]))
    return result


def symmetric(n: int, start: int, p: int) -> Array:
    """(n, n, p) mass tensor of an `spd` block at `start`: the upper triangle, row by row."""
    tensor = np.zeros((n, n, p))
    for k, (i, j) in enumerate(zip(*np.triu_indices(n), strict=True)):
        tensor[i, j, start + k] = tensor[j, i, start + k] = 1.0
    return tensor


def of_a_body(start: int, p: int) -> Array:
    """(6, 6, p) mass tensor of the ten inertial parameters (m, m c, I about the origin) of a body.

    The order is Pinocchio's: m, m c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
    """
    tensor = np.zeros((6, 6, p))
    for i in range(3):
        tensor[i, i, start] = 1.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        # M = [[m, −S(h)], [S(h), I]], with S(h)_ij = −h_k for cyclic i, j, k
        tensor[i, 3 + j, start + 1 + k] = tensor[3 + j, i, start + 1 + k] = 1.0
        tensor[j, 3 + i, start + 1 + k] = tensor[3 + i, j, start + 1 + k] = -1.0
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
        tensor[3 + i, 3 + j, start + 4 + k] = tensor[3 + j, 3 + i, start + 4 + k] = 1.0
    return tensor


def inertial_block(name: str, mass: float, offset: float, inertia: Array) -> Block:
    """The ten inertial parameters of a body, in the order of `of_a_body`.

    Args:
        name: of the block.
        mass: guess [kg].
        offset: guess of how far the centre of mass may lie from the origin [m].
        inertia: (3,) guess of the moments of inertia [kg·m²]; products are a quarter of them.
    """
    x, y, z = inertia
    products = 0.25 * np.sqrt([x * y, x * z, y * z])
    moments = [x, products[0], y, products[1], products[2], z]
    scale = np.array([mass, *[mass * offset] * 3, *moments])
    return Block(
        name, INERTIAL, INERTIAL_UNITS, scale, "pseudo_inertia", labels=inertial_labels(name)
    )


def inertial_labels(body: str) -> tuple[str, ...]:
    """Labels of a body's ten inertial parameters; m·cx is the first moment of mass along x."""
    return tuple(f"{label} of {body}" for label in INERTIAL_LABELS)
