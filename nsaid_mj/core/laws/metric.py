"""Metrics, which map Wᵀ Δv to θ̂̇ (45): the interface, and the paper's constant Γ.

A metric is one file with two sides: the gain, the conserved quantity and the metric's term of V in
Python, and compiled functions for the loops that integrate θ̂. These know θ̂ by coordinates η, in
which a step is taken: in the paper's law η = θ̂ and θ̂̇ = Γ Wᵀ Δv; those of the cone cannot leave it.
A loop is compiled for a metric when an identifier with that metric first needs it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numba import types

from ...base import InvalidInput
from ..numerics.kernels import boolean, f8, kernel_for, matrix, routine, vector, void
from ..numerics.linalg import copy_into, times_into
from ..parameters import Array


class CompiledMetric(NamedTuple):
    """The compiled side of a metric, for loops in its coordinates η.

    Every function's arguments begin with the metric's numbers and end with its workspace. In
    another metric, write them with `numerics.kernels.routine`, as below.
    """

    numbers: Any  # numba's type of `Metric.numbers`
    workspace: Any  # numba's type of `Metric.workspace()`
    enter: Callable[..., None]  # (numbers, θ̂, η, work): writes η (p,) of θ̂ (p,)
    leave: Callable[..., None]  # (numbers, η, θ̂, work): writes θ̂ (p,) of η (p,)
    # (numbers, η, θ̂, gradient, rate, work): writes η̇ (p,) of (45) from Wᵀ Δv (p,)
    adapt: Callable[..., None]
    # (numbers, start, η, work): shortens the step from `start` (p,) to η (p,), in place, where θ̂
    # would leave its domain
    hold: Callable[..., None]
    # (numbers, start, η, before, θ̂, work): whether a step from `start` (p,), θ̂ `before` (p,), to
    # η (p,) and θ̂ (p,) is accurate; where it is not, it is divided
    accurate: Callable[..., bool]


class Metric(ABC):
    """The map from Wᵀ Δv to θ̂̇."""

    Gamma: Array  # (p,) or (p, p) adaptation gain of (45), or of the metric's quadratic part
    conserves: bool  # whether there is a conserved quantity
    divides: ClassVar[bool] = False  # whether a step that is not accurate is divided
    # whether its compiled functions only copy, add, multiply and divide numbers, so that they can
    # be compiled for several runs at once (`numerics.lanes`)
    together: ClassVar[bool] = False
    cancelling: float  # size of the terms that cancel in `divergence`, besides its value [J]
    compiled: ClassVar[CompiledMetric]  # its functions for compiled loops
    numbers: Any  # its numbers for them, a NamedTuple of arrays and numbers

    def descent(self, theta: Array) -> Descent:
        """A descent along slopes that do not depend on θ̂, from θ̂ (p,) on."""
        return Descent(self, theta)

    @abstractmethod
    def workspace(self) -> Any:
        """New workspace of the compiled functions."""

    @abstractmethod
    def conserved(self, theta_hat: Array) -> Array:
        """(...,) the quantity conserved by (45) and (30), for estimates (..., p)."""

    @abstractmethod
    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) the second term of V at θ (p,) and estimates (..., p)."""


# -- descent along a slope -------------------------------------------------------------------------


class Descent:
    """The descent of an estimate in a metric's coordinates, by Heun's method.

    It begins at θ̂ (p,), and follows θ̂̇ = (∇²ψ(θ̂))⁻¹ times a slope that does not depend on θ̂.
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

        slope (p,), such as −Wᵀ s, is held during the step.
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


# -- the paper's metric ---------------------------------------------------------------------------


class ConstantNumbers(NamedTuple):
    """A constant Γ for compiled loops."""

    gain: Array  # (p, p) Γ, or its diagonal (1, p)


_CONSTANT = types.NamedUniTuple(matrix, 1, ConstantNumbers)


@routine(void(_CONSTANT, vector, vector, vector))
def _copy(constant, one, other, work):
    """Writes η (p,) of θ̂ (p,), or θ̂ of η: they are the same."""
    copy_into(one, other)


@routine(void(_CONSTANT, vector, vector, vector, vector, vector))
def _adapt(constant, eta, theta, gradient, rate, work):
    """Writes Γ Wᵀ Δv (p,)."""
    times_into(constant.gain, gradient, rate)


@routine(void(_CONSTANT, vector, vector, vector))
def _hold(constant, start, eta, work):
    """Does nothing: no θ̂ is excluded."""


@routine(boolean(_CONSTANT, vector, vector, vector, vector, vector))
def _accurate(constant, start, eta, before, theta, work):
    """True: the loop's caller watches the conserved quantity."""
    return True


COMPILED = CompiledMetric(_CONSTANT, vector, _copy, _copy, _adapt, _hold, _accurate)


class ConstantMetric(Metric):
    """The paper's metric: θ̂̇ = Γ Wᵀ Δv with a constant Γ.

    Gamma, (p,) or (p, p), is positive definite, but for zero rows and columns of a diagonal, which
    hold a parameter at its prior; held (p,) masks these. `size` is p, by default that of Γ.

    Raises:
        InvalidInput: Γ has another size, or is not positive definite on the parameters that move.
    """

    cancelling = 0.0
    compiled = COMPILED
    together = True

    def __init__(self, Gamma: Array, held: np.ndarray | None = None, size: int | None = None):
        size = len(Gamma) if size is None else size
        self.moving = np.ones(size, dtype=bool) if held is None else ~np.asarray(held)
        self.Gamma = positive_gain("Gamma", Gamma, size, self.moving)
        self.conserves = bool(self.moving.all())
        self.numbers = ConstantNumbers(np.atleast_2d(self.Gamma))

    def workspace(self) -> Array:
        """Nothing."""
        return np.empty(0)

    def conserved(self, theta_hat: Array) -> Array:
        """(...,) θ̂ᵀ Γ⁻¹ θ̂ over the parameters that are not held.

        It is constant under (45) by (30), W θ̂ = 0, unless parameters are held: (30) needs all of θ̂.
        """
        theta = np.asarray(theta_hat)[..., self.moving]
        if self.Gamma.ndim == 1:
            return np.sum(theta**2 / self.Gamma[self.moving], axis=-1)
        rows = theta.reshape(-1, theta.shape[-1])  # one factorisation for all estimates
        solved = np.linalg.solve(self.Gamma, rows.T).T
        return np.sum(rows * solved, axis=-1).reshape(theta.shape[:-1])

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) ½ Δθᵀ Γ⁻¹ Δθ of (66)."""
        return 0.5 * self.conserved(theta_hat - theta)


# -- gains ----------------------------------------------------------------------------------------


def positive_gain(name: str, value: Array, size: int, moving: np.ndarray | None = None) -> Array:
    """Checks that a gain, its diagonal (size,) or all of it (size, size), is positive definite.

    moving (size,) masks the diagonal's entries that must be > 0; None is all. `name` is for
    messages. Returns the gain as a contiguous float array.

    Raises:
        InvalidInput: the shape is wrong, or the gain is not symmetric or not positive definite.
    """
    gain = np.ascontiguousarray(value, dtype=np.float64)
    if gain.shape not in ((size,), (size, size)):
        raise InvalidInput(
            name,
            f"shape ({size},) or ({size}, {size})",
            gain.shape,
            "Pass the diagonal or the full matrix.",
        )
    if not np.isfinite(gain).all():
        raise InvalidInput(name, "finite values", "NaN or infinity", "Check how it was computed.")
    if gain.ndim == 2 and not np.allclose(gain, gain.T, rtol=1e-10, atol=0):
        raise InvalidInput(name, "a symmetric matrix", "one that is not", "Use (G + Gᵀ)/2.")
    smallest = (
        gain[moving if moving is not None else slice(None)].min(initial=np.inf)
        if gain.ndim == 1
        else np.linalg.eigvalsh(gain)[0]
    )
    if not smallest > 0:
        raise InvalidInput(
            name, "a positive definite gain", f"smallest eigenvalue {smallest:g}", "Make it > 0."
        )
    return gain
