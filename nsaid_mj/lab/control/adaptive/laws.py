"""The tracking laws: their demands on a command, and the adaptation of their estimates.

The adaptive ones solve W(t, x, v_r, v̇_r, u) θ̂ = K_d s: Slotine and Li (IJRR 6(3), 1987) in the
cone's metric and with constant Γ, and certainty equivalence with an identifier's estimate.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....core import (
    Array,
    ConeMetric,
    ConstantMetric,
    Metric,
    ParameterSpace,
)
from .reference import PriorMotion, loop_frequency


class ControllerEstimate:
    """θ̂ of a controller, adapted by θ̂̇ = −(∇²ψ(θ̂))⁻¹ Wᵀ s in a metric's chart, or constant.

    The slope −Wᵀ s does not depend on θ̂. It is taken half-way between two samples and held in
    Heun's method, with an error of third order in the time between them.

    Attributes:
        theta: (p,) θ̂, at first the prior; listeners to an identifier overwrite it.
        metric: ∇²ψ; None if no motion changes θ̂.
    """

    def __init__(self, prior: Array, metric: Metric | None = None):
        self.metric = metric
        self._prior = np.array(prior, dtype=np.float64)
        self.reset()

    def reset(self) -> None:
        """Returns to the prior."""
        self.theta = self._prior.copy()
        if self.metric is not None:
            self._descent = self.metric.descent(self.theta)

    def learn(self, slope: Array, step: float) -> None:
        """Integrates the adaptation from sample to sample, `step` [s], with −Wᵀ s (p,) half-way.

        θ̂ is unchanged if that is not finite.
        """
        if self.metric is not None:
            self.theta = self._descent.step(self.theta, slope, step)


class Demand(NamedTuple):
    """The requirement on a command: W(t, x, w, a, u) θ̂ = pull."""

    w: Array  # (n,) velocity that C multiplies
    a: Array  # (n,) acceleration
    pull: Array  # (n,) generalised force


@dataclass(frozen=True, eq=False)
class TrackingLaw:
    """A tracking law."""

    estimate: ControllerEstimate  # θ̂ and its adaptation
    # (n,) K_d of W(t, x, v_r, v̇_r, u) θ̂ = K_d s; None for computed torque
    damping: Array | None = None
    # κ of computed torque, W(t, x, v, v̇_r − κ s, u) θ̂₀ = 0: under θ̂₀, ṡ = −κ s [1/s]
    decay: float = 0.0
    informed: bool = False  # whether it uses an identifier's estimate

    def demand(self, v: Array, v_r: Array, a_r: Array) -> Demand:
        """The demand at a measured velocity v (n,), for v_r (n,) and v̇_r (n,)."""
        s = v - v_r
        if self.damping is None:
            return Demand(v, a_r - self.decay * s, 0.0 * v)
        return Demand(v_r, a_r, self.damping * s)


def conventional(
    space: ParameterSpace, motion: PriorMotion, shape: Array, frequency: float
) -> ConstantMetric:
    """The metric of θ̂̇ = −Γ Wᵀ s of the plant; the gains are the prior's.

    `shape` (p,) is the diagonal of Γ⁻¹ at γ = 1, and the frequency [rad/s] of the adaptation's loop
    sets γ.
    """
    known = np.isin(np.arange(len(space)), space.actuators)
    unit = np.where(known, 0.0, 1 / shape)
    gain = (frequency / loop_frequency(motion, np.diag(unit))) ** 2
    return ConstantMetric(gain * unit, known)


def nullspace(
    space: ParameterSpace,
    motion: PriorMotion,
    shape: Array,
    frequency: float,
    prior: Array,
    barrier: float,
) -> ConeMetric:
    """The metric of θ̂̇ = −(∇²ψ(θ̂))⁻¹ Wᵀ s, of plant and actuators together.

    V = ½ sᵀ M s + D_ψ(θ‖θ̂) has V̇ = −sᵀ K_d s, and the gains that u is divided by stay positive;
    see docs/theory.md. ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ), with μ = `barrier` in units of Γ⁻¹ at the scale;
    the other arguments are those of `conventional`, and the prior, inside the cone.
    """
    mu = barrier * float(np.median(shape * space.scale**2))
    unit = ConeMetric(space, 1 / shape, prior, mu)
    mobility = np.asarray(np.linalg.inv(mu * unit.mirror(prior)[1]), dtype=np.float64)
    gain = (frequency / loop_frequency(motion, mobility)) ** 2
    return ConeMetric(space, gain / shape, prior, mu / gain)
