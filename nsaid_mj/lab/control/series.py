"""Drivers of arms that follow a Fourier series: by computed torque, or as targets of servos."""

from __future__ import annotations

import numpy as np

from ...core import Array, Indices, JointTree
from .computed_torque import Tracking, computed_torque, tracking_workspace
from .driver import CompiledDriver, Driver
from .signals import Series, fourier


def follow(
    system: JointTree, prior: Array, series: Series, bandwidth: float, limit: float
) -> Driver:
    """The driver of a series, with a tracking loop for motors, of an arm on a fixed base.

    prior (p,) is θ̂₀, `bandwidth` that of the loop [Hz], `limit` the largest commands of motors
    over those of operation.
    """
    if system.scales.actuator == "servo":
        return Targets(series, system.driven)
    omega = 2 * np.pi * bandwidth
    return ComputedTorque(system, prior, series, omega, limit * system.scales.command)


class SeriesFollower(CompiledDriver):
    """A driver that begins where a series does."""

    def __init__(self, series: Series):
        self._series = series

    def desired(self, t: float) -> Array:
        """(3, n) desired position, velocity and acceleration at time t [s]."""
        motion = np.empty((len(self._series.centre), 3))
        fourier(self._series, t, motion)
        return np.ascontiguousarray(motion.T)

    def start(self) -> tuple[Array, Array]:
        """(n,) position and (n,) velocity at which the series begins."""
        position, velocity, _ = self.desired(0.0)
        return position, velocity


class Targets(SeriesFollower):
    """The desired motion itself, as targets of the position servos of the joints `driven` (d,)."""

    def __init__(self, series: Series, driven: Indices):
        super().__init__(series)
        self._driven = driven

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(d,) targets."""
        return self.desired(t)[0, self._driven]

    def compiled(self, t: Array) -> Array:
        """(k, d) targets at t (k,)."""
        return np.array([self.desired(each)[0, self._driven] for each in t])


class ComputedTorque(SeriesFollower):
    """u = K̂₀⁻¹ [W_M(a) + W_C(v) − F(u = 0)] θ̂₀ with a = a_d + 2ω ė + ω² e, limited.

    It is for an arm on a fixed base. prior (p,) is θ̂₀, `series` the desired motion, `omega` the
    bandwidth ω of the tracking loop [rad/s], limit (d,) the largest commands, > 0.
    """

    def __init__(self, system: JointTree, prior: Array, series: Series, omega: float, limit: Array):
        super().__init__(series)
        self._tracking = Tracking(
            system.inverse_dynamics(), system.driven, np.array(prior), series, omega, limit
        )
        self._workspace = tracking_workspace(self._tracking)

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(d,) command u."""
        u = np.empty(len(self._tracking.driven))
        state = (np.require(x, np.float64, ["C", "W"]) for x in (q, v))
        computed_torque(self._tracking, t, *state, self._workspace, u)
        return u

    def compiled(self, t: Array) -> Tracking:
        """The parameters of `computed_torque`."""
        return self._tracking
