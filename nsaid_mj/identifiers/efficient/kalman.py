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

from typing import NamedTuple

import numpy as np
from numba import njit

from ...dynamics.forward import (
    difference_into,
    integrate_into,
    transition,
    transition_work,
    write_acceleration,
)
from ...numerics.linalg import cholesky
from ...parameters import Array
from ...structure.arrays import StructureArrays
from ..cone.barrier import Cone, inside
from .noise import MEMORY, Noise, add_increment, noise_variance
from .steps import carry_scale, project_inside

COMPLETED, CONTRADICTED, ROUNDED = 0, 1, 2
"""How `follow_filter` ends: at the log's end, at innovations larger than chance allows, or where
rounding errors left the covariance indefinite."""
_WARM_UP = 20  # fourth differences before the noise is known well enough to begin
_SIGNIFICANT = 6.0  # standard deviations by which a window's innovations must exceed chance
SMALL = 0.1
"""Size of a parameter near 0, relative to its scale, of which a relative change is a share."""
_SMALLEST = 1e-9  # share of a step, below which θ̂ stays
_FLOOR = 1e-14  # least variance of θ over the largest: rounding errors of a window's updates


class Law(NamedTuple):
    """What the filter knows beforehand, for compiled loops.

    Attributes:
        structure: of the system.
        cone: of physical parameters.
        scale: (p,) of θ.
        margin: (p,) of `steps.margin_of`.
        gamma: γ.
        window: samples over which innovations are tested.
        walk: (p,) variance that θ, relative to itself, gains in a second [1/s]; 0 where constant.
    """

    structure: StructureArrays
    cone: Cone
    scale: Array
    margin: Array
    gamma: float
    window: int
    walk: Array


class Filter(NamedTuple):
    """State of the filter at a sample. All arrays are overwritten by `follow_filter`.

    Attributes:
        q: (m,) estimated position.
        v: (n,) estimated velocity.
        theta: (p,) estimate.
        Pxx: (2n, 2n) covariance of the tangent state.
        Pxt: (2n, p) covariance of the state with θ/scale.
        Ptt: (p, p) covariance of θ/scale.
        noise: running estimate of the sensors' noise.
        tally: (4,) whether the filter has begun; samples in the current window, and their sums of
            squared normalised innovations and of log det S.
        safe: (2, p) θ̂ at the start of the preceding window, and of the current one.
        safe_P: (2, p, p) P_θθ there.
        totals: (2,) sum of all squared normalised innovations, and their number.
    """

    q: Array
    v: Array
    theta: Array
    Pxx: Array
    Pxt: Array
    Ptt: Array
    noise: Noise
    tally: Array
    safe: Array
    safe_P: Array
    totals: Array


def filter_at(q: Array, v: Array, theta: Array, Ptt: Array) -> Filter:
    """The filter at its first measurement q (m,), v (n,), with P_θθ (p, p) of θ̂/scale."""
    n, p = len(v), len(theta)
    noise = Noise(np.zeros((3, 2 * n)), np.zeros(2 * n), np.zeros(2 * n), np.zeros(1))
    safe, safe_P = np.array([theta, theta]), np.array([Ptt, Ptt])
    Pxx, Pxt = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, p))
    return Filter(
        q.copy(), v.copy(), theta.copy(), Pxx, Pxt, Ptt.copy(), noise, np.zeros(4), safe, safe_P,
        np.zeros(2),
    )  # fmt: skip


class Along(NamedTuple):
    """What `follow_filter` writes along a log of N samples, from row 1 on.

    Attributes:
        theta: (N, p) θ̂.
        v: (N, n) v̂.
        pivot: (N,) M̂'s smallest pivot in the step that ends at the row.
        innovation: (N, 2n) normalised ones, of position and velocity; NaN where there are none.
    """

    theta: Array
    v: Array
    pivot: Array
    innovation: Array

    @staticmethod
    def empty(count: int, n: int, p: int) -> Along:
        """For N rows, n velocities and p parameters."""
        rows = np.empty((count, p)), np.empty((count, n))
        return Along(*rows, np.full(count, np.inf), np.full((count, 2 * n), np.nan))

    def part(self, first: int) -> Along:
        """The rows from `first` on, which share their memory with these."""
        return Along(*(rows[first:] for rows in self))


def acceptable(law: Law, filter: Filter) -> float:
    """Largest sum of squared normalised innovations in a window that chance explains."""
    return _acceptable(law.window, filter.v.shape[0], filter.noise.seen[0])


@njit(cache=True)
def _acceptable(window, n, seen):
    dof = 2.0 * n * window
    vague = 1.0 + 4.0 / np.sqrt(min(seen, MEMORY))  # of R itself
    return vague * (dof + _SIGNIFICANT * np.sqrt(2.0 * dof) + 0.7 * _SIGNIFICANT**2)


@njit(cache=True)
def restart_state(filter, q, v, R):
    """Starts the state at a measurement, uncorrelated with θ."""
    filter.q[:], filter.v[:] = q, v
    filter.Pxx[:], filter.Pxt[:] = 0.0, 0.0
    for i in range(R.shape[0]):
        filter.Pxx[i, i] = R[i]
    filter.tally[:] = 0.0
    filter.tally[0] = 1.0
    filter.safe[0], filter.safe[1] = filter.theta, filter.theta
    filter.safe_P[0], filter.safe_P[1] = filter.Ptt, filter.Ptt


@njit(cache=True)
def keep_above_rounding(P, L):
    """Adds a floor to P (p, p) where its own rounding errors could make it indefinite.

    Along P_s nothing is learned, while exact data reduce the variance of other directions to where
    it is lost in the rounding errors of the unlearned one; gains from such a P have random signs.
    """
    largest = 0.0
    for i in range(P.shape[0]):
        largest = max(largest, P[i, i])
    if not cholesky(P, L) > _FLOOR * largest:
        for i in range(P.shape[0]):
            P[i, i] += _FLOOR * largest


@njit(cache=True)
def _workspaces(n, p):
    """Allocates the workspaces of `_predict` and `_update`."""
    size = 2 * n
    predicting = (
        np.empty((3 * n, p)), np.empty((3 * n, n)), np.empty((3 * n, 3 * n)),
        np.empty((size, 3 * n)),
    )  # fmt: skip
    updating = (
        np.empty((size, size)), np.zeros((size, size)), np.empty((size, size)),
        np.empty((size, p)), np.empty((p, p)), np.empty(size),
        np.empty(p), np.empty(p), np.empty(p),
    )  # fmt: skip
    return predicting, updating


@njit(cache=True)
def _predict(law, dt, F, B, filter, work):
    """Writes P̄, without R, from the derivatives F (2n, 3n) and B (n, p) of `transition`."""
    Pxx, Pxt, Ptt, gamma = filter.Pxx, filter.Pxt, filter.Ptt, law.gamma
    with_theta, with_c, both, moved = work  # covariances of (x, c) with θ/scale, c and itself
    size, n = Pxt.shape[0], B.shape[0]
    with_theta[:size] = Pxt
    np.dot(B, Ptt, with_theta[size:])
    np.dot(with_theta, B.T, with_c)
    both[:size, :size], both[:, size:] = Pxx, with_c
    both[size:, :size] = with_c[:size].T
    np.dot(F, with_theta, Pxt)
    np.dot(F, both, moved)
    np.dot(moved, F.T, Pxx)
    for i in range(size):
        for j in range(n):
            for k in range(n):
                own = F[i, size + j] * with_c[size + j, k] * F[i, size + k]
                Pxx[i, i] += gamma * gamma * own
    for k in range(law.scale.shape[0]):
        if law.walk[k] > 0.0:
            relative = max(abs(filter.theta[k]) / law.scale[k], SMALL)
            Ptt[k, k] += law.walk[k] * dt * relative * relative


@njit(cache=True)
def _innovate(law, filter, R, y, work):
    """Factors S and writes the step of θ̂ for an innovation y (2n,) into `work`.

    Returns:
        The squared normalised innovation and log det S; NaN if S is not positive definite.
    """
    Pxx, Pxt = filter.Pxx, filter.Pxt
    S, L, inverse, whitened, gained, e, step, _, _ = work
    size, p = Pxt.shape
    for i in range(size):
        for j in range(size):
            S[i, j], inverse[i, j] = 0.5 * (Pxx[i, j] + Pxx[j, i]), 0.0
        S[i, i] += R[i]
        inverse[i, i] = 1.0
    if not cholesky(S, L) > 0.0:
        return np.nan, np.nan
    spread = 0.0
    for i in range(size):  # L⁻¹
        spread += 2.0 * np.log(L[i, i])
        for j in range(i):
            for k in range(j + 1):
                inverse[i, k] -= L[i, j] * inverse[j, k]
        for k in range(i + 1):
            inverse[i, k] /= L[i, i]
    np.dot(inverse, y, e)
    np.dot(inverse, Pxt, whitened)
    np.dot(whitened.T, whitened, gained)
    np.dot(e, whitened, step)
    for k in range(p):
        step[k] *= law.scale[k]
    return np.dot(e, e), spread


@njit(cache=True)
def _update(law, filter, R, share, y, work):
    """Moves θ̂ by a share of its step, updates P, and writes the step of the state into y (2n,)."""
    theta, Pxx, Pxt, Ptt = filter.theta, filter.Pxx, filter.Pxt, filter.Ptt
    S, L, inverse, whitened, gained, e, step, at, trial = work
    scale = law.scale
    size, p = Pxt.shape
    for k in range(p):
        at[k] = theta[k]
        theta[k] += share * step[k]
    learned = share * (2.0 - share)  # (1 − share K H) P (1 − share K H)ᵀ + share² K R Kᵀ
    for i in range(p):  # BLAS may round the two triangles differently
        for k in range(i + 1):
            Ptt[i, k] -= learned * gained[i, k]
            Ptt[k, i] = Ptt[i, k]
    for i in range(size):
        for j in range(size):
            L[i, j] = R[i] * inverse[j, i]  # R L⁻ᵀ
    np.dot(L, whitened, Pxt)
    np.dot(inverse.T, e, y)
    y[:] = np.dot(Pxx, y)  # y − R S⁻¹ y would cancel
    np.dot(inverse, Pxx, S)
    np.dot(L, S, inverse)
    for i in range(size):
        for j in range(size):
            Pxx[i, j] = 0.5 * (inverse[i, j] + inverse[j, i])
    project_inside(law.cone, law.margin, at, theta, scale, Ptt, Pxt, y, trial)
    carry_scale(at, theta, scale, Pxt, Ptt, step, trial)


@njit(cache=True)
def _linear_share(law, q, v, u, filter, predicting, work):
    """Largest share 2⁻ᵏ of θ̂'s step that keeps half of M̂ at a state q (m,), v (n,).

    Along a longer step M̂⁻¹, and with it the derivatives of the prediction, are not nearly constant.
    """
    forward, a, step, trial, share = predicting[0], predicting[3][0], work[6], work[8], 1.0
    while share > _SMALLEST:
        for k in range(step.shape[0]):
            trial[k] = 0.5 * filter.theta[k] + share * step[k]
        if inside(law.cone, trial):  # then M̂ ≻ 0 there
            return share
        if write_acceleration(law.structure, q, v, u, trial, forward, a) > 0.0:
            return share
        share *= 0.5
    return 0.0


# Whatever does not depend on the structure is a function of its own, which is compiled only once.


@njit(cache=True)
def _observe(noise, increment, R):
    """Updates the estimate of the noise by an increment (2n,), and writes R (2n,)."""
    add_increment(noise, increment)
    R[:] = noise_variance(noise)


@njit(cache=True)
def _hand_out(theta, v, theta_row, v_row):
    """Writes one row of the estimates."""
    for i in range(theta.shape[0]):
        theta_row[i] = theta[i]
    for i in range(v.shape[0]):
        v_row[i] = v[i]


@njit(cache=True)
def _begin_window(theta, Ptt, safe, safe_P, tally, factor):
    """Begins another window of innovations; `factor` (p, p) is workspace."""
    keep_above_rounding(Ptt, factor)
    safe[0], safe[1] = safe[1], theta
    safe_P[0], safe_P[1] = safe_P[1], Ptt
    tally[1:] = 0.0


@njit(cache=True, nogil=True)
def follow_filter(law, filter, t, q, v, u, along):
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
    structure, scale, tally, totals = law.structure, law.scale, filter.tally, filter.totals
    thetas, v_hats, pivots, innovations = along
    n, m, p = v.shape[1], q.shape[1], scale.shape[0]
    step, (predicting, updating) = transition_work(structure, n, m, p), _workspaces(n, p)
    size = 2 * n
    q1, v1, y, R = np.empty(m), np.empty(n), np.empty(size), np.empty(size)
    factor = np.zeros((p, p))
    for k in range(1, t.shape[0]):
        difference_into(structure, q[k - 1], q[k], y[:n])
        for i in range(n):
            y[n + i] = v[k, i] - v[k - 1, i]
        _observe(filter.noise, y, R)
        pivots[k], innovations[k] = np.inf, np.nan
        if tally[0] == 0.0:
            if filter.noise.seen[0] >= _WARM_UP + 3:
                restart_state(filter, q[k], v[k], R)
            _hand_out(filter.theta, v[k], thetas[k], v_hats[k])
            continue
        pivot, F, B = transition(
            structure, filter.q, filter.v, u[k - 1], t[k] - t[k - 1], filter.theta, scale, step,
            q1, v1,
        )  # fmt: skip
        square, spread = np.nan, np.nan
        if pivot > 0.0:
            pivots[k] = pivot
            _predict(law, t[k] - t[k - 1], F, B, filter, predicting)
            difference_into(structure, q1, q[k], y[:n])
            for i in range(n):
                y[n + i] = v[k, i] - v1[i]
            square, spread = _innovate(law, filter, R, y, updating)
        if square < np.inf:
            share = _linear_share(law, q[k], v[k], u[k - 1], filter, step, updating)
            _update(law, filter, R, share, y, updating)
        if not square < np.inf:
            _hand_out(filter.theta, v[k], thetas[k], v_hats[k])
            return k, ROUNDED if pivot > 0.0 else CONTRADICTED
        innovations[k] = updating[5]
        integrate_into(structure, q1, y[:n], filter.q)
        for i in range(n):
            filter.v[i] = v1[i] + y[n + i]
        _hand_out(filter.theta, filter.v, thetas[k], v_hats[k])
        tally[1] += 1
        tally[2] += square
        tally[3] += spread
        totals[0] += square
        totals[1] += size
        if tally[2] > _acceptable(law.window, n, filter.noise.seen[0]):
            return k, CONTRADICTED
        if tally[1] >= law.window:
            _begin_window(filter.theta, filter.Ptt, filter.safe, filter.safe_P, tally, factor)
    return t.shape[0] - 1, COMPLETED


@njit(cache=True, nogil=True)
def covariance_along(law, filter, R, t, q, v, u):
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
    n, m, p = v.shape[1], q.shape[1], law.scale.shape[0]
    step, (predicting, updating) = transition_work(law.structure, n, m, p), _workspaces(n, p)
    q1, v1, y = np.empty(m), np.empty(n), np.empty(2 * n)
    for k in range(1, t.shape[0]):
        pivot, F, B = transition(
            law.structure, q[k - 1], v[k - 1], u[k - 1], t[k] - t[k - 1], filter.theta, law.scale,
            step, q1, v1,
        )  # fmt: skip
        if not pivot > 0.0:
            return k - 1
        _predict(law, t[k] - t[k - 1], F, B, filter, predicting)
        y[:] = 0.0
        if not _innovate(law, filter, R, y, updating)[0] < np.inf:
            return k - 1
        _update(law, filter, R, 1.0, y, updating)
    return t.shape[0] - 1
