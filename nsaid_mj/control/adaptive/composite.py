"""Certainty equivalence: the identifier's estimate takes the place of θ."""

from __future__ import annotations

import numpy as np

from ...parameters import Array
from .estimate import Constant
from .tracker import Demand, TrackingLaw


class CompositeTracking(TrackingLaw):
    """W(t, x, v_r, v̇_r, u) θ̂ = K_d s, with θ̂ the estimate of the run's identifier.

    Args:
        prior: (p,) θ̂ until the identifier has one.
        damping: (n,) K_d.
    """

    informed = True

    def __init__(self, prior: Array, damping: Array):
        self.estimate, self._damping = Constant(prior, listens=True), np.asarray(damping)

    def demand(self, v: Array, v_r: Array, a_r: Array) -> Demand:
        """W(t, x, v_r, v̇_r, u) θ̂ = K_d s."""
        return Demand(v_r, a_r, self._damping * (v - v_r))
