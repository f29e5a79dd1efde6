"""The state of a tree at one sample: kinematic quantities that do not depend on estimates."""

import numpy as np

from ..numerics.kernels import helper, index, inlined, kernel, matrix, table, vector, void
from .arrays import (
    AT_Q,
    AT_V,
    AXIS,
    CIRCLE,
    COSINE,
    COUNT,
    FALL,
    FRAME,
    FREE,
    FROM,
    HINGE,
    JOINT,
    KIND,
    OWNER,
    PARENT,
    PLACE,
    PLANAR,
    POSITION,
    RATE,
    SINE,
    SLIDE,
    TO,
    TWIST,
)
from .compiled import STRUCTURE
from .spatial import add_cross, add_turned, clear, rotate, turn_square, unrotate


@helper(void(vector, index, vector, index))
def write_rotation(q, at, R, r):
    """Writes the rotation matrix (9), body to world, of the unit quaternion (x, y, z, w) q[at]."""
    x = q[at]
    y = q[at + 1]
    z = q[at + 2]
    w = q[at + 3]
    R[r] = 1 - 2 * (y * y + z * z)
    R[r + 4] = 1 - 2 * (x * x + z * z)
    R[r + 8] = 1 - 2 * (x * x + y * y)
    R[r + 1] = 2 * (x * y - z * w)
    R[r + 2] = 2 * (x * z + y * w)
    R[r + 5] = 2 * (y * z - x * w)
    R[r + 3] = 2 * (x * y + z * w)
    R[r + 6] = 2 * (x * z - y * w)
    R[r + 7] = 2 * (y * z + x * w)


@helper(void(index, vector, vector, vector, index, index))
def _place_base(kind, gravity, q, state, frame, ground):
    """Defines the common frame by the base; gravity and the upward direction turn in it."""
    if kind == FREE:
        write_rotation(q, 3, state, frame)
    else:
        clear(state, frame, 9)
        state[frame], state[frame + 3] = np.cos(q[2]), np.sin(q[2])
        state[frame + 1], state[frame + 4] = -state[frame + 3], state[frame]
        state[frame + 8] = 1.0
    for i in range(3):
        state[ground + i] = state[frame + 6 + i]
    unrotate(state, frame, gravity, 0, state, ground + FALL)
    clear(state, frame, 12)
    state[frame] = 1.0
    state[frame + 4] = 1.0
    state[frame + 8] = 1.0


@helper(void(index, vector, index, vector, index, vector, index))
def _place_body(kind, q, at, joints, joint, state, frame):
    """Writes rotation and position of a body in its parent's frame."""
    cosine = 1.0
    sine = 0.0
    if kind == HINGE:
        cosine = np.cos(q[at])
        sine = np.sin(q[at])
    elif kind == CIRCLE:
        cosine = q[at]
        sine = q[at + 1]
    for i in range(9):
        turned = cosine * joints[joint + COSINE + i] + sine * joints[joint + SINE + i]
        state[frame + i] = joints[joint + i] + turned
    for i in range(3):
        state[frame + POSITION + i] = joints[joint + PLACE + i]
        if kind == SLIDE:
            for j in range(3):
                travel = q[at] * joints[joint + AXIS + j]
                state[frame + POSITION + i] += travel * joints[joint + 3 * i + j]


@helper(void(vector, index, index))
def _compose(state, above, frame):
    """Overwrites a pose in the parent's frame with that in the common frame."""
    for c in range(3):
        x = state[frame + c]
        y = state[frame + 3 + c]
        z = state[frame + 6 + c]
        for r in range(3):
            R = above + 3 * r
            state[frame + 3 * r + c] = state[R] * x + state[R + 1] * y + state[R + 2] * z
    p = frame + POSITION
    x = state[p]
    y = state[p + 1]
    z = state[p + 2]
    for r in range(3):
        R = above + 3 * r
        state[p + r] = (
            state[above + POSITION + r] + state[R] * x + state[R + 1] * y + state[R + 2] * z
        )


@helper(void(table, vector, index, vector, vector))
def _move(bodies, joints, b, v, state):
    """Writes a body's twist V, and S and Ṡ = V × S of its joint's velocities."""
    parent = bodies[b, PARENT]
    kind = bodies[b, KIND]
    first = bodies[b, AT_V]
    frame = b * FRAME
    axes = bodies.shape[0] * FRAME
    for i in range(TWIST, TWIST + 6):
        state[frame + i] = state[parent * FRAME + i] if parent >= 0 else 0.0
    for j in range(first, first + bodies[b, COUNT]):
        axis = axes + j * FRAME
        clear(state, axis, 6)
        if kind in (FREE, PLANAR):
            state[axis + (5 if kind == PLANAR and j == 2 else j)] = 1.0
        else:
            turns = 0 if kind == SLIDE else 3
            rotate(state, frame, joints, b * JOINT + AXIS, state, axis + turns)
            if turns > 0:
                add_cross(state, frame + POSITION, state, axis + 3, 1.0, state, axis)
        for i in range(6):
            state[frame + TWIST + i] += v[j] * state[axis + i]
    for j in range(first, first + bodies[b, COUNT]):
        axis = axes + j * FRAME
        clear(state, axis + RATE, 6)
        add_turned(state, frame + TWIST, state, axis, 1.0, state, axis + RATE)


@kernel(void(STRUCTURE, vector, vector, vector))
def place(structure, q, v, state):
    """Writes the state at q (m,) and v (n,) into state (s,); see `arrays.POSITION`."""
    bodies = structure.bodies
    joints = structure.joints
    gravity = structure.gravity
    entries = structure.entries
    values = structure.values
    terms = structure.terms
    ground = (bodies.shape[0] + v.shape[0]) * FRAME
    for i in range(3):
        state[ground + i] = 0.0
        state[ground + FALL + i] = gravity[i]
    state[ground + 2] = 1.0
    for b in range(bodies.shape[0]):
        kind = bodies[b, KIND]
        parent = bodies[b, PARENT]
        if kind in (FREE, PLANAR):
            _place_base(kind, gravity, q, state, b * FRAME, ground)
        else:
            _place_body(kind, q, bodies[b, AT_Q], joints, b * JOINT, state, b * FRAME)
            if parent >= 0:
                _compose(state, parent * FRAME, b * FRAME)
        _move(bodies, joints, b, v, state)
    for k in range(terms.shape[0]):
        at = ground + FRAME + 36 * k
        clear(state, at, 36)
        for e in range(terms[k, FROM], terms[k, TO]):
            i = entries[e, 0]
            j = entries[e, 1]
            state[at + 6 * i + j] = values[e]
            state[at + 6 * j + i] = values[e]
        turn_square(state, terms[k, OWNER] * FRAME, state, at)


_place = inlined(place)


@kernel(void(STRUCTURE, matrix, matrix, matrix), inner=True)
def place_along(structure, q, v, states):
    """Writes the states (N, s) at q (N, m) and v (N, n)."""
    for k in range(q.shape[0]):
        _place(structure, q[k], v[k], states[k])
