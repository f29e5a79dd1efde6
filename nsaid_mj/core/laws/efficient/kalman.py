"""An extended Kalman filter of position, velocity and parameters, compiled.

    x̄ = RK4(x̂, u held; θ̂),    F = [Φ Γ; 0 1],
    P̄ = F P Fᵀ + γ² diag(diag(Γ P_θθ Γᵀ)) + F_c M̂⁻¹ D M̂⁻¹ F_cᵀ/dt,
    S = P̄_xx + R,    L Lᵀ = S,    e = L⁻¹ y,    y = (difference(q̄, q), v − v̄),
    θ̂ ← θ̂ + share scale P̄_θx L⁻ᵀ e,    x̂ ← x̄ + P̄_xx L⁻ᵀ e,
    P ← P̄ − P̄ Hᵀ S⁻¹ H P̄,    P_θθ with the factor share (2 − share).

share < 1 where the full step would halve M̂; P is updated for the shorter step (Joseph's form with
the applied gain). Then θ̂, and with it x̂, is projected into the cone in the metric P⁻¹, which
increases its distance to no θ inside, and the covariance is transported along the unknown scales;
see `steps`.

θ acts in a step through c = B θ/scale alone, n accelerations, so that Γ = F_c B, and P̄_x is that
of (x, c) propagated by [Φ F_c]. P_θθ is as before the step: only measurements change it.

This is (44, 45) with K and Γ replaced by the gains of the Kalman filter. Both q and v are measured,
so that P_xθ = R S⁻¹ P̄_xθ and P_xx = R S⁻¹ P̄_xx after an update. γ accounts for the error of
linearisation about θ̂: its standard deviation as a share of what θ's uncertainty does in a step.

D = diag(d k̂²) represents unmodelled forces, as white noise of density d in the motors' commands:
with a fixed density of forces, its relative size would grow if k̂, friction and inertia of a motor
shrink together, and keep them there. With D, joint friction is evaluated at the measured velocity,
as in (44): compared with such forces its noise is negligible, while a step in which friction
reverses is neither linear nor stable.

Contacts without force sensors are an unknown input. The prediction takes their acceleration from
the last measured steps, v̇ = v̇₀ + Y (w − J v̇₀) of `structure.touching`. It may be wrong by any
amount, so P̄ gains F_c Y Yᵀ F_cᵀ times a variance far above the noise's. An innovation then counts
only in the directions that no contact force reaches, those of E W. Where even
these are not exact, because feet sink in, P̄ gains F_c M̂⁻¹ δJᵀ λ̂ λ̂ᵀ δJ M̂⁻¹ F_cᵀ: δJ is due to an
error of the contacts' places that stays for seconds, as a white noise of its low frequencies.
"""

import numpy as np
from numba import types

from ...numerics.kernels import cube, f8, i8, kernel, matrix, vector, void
from ...parameters import Array
from ...quotient.cone import inside
from ...structure.forces import ALL, write_forces
from ...structure.forward_dynamics import accelerate
from ...structure.kinematics import place
from ...structure.poses import difference, integrate
from ...structure.touching import TOUCH
from ...structure.transition import step as transition
from .covariance import copy_matrix, innovate, keep_above_rounding, predict, update
from .filter import (
    ALONG,
    BEGINNING,
    COMPLETED,
    CONSTANTS,
    CONTRADICTED,
    FILTER,
    NEAR,
    ROUNDED,
    WORKSPACES,
    Along,
    FilterConstants,
    FilterState,
    workspace_for,
)
from .noise import MEMORY, add_increment, write_variance

_WARM_UP = 20  # fourth differences before the noise is known well enough to begin
_SIGNIFICANT = 6.0  # standard deviations by which a window's innovations must exceed chance
_FAR = 15.0  # time for which θ̂ may be as far off as a prior [s]
_SMALLEST = 1e-9  # share of a step, below which θ̂ stays


@kernel(f8(i8, i8, f8))
def acceptable(window, size, seen):
    """Threshold of the sum of squared normalised innovations in a window (χ² tail bound).

    There are `size` of them in a sample, and the noise was estimated from `seen` increments.
    """
    dof = 1.0 * size * window
    vague = 1.0 + 4.0 / np.sqrt(min(seen, MEMORY))  # of R itself
    return vague * (dof + _SIGNIFICANT * np.sqrt(2.0 * dof) + 0.7 * _SIGNIFICANT**2)


@kernel(void(FILTER, vector, vector, vector))
def restart_state(filter, q, v, R):
    """Starts the state at a measurement, uncorrelated with θ."""
    n = v.shape[0]
    theta = filter.theta
    tally = filter.tally
    for i in range(q.shape[0]):
        filter.q[i] = q[i]
    for i in range(n):
        filter.v[i] = v[i]
    for i in range(2 * n):
        for j in range(2 * n):
            filter.Pxx[i, j] = R[i] if i == j else 0.0
        for j in range(theta.shape[0]):
            filter.Pxt[i, j] = 0.0
    for i in range(tally.shape[0]):
        tally[i] = 1.0 if i == 0 else 0.0
    for i in range(theta.shape[0]):
        filter.safe[0, i] = filter.safe[1, i] = theta[i]
    copy_matrix(filter.Ptt, filter.safe_P[0])
    copy_matrix(filter.Ptt, filter.safe_P[1])


@kernel(f8(CONSTANTS, vector, vector, vector, FILTER, WORKSPACES), inner=True)
def _linear_share(constants, q, v, u, filter, workspace):
    """Largest share 2⁻ᵏ of θ̂'s step that keeps half of M̂ at a state q (m,), v (n,).

    Along a longer step M̂⁻¹, and with it the prediction's derivatives, would vary too much.
    """
    structure = constants.structure
    stage = workspace.stage
    slopes = workspace.slopes
    step = workspace.step
    trial = workspace.trial
    share = 1.0
    placed = False
    while share > _SMALLEST:
        for k in range(step.shape[0]):
            trial[k] = 0.5 * filter.theta[k] + share * step[k]
        if inside(constants.cone, trial):  # then M̂ ≻ 0 there
            return share
        if not placed:
            place(structure, q, v, slopes.state)
            write_forces(structure, slopes.state, q, v, u, ALL, stage.scratch, slopes.F)
            placed = True
        if (
            accelerate(structure, slopes.state, slopes.F, v, trial, stage, workspace.with_c[0])
            > 0.0
        ):
            return share
        share *= 0.5
    return 0.0


@kernel(void(FILTER, matrix), inner=True)
def _begin_window(filter, factor):
    """Begins another window of innovations; `factor` (p, p) is workspace."""
    theta = filter.theta
    safe = filter.safe
    safe_P = filter.safe_P
    tally = filter.tally
    keep_above_rounding(filter.Ptt, factor)
    for i in range(theta.shape[0]):
        safe[0, i] = safe[1, i]
        safe[1, i] = theta[i]
    copy_matrix(safe_P[1], safe_P[0])
    copy_matrix(filter.Ptt, safe_P[1])
    for i in range(1, tally.shape[0]):
        tally[i] = 0.0


@kernel(void(vector, vector, matrix), inner=True)
def _see(before, after, seen):
    """Writes the velocities (3, n) of a step: measured at both ends, and half-way."""
    for i in range(before.shape[0]):
        seen[0, i] = before[i]
        seen[1, i] = 0.5 * (before[i] + after[i])
        seen[2, i] = after[i]


@kernel(f8(CONSTANTS, FILTER, f8, vector, vector, vector, WORKSPACES), inner=True)
def _move(constants, filter, dt, q, v, u, workspace):
    """Propagates state and covariance through a step, and writes the step and the innovation y.

    Returns M̂'s smallest pivot, > 0 on success.
    """
    pivot = transition(
        constants.structure,
        q,
        v,
        u,
        dt,
        filter.theta,
        constants.scale,
        workspace.stage,
        workspace.slopes,
        workspace.at,
        workspace.q1,
        workspace.v1,
        workspace.F,
        workspace.B,
        workspace.seen if constants.unexplained.shape[0] > 0 else workspace.seen[:0],
        workspace.touch,
    )
    if pivot > 0.0:
        gamma = constants.gamma if filter.noise.seen[0] * dt < _FAR else min(constants.gamma, NEAR)
        predict(
            constants.scale, constants.walk, constants.unexplained, gamma, dt, filter, workspace
        )
    return pivot


@kernel(void(matrix, matrix, matrix, f8, TOUCH), inner=True)
def _touch(J, shift, increments, dt, touch):
    """Writes the contacts of a step: J and its shift (c, n) half-way, and their last acceleration.

    `increments` (3, 2n) are measured, of the steps before: of this step they would have the noise
    of the innovation, and the derivatives by θ with it.
    """
    count = increments.shape[0]
    n = J.shape[1]
    for i in range(J.shape[0]):
        touch.w[i] = 0.0
        for j in range(n):
            touch.J[i, j] = J[i, j]
            touch.shift[i, j] = shift[i, j]
            for k in range(count):
                touch.w[i] += J[i, j] * increments[k, n + j] / (count * dt)


@kernel(
    i8(CONSTANTS, FILTER, i8, vector, matrix, matrix, matrix, cube, cube, ALONG, WORKSPACES),
    inner=True,
)
def _follow_row(constants, filter, k, t, q, v, u, J, shifts, along, workspace):
    """Runs the filter from row k − 1 to k, and returns how it ended."""
    structure = constants.structure
    tally = filter.tally
    totals = filter.totals
    n = v.shape[1]
    y = workspace.y
    x = workspace.stage.scratch
    v1 = workspace.v1
    out = along.innovation[k]
    _touch(J[k - 1], shifts[k - 1], filter.noise.increments, t[k] - t[k - 1], workspace.touch)
    difference(structure.bodies, q[k - 1], q[k], y, x)
    for i in range(n):
        y[n + i] = v[k, i] - v[k - 1, i]
    add_increment(filter.noise, y)
    write_variance(filter.noise, workspace.R)
    along.pivot[k] = np.inf
    for i in range(2 * n):
        out[i] = np.nan
    if tally[0] == 0.0:
        if filter.noise.seen[0] >= _WARM_UP + 3:
            restart_state(filter, q[k], v[k], workspace.R)
        return BEGINNING
    _see(v[k - 1], v[k], workspace.seen)
    pivot = _move(constants, filter, t[k] - t[k - 1], filter.q, filter.v, u[k - 1], workspace)
    if not pivot > 0.0:
        return CONTRADICTED
    along.pivot[k] = pivot
    difference(structure.bodies, workspace.q1, q[k], y, x)
    for i in range(n):
        y[n + i] = v[k, i] - v1[i]
    spread = innovate(constants.scale, filter.Pxx, filter.Pxt, workspace)
    square = 0.0
    for i in range(2 * n):
        square += workspace.e[i] * workspace.e[i]
    if not (spread < np.inf and square < np.inf):
        return ROUNDED
    share = _linear_share(constants, q[k], v[k], u[k - 1], filter, workspace)
    update(
        constants.cone, constants.margin, constants.scale, constants.parts, filter, share, workspace
    )
    integrate(structure.bodies, workspace.q1, y, filter.q, x)
    for i in range(n):
        filter.v[i] = v1[i] + y[n + i]
    for i in range(2 * n):
        out[i] = workspace.e[i]
    tally[1] += 1
    tally[2] += square
    tally[3] += spread
    totals[0] += square
    totals[1] += 2 * n - J.shape[1]
    return COMPLETED


@kernel(
    types.UniTuple(i8, 2)(
        CONSTANTS, FILTER, vector, matrix, matrix, matrix, cube, cube, ALONG, WORKSPACES
    )
)
def _follow(constants, filter, t, q, v, u, J, shifts, along, workspace):
    """Runs the filter along a log, in workspace from `follow_filter`."""
    n = v.shape[1]
    size = 2 * n - J.shape[1]  # contacts that move freely leave no innovations
    tally = filter.tally
    for k in range(1, t.shape[0]):
        end = _follow_row(constants, filter, k, t, q, v, u, J, shifts, along, workspace)
        for i in range(filter.theta.shape[0]):
            along.theta[k, i] = filter.theta[i]
        for i in range(n):
            along.v[k, i] = filter.v[i] if end == COMPLETED else v[k, i]
        if end == BEGINNING:
            continue
        if end != COMPLETED or tally[2] > acceptable(constants.window, size, filter.noise.seen[0]):
            return k, end if end != COMPLETED else CONTRADICTED
        if tally[1] >= constants.window:
            _begin_window(filter, workspace.factor)
    return t.shape[0] - 1, COMPLETED


def follow_filter(
    constants: FilterConstants,
    filter: FilterState,
    t: Array,
    q: Array,
    v: Array,
    u: Array,
    J: Array,
    shifts: Array,
    along: Along,
) -> tuple[int, int]:
    """Runs the filter along a log of N samples, from its state at the first, which it overwrites.

    t (N,) is in s, q is (N, m), v (N, n), u (N, n_u), J (N−1, c, n) the contacts' Jacobian half-way
    between samples, shifts (N−1, c, n) the density of its error [√s]; rows of `along` are written.
    Returns the last row processed, and how the loop ended.
    """
    sizes = v.shape[1], q.shape[1], len(constants.scale), J.shape[1]
    workspace = workspace_for(constants.structure, *sizes)
    return _follow(constants, filter, t, q, v, u, J, shifts, along, workspace)
