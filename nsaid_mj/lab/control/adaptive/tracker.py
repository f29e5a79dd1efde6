"""Adaptive tracking as a driver of a scenario, and the control loop of all tracking laws.

At every sample the command solves W(t, x, w, a, u) θ̂ = pull, where the law chooses w, a and pull.
It is held until the next sample, so it is computed for the state expected half-way, which leaves an
error of second order in the sampling interval. The adaptation takes the state half-way between two
samples as measured, and the command that was held.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from ....base import NonNegative, Positive, PositiveShare, config
from ....core import Array, Measurement
from ...fields import Tones
from ..driver import DriverConfig, InformedDriver

if TYPE_CHECKING:
    from ....core import Metric, SecondOrderSystem
    from .actuation import Actuation
    from .laws import TrackingLaw
    from .reference import Reference


class Tracker(InformedDriver):
    """Tracks a reference under one of the laws; an informed one asks for θ̂ every `period` [s]."""

    def __init__(
        self,
        system: SecondOrderSystem,
        reference: Reference,
        actuation: Actuation,
        law: TrackingLaw,
        period: float,
    ):
        self._system = system
        self._actuation = actuation
        self._law = law
        self.reference = reference
        self.period = period if law.informed else np.inf
        self._idle = np.zeros(system.n_u)

    @property
    def theta_hat(self) -> Array:
        """(p,) θ̂ of the last command."""
        return self._law.estimate.theta

    @property
    def limits(self) -> tuple[Array, Array]:
        """(n_u,), (n_u,) smallest and largest commands."""
        return self._actuation.low, self._actuation.high

    @property
    def metric(self) -> Metric | None:
        """The metric in which θ̂ is adapted; None if it is not."""
        return self._law.estimate.metric

    def start(self) -> tuple[Array, Array]:
        """Returns to the prior, at the beginning of the reference."""
        self._law.estimate.reset()
        self._last: Measurement | None = None
        return self.reference.desired(0.0)

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the command for the state expected half-way to the next sample."""
        system = self._system
        theta_hat = self._law.estimate.theta
        step = 0.0
        if self._last is not None:
            step = t - self._last.t
            self._learn(t, q, v, self._last)
            theta_hat = self._law.estimate.theta
        _, a_r = self.reference(t, q, v)
        ahead = 0.5 * step
        t_m = t + ahead
        q_m = system.integrate(q, ahead * v)
        v_m = v + ahead * a_r
        w, a, pull = self._law.demand(v_m, *self.reference(t_m, q_m, v_m))
        W = system._W(t_m, q_m, v_m, w, a, self._idle)
        u = self._actuation.command(theta_hat, W @ theta_hat - pull)
        self._last = Measurement(t, q, v, u)
        return u

    def _learn(self, t: float, q: Array, v: Array, last: Measurement) -> None:
        """Moves θ̂ by −Wᵀ s half-way between the last sample and this one."""
        system = self._system
        t_m = 0.5 * (last.t + t)
        v_m = 0.5 * (last.v + v)
        q_m = system.integrate(last.q, 0.5 * system.difference(last.q, q))
        v_r, a_r = self.reference(t_m, q_m, v_m)
        W = system._W(t_m, q_m, v_m, v_r, a_r, last.u)
        self._law.estimate.learn(W.T @ (v_r - v_m), t - last.t)

    def inform(self, theta_hat: Array) -> None:
        """Adopts an identifier's estimate, if the law uses one."""
        if self._law.informed:
            self._law.estimate.theta = np.array(theta_hat, dtype=np.float64)


Law = Literal["nullspace", "conventional", "computed_torque", "composite"]


@config
class AdaptiveTracking(DriverConfig):
    """Tracks a persistent trajectory of all coordinates, with or without adaptation.

    For fully or over-actuated robots: arms on a fixed base, and bodies in space with or without an
    arm whose actuators span all directions.

    Attributes:
        law: `nullspace`, Slotine and Li's law in the cone's metric, of plant and gains together;
            `conventional`, the same with constant Γ, and the prior's gains taken as known;
            `computed_torque`, without adaptation; `composite`, certainty equivalence with the
            estimate of the scenario's identifier.
        rate: Λ, decay of the tracking error where s = 0 [1/s].
        damping: K_d over the prior's mean inertia about every axis [1/s].
        adaptation: fastest natural frequency of the adaptation's loop at the prior, which sets
            its gain γ [rad/s]; see `reference`.
        floor: least share of the best excited parameter's stiffness Γ⁻¹.
        barrier: μ of the cone's metric, in units of Γ⁻¹ at the scale.
        period: interval at which `composite` adopts the identifier's estimate [s].
        fundamental: frequency of the trajectory's first harmonic [Hz].
        harmonics: number of harmonics.
        reach: share of every joint's range that the trajectory uses.
        speed: peak speed of every joint [rad/s or m/s].
        travel: bound on a body's displacement along each axis [m].
        tilt: bound on its roll and pitch [rad].
        heading: bound on its yaw [rad].
    """

    law: Law = "nullspace"
    rate: Positive = 5.0
    damping: Positive = 20.0
    adaptation: Positive = 100.0
    floor: PositiveShare = 1e-3
    barrier: Positive = 1.0
    period: Positive = 0.1
    fundamental: Positive = 0.1
    harmonics: Tones = 5
    reach: PositiveShare = 0.8
    speed: Positive = 1.5
    travel: NonNegative = 0.5
    tilt: NonNegative = 0.3
    heading: NonNegative = 0.8

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Tracker:
        """Makes the driver.

        Raises:
            InvalidInput: the system is under-actuated, or its actuators cannot be inverted; or the
                law is `nullspace` and the prior is outside the cone.
        """
        from .actuation import Actuation

        actuation = Actuation(system, prior, *command_range(system))
        reference = self._reference(system, rng)
        law = self._law(system, prior, reference, actuation)
        return Tracker(system, reference, actuation, law, self.period)

    def _law(
        self, system: SecondOrderSystem, prior: Array, reference: Reference, actuation: Actuation
    ) -> TrackingLaw:
        from .laws import ControllerEstimate, TrackingLaw, conventional, nullspace
        from .reference import mean_inertia, prior_motion, stiffness

        damping = self.damping * mean_inertia(system, prior)
        if self.law == "computed_torque":
            return TrackingLaw(ControllerEstimate(prior), decay=self.damping)
        if self.law == "composite":
            return TrackingLaw(ControllerEstimate(prior), damping, informed=True)
        period = 1 / self.fundamental
        motion = prior_motion(system, prior, reference, actuation, period)
        shape = stiffness(motion, system.space.scale, damping, self.floor)
        known = system.space, motion, shape, self.adaptation
        if self.law == "conventional":
            return TrackingLaw(ControllerEstimate(prior, conventional(*known)), damping)
        return TrackingLaw(
            ControllerEstimate(prior, nullspace(*known, prior, self.barrier)), damping
        )

    def _reference(self, system: SecondOrderSystem, rng: np.random.Generator) -> Reference:
        from ..signals import FourierTrajectory
        from .reference import Reference

        base = np.repeat([self.travel, self.tilt, self.heading], [3, 2, 1])[: system.group]
        return Reference(system, FourierTrajectory.within(self, system, rng, base), self.rate)


def command_range(system: SecondOrderSystem) -> tuple[Array, Array, Array]:
    """(n_u,) smallest and largest commands, and efforts preferred by redundant actuators.

    A motor's largest command is the joint's rated torque where the model states one.
    """
    from ....core import JointTree, SingleBody

    one = np.ones(system.n_u)
    if isinstance(system, SingleBody) and system.columns("nozzle"):
        return 0.0 * one, one, 0.4 * one  # nozzles only push
    if isinstance(system, JointTree):
        low, high = system.command_limits
        if system.mounts is not None:  # of thrusters
            return low, high, 0.0 * one
        rated = np.asarray(system.model.effortLimit)[system.group :] / system.scales.gain
        most = np.where((rated > 0) & np.isfinite(rated), rated, high)
        return -most, most, 0.0 * one
    return -one, one, 0.0 * one
