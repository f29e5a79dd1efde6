"""Descent along a slope in a metric's coordinates, by Heun's method, compiled.

A controller's estimate is adapted by it: θ̂̇ = −(∇²ψ(θ̂))⁻¹ times a slope that does not depend on θ̂.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import boolean, f8, kernel_for, vector, void
from ..numerics.linalg import copy_into
from ..parameters import Array
from .metric import Metric


class Descent:
    """The descent of an estimate.

    It begins at θ̂ (p,).
    """

    def __init__(self, metric: Metric, theta: Array):
        self._numbers = metric.numbers
        self._own = metric.workspace()
        begin, self._step = descent_in(type(metric))
        first, second, ahead, guess = np.empty((4, len(theta)))
        self._work = DescentWorkspace(first, second, ahead, guess)
        self._eta = np.empty(len(theta))
        begin(self._numbers, self._own, theta, self._eta)

    def step(self, theta: Array, slope: Array, seconds: float) -> Array:
        """(p,) the next θ̂ after θ̂ (p,), which is returned itself if the step is not finite.

        slope (p,) is −Wᵀ s, held during the step.
        """
        moved = np.empty(len(theta))
        given = self._numbers, self._work, self._own, slope, seconds, self._eta, theta, moved
        return moved if self._step(*given) else theta


class DescentWorkspace(NamedTuple):
    """Workspace of `descend`."""

    first: Array  # (p,) rate at the start
    second: Array  # (p,) rate after a first step
    ahead: Array  # (p,) η after it
    guess: Array  # (p,) θ̂ after it


_DESCENT = types.NamedUniTuple(vector, 4, DescentWorkspace)

# names of a metric's compiled functions in the text below, to which `descent_in` gives a meaning
enter: Any = None
leave: Any = None
adapt: Any = None
hold: Any = None


def begin(numbers, own, theta, eta):
    """Writes the metric's coordinates η (p,) of θ̂ (p,)."""
    enter(numbers, theta, eta, own)


def descend(numbers, work, own, slope, step, eta, theta, moved):
    """A step of Heun's method in a metric's coordinates; returns whether it is finite.

    `own` is the metric's workspace, `slope` (p,) is −Wᵀ s and `step` a time [s]. η of θ̂ (p,) is
    moved in place, unless the step fails; `moved` receives θ̂ (p,) at its end.
    """
    first, second, ahead, guess = work
    p = eta.shape[0]
    adapt(numbers, eta, theta, slope, first, own)
    for i in range(p):
        ahead[i] = eta[i] + step * first[i]
    hold(numbers, eta, ahead, own)
    leave(numbers, ahead, guess, own)
    adapt(numbers, ahead, guess, slope, second, own)
    for i in range(p):
        ahead[i] = eta[i] + 0.5 * step * (first[i] + second[i])
    hold(numbers, eta, ahead, own)
    leave(numbers, ahead, moved, own)
    for i in range(p):
        if not np.isfinite(moved[i]):
            return False
    copy_into(ahead, eta)
    return True


@cache
def descent_in(kind: type[Metric]) -> tuple[Callable[..., None], Callable[..., bool]]:
    """`begin` and `descend` in a kind of metric."""
    metric = kind.compiled
    numbers = metric.numbers
    own = metric.workspace
    start = void(numbers, own, vector, vector)
    step = boolean(numbers, _DESCENT, own, vector, f8, vector, vector, vector)
    return (
        kernel_for(kind, start, begin, enter=metric.enter),
        kernel_for(kind, step, descend, leave=metric.leave, adapt=metric.adapt, hold=metric.hold),
    )
