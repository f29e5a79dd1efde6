"""Adaptive tracking with assumed gains: the law of Slotine and Li (IJRR 6(3), 1987)."""

from __future__ import annotations

import numpy as np

from ...identifiers.metric import ConstantMetric
from ...parameters import Array, ParameterSpace
from .design import Rehearsal, loop_frequency
from .estimate import Adapted
from .tracker import Demand, TrackingLaw


class ConventionalTracking(TrackingLaw):
    """W(t, x, v_r, v̇_r, u) θ̂ = K_d s,  θ̂̇ = −Γ Wᵀ s of the plant; the gains are the prior's.

    Args:
        space: of the parameters.
        prior: (p,) θ̂(0); its gains are taken as known.
        rehearsal: the prior's dynamics along the desired motion.
        shape: (p,) diagonal of Γ⁻¹ at γ = 1.
        frequency: of the adaptation's loop [rad/s]; it sets γ.
        damping: (n,) K_d.
    """

    def __init__(
        self,
        space: ParameterSpace,
        prior: Array,
        rehearsal: Rehearsal,
        shape: Array,
        frequency: float,
        damping: Array,
    ):
        known = np.isin(np.arange(len(space)), space.actuators)
        unit = np.where(known, 0.0, 1 / shape)
        gain = (frequency / loop_frequency(rehearsal, np.diag(unit))) ** 2
        metric = ConstantMetric(gain * unit, known)
        self.estimate = Adapted(metric, prior)
        self._damping = np.asarray(damping)

    def demand(self, v: Array, v_r: Array, a_r: Array) -> Demand:
        """W(t, x, v_r, v̇_r, u) θ̂ = K_d s."""
        return Demand(v_r, a_r, self._damping * (v - v_r))
