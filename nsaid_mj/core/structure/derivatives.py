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
For ten rigid-body parameters, with p and l the linear and angular momentum and N the rate of Ī,

    B m = [2 ω_m × p, N ω_m + ω_m × l],

and K vanishes if gravity is part of A. The rest is kept as 6×6 matrices.
After Singh, Russell and Wensing, Efficient Analytical Derivatives of Rigid-Body Dynamics using
Spatial Vector Algebra, IEEE Robotics and Automation Letters 7 (2022), which holds for any constant
6×6 inertia. Columns are differentiated by forward differences of one body or one joint.
"""

from ..numerics.kernels import (
    boolean,
    f8,
    helper,
    index,
    kernel,
    matrix,
    routine,
    table,
    vector,
    void,
)
from ..numerics.linalg import solve_many
from .arrays import (
    AT,
    AT_V,
    BENT,
    CHANGE,
    CONSTANTS,
    COUNT,
    DENSE,
    DRIFT,
    FALL,
    FIRST,
    FRAME,
    IMPULSE,
    INERTIA,
    INPUT,
    LAST,
    LOAD,
    MOTION,
    MOVED,
    NOTHING,
    PARAMETER,
    PARENT,
    POSE,
    PUSH,
    RATE,
    READS,
    RIGID,
    SLOPE,
    SORT,
    SPARE,
    SPEED,
    SPEED_SLOPE,
    TEN,
    TURN_SLOPE,
    TWICE,
    TWIST,
)
from .columns.fluid import F as WRENCH
from .columns.joint import LOAD as LOAD_FRICTION
from .columns.joint import SHARED_VISCOUS, coordinate, joint_force, slope_by_other
from .compiled import SLOPES, STRUCTURE, WORKSPACE
from .forces import ALL, BODY_KINDS, write_forces, write_surroundings, write_wrench
from .forward_dynamics import accelerate
from .inertia import add_rigid, add_square, add_turning, write_rigid, write_square
from .kinematics import place
from .poses import integrate
from .regressor import write_regressor
from .spatial import add_cross, add_pushed, add_turned, clear, dot, out_of_body, turn_square
from .touching import TOUCH, move_contacts

STEP = 1e-7
"""Step of the forward differences, relative to 1 + |value|."""
_TOTAL = 30  # in the scratch, after what `forces` uses
_HERE = 36
_THERE = 42
_KEPT = 48


@routine(void(STRUCTURE, index, index, vector, vector, vector, index))
def _write_column_wrench(structure, b, reads, u, theta, x, to):
    """Writes the wrench on a body, in its axes, of all columns of one `reads` to x[to : to + 6]."""
    columns = structure.columns
    clear(x, to, 6)
    for k in range(columns.shape[0]):
        if columns[k, AT] == b and columns[k, READS] == reads and columns[k, SORT] >= BODY_KINDS:
            command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
            write_wrench(columns[k, SORT], structure.constants, columns[k, CONSTANTS], command, x)
            for i in range(6):
                x[to + i] += theta[columns[k, PARAMETER]] * x[WRENCH + i]


@kernel(void(STRUCTURE, index, vector, index, vector, vector, vector, vector, index), inner=True)
def _write_columns(structure, b, state, ground, u, theta, x, slopes, own):
    """Writes minus the columns' wrench on a body, and its derivatives, in the common frame."""
    frame = b * FRAME
    write_surroundings(state, frame, ground, x)
    clear(x, _TOTAL, 6)
    for reads in range(3):  # `NOTHING`, `SPEED`, `POSE`
        _write_column_wrench(structure, b, reads, u, theta, x, _HERE)
        for i in range(6):
            x[_TOTAL + i] -= x[_HERE + i]
        first = 0 if reads == SPEED else 6
        last = 9 if reads == POSE else 6
        for c in range(first, last):  # of six twists, then three turns
            at = own + SPEED_SLOPE + c if c < 6 else own + TURN_SLOPE + c - 3
            for i in range(12):
                x[_KEPT + i] = x[i]
            step = STEP * (1.0 + abs(x[c])) if c < 6 else STEP
            if c < 6:
                x[c] += step
            else:  # vectors that are fixed in the world turn the other way
                clear(x, 66, 3)
                x[60 + c] = 1.0
                add_cross(x, 66, x, _KEPT + 6, -step, x, 6)
                add_cross(x, 66, x, _KEPT + 9, -step, x, 9)
            _write_column_wrench(structure, b, reads, u, theta, x, _THERE)
            for i in range(6):
                slopes[at + 6 * i] = (x[_HERE + i] - x[_THERE + i]) / step
            for i in range(12):
                x[i] = x[_KEPT + i]
    out_of_body(state, frame, x, _TOTAL, slopes, own + LOAD)
    turn_square(state, frame, slopes, own + SPEED_SLOPE)
    turn_square(state, frame, slopes, own + TURN_SLOPE)


@helper(void(STRUCTURE, index, vector, index, vector, vector, vector, vector, index))
def _add_rigid(structure, b, state, ground, theta, motion, x, slopes, own):
    """Writes a body's momentum and N, of ten parameters, and adds I (A − g) + V ×* I V.

    With twist (v, ω), N = T + Tᵀ + 2 h·v − h vᵀ − v hᵀ, T = ω × Ī.
    """
    at = b * MOTION
    twist = b * FRAME + TWIST
    change = own + CHANGE
    write_rigid(state, b * FRAME, theta, structure.bodies[b, TEN], x, 0)
    for i in range(6):
        x[12 + i] = motion[at + DRIFT + i] + motion[at + PUSH + i]
    for i in range(3):
        x[12 + i] -= state[ground + FALL + i]
    clear(slopes, own + IMPULSE, 6)
    add_rigid(x, 0, state, twist, 1.0, slopes, own + IMPULSE)
    add_rigid(x, 0, x, 12, 1.0, slopes, own + LOAD)
    add_pushed(state, twist, slopes, own + IMPULSE, 1.0, slopes, own + LOAD)
    hx = x[1]
    hy = x[2]
    hz = x[3]
    vx = state[twist]
    vy = state[twist + 1]
    vz = state[twist + 2]
    wx = state[twist + 3]
    wy = state[twist + 4]
    wz = state[twist + 5]
    xx = x[4]
    xy = x[5]
    yy = x[6]
    xz = x[7]
    yz = x[8]
    zz = x[9]
    both = 2.0 * (hx * vx + hy * vy + hz * vz)
    slopes[change] = both + 2.0 * (wy * xz - wz * xy - hx * vx)
    slopes[change + 1] = wy * yz - wz * yy + wz * xx - wx * xz - hx * vy - hy * vx
    slopes[change + 2] = both + 2.0 * (wz * xy - wx * yz - hy * vy)
    slopes[change + 3] = wy * zz - wz * yz + wx * xy - wy * xx - hx * vz - hz * vx
    slopes[change + 4] = wz * xz - wx * zz + wx * yy - wy * xy - hy * vz - hz * vy
    slopes[change + 5] = both + 2.0 * (wx * yz - wy * xz - hz * vz)


@kernel(void(STRUCTURE, index, vector, index, vector, vector, vector, vector, index), inner=True)
def _add_entries(structure, b, state, ground, theta, motion, x, slopes, own):
    """Writes I of a body's entries, and adds I A + V ×* I V and its derivatives.

    Entries have no weight: a turn cancels the part of gravity in Ψ̈.
    """
    at = b * MOTION
    twist = b * FRAME + TWIST
    write_square(
        structure.bodies,
        structure.entries,
        structure.values,
        structure.terms,
        b,
        state,
        ground,
        theta,
        slopes,
        own,
    )
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
        if c >= 3:
            clear(x, 12, 12)
            add_cross(x, 9, state, ground + FALL, 1.0, x, 12)
            add_square(slopes, own, x, 12, -1.0, x, 18)
            for i in range(6):
                slopes[own + TURN_SLOPE + 6 * i + c] += x[18 + i]


@helper(void(STRUCTURE, index, vector, index, vector, vector))
def _write_axes(structure, b, state, ground, motion, axes):
    """Writes Ψ̇, Ψ̈, with gravity in it, and Ψ̇ + Ṡ of the axes of one body's joint."""
    bodies = structure.bodies
    above = bodies[b, PARENT] * FRAME + TWIST
    parent = bodies[b, PARENT]
    for j in range(bodies[b, AT_V], bodies[b, AT_V] + bodies[b, COUNT]):
        axis = (bodies.shape[0] + j) * FRAME
        out = j * FRAME
        clear(axes, out, FRAME)
        add_cross(state, axis + 3, state, ground + FALL, 1.0, axes, out + TWICE)
        if parent >= 0:
            at = parent * MOTION
            add_turned(state, above, state, axis, 1.0, axes, out + BENT)
            add_turned(motion, at + DRIFT, state, axis, 1.0, axes, out + TWICE)
            add_turned(motion, at + PUSH, state, axis, 1.0, axes, out + TWICE)
            add_turned(state, above, axes, out + BENT, 1.0, axes, out + TWICE)
        for i in range(6):
            axes[out + MOVED + i] = axes[out + BENT + i] + state[axis + RATE + i]


@routine(void(vector, index, vector, index, vector, index))
def _add_transposed(A, at, x, i, y, k):
    """y += Aᵀ x of a (6, 6) matrix that begins at A[at]."""
    for r in range(6):
        for c in range(6):
            y[k + c] += A[at + 6 * r + c] * x[i + r]


@helper(void(vector, index, vector, index, vector, index))
def _add_bent(body, at, m, i, f, k):
    """f += B m of the ten parameters, summed over all that a body carries."""
    p = at + IMPULSE  # as `add_turning` counts
    rate = at + CHANGE - 4
    add_cross(m, i + 3, body, p, 2.0, f, k)
    add_cross(m, i + 3, body, p + 3, 1.0, f, k + 3)
    add_turning(body, rate, m, i + 3, 1.0, f, k + 3)


@helper(void(table, index, vector, vector, index, index, vector, vector, vector))
def _write_felt(bodies, b, state, far, own, axis, x, inertia, body):
    """Writes for an axis S: B Ψ̇ + I Ψ̈ + K S, B S + I (Ψ̇ + Ṡ), Bᵀ S, I S, Kᵀ S and S ×* f."""
    at = b * SLOPE
    clear(x, 0, 36)
    if bodies[b, RIGID]:
        ten = b * INERTIA
        add_rigid(inertia, ten, far, own + TWICE, 1.0, x, 0)
        _add_bent(body, at, far, own + BENT, x, 0)
        add_rigid(inertia, ten, far, own + MOVED, 1.0, x, 6)
        _add_bent(body, at, state, axis, x, 6)
        add_turning(body, at + CHANGE - 4, state, axis + 3, 1.0, x, 15)
        add_cross(body, at + IMPULSE + 3, state, axis + 3, 1.0, x, 15)
        add_cross(body, at + IMPULSE, state, axis, 2.0, x, 15)
        add_rigid(inertia, ten, state, axis, 1.0, x, 18)
    if bodies[b, DENSE]:
        add_square(body, at + SPEED_SLOPE, far, own + BENT, 1.0, x, 0)
        add_square(body, at, far, own + TWICE, 1.0, x, 0)
        add_square(body, at + TURN_SLOPE, state, axis, 1.0, x, 0)
        add_square(body, at + SPEED_SLOPE, state, axis, 1.0, x, 6)
        add_square(body, at, far, own + MOVED, 1.0, x, 6)
        _add_transposed(body, at + SPEED_SLOPE, state, axis, x, 12)
        add_square(body, at, state, axis, 1.0, x, 18)  # I is symmetric
        _add_transposed(body, at + TURN_SLOPE, state, axis, x, 24)
    add_pushed(state, axis, body, at + LOAD, 1.0, x, 30)


@kernel(void(STRUCTURE, vector, vector, SLOPES), inner=True)
def _gather(structure, x, inertia, slopes):
    """Writes ∂τ/∂q and ∂τ/∂v into `slopes.by_state`, from the tips inwards."""
    bodies = structure.bodies
    state = slopes.state
    body = slopes.bodies
    far = slopes.axes
    A = slopes.by_state
    n = slopes.by_state.shape[0]
    rows = bodies.shape[0] * FRAME
    for j in range(n):
        for i in range(2 * n):
            A[j, i] = 0.0
    for b in range(bodies.shape[0] - 1, -1, -1):
        at = b * SLOPE
        parent = bodies[b, PARENT]
        for j in range(bodies[b, AT_V], bodies[b, AT_V] + bodies[b, COUNT]):
            axis = rows + j * FRAME
            own = j * FRAME
            _write_felt(bodies, b, state, far, own, axis, x, inertia, body)
            ancestor = b
            while ancestor >= 0:
                first = bodies[ancestor, AT_V]
                for i in range(first, first + bodies[ancestor, COUNT]):
                    other = rows + i * FRAME
                    its = i * FRAME
                    A[i, j] = dot(state, other, x, 0)
                    A[i, n + j] = dot(state, other, x, 6)
                    if ancestor != b:
                        A[i, j] += dot(state, other, x, 30)
                        A[j, i] = dot(far, its + BENT, x, 12) + dot(far, its + TWICE, x, 18)
                        A[j, i] += dot(state, other, x, 24)
                        A[j, n + i] = dot(state, other, x, 12) + dot(far, its + MOVED, x, 18)
                ancestor = bodies[ancestor, PARENT]
        if parent >= 0:
            first = 0 if bodies[b, DENSE] else LOAD
            for i in range(first, SLOPE if bodies[b, RIGID] else IMPULSE):
                body[parent * SLOPE + i] += body[at + i]


@helper(void(STRUCTURE, vector, vector, vector, vector, vector, SLOPES, boolean))
def _add_joints(structure, q, v, u, theta, x, slopes, held):
    """Adds the derivatives of joints' columns by their own position and, unless held, velocity."""
    bodies = structure.bodies
    columns = structure.columns
    c = structure.constants
    n = v.shape[0]
    state = slopes.state
    A = slopes.by_state
    ground = (bodies.shape[0] + n) * FRAME
    for k in range(columns.shape[0]):
        kind = columns[k, SORT]
        b = columns[k, AT]
        at = columns[k, CONSTANTS]
        fast = columns[k, READS] == SPEED
        if kind >= BODY_KINDS or columns[k, READS] == NOTHING or (fast and held):
            continue
        j = bodies[b, AT_V]
        gain = theta[columns[k, PARAMETER]]
        command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
        angle = coordinate(bodies, b, q)
        rate = v[j]
        step = STEP * (1.0 + abs(rate)) if fast else STEP
        here = joint_force(kind, c, at, bodies, b, state, ground, angle, rate, v, command, x)
        if kind >= SHARED_VISCOUS:
            A[j, n + int(c[at])] -= gain * slope_by_other(kind, c, at, here)
        angle, rate = (angle, rate + step) if fast else (angle + step, rate)
        there = joint_force(kind, c, at, bodies, b, state, ground, angle, rate, v, command, x)
        A[j, n + j if fast else j] -= gain * (there - here) / step


@routine(void(STRUCTURE, vector, vector, vector, vector, WORKSPACE, SLOPES))
def _add_loads(structure, q, v, rates, theta, work, slopes):
    """Adds the derivatives of load-dependent friction by all positions; overwrites the state.

    No other kind on a joint depends on other joints' positions.
    """
    bodies = structure.bodies
    columns = structure.columns
    c = structure.constants
    x = work.scratch
    ground = (bodies.shape[0] + v.shape[0]) * FRAME
    way = work.rows[SPARE]
    moved = slopes.flow[0]
    for k in range(columns.shape[0]):
        if columns[k, SORT] != LOAD_FRICTION:
            continue
        b = columns[k, AT]
        at = columns[k, CONSTANTS]
        gain = theta[columns[k, PARAMETER]]
        here = 0.0
        for i in range(-1, v.shape[0]):
            for j in range(v.shape[0]):
                way[j] = STEP if i == j else 0.0
            integrate(bodies, q, way, moved, x)
            place(structure, moved, v, slopes.state)
            rate = rates[bodies[b, AT_V]]
            force = joint_force(
                LOAD_FRICTION, c, at, bodies, b, slopes.state, ground, 0.0, rate, rates, 0.0, x
            )
            if i < 0:
                here = force
            else:
                slopes.by_state[bodies[b, AT_V], i] -= gain * (force - here) / STEP


@kernel(
    f8(
        STRUCTURE,
        vector,
        vector,
        vector,
        vector,
        vector,
        WORKSPACE,
        SLOPES,
        vector,
        matrix,
        vector,
        TOUCH,
    ),
    inner=True,
)
def linearise(structure, q, v, u, theta, scale, work, slopes, a, B, rates, touch):
    """Writes v̇ (n,) of (29) with C v, and its derivatives; returns M's smallest pivot, > 0 if ≻ 0.

    `slopes.by_state` (n, 2n) receives ∂v̇/∂q and ∂v̇/∂v, B (n, p) ∂v̇/∂(θ/scale) = −M⁻¹ W
    diag(scale). q is (m,), v (n,), u (n_u,), theta and scale (p,). `rates` (n,) are velocities at
    which joints' columns are held; (0,) to evaluate them at v. `touch` are the contacts, which
    move as measured in v̇, and whose forces are held in its derivatives.
    """
    state = slopes.state
    x = work.scratch
    bodies = structure.bodies
    ground = (bodies.shape[0] + v.shape[0]) * FRAME
    held = rates.shape[0] > 0
    at_joints = rates if held else v
    place(structure, q, v, state)
    write_forces(structure, state, q, at_joints, u, ALL, x, slopes.F)
    pivot = accelerate(structure, state, slopes.F, v, theta, work, a)
    if not pivot > 0.0:
        return pivot
    if touch.J.shape[0] > 0:
        move_contacts(touch, work, a)
    write_regressor(structure, state, v, a, 1.0, slopes.F, work, B)
    for b in range(bodies.shape[0]):
        own = b * SLOPE
        first = 0 if bodies[b, DENSE] else LOAD
        clear(slopes.bodies, own + first, SLOPE - first)
        if bodies[b, DENSE]:
            _write_columns(structure, b, state, ground, u, theta, x, slopes.bodies, own)
        if bodies[b, LAST] > bodies[b, FIRST]:
            _add_entries(structure, b, state, ground, theta, work.motion, x, slopes.bodies, own)
        if bodies[b, TEN] >= 0:
            _add_rigid(structure, b, state, ground, theta, work.motion, x, slopes.bodies, own)
        _write_axes(structure, b, state, ground, work.motion, slopes.axes)
    _gather(structure, x, work.inertia, slopes)
    _add_joints(structure, q, at_joints, u, theta, x, slopes, held)
    _add_loads(structure, q, v, at_joints, theta, work, slopes)
    for i in range(v.shape[0]):
        for j in range(2 * v.shape[0]):
            slopes.by_state[i, j] = -slopes.by_state[i, j]
        for k in range(theta.shape[0]):
            B[i, k] *= -scale[k]
    solve_many(work.L, slopes.by_state)
    solve_many(work.L, B)
    return pivot
