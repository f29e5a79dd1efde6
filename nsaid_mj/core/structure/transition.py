"""One RK4 step of the forward dynamics and its derivatives.

Positions are integrated in the tangent step ξ from the step's start, with
ξ̇ = v + ½[ξ, v] + 1/12 [ξ, [ξ, v]]. A deviation (δq, δv, δθ), with δq the tangent step from the
undisturbed position, obeys

    δ̇q = δv − [v, δq],    δ̇v = ∂v̇/∂q δq + ∂v̇/∂v δv + c,    c = ∂v̇/∂θ δθ.

The derivatives are held in the step at their values in RK4's third stage, half-way: by symmetry the
error is of third order in the step. θ acts through the n components of c alone.
"""

from ..numerics.kernels import f8, index, kernel, matrix, routine, vector, void
from .compiled import SLOPES, STRUCTURE, WORKSPACE
from .derivatives import linearise
from .forces import ALL, write_forces
from .forward_dynamics import accelerate
from .kinematics import place
from .poses import add_bracket, group_of, integrate
from .spatial import clear
from .touching import TOUCH, move_contacts

WAY, SPEED, RATE, FORCE, SUM, SUMS = range(6)
"""Rows of `Workspace.rows` in a step: ξ, v and their rates at a stage, and their sums."""


@routine(void(index, index, f8, vector, matrix, vector))
def _advance(group, stage, dt, v, rows, x):
    """Adds a stage's rates to the sums, and moves to the next stage."""
    way = rows[WAY]
    speed = rows[SPEED]
    rate = rows[RATE]
    clear(x, 0, 12)
    add_bracket(group, way, 0, speed, 0, 1.0, x, 0)
    add_bracket(group, way, 0, x, 0, 1.0, x, 6)
    weight = dt / 3 if stage in (1, 2) else dt / 6
    reach = dt if stage == 2 else 0.5 * dt
    for i in range(v.shape[0]):
        rate[i] = speed[i]
        if i < group:
            rate[i] += 0.5 * x[i] + x[6 + i] / 12
    for i in range(v.shape[0]):
        rows[SUM, i] += weight * rate[i]
        rows[SUMS, i] += weight * rows[FORCE, i]
        way[i] = reach * rate[i]
        speed[i] = v[i] + reach * rows[FORCE, i]


@kernel(void(index, f8, vector, matrix, matrix, vector, matrix), inner=True)
def _write_flow(group, dt, v, A, rates, x, F):
    """Writes the flow F (2n, 3n) of deviations under constant derivatives, to fourth order in dt.

    F holds the deviation at the end per (δq, δv, c); `group` is the number of leading velocities
    that form a body twist, v is (n,), A (n, 2n) holds ∂v̇/∂q and ∂v̇/∂v; rates (≥ 2n, 3n) and x are
    workspace.
    """
    n = v.shape[0]
    size = F.shape[1]
    for i in range(2 * n):
        for k in range(size):
            F[i, k] = 1.0 if i == k else 0.0
    for order in range(4, 0, -1):  # Horner's scheme: F ← [1, 0] + dt/order (the rates of F)
        for i in range(n):
            for k in range(size):
                rates[i, k] = F[n + i, k]
                rates[n + i, k] = 0.0
            rates[n + i, 2 * n + i] = 1.0
            for j in range(2 * n):
                factor = A[i, j]
                for k in range(size):
                    rates[n + i, k] += factor * F[j, k]
        for k in range(size if group else 0):
            for i in range(group):
                x[i] = F[i, k]
                x[6 + i] = 0.0
            add_bracket(group, v, 0, x, 0, 1.0, x, 6)
            for i in range(group):
                rates[i, k] -= x[6 + i]
        for i in range(2 * n):
            for k in range(size):
                F[i, k] = dt / order * rates[i, k]
            F[i, i] += 1.0


@kernel(
    f8(
        STRUCTURE,
        vector,
        vector,
        vector,
        f8,
        vector,
        vector,
        WORKSPACE,
        SLOPES,
        vector,
        vector,
        vector,
        matrix,
        matrix,
        matrix,
        TOUCH,
    ),
    inner=True,
)
def step(structure, q, v, u, dt, theta, scale, work, slopes, at, q1, v1, F, B, seen, touch):
    """Writes the state after a step with the command held, and its derivatives.

    Args:
        structure: the robot.
        q: (m,) position at the step's start.
        v: (n,) velocity at the step's start.
        u: (n_u,) command.
        dt: the step [s].
        theta: (p,) parameters.
        scale: (p,) their scale.
        work: workspace.
        slopes: workspace.
        at: (m,) workspace.
        q1: (m,) position at the end; written.
        v1: (n,) velocity at the end; written.
        F: (2n, 3n) derivatives of the end by (q, v) at the start and c; written.
        B: (n, p) derivatives of c by θ/scale; written.
        seen: (3, n) velocities at the start, half-way and at the end at which joints' columns, such
            as friction that is stiff in the step, are held; (0, n) to evaluate them along the step.
        touch: the contacts, which move as measured.

    Returns:
        M's smallest pivot, > 0 on success.
    """
    group = group_of(structure.bodies)
    rows = work.rows
    x = work.scratch
    lowest = 1e300
    for i in range(v.shape[0]):
        rows[WAY, i] = 0.0
        rows[SPEED, i] = v[i]
        rows[SUM, i] = 0.0
        rows[SUMS, i] = 0.0
    for i in range(q.shape[0]):
        at[i] = q[i]
    for stage in range(4):
        speed = rows[SPEED]
        a = rows[FORCE]
        rates = seen[(stage + 1) // 2] if seen.shape[0] > 0 else speed
        if stage == 2:
            own = rates if seen.shape[0] > 0 else rates[:0]
            pivot = linearise(structure, at, speed, u, theta, scale, work, slopes, a, B, own, touch)
            _write_flow(group, dt, speed, slopes.by_state, slopes.flow, x, F)
        else:
            place(structure, at, speed, slopes.state)
            write_forces(structure, slopes.state, at, rates, u, ALL, x, slopes.F)
            pivot = accelerate(structure, slopes.state, slopes.F, speed, theta, work, a)
            if touch.J.shape[0] > 0 and pivot > 0.0:
                move_contacts(touch, work, a)
        lowest = min(lowest, pivot)
        if not pivot > 0.0:
            return pivot
        _advance(group, stage, dt, v, rows, x)
        if stage < 3:
            integrate(structure.bodies, q, rows[WAY], at, x)
    for i in range(v.shape[0]):
        v1[i] = v[i] + rows[SUMS, i]
    integrate(structure.bodies, q, rows[SUM], q1, x)
    return lowest
