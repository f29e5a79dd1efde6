"""Arms follow a Fourier trajectory by computed torque based on the prior."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from ..bounds import Positive, PositiveShare, Tones, config
from ..errors import InvalidInput
from ..parameters import Array
from ..structure.joints import JointTree
from ..structure.structured import plain
from ..system import SecondOrderSystem
from .computed_torque import Tracking, computed_torque, tracking_workspace
from .driver import Driver, DriverConfig
from .signals import FourierTrajectory, Series, fourier

LIMIT = 5.0
"""Largest command, as a multiple of what a joint's nominal inertia, weight and friction ask for."""


@config
class FourierTracking(DriverConfig):
    """Every joint tracks a random finite Fourier series.

    Attributes:
        fundamental: frequency of the first harmonic [Hz].
        harmonics: number of harmonics.
        reach: share of each joint's range and speed limits that the trajectory uses, in (0, 1].
        bandwidth: of the tracking loop [Hz].
        speed: peak speed of every joint [rad/s or m/s]; None takes `reach` of the nominal speeds.
        joints: numbers of the joints that move, from 1; the others are held at the middle of their
            range. None moves all.
        limit: largest command, as a multiple of what the joint's nominal inertia, weight and
            friction ask for at its nominal speed.
    """

    fundamental: Positive = 0.1
    harmonics: Tones = 5
    reach: PositiveShare = 0.8
    bandwidth: Positive = 2.0
    speed: Positive | None = None
    joints: tuple[Annotated[int, Field(strict=True, ge=1)], ...] | None = None
    limit: Positive = LIMIT

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the system is not a tree of motor-driven joints on a fixed base.
        """
        system = fixed_arm(system, "an arm on a fixed base", "Use MultisineCommand.")
        moving = np.isin(np.arange(1, system.n + 1), self.joints or np.arange(1, system.n + 1))
        if self.joints is not None and moving.sum() != len(set(self.joints)):
            raise InvalidInput(
                "excitation.joints", f"numbers from 1 to {system.n}", self.joints, "Leave it out."
            )
        nominal = self.reach * system.scales.speed
        trajectory = FourierTrajectory.within(
            system.limits,
            self.reach,
            nominal if self.speed is None else np.full(system.n, self.speed),
            (self.fundamental, self.harmonics),
            rng,
        )
        trajectory.series.coefficients[~moving] = 0.0
        limit = self.limit * system.scales.command
        omega = 2 * np.pi * self.bandwidth
        return ComputedTorque(system, prior, trajectory.series, omega, limit)


def fixed_arm(system: SecondOrderSystem, wanted: str, remedy: str) -> JointTree:
    """The system, if it is an arm on a fixed base.

    Raises:
        InvalidInput: it is not; the message says what is wanted.
    """
    if not isinstance(system, JointTree) or system.group:
        raise InvalidInput("excitation", wanted, type(system).__name__, remedy)
    return system


class ComputedTorque(Driver):
    """u = K̂₀⁻¹ [W_M(a) + W_C(v) − F(u = 0)] θ̂₀ with a = a_d + 2ω ė + ω² e, limited.

    Args:
        system: an arm on a fixed base.
        prior: (p,) θ̂₀.
        series: the desired motion.
        omega: bandwidth ω of the tracking loop [rad/s].
        limit: (n,) largest commands, > 0.

    Raises:
        InvalidInput: the joints have servos, or some are passive.
    """

    def __init__(self, system: JointTree, prior: Array, series: Series, omega: float, limit: Array):
        if system.scales.actuator != "motor":
            expected, remedy = (
                "motors, whose commands are torques",
                "Use MultisineCommand: targets.",
            )
            raise InvalidInput("excitation", expected, "position servos", remedy)
        if system.n_u < system.n:
            expected, got = "a motor on every joint", f"{system.n_u} motors on {system.n} joints"
            raise InvalidInput("excitation", expected, got, "Use MultisineCommand: efforts.")
        self._tracking = Tracking(system.structure.arrays, np.array(prior), series, omega, limit)
        self._workspace = tracking_workspace(self._tracking)

    def desired(self, t: float) -> Array:
        """(3, n) desired position, velocity and acceleration at time t [s]."""
        motion = np.empty((len(self._tracking.series.centre), 3))
        fourier(self._tracking.series, t, motion)
        return motion.T

    def start(self) -> tuple[Array, Array]:
        """(n,) position and (n,) velocity at which the series begins."""
        position, velocity, _ = self.desired(0.0)
        return position, velocity

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n,) command u."""
        u = np.empty(len(v))
        computed_torque(self._tracking, t, plain(q), plain(v), self._workspace, u)
        return u

    def compiled(self, t: Array) -> Tracking:
        """The parameters of `computed_torque`."""
        return self._tracking
