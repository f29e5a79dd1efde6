"""Gauss–Newton steps that stay inside the cone of physical parameters."""

from typing import NamedTuple, Protocol

import numpy as np

from ..parameters import Array
from .matrices import solve


class ConeFunction(Protocol):
    """A function on the cone, with the metric in which steps are measured."""

    def value(self, theta: Array) -> float:
        """The function at θ (p,); infinite or NaN outside the cone."""
        ...

    def derivatives(self, theta: Array) -> tuple[Array, Array]:
        """(p,) its gradient and (p, p) its positive semidefinite Gauss–Newton Hessian."""
        ...

    def length(self, theta: Array, step: Array) -> float:
        """Length of a step (p,) in the cone's metric at θ: shorter than 1, it stays inside."""
        ...


class Objective(ConeFunction, Protocol):
    """The function to minimise."""

    def gradient(self, theta: Array) -> Array:
        """(p,) its gradient."""
        ...


class Rules(NamedTuple):
    """Limits of steps, and stopping criteria."""

    steps: int  # their largest number
    halvings: int  # at most, of a step that does not decrease the objective
    done: float  # Newton decrement at which they end
    fall: float = 0.0  # least decrease of the objective, below which they end
    reach: float = 0.5  # longest step in the metric
    # length below which a step is scaled by the gradient, which is exact there, while differences
    # of the objective are rounding errors
    close: float = 0.0


class Reached(NamedTuple):
    """The point at which the steps end."""

    theta: Array  # (p,) θ
    decrement: float  # Newton decrement √(gᵀ H⁻¹ g) there, or in the step before
    hessian: Array  # (p, p) Gauss–Newton Hessian of the same point


def minimise(
    objective: Objective, start: Array, rules: Rules, basis: Array | None = None
) -> Reached:
    """Minimises an objective from a start θ (p,) inside the cone.

    basis (p, k) are the directions in which θ may move; None for all.
    """
    theta = start
    decrement = np.inf
    hessian = np.eye(len(start))
    value = None
    for _ in range(rules.steps):
        gradient, hessian = objective.derivatives(theta)
        if basis is None:
            way = -solve(hessian, gradient)
        else:
            way = -basis @ solve(basis.T @ hessian @ basis, basis.T @ gradient)
        slope = float(gradient @ way)
        decrement = float(np.sqrt(max(0.0, -slope)))
        if not decrement > rules.done:  # or NaN
            break
        length = objective.length(theta, way)
        if length > rules.close:
            share = min(1.0, rules.reach / max(length, 1e-300))
            before = objective.value(theta) if value is None else value
            way, value = _shortened(objective, theta, share * way, rules.halvings, before)
            fall = before - value
        else:
            ahead = float(objective.gradient(theta + way) @ way)
            way = way / (1 + max(0.0, -ahead / slope))
            fall = np.inf
            value = None
        theta = theta + way
        if not way.any() or fall < rules.fall:
            break
    return Reached(theta, decrement, hessian)


def _shortened(
    objective: Objective, theta: Array, way: Array, most: int, before: float
) -> tuple[Array, float]:
    """The first of way, way/2, way/4 … that lowers the objective, or 0, and the objective there.

    `before` is the objective at theta.
    """
    for _ in range(most):
        after = objective.value(theta + way)
        if after <= before + 1e-12 * abs(before):
            return way, after
        way = 0.5 * way
    return 0 * way, before
