"""Metrics, which map Wᵀ Δv to θ̂̇ (45), in Python and for compiled loops.

A `Metric` is the Python side: the gain, the conserved quantity, the metric's term of V. Compiled
loops get a tuple of arrays with a chart, the coordinates in which θ̂ is integrated: `Flat` is the
paper's law, with η = θ̂ and θ̂̇ = Γ Wᵀ Δv; `Curved` is the cone's, with a chart that cannot leave
the cone. The type of the tuple selects the code that is compiled.
"""

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

from ..errors import InvalidInput
from ..numerics.compiler import FAST
from ..numerics.linalg import copy_into, times_into
from ..parameters import Array
from ..quotient.cone import Cone
from .cone.chart import (
    chart_workspace,
    confine,
    dense_rate_into,
    from_chart_into,
    height,
    natural_rate_into,
    to_chart_into,
)

ACCURACY = 1e-7
"""Largest change of the conserved quantity in one step of the cone's law, relative to μν."""


class Flat(NamedTuple):
    """The paper's law, for compiled loops."""

    K: Array  # (n,) or (n, n) gain of the identification plant [1/s]
    Gamma: Array  # (p,) or (p, p) adaptation gain


class Curved(NamedTuple):
    """The law in the cone's metric Γ⁻¹ + μ ∇²b(θ̂), for compiled loops."""

    K: Array  # (n,) or (n, n) gain of the identification plant [1/s]
    cone: Cone
    pairing: Array  # (e,) `barrier.coordinates` of the cone
    stiffness: Array  # (p,) or (p, p) Γ⁻¹
    mu: float  # weight μ of the barrier [J]


Law = Flat | Curved


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

    def law(self, K: Array) -> Flat:
        """K and Γ for compiled loops."""
        return Flat(K, self.Gamma)

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


# -- compiled functions, selected by the law's type -----------------------------------------------


def _by_law(flat: Any, curved: Any, dense: Any = None, options: Any = FAST) -> Any:
    """A function of a law for compiled code: `flat` if the law is a `Flat`, else `curved`.

    `dense` is that for a Γ that is not diagonal, where it differs.
    """

    def chosen(law, *given):
        raise NotImplementedError  # called by compiled code only

    def function_of(law, *_):
        if law.instance_class is Flat:
            return flat
        return curved if dense is None or _diagonal(law) else dense

    overload(chosen, jit_options=options, strict=False)(function_of)
    return chosen


def _diagonal(law: Any) -> bool:
    """Whether Γ is diagonal, given the type of a `Curved`."""
    return law.types[law.fields.index("stiffness")].ndim == 1


@njit(**FAST)
def stored(stiffness, theta):
    """θᵀ Γ⁻¹ θ at θ (p,), for Γ⁻¹ (p,) or (p, p)."""
    total = 0.0
    if stiffness.ndim == 1:
        for i in range(theta.shape[0]):
            total += stiffness[i] * theta[i] * theta[i]
        return total
    for i in range(theta.shape[0]):
        for j in range(theta.shape[0]):
            total += theta[i] * stiffness[i, j] * theta[j]
    return total


def _accurate(law, start, eta, before, theta, scratch):
    change = stored(law.stiffness, theta) - stored(law.stiffness, before)
    b = height(law.cone, eta, theta, scratch) - height(law.cone, start, before, scratch)
    return abs(change - 2 * law.mu * b) <= ACCURACY * law.mu * law.cone.degree


chart = _by_law(lambda law: None, lambda law: chart_workspace(law.cone), options={})  # allocates
"""Allocates the chart's workspace, the argument `scratch` of the functions below."""

enter = _by_law(
    lambda law, theta, eta, scratch: copy_into(theta, eta),
    lambda law, theta, eta, scratch: to_chart_into(law.cone, theta, eta, scratch),
)
"""Writes η (p,) of θ̂ (p,)."""

leave = _by_law(
    lambda law, eta, theta, scratch: copy_into(eta, theta),
    lambda law, eta, theta, scratch: from_chart_into(law.cone, eta, law.pairing, theta, scratch),
)
"""Writes θ̂ (p,) of η (p,)."""

adapt = _by_law(
    lambda law, eta, theta, gradient, rate, scratch: times_into(law.Gamma, gradient, rate),
    lambda law, eta, theta, gradient, rate, scratch: natural_rate_into(
        law.cone, eta, theta, law.stiffness, law.mu, gradient, rate, scratch
    ),
    lambda law, eta, theta, gradient, rate, scratch: dense_rate_into(
        law.cone, eta, theta, law.stiffness, law.mu, gradient, rate
    ),
)
"""Writes η̇ (p,) of (45) from Wᵀ Δv (p,)."""

hold = _by_law(lambda law, start, eta: None, lambda law, start, eta: confine(law.cone, start, eta))
"""Shortens the step from `start` (p,) to η (p,), in place, where θ̂ would leave its domain."""

accurate = _by_law(lambda law, start, eta, before, theta, scratch: True, _accurate)
"""Whether a step from `start` (p,), θ̂ `before` (p,), to η (p,) and θ̂ (p,) is accurate.

It is not where θ̂ is outside the cone, as only rounding could bring about.
"""


def charts(law: Any, *_: Any) -> tuple[Any, ...]:
    """The kernels that the functions above call, given the type of a law."""
    if law.instance_class is Flat:
        return ()
    rate = natural_rate_into if _diagonal(law) else dense_rate_into
    return confine, from_chart_into, height, rate, to_chart_into


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
