"""Derivatives of v̇ = (29) with C v, by position, velocity and parameters, by recursion.

All in the common frame. With V and A a body's twist and spatial acceleration, S a velocity's axis,
λ its body's parent, I the inertia and

    Ψ̇ = V_λ × S,    Ψ̈ = A_λ × S + V_λ × Ψ̇,    Ṡ = V × S,
    B m = V ×* I m − I (V × m) + m ×* I V + ∂f/∂V m,    K m = ∂f/∂(turn) m,

where f is minus the wrench of gravity and of all columns on the body, and its derivatives are those
in the body's own axes, the derivatives of τ = Σ Jᵀ (I A + V ×* I V + f) are, for i ≼ j,

    ∂τ_j/∂q_i = S_jᵀ (B Ψ̇_i + I Ψ̈_i + K S_i),            ∂τ_j/∂v_i = S_jᵀ (B S_i + I (Ψ̇_i + Ṡ_i)),
    ∂τ_i/∂q_j = S_iᵀ (B Ψ̇_j + I Ψ̈_j + K S_j + S_j ×* f),  ∂τ_i/∂v_j = S_iᵀ (B S_j + I (Ψ̇_j + Ṡ_j)),

the term with the wrench f for i ≺ j only, and I, B, K, f summed over the bodies that j carries.
After Singh, Russell and Wensing, Efficient Analytical Derivatives of Rigid-Body Dynamics using
Spatial Vector Algebra, IEEE Robotics and Automation Letters 7 (2022), which holds for any constant
6×6 inertia. Columns are differentiated by forward differences of one body or one joint.
"""

from __future__ import annotations

from ..numerics.linalg import solve_many
from .arrays import (
    AT,
    AT_V,
    BENT,
    CONSTANTS,
    COUNT,
    DRIFT,
    FALL,
    FIRST,
    FRAME,
    INERTIA,
    INPUT,
    LAST,
    LOAD,
    MOTION,
    MOVED,
    PARAMETER,
    PARENT,
    PUSH,
    RATE,
    SLOPE,
    SORT,
    SPARE,
    SPEED_SLOPE,
    SQUARE,
    TEN,
    TURN_SLOPE,
    TWICE,
    TWIST,
)  # fmt: skip
from .columns.fluid import F as WRENCH
from .columns.joint import LOAD as LOAD_FRICTION
from .columns.joint import coordinate, joint_force
from .compiled import (
    SLOPES,
    STRUCTURE,
    WORKSPACE,
    f8,
    i8,
    kernel,
    matrix,
    routine,
    vector,
    void,
)  # fmt: skip
from .forces import BODY_KINDS, write_forces, write_surroundings, write_wrench
from .inertia import add_rigid, add_square, write_rigid, write_square
from .kinematics import place
from .poses import integrate
from .regressor import write_regressor
from .spatial import (
    add_cross,
    add_pushed,
    add_turned,
    clear,
    dot,
    out_of_body,
    turn_square,
)  # fmt: skip
from .stage import accelerate

STEP = 1e-7
"""Step of the forward differences, relative to 1 + |value|."""
_TOTAL, _KEPT = 30, 48  # in the scratch, after what `forces` uses


@routine(void(STRUCTURE, i8, vector, vector, vector, i8))
def _write_column_wrench(structure, b, u, theta, x, to):
    """Writes the sum of all columns' wrenches on a body, in its axes, into x[to : to + 6]."""
    columns = structure.columns
    clear(x, to, 6)
    for k in range(columns.shape[0]):
        if columns[k, AT] == b and columns[k, SORT] >= BODY_KINDS:
            command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
            write_wrench(columns[k, SORT], structure.constants, columns[k, CONSTANTS], command, x)
            for i in range(6):
                x[to + i] += theta[columns[k, PARAMETER]] * x[WRENCH + i]


@routine(void(STRUCTURE, i8, vector, i8, vector, vector, vector, vector, i8))
def _add_columns(structure, b, state, ground, u, theta, x, slopes, own):
    """Writes minus the columns' wrench on a body, and its derivatives, in the common frame."""
    columns, frame, busy = structure.columns, b * FRAME, False
    for k in range(columns.shape[0]):
        busy = busy or (columns[k, AT] == b and columns[k, SORT] >= BODY_KINDS)
    if not busy:
        return
    write_surroundings(state, frame, ground, x)
    _write_column_wrench(structure, b, u, theta, x, _TOTAL)
    for c in range(9):  # six twists, then three turns
        at = own + SPEED_SLOPE + c if c < 6 else own + TURN_SLOPE + c - 3
        for i in range(12):
            x[_KEPT + i] = x[i]
        step = STEP * (1.0 + abs(x[c])) if c < 6 else STEP
        if c < 6:
            x[c] += step
        else:  # what is fixed in the world turns the other way
            clear(x, 66, 3)
            x[60 + c] = 1.0
            add_cross(x, 66, x, _KEPT + 6, -step, x, 6)
            add_cross(x, 66, x, _KEPT + 9, -step, x, 9)
        _write_column_wrench(structure, b, u, theta, x, _TOTAL + 6)
        for i in range(6):
            slopes[at + 6 * i] = (x[_TOTAL + i] - x[_TOTAL + 6 + i]) / step
        for i in range(12):
            x[i] = x[_KEPT + i]
    for i in range(6):
        x[_TOTAL + i] = -x[_TOTAL + i]
    out_of_body(state, frame, x, _TOTAL, slopes, own + LOAD)
    turn_square(state, frame, slopes, own + SPEED_SLOPE)
    turn_square(state, frame, slopes, own + TURN_SLOPE)


@routine(void(STRUCTURE, i8, vector, i8, vector, vector, vector, vector, i8))
def _add_inertia(structure, b, state, ground, theta, x, inertia, slopes, own):
    """Writes I (6, 6), and adds weight and its derivative by a turn, for one body."""
    bodies, at = structure.bodies, b * INERTIA
    clear(inertia, at + SQUARE, 36)
    if bodies[b, LAST] > bodies[b, FIRST]:
        write_square(
            bodies, structure.entries, structure.values, structure.terms, b, state, ground, theta,
            inertia, at + SQUARE,
        )  # fmt: skip
    for i in range(36):
        slopes[own + i] = inertia[at + SQUARE + i]
    if bodies[b, TEN] < 0:
        return
    write_rigid(state, b * FRAME, theta, bodies[b, TEN], inertia, at)
    for c in range(6):
        clear(x, 0, 12)
        x[c] = 1.0
        add_rigid(inertia, at, x, 0, 1.0, x, 6)
        for i in range(6):
            slopes[own + 6 * i + c] += x[6 + i]
        if c >= 3:  # gravity, as the body sees it, turns by −e × g
            clear(x, 12, 12)
            add_cross(x, 3, state, ground + FALL, 1.0, x, 12)
            add_rigid(inertia, at, x, 12, 1.0, x, 18)
            for i in range(6):
                slopes[own + TURN_SLOPE + 6 * i + c] += x[18 + i]
    clear(x, 0, 6)
    for i in range(3):
        x[i] = state[ground + FALL + i]
    add_rigid(inertia, at, x, 0, -1.0, slopes, own + LOAD)


@routine(void(vector, i8, vector, i8, vector, vector, i8))
def _add_motion(state, frame, motion, at, x, slopes, own):
    """Adds I A + V ×* I V and its derivative by the twist; I (6, 6) is at slopes[own]."""
    twist = frame + TWIST
    clear(x, 0, 12)
    for i in range(6):
        x[6 + i] = motion[at + DRIFT + i] + motion[at + PUSH + i]
    add_square(slopes, own, state, twist, 1.0, x, 0)
    add_square(slopes, own, x, 6, 1.0, slopes, own + LOAD)
    add_pushed(state, twist, x, 0, 1.0, slopes, own + LOAD)
    for c in range(6):
        clear(x, 6, 24)
        x[6 + c] = 1.0
        for i in range(6):
            x[12 + i] = slopes[own + 6 * i + c]
        add_pushed(state, twist, x, 12, 1.0, x, 18)
        add_pushed(x, 6, x, 0, 1.0, x, 18)
        add_turned(state, twist, x, 6, -1.0, x, 24)
        add_square(slopes, own, x, 24, 1.0, x, 18)
        for i in range(6):
            slopes[own + SPEED_SLOPE + 6 * i + c] += x[18 + i]


@routine(void(STRUCTURE, i8, vector, vector, vector))
def _write_axes(structure, b, state, motion, axes):
    """Writes Ψ̇, Ψ̈ and Ψ̇ + Ṡ of the axes of one body's joint."""
    bodies = structure.bodies
    above, parent = bodies[b, PARENT] * FRAME + TWIST, bodies[b, PARENT]
    for j in range(bodies[b, AT_V], bodies[b, AT_V] + bodies[b, COUNT]):
        axis, out = (bodies.shape[0] + j) * FRAME, j * FRAME
        clear(axes, out, FRAME)
        if parent >= 0:
            at = parent * MOTION
            add_turned(state, above, state, axis, 1.0, axes, out + BENT)
            add_turned(motion, at + DRIFT, state, axis, 1.0, axes, out + TWICE)
            add_turned(motion, at + PUSH, state, axis, 1.0, axes, out + TWICE)
            add_turned(state, above, axes, out + BENT, 1.0, axes, out + TWICE)
        for i in range(6):
            axes[out + MOVED + i] = axes[out + BENT + i] + state[axis + RATE + i]


@routine(void(vector, i8, vector, i8, vector, i8))
def _add_transposed(A, at, x, i, y, k):
    """y += Aᵀ x of a (6, 6) matrix that begins at A[at]."""
    for r in range(6):
        for c in range(6):
            y[k + c] += A[at + 6 * r + c] * x[i + r]


@routine(void(STRUCTURE, vector, SLOPES))
def _gather(structure, x, slopes):
    """Writes ∂τ/∂q and ∂τ/∂v into `slopes.by_state`, from the tips inwards."""
    bodies, state, body, far = structure.bodies, slopes.state, slopes.bodies, slopes.axes
    A, n, rows = slopes.by_state, slopes.by_state.shape[0], bodies.shape[0] * FRAME
    for j in range(n):
        for i in range(2 * n):
            A[j, i] = 0.0
    for b in range(bodies.shape[0] - 1, -1, -1):
        at, parent = b * SLOPE, bodies[b, PARENT]
        for j in range(bodies[b, AT_V], bodies[b, AT_V] + bodies[b, COUNT]):
            axis, own = rows + j * FRAME, j * FRAME
            clear(x, 0, 36)
            add_square(body, at + SPEED_SLOPE, far, own + BENT, 1.0, x, 0)
            add_square(body, at, far, own + TWICE, 1.0, x, 0)
            add_square(body, at + TURN_SLOPE, state, axis, 1.0, x, 0)
            add_square(body, at + SPEED_SLOPE, state, axis, 1.0, x, 6)
            add_square(body, at, far, own + MOVED, 1.0, x, 6)
            _add_transposed(body, at + SPEED_SLOPE, state, axis, x, 12)
            add_square(body, at, state, axis, 1.0, x, 18)  # I is symmetric
            _add_transposed(body, at + TURN_SLOPE, state, axis, x, 24)
            add_pushed(state, axis, body, at + LOAD, 1.0, x, 30)
            ancestor = b
            while ancestor >= 0:
                first = bodies[ancestor, AT_V]
                for i in range(first, first + bodies[ancestor, COUNT]):
                    other, its = rows + i * FRAME, i * FRAME
                    A[i, j] = dot(state, other, x, 0)
                    A[i, n + j] = dot(state, other, x, 6)
                    if ancestor != b:
                        A[i, j] += dot(state, other, x, 30)
                        A[j, i] = dot(far, its + BENT, x, 12) + dot(far, its + TWICE, x, 18)
                        A[j, i] += dot(state, other, x, 24)
                        A[j, n + i] = dot(state, other, x, 12) + dot(far, its + MOVED, x, 18)
                ancestor = bodies[ancestor, PARENT]
        for i in range(SLOPE if parent >= 0 else 0):
            body[parent * SLOPE + i] += body[at + i]


@routine(void(STRUCTURE, vector, vector, vector, vector, vector, SLOPES))
def _add_joints(structure, q, v, u, theta, x, slopes):
    """Adds the derivatives of joints' columns by their own position and velocity."""
    bodies, columns, c, n = structure.bodies, structure.columns, structure.constants, v.shape[0]
    state, A, ground = slopes.state, slopes.by_state, (bodies.shape[0] + n) * FRAME
    for k in range(columns.shape[0]):
        kind, b, at = columns[k, SORT], columns[k, AT], columns[k, CONSTANTS]
        if kind >= BODY_KINDS:
            continue
        j, gain, here = bodies[b, AT_V], theta[columns[k, PARAMETER]], 0.0
        command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
        angle, rate = coordinate(bodies, b, q), v[j]
        step = STEP * (1.0 + abs(rate))
        for way in range(3):  # here, elsewhere, faster
            force = joint_force(
                kind, c, at, bodies, b, state, ground,
                angle + (STEP if way == 1 else 0.0), rate + (step if way == 2 else 0.0), command, x,
            )  # fmt: skip
            if way == 0:
                here = force
            elif way == 1:
                A[j, j] -= gain * (force - here) / STEP
            else:
                A[j, n + j] -= gain * (force - here) / step


@routine(void(STRUCTURE, vector, vector, vector, WORKSPACE, SLOPES))
def _add_loads(structure, q, v, theta, work, slopes):
    """Adds the derivatives of load-dependent friction by all positions; overwrites the state.

    That is the only kind of a joint that depends on other joints' positions.
    """
    bodies, columns, c, x = structure.bodies, structure.columns, structure.constants, work.scratch
    ground, way, moved = (bodies.shape[0] + v.shape[0]) * FRAME, work.rows[SPARE], slopes.flow[0]
    for k in range(columns.shape[0]):
        if columns[k, SORT] != LOAD_FRICTION:
            continue
        b, at, gain, here = columns[k, AT], columns[k, CONSTANTS], theta[columns[k, PARAMETER]], 0.0
        for i in range(-1, v.shape[0]):
            for j in range(v.shape[0]):
                way[j] = STEP if i == j else 0.0
            integrate(bodies, q, way, moved, x)
            place(structure, moved, v, slopes.state)
            rate = v[bodies[b, AT_V]]
            force = joint_force(
                LOAD_FRICTION, c, at, bodies, b, slopes.state, ground, 0.0, rate, 0.0, x
            )
            if i < 0:
                here = force
            else:
                slopes.by_state[bodies[b, AT_V], i] -= gain * (force - here) / STEP


@kernel(f8(STRUCTURE, vector, vector, vector, vector, vector, WORKSPACE, SLOPES, vector, matrix))
def linearise(structure, q, v, u, theta, scale, work, slopes, a, B):
    """Writes v̇ and its derivatives; returns M's smallest pivot, > 0 if it succeeded.

    Args:
        structure: the robot.
        q: (m,) position.
        v: (n,) velocity.
        u: (n_u,) command.
        theta: (p,) parameters.
        scale: (p,) their scale.
        work: memory.
        slopes: memory; `by_state` (n, 2n) receives ∂v̇/∂q and ∂v̇/∂v.
        a: (n,) v̇ of (29) with C v; written.
        B: (n, p) ∂v̇/∂(θ/scale) = −M⁻¹ W diag(scale); written.
    """
    state, x, bodies = slopes.state, work.scratch, structure.bodies
    ground = (bodies.shape[0] + v.shape[0]) * FRAME
    place(structure, q, v, state)
    write_forces(structure, state, q, v, u, True, x, slopes.F)
    pivot = accelerate(structure, state, slopes.F, v, theta, work, a)
    if not pivot > 0.0:
        return pivot
    write_regressor(structure, state, v, a, 1.0, slopes.F, work, B)
    for b in range(bodies.shape[0]):
        own = b * SLOPE
        clear(slopes.bodies, own + SPEED_SLOPE, SLOPE - SPEED_SLOPE)
        _add_columns(structure, b, state, ground, u, theta, x, slopes.bodies, own)
        _add_inertia(structure, b, state, ground, theta, x, work.inertia, slopes.bodies, own)
        _add_motion(state, b * FRAME, work.motion, b * MOTION, x, slopes.bodies, own)
        _write_axes(structure, b, state, work.motion, slopes.axes)
    _gather(structure, x, slopes)
    _add_joints(structure, q, v, u, theta, x, slopes)
    _add_loads(structure, q, v, theta, work, slopes)
    for i in range(v.shape[0]):
        for j in range(2 * v.shape[0]):
            slopes.by_state[i, j] = -slopes.by_state[i, j]
        for k in range(theta.shape[0]):
            B[i, k] *= -scale[k]
    solve_many(work.L, slopes.by_state)
    solve_many(work.L, B)
    return pivot
