"""RK4 integration of (44) and (45), compiled: one loop for every metric."""

from typing import NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import f8, i8, kernel, matrix, routine, vector, void
from ..numerics.linalg import copy_into, times_into
from ..parameters import Array
from ..structure.arrays import Workspace, workspace
from ..structure.compiled import WORKSPACE
from ..structure.motion import MOTION, stage
from .cone.chart import CHART, Chart, chart_of
from .metric import LAW, accurate, adapt, enter, hold, leave


class Step(NamedTuple):
    """Workspace of a step, with z = (v̂, η)."""

    start: Array  # (n + p,) z at the start
    z: Array  # (n + p,) of a stage
    total: Array  # (n + p,) weighted sum
    rate: Array  # (n + p,) of a stage
    theta: Array  # (p,) θ̂ of a stage
    a_hat: Array  # (n,) â of (29)
    gradient: Array  # (p,) Wᵀ Δv
    chart: Chart
    stage: Workspace


_stage_workspace = routine(WORKSPACE(i8, i8), _nrt=True)(workspace)
STEP = types.NamedTuple((*(vector,) * 7, CHART, WORKSPACE), Step)


@routine(void(LAW, STEP, vector, vector))
def begin(law, work, v_hat, theta_hat):
    """Initialises a step's workspace at v̂ (n,) and θ̂ (p,)."""
    n = v_hat.shape[0]
    copy_into(v_hat, work.start[:n])
    enter(law, theta_hat, work.start[n:], work.chart)
    copy_into(work.start, work.z)
    copy_into(work.start, work.total)
    copy_into(theta_hat, work.theta)


@routine(void(LAW, STEP, vector, f8, f8))
def advance(law, work, v, weight, reach):
    """Adds a stage's rates to the weighted sum; moves z and θ̂ to the next stage or the step's end.

    v (n,) is measured; `weight` is the stage's in the step [s], `reach` the time from the step's
    start to the next stage [s], 0 after the last.
    """
    start, z, total, rate = work.start, work.z, work.total, work.rate
    n = v.shape[0]
    dv, eta = z[:n], z[n:]
    for i in range(n):
        dv[i] -= v[i]  # (37)
    times_into(law.K, dv, rate[:n])
    for i in range(n):
        rate[i] = work.a_hat[i] - rate[i]  # (44)
    adapt(law, eta, work.theta, work.gradient, rate[n:], work.chart)  # (45)
    for i in range(z.shape[0]):
        total[i] += weight * rate[i]
    if reach > 0.0:
        for i in range(z.shape[0]):
            z[i] = start[i] + reach * rate[i]
    else:
        copy_into(total, z)
    hold(law, start[n:], eta)
    leave(law, eta, work.theta, work.chart)


@kernel(i8(LAW, MOTION, matrix, matrix, vector, i8, STEP), inner=True)
def _follow(law, motion, v_hats, theta_hats, pivots, first, work):
    """Integrates (44, 45) along a motion, in workspace from `follow`."""
    t, start, z, theta = motion.t, work.start, work.z, work.theta
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
            pivot = stage(motion, at, k, v_hat, theta, work.stage, work.a_hat, work.gradient)
            if not pivot > 0.0:
                pivots[k] = pivot
                return k
            pivots[k] = min(pivots[k], pivot)
            advance(law, work, v, weight, reach)
        if not accurate(law, start[n:], z[n:], theta_hats[k - 1], theta, work.chart):
            return k
        copy_into(v_hat, v_hats[k])
        copy_into(theta, theta_hats[k])
    return t.shape[0]


@kernel(i8(LAW, MOTION, matrix, matrix, vector, i8), _nrt=True)
def follow(law, motion, v_hats, theta_hats, pivots, first):
    """Integrates (44, 45) along a motion of N samples.

    v_hats (N, n), theta_hats (N, p) and pivots (N,), M̂'s smallest in the step that ends at the
    row, are written from row `first` on; the row before holds the initial values.

    Returns:
        The first row at which M̂ was not positive definite, or the step was too long to be accurate;
        N if none.
    """
    n, p = v_hats.shape[1], theta_hats.shape[1]
    start, z, total, rate = np.zeros(n + p), np.zeros(n + p), np.zeros(n + p), np.zeros(n + p)
    stage, chart = _stage_workspace(motion.structure.bodies.shape[0], n), chart_of(law.cone)
    own = np.zeros(p), np.zeros(n), np.zeros(p), chart, stage
    work = Step(start, z, total, rate, *own)
    return _follow(law, motion, v_hats, theta_hats, pivots, first, work)
