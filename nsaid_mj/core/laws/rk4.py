"""RK4 integration of (44) and (45), compiled: one text, composed with one metric at a time."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import composed, f8, i8, kernel_for, matrix, routine, vector, void
from ..numerics.lanes import as_lanes, widened
from ..numerics.linalg import copy_into, times_into
from ..parameters import Array
from ..structure.arrays import Workspace, workspace
from ..structure.compiled import WORKSPACE
from ..structure.motion import MOTION, own_stage, stage
from .metric import Metric


class Step(NamedTuple):
    """Workspace of a step, with z = (v̂, η)."""

    start: Array  # (n + p,) z at the start
    z: Array  # (n + p,) of a stage
    total: Array  # (n + p,) weighted sum
    rate: Array  # (n + p,) of a stage
    theta: Array  # (p,) θ̂ of a stage
    a_hat: Array  # (n,) â of (29)
    gradient: Array  # (p,) Wᵀ Δv
    stage: Workspace

    @staticmethod
    def of(bodies: int, n: int, p: int) -> "Step":
        """New workspace, for a robot of so many bodies, velocities and parameters."""
        start, z, total, rate = np.zeros((4, n + p))
        theta, gradient = np.zeros((2, p))
        return Step(start, z, total, rate, theta, np.zeros(n), gradient, workspace(bodies, n))


STEP = types.NamedTuple((*(vector,) * 7, WORKSPACE), Step)


@routine(void(matrix, STEP, vector))
def add_damping(K, work, v):
    """Writes Δv (n,) into z, and v̂̇ of (44) into the rates; v (n,) is measured."""
    dv = work.z[: v.shape[0]]
    rate = work.rate[: v.shape[0]]
    for i in range(v.shape[0]):
        dv[i] -= v[i]  # (37)
    times_into(K, dv, rate)
    for i in range(v.shape[0]):
        rate[i] = work.a_hat[i] - rate[i]  # (44)


@routine(void(STEP, f8, f8))
def move(work, weight, reach):
    """Adds a stage's rates to the weighted sum; moves z to the next stage or the step's end.

    `weight` is the stage's in the step [s], `reach` the time from the step's start to the next
    stage [s], 0 after the last.
    """
    start = work.start
    z = work.z
    total = work.total
    rate = work.rate
    for i in range(z.shape[0]):
        total[i] += weight * rate[i]
    if reach > 0.0:
        for i in range(z.shape[0]):
            z[i] = start[i] + reach * rate[i]
    else:
        copy_into(total, z)


# names of a metric's compiled functions in the text below, which `flow_in` gives their meaning
enter: Any = None
leave: Any = None
adapt: Any = None
hold: Any = None
accurate: Any = None


def follow(K, numbers, motion, v_hats, theta_hats, pivots, first, work, own):
    """Integrates (44, 45) along a motion of N samples.

    Args:
        K: (n, n) gain of the identification plant, or its diagonal (1, n) [1/s].
        numbers: the metric's.
        motion: of the log.
        v_hats: (N, n) v̂; written from row `first` on, the row before holds the initial values.
        theta_hats: (N, p) θ̂, likewise.
        pivots: (N,) M̂'s smallest in the step that ends at the row; likewise.
        first: number of the first row to write.
        work: `Step` for the robot.
        own: workspace of the metric.

    Returns:
        The first row at which M̂ was not positive definite, or the step was too long to be accurate;
        N if none.
    """
    t = motion.t
    start = work.start
    z = work.z
    theta = work.theta
    n = v_hats.shape[1]
    v_hat = z[:n]
    eta = z[n:]
    before = start[n:]
    for k in range(first, t.shape[0]):
        dt = t[k] - t[k - 1]
        copy_into(v_hats[k - 1], start[:n])
        enter(numbers, theta_hats[k - 1], before, own)
        copy_into(start, z)
        copy_into(start, work.total)
        copy_into(theta_hats[k - 1], theta)
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
            add_damping(K, work, v)
            adapt(numbers, eta, theta, work.gradient, work.rate[n:], own)  # (45)
            move(work, weight, reach)
            hold(numbers, before, eta, own)
            leave(numbers, eta, theta, own)
        if not accurate(numbers, before, eta, theta_hats[k - 1], theta, own):
            return k
        copy_into(v_hat, v_hats[k])
        copy_into(theta, theta_hats[k])
    return t.shape[0]


@cache
def flow_in(kind: type[Metric]) -> Callable[..., int]:
    """`follow` in a kind of metric; each is compiled when it is first called."""
    return kernel_for(kind, _signature(kind), follow, **_meanings(kind))


def _signature(kind: type[Metric], array: Callable[[Any], Any] = lambda of_one: of_one) -> Any:
    """That of `follow` in a kind of metric; `array` gives the types of what is a run's own."""
    metric = kind.compiled
    gains = array(matrix), array(metric.numbers)
    rows = array(matrix), array(matrix), array(vector)
    return i8(*gains, MOTION, *rows, i8, array(STEP), array(metric.workspace))


def _meanings(kind: type[Metric]) -> dict[str, Any]:
    """Of the names in the text of `follow`."""
    metric = kind.compiled
    return {
        "enter": metric.enter,
        "leave": metric.leave,
        "adapt": metric.adapt,
        "hold": metric.hold,
        "accurate": metric.accurate,
    }


# -- several runs at once --------------------------------------------------------------------------

follow_one: Any = None  # `follow` in a metric


def follow_together(K, numbers, motion, v_hats, theta_hats, pivots, first, work, own):
    """Integrates (44, 45) for `WIDTH` runs along a motion that they share.

    The arguments are those of `follow`; all but `motion` and `first` have an axis more, the last,
    with a number for each run. Returns the first row at which any M̂ was not positive definite.
    """
    return follow_one(
        as_lanes(K),
        as_lanes(numbers),
        motion,
        as_lanes(v_hats),
        as_lanes(theta_hats),
        as_lanes(pivots),
        first,
        as_lanes(work),
        as_lanes(own),
    )


@cache
def flow_together_in(kind: type[Metric]) -> Callable[..., int]:
    """`follow_together` in a kind of metric that is `together`."""
    text = composed(kind, follow, stage=own_stage, **_meanings(kind))
    one = routine(_signature(kind))(text)
    return kernel_for(kind, _signature(kind, widened), follow_together, follow_one=one)
