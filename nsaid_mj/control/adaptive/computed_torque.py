"""Computed torque with the prior: no adaptation."""

from __future__ import annotations

from ...parameters import Array
from .estimate import Constant
from .tracker import Demand, TrackingLaw


class ComputedTorque(TrackingLaw):
    """W(t, x, v, v̇_r − κ s, u) θ̂₀ = 0: under the prior ṡ = −κ s.

    Args:
        prior: (p,) the model θ̂₀.
        decay: κ [1/s].
    """

    def __init__(self, prior: Array, decay: float):
        self.estimate, self._decay = Constant(prior, listens=False), decay

    def demand(self, v: Array, v_r: Array, a_r: Array) -> Demand:
        """W(t, x, v, v̇_r − κ s, u) θ̂₀ = 0."""
        return Demand(v, a_r - self._decay * (v - v_r), 0.0 * v)
