"""Metrics, which map Wᵀ Δv to θ̂̇ (45), in Python and for compiled loops.

A `Metric` is the Python side: the gain, the conserved quantity, the metric's term of V. Compiled
loops get a `Law` with a chart, the coordinates η in which θ̂ is integrated: in the paper's law η = θ̂
and θ̂̇ = Γ Wᵀ Δv; the cone's chart cannot leave the cone.
"""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
from numba import types

from ..errors import InvalidInput
from ..numerics.kernels import boolean, f8, matrix, routine, vector, void
from ..numerics.linalg import copy_into, times_into
from ..parameters import Array
from ..quotient.cone import CONE, NO_CONE, Cone
from .cone.chart import (
    CHART,
    confine,
    dense_rate_into,
    from_chart_into,
    height,
    natural_rate_into,
    to_chart_into,
)

ACCURACY = 1e-7
"""Largest change of the conserved quantity in one step of the cone's law, relative to μν."""


class Law(NamedTuple):
    """(44) and (45) for compiled loops, in the paper's metric or the cone's."""

    K: Array  # (n, n) gain of the identification plant, or its diagonal (1, n) [1/s]
    gain: Array  # (p, p), or a diagonal (1, p): Γ of the paper's law, Γ⁻¹ of the cone's
    cone: Cone = NO_CONE
    pairing: Array = np.empty(0)  # (e,) `coordinates` of the cone
    mu: float = 0.0  # weight μ of the barrier [J]; 0 for the paper's law


LAW = types.NamedTuple((matrix, matrix, CONE, vector, f8), Law)


class Metric(ABC):
    """The map from Wᵀ Δv to θ̂̇."""

    Gamma: Array  # (p,) or (p, p) adaptation gain of (45), or of the metric's quadratic part
    conserves: bool  # whether there is a conserved quantity
    cancelling: float  # size of the terms that cancel in `divergence`, besides its value [J]

    @abstractmethod
    def law(self, K: Array) -> Law:
        """The metric and the gain K, (n,) or (n, n), of (44) for compiled loops."""

    @abstractmethod
    def conserved(self, theta_hat: Array) -> Array:
        """(...,) the quantity conserved by (45) and (30), for estimates (..., p)."""

    @abstractmethod
    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) the second term of V at θ (p,) and estimates (..., p)."""


class ConstantMetric(Metric):
    """The paper's metric: θ̂̇ = Γ Wᵀ Δv with a constant Γ.

    Gamma, (p,) or (p, p), is positive definite, but for zero rows and columns of a diagonal, which
    hold a parameter at its prior; held (p,) masks these. `size` is p, by default that of Γ.

    Raises:
        InvalidInput: Γ has another size, or is not positive definite on the parameters that move.
    """

    cancelling = 0.0

    def __init__(self, Gamma: Array, held: np.ndarray | None = None, size: int | None = None):
        size = len(Gamma) if size is None else size
        self.moving = np.ones(size, dtype=bool) if held is None else ~np.asarray(held)
        self.Gamma = positive_gain("Gamma", Gamma, size, self.moving)
        self.conserves = bool(self.moving.all())

    def law(self, K: Array) -> Law:
        """K and Γ for compiled loops."""
        return Law(np.atleast_2d(K), np.atleast_2d(self.Gamma))

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


# -- compiled functions ----------------------------------------------------------------------------


@routine(void(LAW, vector, vector, CHART))
def enter(law, theta, eta, chart):
    """Writes η (p,) of θ̂ (p,)."""
    if law.mu > 0.0:
        to_chart_into(law.cone, theta, eta, chart)
    else:
        copy_into(theta, eta)


@routine(void(LAW, vector, vector, CHART))
def leave(law, eta, theta, chart):
    """Writes θ̂ (p,) of η (p,)."""
    if law.mu > 0.0:
        from_chart_into(law.cone, eta, law.pairing, theta, chart)
    else:
        copy_into(eta, theta)


@routine(void(LAW, vector, vector, vector, vector, CHART))
def adapt(law, eta, theta, gradient, rate, chart):
    """Writes η̇ (p,) of (45) from Wᵀ Δv (p,), at η and θ̂ (p,)."""
    if law.mu == 0.0:
        times_into(law.gain, gradient, rate)
    elif law.gain.shape[0] == 1:
        natural_rate_into(law.cone, eta, theta, law.gain[0], law.mu, gradient, rate, chart)
    else:
        dense_rate_into(law.cone, eta, theta, law.gain, law.mu, gradient, rate)


@routine(void(LAW, vector, vector))
def hold(law, start, eta):
    """Shortens the step from `start` (p,) to η (p,), in place, where θ̂ would leave its domain."""
    if law.mu > 0.0:
        confine(law.cone, start, eta)


@routine(f8(matrix, vector))
def stored(stiffness, theta):
    """θᵀ Γ⁻¹ θ at θ (p,), for Γ⁻¹ (p, p) or its diagonal (1, p)."""
    total = 0.0
    for i in range(theta.shape[0]):
        if stiffness.shape[0] == 1:
            total += stiffness[0, i] * theta[i] * theta[i]
            continue
        for j in range(theta.shape[0]):
            total += theta[i] * stiffness[i, j] * theta[j]
    return total


@routine(boolean(LAW, vector, vector, vector, vector, CHART))
def accurate(law, start, eta, before, theta, chart):
    """Whether a step from `start` (p,), θ̂ `before` (p,), to η (p,) and θ̂ (p,) is accurate.

    In the cone's metric it is not where θ̂ is outside the cone, as only rounding could bring about.
    """
    if law.mu == 0.0:
        return True
    change = stored(law.gain, theta) - stored(law.gain, before)
    b = height(law.cone, eta, theta, chart) - height(law.cone, start, before, chart)
    return abs(change - 2 * law.mu * b) <= ACCURACY * law.mu * law.cone.degree


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
