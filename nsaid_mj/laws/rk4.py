"""RK4 integration of (44) and (45), compiled: one loop for every metric."""

import numpy as np
from numba import njit

from ..numerics.compiler import FAST
from ..numerics.kernels import kernel
from ..numerics.linalg import copy_into, times_into
from ..structure.motion import stage, stage_workspace
from .metric import accurate, adapt, chart, charts, enter, hold, leave

# -- one step --------------------------------------------------------------------------------------


@kernel()
def workspace(law, n, p):
    """Allocates the workspace of a step: start, stage z = (v̂, η), weighted sum, rate, θ̂, chart."""
    start, z, total, rate = np.zeros(n + p), np.zeros(n + p), np.zeros(n + p), np.zeros(n + p)
    return start, z, total, rate, np.zeros(p), chart(law)


@njit(**FAST)
def begin(law, work, v_hat, theta_hat):
    """Initialises a step's workspace at v̂ (n,) and θ̂ (p,)."""
    start, z, total, _, theta, scratch = work
    n = v_hat.shape[0]
    copy_into(v_hat, start[:n])
    enter(law, theta_hat, start[n:], scratch)
    copy_into(start, z)
    copy_into(start, total)
    copy_into(theta_hat, theta)


@njit(**FAST)
def advance(law, work, v, a_hat, gradient, weight, reach):
    """Adds a stage's rates to the weighted sum; moves z and θ̂ to the next stage or the step's end.

    v (n,) is measured, a_hat (n,) is â of (29), gradient (p,) Wᵀ Δv; `weight` is the stage's in the
    step [s], `reach` the time from the step's start to the next stage [s], 0 after the last.
    """
    start, z, total, rate, theta, scratch = work
    n = v.shape[0]
    dv, eta = z[:n], z[n:]
    for i in range(n):
        dv[i] -= v[i]  # (37)
    times_into(law.K, dv, rate[:n])
    for i in range(n):
        rate[i] = a_hat[i] - rate[i]  # (44)
    adapt(law, eta, theta, gradient, rate[n:], scratch)  # (45)
    for i in range(z.shape[0]):
        total[i] += weight * rate[i]
    if reach > 0.0:
        for i in range(z.shape[0]):
            z[i] = start[i] + reach * rate[i]
    else:
        copy_into(total, z)
    hold(law, start[n:], eta)
    leave(law, eta, theta, scratch)


# -- along a log -----------------------------------------------------------------------------------


@kernel(None, charts)
def follow(law, motion, v_hats, theta_hats, pivots, first):
    """Integrates (44, 45) along a motion of N samples.

    v_hats (N, n), theta_hats (N, p) and pivots (N,), M̂'s smallest in the step that ends at the
    row, are written from row `first` on; the row before holds the initial values.

    Returns:
        The first row at which M̂ was not positive definite, or the step was too long to be accurate;
        N if none.
    """
    n, p = v_hats.shape[1], theta_hats.shape[1]
    stages, work = stage_workspace(motion), workspace(law, n, p)
    a_hat, gradient = np.zeros(n), np.zeros(p)
    return _follow(law, motion, v_hats, theta_hats, pivots, first, stages, work, a_hat, gradient)


@njit(**FAST)
def _follow(law, motion, v_hats, theta_hats, pivots, first, stages, work, a_hat, gradient):
    """Integrates (44, 45) along a motion, in workspace from `follow`."""
    t, start, z, theta = motion.t, work[0], work[1], work[4]
    n = v_hats.shape[1]
    v_hat = z[:n]
    for k in range(first, t.shape[0]):
        dt = t[k] - t[k - 1]
        begin(law, work, v_hats[k - 1], theta_hats[k - 1])
        pivots[k] = np.inf
        for at, v, weight, reach in (
            (0, motion.v[k - 1], dt / 6, dt / 2),
            (1, motion.vm[k - 1], dt / 3, dt / 2),
            (1, motion.vm[k - 1], dt / 3, dt),
            (2, motion.v[k], dt / 6, 0.0),
        ):
            pivot = stage(motion, at, k, v_hat, theta, stages, a_hat, gradient)
            if not pivot > 0.0:
                pivots[k] = pivot
                return k
            pivots[k] = min(pivots[k], pivot)
            advance(law, work, v, a_hat, gradient, weight, reach)
        if not accurate(law, start[n:], z[n:], theta_hats[k - 1], theta, work[5]):
            return k
        copy_into(v_hat, v_hats[k])
        copy_into(theta, theta_hats[k])
    return t.shape[0]
