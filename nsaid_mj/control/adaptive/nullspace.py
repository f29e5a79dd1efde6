"""Adaptive tracking with unknown actuators: Slotine and Li in the cone's metric."""

from __future__ import annotations

import numpy as np

from ...identifiers.cone.law import ConeMetric
from ...parameters import Array, ParameterSpace
from .design import Rehearsal, loop_frequency
from .estimate import Adapted
from .tracker import Demand, TrackingLaw


class NullspaceTracking(TrackingLaw):
    """W(t, x, v_r, v̇_r, u) θ̂ = K_d s,  θ̂̇ = −(∇²ψ(θ̂))⁻¹ Wᵀ s, of plant and actuators together.

    V = ½ sᵀ M s + D_ψ(θ‖θ̂) has V̇ = −sᵀ K_d s, and the gains that u is divided by stay positive;
    see docs/theory.md.

    Args:
        space: of the parameters.
        prior: (p,) θ̂(0), inside the cone.
        rehearsal: the prior's dynamics along the desired motion.
        shape: (p,) diagonal of Γ⁻¹ at γ = 1, of ψ(θ) = ½ θᵀ Γ⁻¹ θ + μ b(θ).
        frequency: of the adaptation's loop [rad/s]; it sets γ.
        barrier: μ in units of Γ⁻¹ at the scale.
        damping: (n,) K_d.
    """

    def __init__(
        self,
        space: ParameterSpace,
        prior: Array,
        rehearsal: Rehearsal,
        shape: Array,
        frequency: float,
        barrier: float,
        damping: Array,
    ):
        mu = barrier * float(np.median(shape * space.scale**2))
        unit = ConeMetric(space, 1 / shape, prior, mu)
        mobility = np.asarray(np.linalg.inv(mu * unit.mirror(prior)[1]), dtype=np.float64)
        gain = (frequency / loop_frequency(rehearsal, mobility)) ** 2
        metric = ConeMetric(space, gain / shape, prior, mu / gain)
        self.estimate = Adapted(metric, prior)
        self._damping = np.asarray(damping)

    def demand(self, v: Array, v_r: Array, a_r: Array) -> Demand:
        """W(t, x, v_r, v̇_r, u) θ̂ = K_d s."""
        return Demand(v_r, a_r, self._damping * (v - v_r))
