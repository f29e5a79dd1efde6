"""Holds a body at a slowly moving pose with a controller based on the prior, plus dither."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from pydantic import StrictBool

from ...base import NonNegative, Positive, config
from ...core import Array
from ..fields import Tones
from .driver import Driver, DriverConfig, Feedback
from .multisine import unit_wrenches

if TYPE_CHECKING:
    from ...core import SecondOrderSystem


@config
class PoseHold(DriverConfig):
    """PD control to a slowly moving pose, plus a multisine on every actuator.

    For free-floating bodies whose actuators push in proportion to their commands.

    Attributes:
        bandwidth: bandwidth of the control loop [Hz].
        travel: bound on the reference's translation along each axis [m].
        turn: bound on the reference's rotation about each axis [rad].
        period: shortest period of the reference [s].
        bias: command of every actuator at rest.
        dither: bound on each actuator's multisine.
        low: lowest frequency of the dither [Hz].
        high: highest frequency of the dither [Hz].
        tones: number of sines in every dither.
        one_sided: whether commands lie in [0, 1], as for nozzles, rather than in [−1, 1].
    """

    bandwidth: Positive = 0.05
    travel: NonNegative = 0.3
    turn: NonNegative = 0.5
    period: Positive = 20.0
    bias: NonNegative = 0.4
    dither: Positive = 0.4
    low: Positive = 0.05
    high: Positive = 0.5
    tones: Tones = 8
    one_sided: StrictBool = True

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless a free body has one gain per command."""
        from .signals import Multisine

        wrenches = unit_wrenches(system, prior)
        bound = np.repeat([self.travel, self.turn], 3)
        reference = Multisine(6, 0.2 / self.period, 1 / self.period, 3, 1.0, rng)
        dither = Multisine(system.n_u, self.low, self.high, self.tones, self.dither, rng)
        M = system.mass_matrix(np.r_[np.zeros(6), 1.0, np.zeros(6)], prior)
        allocation = np.linalg.pinv(wrenches) @ M
        omega = 2 * np.pi * self.bandwidth
        least = 0.0 if self.one_sided else -1.0

        def command(t: float, q: Array, v: Array) -> Array:
            """Bias + dither + B⁺ M̂₀ (ω² e − 2 ω ν), B (6, n_u) the prior's wrench per command."""
            error = system.difference(q, system.position(bound * reference(t)))
            desired = omega**2 * error - 2 * omega * v
            return np.clip(self.bias + dither(t) + allocation @ desired, least, 1.0)

        return Feedback(lambda: (bound * reference(0.0), np.zeros(6)), command)
