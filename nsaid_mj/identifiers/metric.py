"""What tells the laws apart, for compiled loops: gains, and the chart in which θ̂ moves.

A `Flat` law is the paper's: its chart is η = θ̂, and θ̂̇ = Γ Wᵀ Δv. A `Curved` one has the cone's
metric in place of Γ⁻¹ and a chart that cannot leave it. Which is chosen when a loop is compiled.
"""

from __future__ import annotations

from typing import NamedTuple

from numba.extending import overload

from ..numerics.linalg import copy_into, times_into
from ..parameters import Array
from .cone.barrier import Cone, inside
from .cone.chart import chart_room, confine, from_chart_into, natural_rate_into, to_chart_into


class Flat(NamedTuple):
    """The paper's law.

    Attributes:
        K: (n,) or (n, n) gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) adaptation gain.
    """

    K: Array
    Gamma: Array


class Curved(NamedTuple):
    """The law in the cone's metric Γ⁻¹ + μ ∇²b(θ̂).

    Attributes:
        K: (n,) or (n, n) gain of the identification plant [1/s].
        cone: the cone.
        pairing: `cone.coordinates` of it.
        stiffness: (p,) or (p, p) Γ⁻¹.
        mu: weight μ of the barrier [J].
    """

    K: Array
    cone: Cone
    pairing: Array
    stiffness: Array
    mu: float


Law = Flat | Curved

# -- what a law's metric decides ------------------------------------------------------------------


def chart(law):
    """What the law's chart works with: `scratch` of the functions below."""


def enter(law, theta, eta, scratch):
    """Writes η (p,) of θ̂ (p,)."""


def leave(law, eta, theta, scratch):
    """Writes θ̂ (p,) of η (p,)."""


def adapt(law, eta, theta, gradient, rate, scratch):
    """Writes η̇ (p,) of (45) from Wᵀ Δv (p,)."""


def hold(law, start, eta):
    """Cuts the step from `start` (p,) to η (p,) back to where θ̂ is inside."""


def sound(law, theta):
    """Whether θ̂ (p,) is inside."""


@overload(chart)
def _chart(law):
    def flat(law):
        pass

    def curved(law):
        return chart_room(law.cone)

    return flat if law.instance_class is Flat else curved


@overload(enter)
def _enter(law, theta, eta, scratch):
    def flat(law, theta, eta, scratch):
        copy_into(theta, eta)

    def curved(law, theta, eta, scratch):
        to_chart_into(law.cone, theta, eta, scratch)

    return flat if law.instance_class is Flat else curved


@overload(leave)
def _leave(law, eta, theta, scratch):
    def flat(law, eta, theta, scratch):
        copy_into(eta, theta)

    def curved(law, eta, theta, scratch):
        from_chart_into(law.cone, eta, law.pairing, theta, scratch)

    return flat if law.instance_class is Flat else curved


@overload(adapt)
def _adapt(law, eta, theta, gradient, rate, scratch):
    def flat(law, eta, theta, gradient, rate, scratch):
        times_into(law.Gamma, gradient, rate)

    def curved(law, eta, theta, gradient, rate, scratch):
        natural_rate_into(law.cone, eta, theta, law.stiffness, law.mu, gradient, rate, scratch)

    return flat if law.instance_class is Flat else curved


@overload(hold)
def _hold(law, start, eta):
    def flat(law, start, eta):
        pass

    def curved(law, start, eta):
        confine(law.cone, start, eta)

    return flat if law.instance_class is Flat else curved


@overload(sound)
def _sound(law, theta):
    def flat(law, theta):
        return True

    def curved(law, theta):
        return inside(law.cone, theta)

    return flat if law.instance_class is Flat else curved
