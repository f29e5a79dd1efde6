"""Exact forces on a floating tree in MuJoCo: water on base and links, thrusters, motors.

MuJoCo's passive forces cannot represent an inertia. The callback solves for q̈ and returns the force
under which MuJoCo's rigid bodies have this acceleration. With Q_b (6, nv) the Jacobian of the twist
ν_b of an added inertia A_b at its centre, in body axes and relative to the water,

    t = f + Σ Q_bᵀ (−C_A(ν_b) ν_b − A_b Q̇_b q̇) − bias,    (M + Σ Q_bᵀ A_b Q_b) q̈ = t,

and f_passive = M q̈ + bias. Jacobians, M and bias are MuJoCo's; its bias includes weight. All other
forces are in f, also those of the commands: MuJoCo's actuators have zero gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import carray, cfunc, njit, types

from ...numerics.linalg import solve_positive
from ...numerics.spatial import cross
from ...parameters import Array
from .callbacks import ARRAYS, WORDS, CFunction, field_offsets

_POINTS, _LENGTHS = np.polynomial.legendre.leggauss(4)  # quadrature along a cylinder, on [−1, 1]
_FLOW, _CURVE, _SPEED, _BUOYANCY, _RIGHTING = 6, 9, 18, 19, 20  # offsets in userdata
_LINEAR, _QUADRATIC, _ADDED, _HEADER = 23, 29, 35, 71
_THRUSTER, _CYLINDER, _JOINT = 8, 11, 4  # values for each, after the header


@dataclass(frozen=True)
class TreeForces:
    """Parameters of the forces on a floating tree; the base has x forward, y left, z up.

    Attributes:
        base: name of the base's body.
        added: (6, 6) the base's added mass [kg, kg·m, kg·m²].
        linear: (6,) its linear drag [N·s/m, N·m·s/rad].
        quadratic: (6,) its quadratic drag [N·s²/m², N·m·s²/rad²].
        buoyancy: of the base [N].
        righting: (3,) its r_B B − r_G W, without the part that MuJoCo's weight exerts [N·m].
        positions: (t, 3) of the thrusters on the base [m].
        directions: (t, 3) unit vectors of the thrusts.
        thrust: (t,) at full command [N].
        torque: (t,) on the base about the direction at full command [N·m].
        curve: (9,) coefficients of u, u² … u⁹ in the command curve.
        links: names of the bodies that are cylinders in water.
        centres: (k, 3) of the cylinders in their bodies' axes [m].
        axes: (k, 3) unit vectors.
        lengths: (k,) [m].
        cylinder_added: (k,) added mass across the axis [kg].
        cylinder_drag: (k,) quadratic drag across the axis per unit length [N·s²/m³].
        cylinder_buoyancy: (k,) [N].
        viscous: (j,) friction of the joints [N·m·s/rad or N·s/m].
        coulomb: (j,) friction of the joints [N·m or N].
        friction_speed: s in the Coulomb friction −c tanh(q̇/s) [rad/s or m/s].
        gain: (j,) of the motors [N·m or N per unit of command].
        flow: (3,) velocity of the water in the world [m/s].
    """

    base: str
    added: Array
    linear: Array
    quadratic: Array
    buoyancy: float
    righting: Array
    positions: Array
    directions: Array
    thrust: Array
    torque: Array
    curve: Array
    links: tuple[str, ...]
    centres: Array
    axes: Array
    lengths: Array
    cylinder_added: Array
    cylinder_drag: Array
    cylinder_buoyancy: Array
    viscous: Array
    coulomb: Array
    friction_speed: float
    gain: Array
    flow: Array

    @property
    def size(self) -> int:
        """Length of `numbers`."""
        thrusters, cylinders = _THRUSTER * len(self.thrust), _CYLINDER * len(self.links)
        return _HEADER + thrusters + cylinders + _JOINT * len(self.gain)

    def numbers(self, model: Any, motors: Array, lagged: bool) -> Array:
        """The parameters as `tree_forces` reads them from userdata.

        Args:
            model: MuJoCo's model.
            motors: (j,) index in qvel of every motor's joint.
            lagged: whether the actuators have an activation state.
        """
        counts = len(self.thrust), len(self.links), len(self.gain)
        header = [
            model.nv,
            *counts,
            float(lagged),
            model.body(self.base).id,
            *self.flow,
            *self.curve,
            self.friction_speed,
            self.buoyancy,
            *self.righting,
            *self.linear,
            *self.quadratic,
            *self.added.ravel(),
        ]
        ids = [model.body(name).id for name in self.links]
        thrusters = np.column_stack([self.positions, self.directions, self.thrust, self.torque])
        cylinders = np.column_stack(
            [
                ids,
                self.centres,
                self.axes,
                self.lengths,
                self.cylinder_added,
                self.cylinder_drag,
                self.cylinder_buoyancy,
            ]
        )
        joints = np.column_stack([motors, self.viscous, self.coulomb, self.gain])
        return np.concatenate([header, thrusters.ravel(), cylinders.ravel(), joints.ravel()])

    @property
    def gain_places(self) -> list[list[int]]:
        """For each motor, then each thruster, the indices of its gains in `numbers`."""
        thrusters, motors = len(self.thrust), len(self.gain)
        joints = _HEADER + _THRUSTER * thrusters + _CYLINDER * len(self.links)
        return [
            *([joints + _JOINT * k + 3] for k in range(motors)),
            *([_HEADER + _THRUSTER * k + i for i in (6, 7)] for k in range(thrusters)),
        ]


@njit(cache=True)
def _add_inertia(A, t, Q, turning, twist, inertia):
    """Adds Qᵀ A_b Q to A, and Qᵀ(−C_A(ν) ν − A_b Q̇q̇) to t; `turning` is Q̇q̇ (6,)."""
    momentum, force = np.dot(inertia, twist), -np.dot(inertia, turning)
    force[:3] -= cross(twist[3:], momentum[:3])  # Kirchhoff: −ω × p, −v × p − ω × h
    force[3:] -= cross(twist[:3], momentum[:3]) + cross(twist[3:], momentum[3:])
    A += np.dot(Q.T, np.dot(inertia, Q))
    t += np.dot(Q.T, force)


@njit(cache=True)
def _on_base(d, thrusters, command, twist, up):
    """(6,) wrench of water and thrusters on the base, in its axes at its origin."""
    wrench = np.empty(6)
    for i in range(6):
        wrench[i] = -(d[_LINEAR + i] + d[_QUADRATIC + i] * abs(twist[i])) * twist[i]
    wrench[:3] += d[_BUOYANCY] * up
    wrench[3:] += cross(d[_RIGHTING : _RIGHTING + 3], up)
    for k in range(thrusters):
        own = d[_HEADER + _THRUSTER * k : _HEADER + _THRUSTER * (k + 1)]
        share, power = 0.0, 1.0
        for i in range(9):
            power *= command[k]
            share += d[_CURVE + i] * power
        push = own[6] * share * own[3:6]
        wrench[:3] += push
        wrench[3:] += cross(own[:3], push) + own[7] * share * own[3:6]
    return wrench


@njit(cache=True)
def _on_cylinder(own, points, lengths, twist, up):
    """(6,) wrench of drag and buoyancy on a cylinder, in its body's axes at its centre."""
    wrench, e, half = np.zeros(6), own[4:7], 0.5 * own[7]
    wrench[:3] = own[10] * up
    for s in range(points.shape[0]):
        lever = half * points[s] * e
        flow = twist[:3] + cross(twist[3:], lever)
        flow = cross(e, cross(flow, e))  # its component across the axis
        drag = -own[9] * half * lengths[s] * np.sqrt(np.sum(flow * flow)) * flow
        wrench[:3] += drag
        wrench[3:] += cross(lever, drag)
    return wrench


@njit(cache=True)
def _cylinder_inertia(own):
    """(6, 6) added inertia of a cylinder at its centre, in its body's axes."""
    inertia, e = np.zeros((6, 6)), own[4:7]
    for i in range(3):
        for j in range(3):
            across = (1.0 if i == j else 0.0) - e[i] * e[j]
            inertia[i, j] = own[8] * across
            inertia[3 + i, 3 + j] = own[8] * own[7] ** 2 / 12 * across
    return inertia


@njit(cache=True)
def _add_joints(t, d, start, command, qvel):
    """Adds the joints' friction and motor torques to t (nv,)."""
    for k in range(command.shape[0]):
        own = d[start + _JOINT * k : start + _JOINT * (k + 1)]
        dof = int(own[0])
        t[dof] += own[3] * command[k] - own[1] * qvel[dof]
        t[dof] -= own[2] * np.tanh(qvel[dof] / d[_SPEED])


@njit(cache=True)
def _passive_force(M, bias, A, t):
    """(nv,) M q̈ + bias with A q̈ = t; NaN where A is not positive definite."""
    L = np.zeros(A.shape)
    if not solve_positive(A, L, t) > 0.0:
        return np.full(t.shape[0], np.nan)
    return np.dot(M, t) + bias


class _Places(NamedTuple):
    """What the callback needs of MuJoCo: offsets of arrays in mjData, in words, and functions."""

    qvel: int
    force: int
    user: int
    ctrl: int
    act: int
    xpos: int
    xmat: int
    full_m: CFunction
    rne: CFunction
    jac: CFunction
    jac_dot: CFunction


@njit(cache=True)
def _act(model, data, at, points, lengths):
    """Adds f_passive = M q̈ + bias to qfrc_passive; see the module.

    Args:
        model: address of mjModel.
        data: mjData, as an array of pointers.
        at: `_Places`.
        points: (s,) quadrature points along a cylinder, on [−1, 1].
        lengths: (s,) quadrature weights.
    """
    arrays: Any = carray(data, (WORDS,))
    own_data = arrays.ctypes.data
    head = carray(arrays[at.user], (_HEADER,))
    nv, thrusters, links, joints = int(head[0]), int(head[1]), int(head[2]), int(head[3])
    cylinders = _HEADER + _THRUSTER * thrusters
    motors = cylinders + _CYLINDER * links
    d = carray(arrays[at.user], (motors + _JOINT * joints,))
    command = carray(arrays[at.act if head[4] > 0 else at.ctrl], (joints + thrusters,))
    qvel = carray(arrays[at.qvel], (nv,))
    M, bias = np.zeros((nv, nv)), np.zeros(nv)
    at.full_m(model, own_data, M.ctypes.data)
    at.rne(model, own_data, np.int32(0), bias.ctypes.data)
    A, t, J, J_dot = M.copy(), -bias, np.zeros((6, nv)), np.zeros((6, nv))
    point = np.empty(3)
    for b in range(1 + links):
        own = d[cylinders + _CYLINDER * (b - 1) : cylinders + _CYLINDER * b] if b else d[5:6]
        body = int(own[0])
        R = carray(arrays[at.xmat], (body + 1, 3, 3))[body]
        point[:] = carray(arrays[at.xpos], (body + 1, 3))[body]
        if b:
            point += np.dot(R, own[1:4])
        place, number = point.ctypes.data, np.int32(body)
        at.jac(model, own_data, J.ctypes.data, J[3:].ctypes.data, place, number)
        at.jac_dot(model, own_data, J_dot.ctypes.data, J_dot[3:].ctypes.data, place, number)
        to_body = np.zeros((6, 6))
        to_body[:3, :3], to_body[3:, 3:] = R.T, R.T
        Q = np.dot(to_body, J)
        twist, turning = np.dot(Q, qvel), np.dot(to_body, np.dot(J_dot, qvel))
        twist[:3] -= np.dot(d[_FLOW : _FLOW + 3], R)  # relative to the water
        turning[:3] -= cross(twist[3:], twist[:3])
        up = R[2].copy()  # the world's z in the body's axes
        if b:
            inertia, wrench = _cylinder_inertia(own), _on_cylinder(own, points, lengths, twist, up)
        else:
            inertia = d[_ADDED : _ADDED + 36].copy().reshape(6, 6)
            wrench = _on_base(d, thrusters, command[joints:], twist, up)
        _add_inertia(A, t, Q, turning, twist, inertia)
        t += np.dot(Q.T, wrench)
    _add_joints(t, d, motors, command[:joints], qvel)
    carray(arrays[at.force], (nv,))[:] += _passive_force(M, bias, A, t)


@cache
def tree_forces() -> Any:
    """Callback for a model made by `tree_spec`; it reads `TreeForces.numbers` from userdata."""
    fields = ("qvel", "qfrc_passive", "userdata", "ctrl", "act", "xpos", "xmat")
    offsets, pointer, number = field_offsets(), types.uintp, types.intc
    functions = [
        CFunction("mj_fullM", pointer, pointer, pointer),
        CFunction("mj_rne", pointer, pointer, number, pointer),
        CFunction("mj_jac", *[pointer] * 5, number),
        CFunction("mj_jacDot", *[pointer] * 5, number),
    ]
    places: list[Any] = [*(offsets[name] for name in fields), *functions]
    at = _Places(*places)
    points, lengths = _POINTS, _LENGTHS

    @cfunc(types.void(pointer, ARRAYS))
    def passive(model, data):
        _act(model, data, at, points, lengths)

    return passive
