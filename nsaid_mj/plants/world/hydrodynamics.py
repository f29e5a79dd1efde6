"""Fossen's exact hydrodynamics in MuJoCo: drag, buoyancy, thrusters and added mass.

MuJoCo's passive forces cannot represent an inertia. The callback solves Fossen's equations for ν̇
and returns the force under which MuJoCo's rigid body has this acceleration:

    (M_RB + M_A) ν̇ = f(ν_r) − C_RB(ν) ν − C_A(ν_r) ν_r + M_A ν̇_c,     f_passive = M_RB ν̇ + C_RB(ν) ν

Gravity is off in MuJoCo; weight is part of f. ν_r = ν − ν_c is the velocity relative to the water.
The current is constant in the world, so that ν̇_c = −ω × v_c in body axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import carray, cfunc, njit
from scipy.linalg import eigh

from ...numerics.spatial import coadjoint, rotate, unrotate
from ...parameters import Array
from .callbacks import CALLBACK, WORDS, field_offsets

LIMIT = 16
"""Largest number of thrusters on a body."""

POWERS = 5
"""Number of odd powers of the command in the thrusters' curve: u, u³, u⁵, u⁷, u⁹."""


@dataclass(frozen=True)
class Hydrodynamics:
    """Parameters of a body in water; axes x forward, y left, z up.

    Attributes:
        rigid: (6, 6) M_RB about the body's origin [kg, kg·m, kg·m²].
        added: (6, 6) M_A, symmetric [kg, kg·m, kg·m²].
        linear: (6,) linear drag [N·s/m, N·m·s/rad].
        quadratic: (6,) quadratic drag [N·s²/m², N·m·s²/rad²].
        net_weight: weight less buoyancy [N].
        righting: (3,) r_B B − r_G W [N·m].
        positions: (k, 3) of the thrusters [m].
        directions: (k, 3) unit vectors of the thrusts.
        thrust: (k,) at full command [N].
        curve: (5,) coefficients of u, u³, u⁵, u⁷, u⁹ in the command curve.
        flow: (3,) velocity of the water in the world [m/s].
    """

    rigid: Array
    added: Array
    linear: Array
    quadratic: Array
    net_weight: float
    righting: Array
    positions: Array
    directions: Array
    thrust: Array
    curve: Array
    flow: Array

    def numbers(self, lagged: bool) -> Array:
        """The parameters as `fossen` reads them from userdata.

        Args:
            lagged: whether the actuators have an activation state.
        """
        inverse = np.linalg.inv(self.rigid + self.added)
        thrusters = np.hstack([self.positions, self.directions, self.thrust[:, None]])
        return np.concatenate(
            [
                [len(thrusters), float(lagged)],
                self.rigid.ravel(),
                self.added.ravel(),
                inverse.ravel(),
                self.linear,
                self.quadratic,
                [self.net_weight],
                self.righting,
                self.flow,
                self.curve,
                thrusters.ravel(),
            ]
        )

    @property
    def gain_places(self) -> list[list[int]]:
        """For each thruster, the index of its gain in `numbers`."""
        return [[140 + 7 * j] for j in range(len(self.thrust))]


def split_mass(M: Array, rigid: Array, added: Array) -> tuple[Array, Array]:
    """Divides a mass matrix into rigid-body and added mass; only their sum can be identified.

    The rigid body is the nominal one, times the largest factor for which the added mass exceeds the
    nominal one times this factor: both are then physical.

    Args:
        M: (6, 6) the sum, positive definite.
        rigid: (6, 6) nominal M_RB.
        added: (6, 6) nominal M_A.
    """
    share = eigh(M, rigid + added, eigvals_only=True)[0]
    return share * rigid, M - share * rigid


SIZE = 2 + 3 * 36 + 12 + 1 + 3 + 3 + 5 + 7 * LIMIT
"""Largest length of `Hydrodynamics.numbers`."""


@njit(cache=True)
def motion_in_water(attitude, qvel, flow):
    """(6,) ν, (6,) ν_r and (6,) ν̇_c of a body in a constant current, in body axes.

    Args:
        attitude: (4,) quaternion x, y, z, w, body to world.
        qvel: (6,) MuJoCo's velocity of the free joint.
        flow: (3,) velocity of the water in the world [m/s].
    """
    v, relative, carried = np.empty(6), np.empty(6), np.zeros(6)
    linear, current = unrotate(attitude, qvel[:3]), unrotate(attitude, flow)
    for i in range(3):
        v[i], v[3 + i] = linear[i], qvel[3 + i]
        relative[i], relative[3 + i] = linear[i] - current[i], qvel[3 + i]
    carried[0] = current[1] * v[5] - current[2] * v[4]  # v_c × ω: time derivative of the current
    carried[1] = current[2] * v[3] - current[0] * v[5]  # in body axes
    carried[2] = current[0] * v[4] - current[1] * v[3]
    return v, relative, carried


@njit(cache=True)
def passive_wrench(rigid, added, inverse, v, relative, carried, f):
    """(6,) M_RB ν̇ + C_RB(ν) ν in body axes, with ν̇ of Fossen's equations; see the module.

    Args:
        rigid: (6, 6) M_RB.
        added: (6, 6) M_A.
        inverse: (6, 6) of M_RB + M_A.
        v: (6,) ν.
        relative: (6,) ν_r.
        carried: (6,) ν̇_c.
        f: (6,) all other forces on the body; overwritten by the result.
    """
    momentum, stirred, a = np.zeros(6), np.zeros(6), np.zeros(6)
    for i in range(6):
        for j in range(6):
            momentum[i] += rigid[i, j] * v[j]
            stirred[i] += added[i, j] * relative[j]
            f[i] += added[i, j] * carried[j]
    turning = coadjoint(6, v, momentum)  # −C_RB(ν) ν
    lost = coadjoint(6, relative, stirred)  # −C_A(ν_r) ν_r
    f += turning + lost
    for i in range(6):
        for j in range(6):
            a[i] += inverse[i, j] * f[j]
    for i in range(6):
        f[i] = -turning[i]
        for j in range(6):
            f[i] += rigid[i, j] * a[j]
    return f


@cache
def fossen() -> Any:
    """Callback for a model whose only joint is the body's free joint.

    It reads `Hydrodynamics.numbers` from userdata.
    """
    offsets = field_offsets()
    at_qpos, at_qvel, at_force = offsets["qpos"], offsets["qvel"], offsets["qfrc_passive"]
    at_user, at_ctrl, at_act = offsets["userdata"], offsets["ctrl"], offsets["act"]

    @cfunc(CALLBACK, cache=True)
    def passive(model, data):  # noqa: ARG001 (MuJoCo's signature)
        arrays: Any = carray(data, (WORDS,))
        d = carray(arrays[at_user], (SIZE,))
        qpos = carray(arrays[at_qpos], (7,))
        qvel = carray(arrays[at_qvel], (6,))
        force = carray(arrays[at_force], (6,))
        k = int(d[0])
        command = carray(arrays[at_act if d[1] > 0 else at_ctrl], (k,))
        rigid, added = d[2:38].reshape(6, 6), d[38:74].reshape(6, 6)
        inverse = d[74:110].reshape(6, 6)
        attitude = (qpos[4], qpos[5], qpos[6], qpos[3])
        v, relative, carried = motion_in_water(attitude, qvel, d[126:129])
        f = np.zeros(6)
        for i in range(6):
            f[i] = -(d[110 + i] + d[116 + i] * abs(relative[i])) * relative[i]
        x, y, z = unrotate(attitude, (0.0, 0.0, 1.0))
        f[0], f[1], f[2] = f[0] - d[122] * x, f[1] - d[122] * y, f[2] - d[122] * z
        f[3] += d[124] * z - d[125] * y
        f[4] += d[125] * x - d[123] * z
        f[5] += d[123] * y - d[124] * x
        for j in range(k):
            px, py, pz, x, y, z, gain = d[134 + 7 * j : 141 + 7 * j]
            u = command[j]
            s = u * u
            shape = ((((d[133] * s + d[132]) * s + d[131]) * s + d[130]) * s + d[129]) * u
            x, y, z = gain * shape * x, gain * shape * y, gain * shape * z
            f[0], f[1], f[2] = f[0] + x, f[1] + y, f[2] + z
            f[3] += py * z - pz * y
            f[4] += pz * x - px * z
            f[5] += px * y - py * x
        wrench = passive_wrench(rigid, added, inverse, v, relative, carried, f)
        linear = rotate(attitude, wrench[:3])
        for i in range(3):
            force[i] += linear[i]
            force[3 + i] += wrench[3 + i]

    return passive
