"""All forces that MuJoCo does not model, in one callback: a structure's columns at the true θ.

MuJoCo's passive forces cannot represent inertia. If the structure has inertia beyond that of
MuJoCo's bodies, such as added mass, the callback solves for q̈ and returns the force that gives
MuJoCo's bodies this acceleration. With v_r the structure's velocity relative to the water or the
air, whose flow is constant in the world, and v = T q̇,

    t = Tᵀ (F θ − C_A(v_r) v_r + M_A (ω × v_r)) − bias,    (M + Tᵀ M_A T) q̈ = t,

and f_passive = M q̈ + bias; otherwise it is Tᵀ F θ. M and the bias, which includes weight, are
MuJoCo's; M_A, C_A and F are the structure's at a θ without the parameters of MuJoCo's bodies. A
command acts through F only: MuJoCo's actuators have zero gain.
"""

import ctypes
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import f8, i8, types, void

from ....core import (
    ACTING,
    Acting,
    Array,
    SecondOrderSystem,
    act,
    act_on_joints,
    kernel,
    routine,
    solve_positive,
    write_rotation,
)
from .callbacks import (
    NUMBERS,
    WORDS,
    accepted,
    array_at,
    c_function,
    field_offsets,
    matrix_of,
    pointer,
    table_of,
    vector_of,
)
from .coordinates import Reading

_TOTAL, _LAGGED, _COMMANDS, _ADDED, _FLOW = range(5)
_GROUP, _POSE, _PLACED, _LAYOUT = range(_FLOW + 3, _FLOW + 7)
"""Places in userdata: its length; whether commands are activations; their number; whether there is
inertia beyond MuJoCo's; `Forces.flow`; `Reading.group`; where the base's pose is in qpos; whether
any force depends on the bodies' poses; place, rows and columns of every part."""
_DOFS = len(Acting._fields)
_OWN = _DOFS + 1
_HEADER = _LAYOUT + 3 * (_OWN + 8)
"""Parts of the userdata, after those of `Acting`: every velocity's place in qvel, its joint's in
qpos and in q, and whether q has cosine and sine; `_ForceWorkspace`."""

_ADDRESSES = types.CPointer(types.uintp)
_full_m = c_function("mj_fullM", types.uintp, types.uintp, types.uintp)
_rne = c_function("mj_rne", types.uintp, types.uintp, types.intc, types.uintp)


@dataclass(frozen=True)
class ColumnForces:
    """The forces on a plant beyond MuJoCo's."""

    system: SecondOrderSystem  # the plant's
    theta: Array  # (p,) the true θ, with 0 for parameters of MuJoCo's own bodies or actuators
    flow: Array  # (3,) velocity of the water or the air in the world [m/s]

    def numbers(self, reading: Reading, lagged: bool) -> Array:
        """The callback's input and output, for MuJoCo's userdata.

        `lagged` says whether the actuators have an activation state.
        """
        base = [(reading.free[1] + i, 0, 0, 0) for i in range(6 if reading.group == 6 else 0)]
        joints = [(dof, at, to, circle) for at, dof, to, circle in reading.joints]
        parts = self._parts(np.array([*base, *joints], dtype=np.int64))
        places = _HEADER + np.cumsum([0, *(part.size for part in parts)])
        layout = [(at, *(*part.shape, 1)[:2]) for at, part in zip(places, parts, strict=False)]
        head = [
            places[-1],
            lagged,
            self.system.n_u,
            self.system.structure.has_added_inertia(self.theta),
            *self.flow,
            reading.group,
            reading.free[0],
            self.system.structure.acts_on_bodies(self.theta),
        ]
        flat = [np.ascontiguousarray(part).ravel().view(np.float64) for part in parts]
        return np.concatenate([head, np.ravel(layout), *flat], dtype=np.float64)

    def _parts(self, dofs: Any) -> list[Any]:
        """The parts of the userdata, with the places of all velocities (n, 4)."""
        n = self.system.n
        own = [np.zeros(size) for size in (self.system.m, n, n, 9, n, n, (n, n), (n, n))]
        return [*self.system.structure.acting(self.theta), dofs, *own]

    @property
    def size(self) -> int:
        """Length of `numbers`."""
        parts = self._parts(np.zeros((self.system.n, 4), dtype=np.int64))
        return _HEADER + sum(part.size for part in parts)

    @property
    def gain_places(self) -> list[list[int]]:
        """For every command, the indices in `numbers` of its actuator's parameters."""
        structure = self.system.structure
        start = _HEADER + sum(part.size for part in structure.arrays)  # θ stands behind these
        return [[start + k for k in own] for own in structure.gains_of_commands()]


class _ForceWorkspace(NamedTuple):
    """The callback's workspace."""

    q: Array  # (m,) the structure's position
    v: Array  # (n,) v_r
    ground: Array  # (n,) the velocity on the ground
    R: Array  # (9,) the base's axes in the world
    force: Array  # (n,) force of all columns, then the total
    bias: Array  # (n,) MuJoCo's
    M: Array  # (n, n) MuJoCo's
    A: Array  # (n, n) M + Tᵀ M_A T


_MEMORY = types.NamedTuple((f8[::1],) * 6 + (f8[:, ::1],) * 2, _ForceWorkspace)


@routine(void(f8[::1], f8[::1], f8[::1], f8))
def _into_base(d, R, v, sign):
    """Adds the flow times a sign to the base's velocity in v (n,), and turns it into its axes."""
    size = 3 if d[_GROUP] == 6 else 2 if d[_GROUP] == 3 else 0
    x = v[0] + sign * d[_FLOW]
    y = v[1] + sign * d[_FLOW + 1] if size else 0.0
    z = v[2] + sign * d[_FLOW + 2] if size == 3 else 0.0
    for i in range(size):
        v[i] = R[i] * x + R[3 + i] * y + R[6 + i] * z


@routine(void(f8[::1], f8[::1], f8[::1]))
def _into_world(d, R, x):
    """Turns the base's linear part of a force x (n,) from its axes into the world's."""
    size = 3 if d[_GROUP] == 6 else 2 if d[_GROUP] == 3 else 0
    if size:
        a = x[0]
        b = x[1]
        c = x[2] if size == 3 else 0.0
        for i in range(size):
            x[i] = R[3 * i] * a + R[3 * i + 1] * b + R[3 * i + 2] * c


@routine(void(f8[::1], i8[:, ::1], f8[::1], f8[::1], _MEMORY))
def _read(d, dofs, qpos, qvel, own):
    """Writes q, both velocities and the base's axes, from MuJoCo's state."""
    q = own.q
    v = own.v
    R = own.R
    free = 6 if d[_GROUP] == 6 else 0
    if free:
        at = np.int64(d[_POSE])
        for i in range(3):
            q[i] = qpos[at + i]
            q[3 + i] = qpos[at + 4 + i]
        q[6] = qpos[at + 3]
        write_rotation(q, 3, R, 0)
    for k in range(free, v.shape[0]):
        angle = qpos[dofs[k, 1]]
        to = dofs[k, 2]
        q[to] = angle
        if dofs[k, 3]:
            q[to], q[to + 1] = np.cos(angle), np.sin(angle)
    if d[_GROUP] == 3:
        R[0], R[1], R[3], R[4] = np.cos(q[2]), -np.sin(q[2]), np.sin(q[2]), np.cos(q[2])
    for i in range(v.shape[0]):
        v[i] = own.ground[i] = qvel[dofs[i, 0]]
    _into_base(d, R, v, -1.0)
    _into_base(d, R, own.ground, 0.0)


@routine(void(f8[::1], i8[:, ::1], ACTING, _MEMORY))
def _push(d, dofs, acting, own):
    """Overwrites F θ − C_A v_r with M q̈ + bias, both of the base in the world's axes.

    M_A's lower triangle is in `acting`.
    """
    v = own.v
    R = own.R
    force = own.force
    A = own.A
    added = acting.M
    L = acting.L
    M = own.M
    bias = own.bias
    n = force.shape[0]
    for i in range(n):
        for j in range(i):
            added[j, i] = added[i, j]
    x = -v[2] * v[1]  # ω × v_r, of a body in the plane
    y = v[2] * v[0]
    z = 0.0
    if d[_GROUP] == 6:
        x = v[4] * v[2] - v[5] * v[1]
        y = v[5] * v[0] - v[3] * v[2]
        z = v[3] * v[1] - v[4] * v[0]
    for i in range(n):
        force[i] += added[i, 0] * x + added[i, 1] * y + added[i, 2] * z
    for _ in range(2):  # Tᵀ M_A T
        for i in range(n):
            _into_world(d, R, added[i])
            for j in range(i):
                added[i, j], added[j, i] = added[j, i], added[i, j]
    _into_world(d, R, force)
    for i in range(n):
        force[i] -= bias[dofs[i, 0]]
        for j in range(i + 1):
            A[i, j] = added[i, j] + M[dofs[i, 0], dofs[j, 0]]
    if not solve_positive(A, L, force) > 0.0:
        for i in range(n):
            force[i] = np.nan
    for i in range(n):
        L[0, i] = bias[dofs[i, 0]]
        for j in range(n):
            L[0, i] += M[dofs[i, 0], dofs[j, 0]] * force[j]
    for i in range(n):
        force[i] = L[0, i]


_VIEWS = types.UniTuple(f8[::1], 5)  # of userdata, commands, qpos, qvel and qfrc_passive


@routine(_VIEWS(types.uintp, i8, i8, i8, i8, i8, i8), _nrt=True)
def _views(data, at_user, at_ctrl, at_act, at_q, at_v, at_force):
    """Views of mjData's arrays, at the words where their addresses are."""
    arrays = array_at(pointer(data, _ADDRESSES), WORDS)
    d = array_at(pointer(arrays[at_user], NUMBERS), WORDS)
    commands = arrays[at_act] if d[_LAGGED] > 0 else arrays[at_ctrl]
    u = array_at(pointer(commands, NUMBERS), np.int64(d[_COMMANDS]))
    qpos = array_at(pointer(arrays[at_q], NUMBERS), WORDS)
    qvel = array_at(pointer(arrays[at_v], NUMBERS), WORDS)
    return d, u, qpos, qvel, array_at(pointer(arrays[at_force], NUMBERS), WORDS)


@routine(ACTING(types.uintp), _nrt=True)
def _acting(user):
    """The structure with θ and workspace, in userdata at an address."""
    return Acting(
        table_of(user, _LAYOUT, 0),
        vector_of(user, _LAYOUT, 1),
        vector_of(user, _LAYOUT, 2),
        table_of(user, _LAYOUT, 3),
        table_of(user, _LAYOUT, 4),
        vector_of(user, _LAYOUT, 5),
        table_of(user, _LAYOUT, 6),
        table_of(user, _LAYOUT, 7),
        vector_of(user, _LAYOUT, 8),
        table_of(user, _LAYOUT, 9),
        vector_of(user, _LAYOUT, 10),
        vector_of(user, _LAYOUT, 11),
        vector_of(user, _LAYOUT, 12),
        matrix_of(user, _LAYOUT, 13),
        matrix_of(user, _LAYOUT, 14),
        matrix_of(user, _LAYOUT, 15),
        vector_of(user, _LAYOUT, 16),
        vector_of(user, _LAYOUT, 17),
        vector_of(user, _LAYOUT, 18),
    )


@routine(void(types.uintp, f8[::1], f8[::1], f8[::1], f8[::1]), _nrt=True)
def _act_on_joints(user, u, qpos, qvel, passive):
    """Adds the forces on joints, where none depends on the bodies' poses."""
    acting = _acting(user)
    dofs = table_of(user, _LAYOUT, _DOFS)
    angles = vector_of(user, _LAYOUT, _OWN + 1)
    rates = vector_of(user, _LAYOUT, _OWN + 2)
    force = vector_of(user, _LAYOUT, _OWN + 4)
    for i in range(force.shape[0]):
        angles[i] = qpos[dofs[i, 1]]
        rates[i] = qvel[dofs[i, 0]]
        force[i] = passive[dofs[i, 0]]
    act_on_joints(acting, angles, rates, u, force)
    for i in range(force.shape[0]):
        passive[dofs[i, 0]] = force[i]


@routine(void(types.uintp, types.uintp, types.uintp, *(f8[::1],) * 5), _nrt=True)
def _act_on_bodies(model, data, user, d, u, qpos, qvel, passive):
    """Adds all forces, from arrays in userdata."""
    acting = _acting(user)
    own = _ForceWorkspace(
        vector_of(user, _LAYOUT, _OWN),
        vector_of(user, _LAYOUT, _OWN + 1),
        vector_of(user, _LAYOUT, _OWN + 2),
        vector_of(user, _LAYOUT, _OWN + 3),
        vector_of(user, _LAYOUT, _OWN + 4),
        vector_of(user, _LAYOUT, _OWN + 5),
        matrix_of(user, _LAYOUT, _OWN + 6),
        matrix_of(user, _LAYOUT, _OWN + 7),
    )
    dofs = table_of(user, _LAYOUT, _DOFS)
    added = d[_ADDED] > 0
    flowing = d[_FLOW] != 0.0 or d[_FLOW + 1] != 0.0 or d[_FLOW + 2] != 0.0
    _read(d, dofs, qpos, qvel, own)
    act(acting, own.q, own.v, own.ground, u, added, flowing, own.force)
    if added:
        _full_m(model, data, user + types.uintp(8 * d[_LAYOUT + 3 * (_OWN + 6)]))
        _rne(model, data, np.int32(0), user + types.uintp(8 * d[_LAYOUT + 3 * (_OWN + 5)]))
        _push(d, dofs, acting, own)
    else:
        _into_world(d, own.R, own.force)
    for i in range(own.force.shape[0]):
        passive[dofs[i, 0]] += own.force[i]


@kernel(void(types.uintp, types.uintp, i8, i8, i8, i8, i8, i8), inner=True, _nrt=True)
def _act(model, data, user, ctrl, act, q, v, force):
    """Adds all forces to qfrc_passive; the integers are `field_offsets` of mjData's arrays."""
    d, u, qpos, qvel, pushed = _views(data, user, ctrl, act, q, v, force)
    if not accepted(u):
        return
    if d[_PLACED] > 0:
        _act_on_bodies(model, data, d.ctypes.data, d, u, qpos, qvel, pushed)
    else:
        _act_on_joints(d.ctypes.data, u, qpos, qvel, pushed)


@cache
def column_forces() -> Any:
    """The callback, which reads `Forces.numbers` in userdata and adds to qfrc_passive.

    It is the same for all robots: a second one would compile the same columns again.
    """
    offsets = field_offsets()
    user, ctrl, act, q, v, force = (
        offsets[name] for name in ("userdata", "ctrl", "act", "qpos", "qvel", "qfrc_passive")
    )

    @kernel(void(types.uintp, types.uintp), inner=True, no_cfunc_wrapper=False)
    def passive(model, data):
        _act(model, data, user, ctrl, act, q, v, force)

    return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(passive.callback)
