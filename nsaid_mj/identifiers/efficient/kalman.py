"""An extended Kalman filter of position, velocity and parameters, compiled.

    x̄ = RK4(x̂, u held; θ̂),    F = [Φ Γ; 0 1],
    P̄ = F P Fᵀ + γ² diag(diag(Γ P_θθ Γᵀ)),
    S = P̄_xx + R,    L Lᵀ = S,    e = L⁻¹ y,    y = (difference(q̄, q), v − v̄),
    θ̂ ← θ̂ + share scale P̄_θx L⁻ᵀ e,    x̂ ← x̄ + P̄_xx L⁻ᵀ e,
    P ← P̄ − P̄ Hᵀ S⁻¹ H P̄,    P_θθ with the factor share (2 − share).

share < 1 where the step would halve M̂: P shrinks by what the shorter step learns (Joseph's form
with the gain that is applied). Then θ̂, and with it x̂, is projected into the cone in the metric
P⁻¹, which takes it no further from any θ inside, and the error of the common scale is carried
along; see `steps`.

θ acts in a step through c = B θ/scale alone, n accelerations, so that Γ = F_c B, and P̄_x is that of
(x, c) carried along by [Φ F_c]. P_θθ is as before the step: only measurements change it.

This is (44, 45) with K and Γ replaced by the gains that the data's own information implies. Both q
and v are measured, so that P_xθ = R S⁻¹ P̄_xθ and P_xx = R S⁻¹ P̄_xx after an update. γ accounts for
the error of linearisation about θ̂: a share of what the uncertainty of θ does in a step.
"""

from __future__ import annotations

import numpy as np
from numba import types

from ...numerics.linalg import cholesky, multiply, subtract_square, transpose
from ...parameters import Array
from ...quotient.cone import inside
from ...structure.compiled import f8, i8, kernel, matrix, vector, void
from ...structure.forces import ALL, write_forces
from ...structure.kinematics import place
from ...structure.poses import difference, integrate
from ...structure.stage import accelerate
from ...structure.transition import step as transition
from .filter import (
    ALONG,
    BEGINNING,
    COMPLETED,
    CONTRADICTED,
    FILTER,
    LAW,
    MEMORIES,
    ROUNDED,
    Along,
    Filter,
    Law,
    memory_for,
)
from .noise import MEMORY, add_increment, write_variance
from .steps import carry_scale, project_inside

_WARM_UP = 20  # fourth differences before the noise is known well enough to begin
_SIGNIFICANT = 6.0  # standard deviations by which a window's innovations must exceed chance
SMALL = 0.1
"""Size of a parameter near 0, relative to its scale, of which a relative change is a share."""
_SMALLEST = 1e-9  # share of a step, below which θ̂ stays
_FLOOR = 1e-14  # least variance of θ over the largest: rounding errors of a window's updates


def acceptable(law: Law, filter: Filter) -> float:
    """Largest sum of squared normalised innovations in a window that chance explains."""
    return _acceptable(law.window, filter.v.shape[0], filter.noise.seen[0])


@kernel(f8(i8, i8, f8))
def _acceptable(window, n, seen):
    dof = 2.0 * n * window
    vague = 1.0 + 4.0 / np.sqrt(min(seen, MEMORY))  # of R itself
    return vague * (dof + _SIGNIFICANT * np.sqrt(2.0 * dof) + 0.7 * _SIGNIFICANT**2)


@kernel(void(matrix, matrix), inner=True)
def _copy(source, target):
    """Copies a matrix."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel(void(FILTER, vector, vector, vector))
def restart_state(filter, q, v, R):
    """Starts the state at a measurement, uncorrelated with θ."""
    n, theta, tally = v.shape[0], filter.theta, filter.tally
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
    _copy(filter.Ptt, filter.safe_P[0])
    _copy(filter.Ptt, filter.safe_P[1])


@kernel(void(matrix, matrix))
def keep_above_rounding(P, L):
    """Makes P (p, p) symmetric, and adds a floor where its rounding errors could be indefinite.

    Along P_s nothing is learned, while exact data reduce the variance of other directions to where
    it is lost in the rounding errors of the unlearned one; gains from such a P have random signs.
    """
    largest = 0.0
    for i in range(P.shape[0]):
        largest = max(largest, P[i, i])
        for k in range(i):
            P[k, i] = P[i, k]
    if not cholesky(P, L) > _FLOOR * largest:
        for i in range(P.shape[0]):
            P[i, i] += _FLOOR * largest


@kernel(void(LAW, f8, FILTER, MEMORIES), inner=True)
def _predict(law, dt, filter, memory):
    """Writes P̄, without R, from the derivatives F and B of `transition`."""
    Pxx, Pxt, Ptt, gamma, F = filter.Pxx, filter.Pxt, filter.Ptt, law.gamma, memory.F
    with_theta, with_c, both = memory.with_theta, memory.with_c, memory.both
    size, n = Pxt.shape[0], filter.v.shape[0]
    transpose(F, memory.F_T)
    _copy(Pxt, with_theta)
    multiply(memory.B, Ptt, with_theta[size:])
    transpose(with_theta, memory.theta_with)
    multiply(memory.B, memory.theta_with, memory.c_with)
    transpose(memory.c_with, with_c)
    for i in range(size + n):
        for j in range(n):
            both[i, size + j] = with_c[i, j]
    for i in range(size):
        for j in range(size):
            both[i, j] = Pxx[i, j]
        for j in range(n):
            both[size + j, i] = with_c[i, j]
    multiply(F, with_theta, Pxt)
    multiply(F, both, memory.moved)
    multiply(memory.moved, memory.F_T, Pxx)
    for i in range(size):
        for j in range(n):
            for k in range(n):
                own = F[i, size + j] * with_c[size + j, k] * F[i, size + k]
                Pxx[i, i] += gamma * gamma * own
    for k in range(law.scale.shape[0]):
        if law.walk[k] > 0.0:
            relative = max(abs(filter.theta[k]) / law.scale[k], SMALL)
            Ptt[k, k] += law.walk[k] * dt * relative * relative


@kernel(f8(LAW, FILTER, MEMORIES), inner=True)
def _innovate(law, filter, memory):
    """Factors S and writes the step of θ̂ for the innovation y.

    Returns:
        log det S; NaN if S is not positive definite.
    """
    Pxx, S, L, inverse = filter.Pxx, memory.S, memory.L, memory.inverse
    y, e, step, whitened = memory.y, memory.e, memory.step, memory.whitened
    size, p = whitened.shape
    for i in range(size):
        for j in range(size):
            S[i, j], inverse[i, j] = 0.5 * (Pxx[i, j] + Pxx[j, i]), 0.0
        S[i, i] += memory.R[i]
        inverse[i, i] = 1.0
    if not cholesky(S, L) > 0.0:
        return np.nan
    spread = 0.0
    for i in range(size):  # L⁻¹
        spread += 2.0 * np.log(L[i, i])
        for j in range(i):
            for k in range(j + 1):
                inverse[i, k] -= L[i, j] * inverse[j, k]
        for k in range(i + 1):
            inverse[i, k] /= L[i, i]
    multiply(inverse, filter.Pxt, whitened)
    for k in range(p):
        step[k] = 0.0
    for i in range(size):
        e[i] = 0.0
        for j in range(i + 1):
            e[i] += inverse[i, j] * y[j]
        for k in range(p):
            step[k] += e[i] * whitened[i, k]
    for k in range(p):
        step[k] *= law.scale[k]
    return spread


@kernel(void(LAW, FILTER, f8, MEMORIES), inner=True)
def _update(law, filter, share, memory):
    """Moves θ̂ by a share of its step, updates P, and overwrites y by the step of the state."""
    theta, Pxx, Pxt, Ptt = filter.theta, filter.Pxx, filter.Pxt, filter.Ptt
    S, L, inverse, whitened = memory.S, memory.L, memory.inverse, memory.whitened
    e, y, R, before, trial = memory.e, memory.y, memory.R, memory.before, memory.trial
    size, p = whitened.shape
    for k in range(p):
        before[k] = theta[k]
        theta[k] += share * memory.step[k]
    for i in range(size):
        for j in range(size):
            L[i, j] = R[i] * inverse[j, i]  # R L⁻ᵀ
    multiply(L, whitened, Pxt)
    learned = np.sqrt(share * (2.0 - share))
    for r in range(size):
        for k in range(p):
            whitened[r, k] *= learned
    subtract_square(whitened, Ptt)  # (1 − share K H) P (1 − share K H)ᵀ + share² K R Kᵀ
    for i in range(size):
        S[0, i], y[i] = 0.0, 0.0
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
    project_inside(law.cone, law.margin, before, theta, law.scale, Ptt, Pxt, y, trial)
    carry_scale(before, theta, law.scale, Pxt, Ptt, memory.step, trial)


@kernel(f8(LAW, vector, vector, vector, FILTER, MEMORIES), inner=True)
def _linear_share(law, q, v, u, filter, memory):
    """Largest share 2⁻ᵏ of θ̂'s step that keeps half of M̂ at a state q (m,), v (n,).

    Along a longer step M̂⁻¹, and with it the derivatives of the prediction, are not nearly constant.
    """
    structure, stage, slopes = law.structure, memory.stage, memory.slopes
    step, trial, share, placed = memory.step, memory.trial, 1.0, False
    while share > _SMALLEST:
        for k in range(step.shape[0]):
            trial[k] = 0.5 * filter.theta[k] + share * step[k]
        if inside(law.cone, trial):  # then M̂ ≻ 0 there
            return share
        if not placed:
            place(structure, q, v, slopes.state)
            write_forces(structure, slopes.state, q, v, u, ALL, stage.scratch, slopes.F)
            placed = True
        if accelerate(structure, slopes.state, slopes.F, v, trial, stage, memory.with_c[0]) > 0.0:
            return share
        share *= 0.5
    return 0.0


@kernel(void(FILTER, matrix), inner=True)
def _begin_window(filter, factor):
    """Begins another window of innovations; `factor` (p, p) is workspace."""
    theta, safe, safe_P, tally = filter.theta, filter.safe, filter.safe_P, filter.tally
    keep_above_rounding(filter.Ptt, factor)
    for i in range(theta.shape[0]):
        safe[0, i], safe[1, i] = safe[1, i], theta[i]
    _copy(safe_P[1], safe_P[0])
    _copy(filter.Ptt, safe_P[1])
    for i in range(1, tally.shape[0]):
        tally[i] = 0.0


@kernel(f8(LAW, FILTER, f8, vector, vector, vector, MEMORIES), inner=True)
def _move(law, filter, dt, q, v, u, memory):
    """Carries state and covariance through a step, and writes the step and the innovation y.

    Returns:
        M̂'s smallest pivot, > 0 if it succeeded.
    """
    pivot = transition(
        law.structure, q, v, u, dt, filter.theta, law.scale, memory.stage, memory.slopes,
        memory.at, memory.q1, memory.v1, memory.F, memory.B,
    )  # fmt: skip
    if pivot > 0.0:
        _predict(law, dt, filter, memory)
    return pivot


@kernel(i8(LAW, FILTER, i8, vector, matrix, matrix, matrix, ALONG, MEMORIES), inner=True)
def _follow_row(law, filter, k, t, q, v, u, along, memory):
    """Runs the filter from row k − 1 to k, and returns how that ended."""
    structure, tally, totals = law.structure, filter.tally, filter.totals
    n, y, x, v1, out = v.shape[1], memory.y, memory.stage.scratch, memory.v1, along.innovation[k]
    difference(structure.bodies, q[k - 1], q[k], y, x)
    for i in range(n):
        y[n + i] = v[k, i] - v[k - 1, i]
    add_increment(filter.noise, y)
    write_variance(filter.noise, memory.R)
    along.pivot[k] = np.inf
    for i in range(2 * n):
        out[i] = np.nan
    if tally[0] == 0.0:
        if filter.noise.seen[0] >= _WARM_UP + 3:
            restart_state(filter, q[k], v[k], memory.R)
        return BEGINNING
    pivot = _move(law, filter, t[k] - t[k - 1], filter.q, filter.v, u[k - 1], memory)
    if not pivot > 0.0:
        return CONTRADICTED
    along.pivot[k] = pivot
    difference(structure.bodies, memory.q1, q[k], y, x)
    for i in range(n):
        y[n + i] = v[k, i] - v1[i]
    spread, square = _innovate(law, filter, memory), 0.0
    for i in range(2 * n):
        square += memory.e[i] * memory.e[i]
    if not (spread < np.inf and square < np.inf):
        return ROUNDED
    share = _linear_share(law, q[k], v[k], u[k - 1], filter, memory)
    _update(law, filter, share, memory)
    integrate(structure.bodies, memory.q1, y, filter.q, x)
    for i in range(n):
        filter.v[i] = v1[i] + y[n + i]
    for i in range(2 * n):
        out[i] = memory.e[i]
    tally[1] += 1
    tally[2] += square
    tally[3] += spread
    totals[0] += square
    totals[1] += 2 * n
    return COMPLETED


@kernel(types.UniTuple(i8, 2)(LAW, FILTER, vector, matrix, matrix, matrix, ALONG, MEMORIES))
def _follow(law, filter, t, q, v, u, along, memory):
    """Does what `follow_filter` says, in its memory."""
    n, tally = v.shape[1], filter.tally
    for k in range(1, t.shape[0]):
        end = _follow_row(law, filter, k, t, q, v, u, along, memory)
        for i in range(filter.theta.shape[0]):
            along.theta[k, i] = filter.theta[i]
        for i in range(n):
            along.v[k, i] = filter.v[i] if end == COMPLETED else v[k, i]
        if end == BEGINNING:
            continue
        if end != COMPLETED or tally[2] > _acceptable(law.window, n, filter.noise.seen[0]):
            return k, end if end != COMPLETED else CONTRADICTED
        if tally[1] >= law.window:
            _begin_window(filter, memory.factor)
    return t.shape[0] - 1, COMPLETED


def follow_filter(
    law: Law, filter: Filter, t: Array, q: Array, v: Array, u: Array, along: Along
) -> tuple[int, int]:
    """Runs the filter along a log of N samples.

    Args:
        law: what is known beforehand.
        filter: at the first sample; overwritten by that at the last one processed.
        t: (N,) times [s].
        q: (N, m) positions.
        v: (N, n) velocities.
        u: (N, n_u) commands.
        along: rows written.

    Returns:
        The last row processed, and how the loop ended.
    """
    memory = memory_for(law.structure, v.shape[1], q.shape[1], len(law.scale))
    return _follow(law, filter, t, q, v, u, along, memory)


@kernel(i8(LAW, FILTER, vector, vector, matrix, matrix, matrix, MEMORIES))
def _cover(law, filter, R, t, q, v, u, memory):
    """Does what `covariance_along` says, in its memory."""
    for i in range(R.shape[0]):
        memory.R[i] = R[i]
    for k in range(1, t.shape[0]):
        if not _move(law, filter, t[k] - t[k - 1], q[k - 1], v[k - 1], u[k - 1], memory) > 0.0:
            return k - 1
        for i in range(R.shape[0]):
            memory.y[i] = 0.0
        if not _innovate(law, filter, memory) < np.inf:
            return k - 1
        _update(law, filter, 1.0, memory)
    return t.shape[0] - 1


def covariance_along(
    law: Law, filter: Filter, R: Array, t: Array, q: Array, v: Array, u: Array
) -> int:
    """Overwrites P of a filter by that after a log, along given states and at a given θ.

    Args:
        law: what is known beforehand; its γ adds to the covariance as in the filter.
        filter: its θ̂ is the θ at which the system is linearised; P at the first sample.
        R: (2n,) variances of the noise.
        t: (N,) times [s].
        q: (N, m) positions at which the system is linearised.
        v: (N, n) velocities there.
        u: (N, n_u) commands.

    Returns:
        The last row processed: N − 1, or that where M or S was not positive definite.
    """
    memory = memory_for(law.structure, v.shape[1], q.shape[1], len(law.scale))
    return _cover(law, filter, R, t, q, v, u, memory)
