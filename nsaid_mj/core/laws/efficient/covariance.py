"""Time and measurement updates of the filter's covariance; equations are in `kalman`."""

import numpy as np

from ...numerics.kernels import f8, kernel, matrix, vector, void
from ...numerics.linalg import (
    add_product,
    cholesky,
    invert_lower,
    multiply,
    multiply_transposed,
    solve_many,
)
from ...quotient.cone import CONE
from ...structure.touching import TOUCH
from .filter import FILTER, WORKSPACES
from .steps import carry_scale, project_inside

SMALL = 0.1
"""Least size of a parameter, relative to its scale, to which relative changes refer."""
_FREE = 1e4  # deviation of a contact's velocity after a step, over that of the velocities' noise
_FLOOR = 1e-14  # least variance of θ over the largest: rounding errors of a window's updates


@kernel(void(matrix, matrix), inner=True)
def copy_matrix(source, target):
    """Copies a matrix."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel(void(matrix, matrix))
def keep_above_rounding(P, L):
    """Makes P (p, p) symmetric, and adds a floor where its rounding errors could be indefinite.

    Exact data reduce the variance of observable directions far below that along P_s, which stays.
    Below its rounding errors P would be indefinite, and the gains would have random signs.
    """
    largest = 0.0
    for i in range(P.shape[0]):
        largest = max(largest, P[i, i])
        for k in range(i):
            P[k, i] = P[i, k]
    if not cholesky(P, L) > _FLOOR * largest:
        for i in range(P.shape[0]):
            P[i, i] += _FLOOR * largest


@kernel(void(vector, f8, vector, matrix, matrix, matrix), inner=True)
def _add_unexplained(density, dt, theta, L, spread, rows):
    """Adds M̂⁻¹ D M̂⁻¹/dt to the covariance of c, the last n columns of `rows` (n, 3n).

    D is `density` (n,) times the square of the last motor's gain, the last of theta (p,). L is the
    factor that `solve_positive` left; `spread` (2n, 2n) is workspace.
    """
    n = density.shape[0]
    gain = theta[theta.shape[0] - 1]
    columns = spread[:n]
    for i in range(n):
        for j in range(columns.shape[1]):
            columns[i, j] = 1.0 if i == j else 0.0
    solve_many(L, columns)
    for i in range(n):
        for j in range(n):
            for k in range(n):
                own = density[k] * gain * gain / dt
                rows[i, 2 * n + j] += columns[i, k] * columns[j, k] * own


@kernel(void(TOUCH, vector, f8, matrix), inner=True)
def _add_contacts(touch, R, dt, rows):
    """Adds Y Yᵀ to the covariance of c, the last n columns of `rows` (n, 3n): contacts move freely.

    Their velocity gains a deviation of `_FREE` times that of the sensors' noise, R (2n,) in all.
    """
    n = touch.Y.shape[0]
    variance = 0.0
    for i in range(n):
        variance += R[n + i] / n
    variance *= (_FREE / dt) ** 2
    for i in range(n):
        for j in range(n):
            for k in range(touch.Y.shape[1]):
                rows[i, 2 * n + j] += variance * touch.Y[i, k] * touch.Y[j, k]


@kernel(void(TOUCH, matrix, f8, matrix, matrix), inner=True)
def _add_displaced(touch, L, dt, columns, rows):
    """Adds what uncertain places of the contacts do to c, the last n columns of `rows` (n, 3n).

    Row by row, `touch.shift` times its force is the density of a white noise. L is the factor that
    `solve_positive` left; the first rows of `columns` (2n, 2n) are workspace.
    """
    n = touch.Y.shape[0]
    effects = columns[:n]
    for i in range(n):
        for k in range(n):
            effects[i, k] = touch.shift[k, i] * touch.force[k] if k < touch.J.shape[0] else 0.0
    solve_many(L, effects)
    for i in range(n):
        for j in range(n):
            for k in range(touch.J.shape[0]):
                rows[i, 2 * n + j] += effects[i, k] * effects[j, k] / dt


@kernel(void(vector, vector, vector, f8, f8, FILTER, WORKSPACES), inner=True)
def predict(scale, walk, unexplained, gamma, dt, filter, workspace):
    """Writes P̄, without R, from the derivatives F and B of `transition`.

    The first four arguments are `Law`'s: kernels pass every array of a tuple, used or not.
    """
    Pxx = filter.Pxx
    Pxt = filter.Pxt
    Ptt = filter.Ptt
    F = workspace.F
    with_theta = workspace.with_theta
    with_c = workspace.with_c
    both = workspace.both
    size = Pxt.shape[0]
    n = filter.v.shape[0]
    copy_matrix(Pxt, with_theta)
    multiply(workspace.B, Ptt, with_theta[size:])
    multiply_transposed(with_theta, workspace.B, with_c)
    for i in range(size + n):
        for j in range(n):
            both[i, size + j] = with_c[i, j]
    for i in range(size):
        for j in range(size):
            both[i, j] = Pxx[i, j]
        for j in range(n):
            both[size + j, i] = with_c[i, j]
    if unexplained.shape[0]:
        _add_unexplained(unexplained, dt, filter.theta, workspace.stage.L, workspace.S, both[size:])
    if workspace.touch.J.shape[0]:
        _add_contacts(workspace.touch, workspace.R, dt, both[size:])
        _add_displaced(workspace.touch, workspace.stage.L, dt, workspace.S, both[size:])
    multiply(F, with_theta, Pxt)
    multiply(F, both, workspace.moved)
    multiply_transposed(workspace.moved, F, Pxx)
    for i in range(size):
        for j in range(n):
            for k in range(n):
                own = F[i, size + j] * with_c[size + j, k] * F[i, size + k]
                Pxx[i, i] += gamma * gamma * own
    for k in range(scale.shape[0]):
        if walk[k] > 0.0:
            relative = max(abs(filter.theta[k]) / scale[k], SMALL)
            Ptt[k, k] += walk[k] * dt * relative * relative


@kernel(f8(vector, matrix, matrix, WORKSPACES), inner=True)
def innovate(scale, Pxx, Pxt, workspace):
    """Factors S and writes the step of θ̂ for the innovation y; returns log det S, NaN if S ⊁ 0."""
    S = workspace.S
    L = workspace.L
    inverse = workspace.inverse
    y = workspace.y
    e = workspace.e
    step = workspace.step
    whitened = workspace.whitened
    size, p = whitened.shape
    for i in range(size):
        for j in range(size):
            S[i, j] = 0.5 * (Pxx[i, j] + Pxx[j, i])
        S[i, i] += workspace.R[i]
    if not cholesky(S, L) > 0.0:
        return np.nan
    spread = 0.0
    for i in range(size):
        spread += 2.0 * np.log(L[i, i])
    invert_lower(L, inverse)
    multiply(inverse, Pxt, whitened)
    for k in range(p):
        step[k] = 0.0
    for i in range(size):
        e[i] = 0.0
        for j in range(i + 1):
            e[i] += inverse[i, j] * y[j]
        for k in range(p):
            step[k] += e[i] * whitened[i, k]
    for k in range(p):
        step[k] *= scale[k]
    return spread


@kernel(void(CONE, vector, vector, matrix, FILTER, f8, WORKSPACES), inner=True)
def update(cone, margin, scale, parts, filter, share, workspace):
    """Moves θ̂ by a share of its step, updates P, and overwrites y with the step of the state."""
    theta = filter.theta
    Pxx = filter.Pxx
    Pxt = filter.Pxt
    Ptt = filter.Ptt
    S = workspace.S
    L = workspace.L
    inverse = workspace.inverse
    whitened = workspace.whitened
    e = workspace.e
    y = workspace.y
    R = workspace.R
    before = workspace.before
    trial = workspace.trial
    size, p = whitened.shape
    for k in range(p):
        before[k] = theta[k]
        theta[k] += share * workspace.step[k]
    for i in range(size):
        for j in range(size):
            L[i, j] = R[i] * inverse[j, i]  # R L⁻ᵀ
    multiply(L, whitened, Pxt)
    learned = np.sqrt(share * (2.0 - share))
    for r in range(size):
        for k in range(p):
            whitened[r, k] *= learned
    # (1 − share K H) P (1 − share K H)ᵀ + share² K R Kᵀ
    add_product(-1.0, whitened.T, whitened, Ptt)
    for i in range(size):
        S[0, i] = 0.0
        y[i] = 0.0
        for j in range(i, size):
            S[0, i] += inverse[j, i] * e[j]
    for i in range(size):  # y − R S⁻¹ y would cancel
        for j in range(size):
            y[i] += Pxx[i, j] * S[0, j]
    multiply(inverse, Pxx, S)
    multiply(L, S, inverse)
    for i in range(size):
        for j in range(size):
            Pxx[i, j] = 0.5 * (inverse[i, j] + inverse[j, i])
    work = trial, workspace.step, workspace.factor
    project_inside(cone, margin, before, theta, scale, Ptt, Pxt, y, *work)
    for k in range(parts.shape[0]):
        carry_scale(parts[k], before, theta, scale, Pxt, Ptt, workspace.step, trial)
