"""All forces that MuJoCo does not have, in one callback: the columns of a structure at the true θ.

MuJoCo's passive forces cannot represent an inertia. Where the structure has some that MuJoCo's
bodies have not, such as added mass, the callback solves for q̈ and returns the force under which
MuJoCo's own bodies have this acceleration. With v_r the structure's velocity relative to the water
or the air, whose flow is constant in the world, and v = T q̇,

    t = Tᵀ (F θ − C_A(v_r) v_r + M_A (ω × v_r)) − bias,    (M + Tᵀ M_A T) q̈ = t,

and f_passive = M q̈ + bias; otherwise it is Tᵀ F θ. M and the bias, which includes weight, are
MuJoCo's; M_A, C_A and F are the structure's at a θ without what MuJoCo's bodies have. A command
acts through F only: MuJoCo's actuators have zero gain.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numba import carray, cfunc, njit, types

from ...numerics.linalg import solve_positive
from ...parameters import Array
from ...structure.arrays import StructureArrays, Workspace
from ...structure.columns import KINDS
from ...structure.compiled import FAST, Kernel, i8, vector, void
from ...structure.forces import add_forces
from ...structure.kinematics import place, write_rotation
from ...structure.stage import write_equations
from ...structure.structure import Structure
from .callbacks import ARRAYS, WORDS, c_function, field_offsets
from .coordinates import Reading

_TOTAL, _LAGGED, _COMMANDS, _ADDED, _FLOW, _GROUP, _POSE, _LAYOUT = 0, 1, 2, 3, 4, 7, 8, 9
"""Places in userdata: its length; whether commands are activations; their number; whether there is
inertia beyond MuJoCo's; `Forces.flow`; `Reading.group`; where the base's pose is in qpos; place,
rows and columns of every part."""
_DOFS, _THETA, _OWN, _WORK = 10, 11, 12, 22
_HEADER = _LAYOUT + 3 * (_WORK + len(Workspace._fields))
"""Parts of the userdata, after those of `StructureArrays`: of every velocity its place in qvel, its
joint's in qpos and in q, and whether q has cosine and sine; θ; `_Memory`; a stage's memory."""

_full_m = c_function("mj_fullM", types.uintp, types.uintp, types.uintp)
_rne = c_function("mj_rne", types.uintp, types.uintp, types.intc, types.uintp)


@dataclass(frozen=True)
class Forces:
    """The forces on a plant beyond MuJoCo's.

    Attributes:
        structure: of the plant.
        theta: (p,) the true θ, but 0 for what MuJoCo's own bodies or actuators have.
        flow: (3,) velocity of the water or the air in the world [m/s].
    """

    structure: Structure
    theta: Array
    flow: Array

    def numbers(self, reading: Reading, lagged: bool) -> Array:
        """What the callback reads and writes, for MuJoCo's userdata.

        Args:
            reading: where the structure's coordinates are in MuJoCo's.
            lagged: whether the actuators have an activation state.
        """
        base = [(reading.free[1] + i, 0, 0, 0) for i in range(6 if reading.group == 6 else 0)]
        joints = [(dof, at, to, circle) for at, dof, to, circle in reading.joints]
        parts = self._parts(np.array([*base, *joints], dtype=np.int64))
        places = _HEADER + np.cumsum([0, *(part.size for part in parts)])
        layout = [(at, *(*part.shape, 1)[:2]) for at, part in zip(places, parts, strict=False)]
        commands, flow = self.structure.n_u, self.flow
        head = [places[-1], lagged, commands, self.added, *flow, reading.group, reading.free[0]]
        flat = [np.ascontiguousarray(part).ravel().view(np.float64) for part in parts]
        return np.concatenate([head, np.ravel(layout), *flat], dtype=np.float64)

    def _parts(self, dofs: Any) -> list[Any]:
        """The parts of the userdata, with the places of all velocities (n, 4)."""
        s, n = self.structure, self.structure.n
        memory = s.m, n, n, 9, n, n, (n, n), (n, n), s.state_size, s.state_size
        own = [np.zeros(size) for size in memory]
        return [*s.arrays, dofs, np.array(self.theta, dtype=np.float64), *own, *s.workspace()]

    @property
    def size(self) -> int:
        """Length of `numbers`."""
        parts = self._parts(np.zeros((self.structure.n, 4), dtype=np.int64))
        return _HEADER + sum(part.size for part in parts)

    @property
    def added(self) -> bool:
        """Whether there is inertia beyond MuJoCo's."""
        return any(
            self.theta[i.start : i.start + i.tensor.shape[2]].any()
            for i in self.structure.inertias
            if i.tensor is not None
        )

    @property
    def gain_places(self) -> list[list[int]]:
        """For every command, the indices in `numbers` of its actuator's parameters."""
        start = _HEADER + sum(part.size for part in self.structure.arrays) + 4 * self.structure.n
        acting = [c for c in self.structure.columns if KINDS[c.kind].actuator]
        return [
            sorted({start + c.parameter for c in acting if c.input == k})
            for k in range(self.structure.n_u)
        ]


class _Memory(NamedTuple):
    """What the callback writes.

    Attributes:
        q: (m,) the structure's position.
        v: (n,) v_r.
        ground: (n,) the velocity on the ground.
        R: (9,) the base's axes in the world.
        force: (n,) of all columns, then of all that acts.
        bias: (n,) MuJoCo's.
        M: (n, n) MuJoCo's.
        A: (n, n) M + Tᵀ M_A T.
        state: (s,) of `kinematics.place` at v_r.
        on_ground: (s,) the same at the velocity on the ground.
    """

    q: Array
    v: Array
    ground: Array
    R: Array
    force: Array
    bias: Array
    M: Array
    A: Array
    state: Array
    on_ground: Array


@njit(cache=True, **FAST)
def _into_base(d, R, v, sign):
    """Adds the flow times a sign to the base's velocity in v (n,), and turns it into its axes."""
    size = 3 if d[_GROUP] == 6 else 2 if d[_GROUP] == 3 else 0
    x, y = v[0] + sign * d[_FLOW], v[1] + sign * d[_FLOW + 1] if size else 0.0
    z = v[2] + sign * d[_FLOW + 2] if size == 3 else 0.0
    for i in range(size):
        v[i] = R[i] * x + R[3 + i] * y + R[6 + i] * z


@njit(cache=True, **FAST)
def _into_world(d, R, x):
    """Turns the base's linear part of a force x (n,) from its axes into the world's."""
    size = 3 if d[_GROUP] == 6 else 2 if d[_GROUP] == 3 else 0
    if size:
        a, b, c = x[0], x[1], x[2] if size == 3 else 0.0
        for i in range(size):
            x[i] = R[3 * i] * a + R[3 * i + 1] * b + R[3 * i + 2] * c


@njit(cache=True, **FAST)
def _read(d, dofs, qpos, qvel, own):
    """Writes q, both velocities and the base's axes, from MuJoCo's state."""
    q, v, R, free = own.q, own.v, own.R, 6 if d[_GROUP] == 6 else 0
    if free:
        at = int(d[_POSE])
        for i in range(3):
            q[i], q[3 + i] = qpos[at + i], qpos[at + 4 + i]
        q[6] = qpos[at + 3]
        write_rotation(q, 3, R, 0)
    for k in range(free, v.shape[0]):
        angle, to = qpos[dofs[k, 1]], dofs[k, 2]
        q[to] = angle
        if dofs[k, 3]:
            q[to], q[to + 1] = np.cos(angle), np.sin(angle)
    if d[_GROUP] == 3:
        R[0], R[1], R[3], R[4] = np.cos(q[2]), -np.sin(q[2]), np.sin(q[2]), np.cos(q[2])
    for i in range(v.shape[0]):
        v[i] = own.ground[i] = qvel[dofs[i, 0]]
    _into_base(d, R, v, -1.0)
    _into_base(d, R, own.ground, 0.0)


@njit(cache=True, **FAST)
def _push(d, dofs, work, own):
    """Overwrites F θ − C_A v_r by M q̈ + bias, both of the base in the world's axes.

    M_A's lower triangle is in the stage's memory.
    """
    v, R, force, A, added, L = own.v, own.R, own.force, own.A, work.M, work.L
    M, bias, n = own.M, own.bias, force.shape[0]
    for i in range(n):
        for j in range(i):
            added[j, i] = added[i, j]
    x, y, z = -v[2] * v[1], v[2] * v[0], 0.0  # ω × v_r, of a body in the plane
    if d[_GROUP] == 6:
        x = v[4] * v[2] - v[5] * v[1]
        y, z = v[5] * v[0] - v[3] * v[2], v[3] * v[1] - v[4] * v[0]
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


@njit(inline="always")
def _vector(d, k):
    """Part k of the userdata d."""
    at = int(d[_LAYOUT + 3 * k])
    return d[at : at + int(d[_LAYOUT + 3 * k + 1]) * int(d[_LAYOUT + 3 * k + 2])]


@njit(inline="always")
def _matrix(d, k, x):
    """Part k of the userdata d, of rows and columns, as numbers of x: d, or its integers."""
    at, rows = int(d[_LAYOUT + 3 * k]), int(d[_LAYOUT + 3 * k + 1])
    columns = int(d[_LAYOUT + 3 * k + 2])
    return x[at : at + rows * columns].reshape((rows, columns))


@njit(inline="always")
def _workspace(d):
    """The memory of a stage."""
    return Workspace(
        _vector(d, _WORK), _vector(d, _WORK + 1), _matrix(d, _WORK + 2, d),
        _matrix(d, _WORK + 3, d), _matrix(d, _WORK + 4, d), _vector(d, _WORK + 5),
    )  # fmt: skip


@njit(inline="always")
def _memory(d):
    """The callback's own memory."""
    return _Memory(
        _vector(d, _OWN), _vector(d, _OWN + 1), _vector(d, _OWN + 2), _vector(d, _OWN + 3),
        _vector(d, _OWN + 4), _vector(d, _OWN + 5), _matrix(d, _OWN + 6, d),
        _matrix(d, _OWN + 7, d), _vector(d, _OWN + 8), _vector(d, _OWN + 9),
    )  # fmt: skip


@partial(Kernel, signature=void(vector, i8[::1], vector, vector, vector))
def _begin(d, integers, qpos, qvel, u):
    """Writes F θ in the world's axes, or with added inertias F θ − C_A v_r in the body's."""
    structure = StructureArrays(
        _matrix(d, 0, integers), _vector(d, 1), _vector(d, 2), _matrix(d, 3, integers),
        _matrix(d, 4, integers), _vector(d, 5), _matrix(d, 6, integers), _matrix(d, 7, integers),
        _vector(d, 8), _matrix(d, 9, integers),
    )  # fmt: skip
    work, own, theta = _workspace(d), _memory(d), _vector(d, _THETA)
    _read(d, _matrix(d, _DOFS, integers), qpos, qvel, own)
    place(structure, own.q, own.v, own.state)
    if d[_FLOW] != 0.0 or d[_FLOW + 1] != 0.0 or d[_FLOW + 2] != 0.0:
        place(structure, own.q, own.ground, own.on_ground)
    else:
        for i in range(own.state.shape[0]):
            own.on_ground[i] = own.state[i]
    if d[_ADDED] > 0:
        write_equations(structure, own.state, own.v, theta, work, own.force)
    else:
        for i in range(own.force.shape[0]):
            own.force[i] = 0.0
    add_forces(structure, own.state, own.on_ground, own.q, own.v, u, theta, work.scratch, own.force)


@partial(Kernel, signature=void(vector, i8[::1], vector))
def _end(d, integers, passive):
    """Adds the forces in the world's axes to MuJoCo's."""
    own, dofs = _memory(d), _matrix(d, _DOFS, integers)
    if d[_ADDED] > 0:
        _push(d, dofs, _workspace(d), own)
    else:
        _into_world(d, own.R, own.force)
    for i in range(own.force.shape[0]):
        passive[dofs[i, 0]] += own.force[i]


@cache
def column_forces() -> Any:
    """The callback, which reads `Forces.numbers` in userdata and adds to qfrc_passive."""
    for made in (_begin, _end):
        made.load()
    offsets = field_offsets()
    at_q, at_v, at_ctrl, at_act, at_force, at_user = (
        offsets[name] for name in ("qpos", "qvel", "ctrl", "act", "qfrc_passive", "userdata")
    )

    @cfunc(types.void(types.uintp, ARRAYS), cache=True)
    def passive(model, data):
        arrays: Any = carray(data, (WORDS,))
        d = carray(arrays[at_user], (int(carray(arrays[at_user], (1,))[0]),))
        u = carray(arrays[at_act if d[_LAGGED] > 0 else at_ctrl], (int(d[_COMMANDS]),))
        qpos, qvel = carray(arrays[at_q], (WORDS,)), carray(arrays[at_v], (WORDS,))
        integers = d.view(np.int64)
        _begin(d, integers, qpos, qvel, u)
        if d[_ADDED] > 0:
            own = arrays.ctypes.data
            _full_m(model, own, d[int(d[_LAYOUT + 3 * (_OWN + 6)]) :].ctypes.data)
            _rne(model, own, np.int32(0), d[int(d[_LAYOUT + 3 * (_OWN + 5)]) :].ctypes.data)
        _end(d, integers, carray(arrays[at_force], (WORDS,)))

    return passive
