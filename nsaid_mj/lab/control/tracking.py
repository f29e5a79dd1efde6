"""Arms follow Fourier series, random or designed: by computed torque based on the prior.

Position servos get the series as their targets.

The results of `nsaid_mj.plans.excite` are data: series, or the draws of any other driver.
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from ...base import InvalidInput, Number, Positive, PositiveShare, config
from ...core import Array
from ..fields import Tones
from .driver import Driver, DriverConfig, tree
from .multisine import MultisineCommand

if TYPE_CHECKING:
    from ...core import SecondOrderSystem
    from .signals import Series

LIMIT = 5.0
"""Largest command, as a multiple of what a joint's nominal inertia, weight and friction require."""


@config
class FourierTracking(DriverConfig):
    """Every joint tracks a random finite Fourier series; passive ones swing freely.

    Attributes:
        fundamental: frequency of the first harmonic [Hz].
        harmonics: number of harmonics.
        reach: share of each joint's range and speed limits that the trajectory uses, in (0, 1].
        bandwidth: bandwidth of the tracking loop [Hz].
        speed: peak speed of every joint [rad/s or m/s]; None takes `reach` of the nominal speeds.
        joints: numbers of the joints that are moved, from 1; the others that have actuators are
            held at the middle of their range. None moves all.
        limit: largest command, as a multiple of what the joint's nominal inertia, weight and
            friction require at its nominal speed.
    """

    fundamental: Positive = 0.1
    harmonics: Tones = 5
    reach: PositiveShare = 0.8
    bandwidth: Positive = 2.0
    speed: Positive | None = None
    joints: tuple[Annotated[int, Field(strict=True, ge=1)], ...] | None = None
    limit: Positive = LIMIT

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; raises `InvalidInput` unless the robot is an arm on a fixed base."""
        from .series import follow
        from .signals import FourierTrajectory

        system = tree(system, "an arm on a fixed base", "Use MultisineCommand.")
        moving = np.isin(np.arange(1, system.n + 1), self.joints or np.arange(1, system.n + 1))
        if self.joints is not None and moving.sum() != len(set(self.joints)):
            raise InvalidInput(
                "excitation.joints", f"numbers from 1 to {system.n}", self.joints, "Leave it out."
            )
        trajectory = FourierTrajectory.within(self, system, rng)
        moving &= np.isin(np.arange(system.n), system.driven)
        trajectory.series.coefficients[~moving] = 0.0
        return follow(system, prior, trajectory.series, self.bandwidth, self.limit)


_REMEDY = "Use the excitation that `nsaid excite` wrote, for the same robot."


@config
class DesignedTracking(DriverConfig):
    """Every joint tracks a given finite Fourier series, centre + Σ (a_k sin kωt + b_k cos kωt).

    Attributes:
        fundamental: frequency of the first harmonic, ω/2π [Hz].
        centre: centre of every joint's motion [rad or m].
        sines: a_1 … a_h of the first joint, then of the next [rad or m].
        cosines: b_1 … b_h of the first joint, then of the next [rad or m].
        bandwidth: bandwidth of the tracking loop [Hz].
    """

    fundamental: Positive = 0.1
    centre: tuple[Number, ...] = (0.0,)
    sines: tuple[Number, ...] = (0.5,)
    cosines: tuple[Number, ...] = (0.0,)
    bandwidth: Positive = 2.0

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        n = len(self.centre)
        count = len(self.sines)
        if not n or not count or count % n or len(self.cosines) != count:
            raise InvalidInput(
                "excitation.sines",
                f"as many sines as cosines, the same number for each of {n} joints",
                f"{count} and {len(self.cosines)}",
                _REMEDY,
            )
        return self

    @property
    def series(self) -> Series:
        """The trajectory of all joints."""
        from .signals import Series

        n = len(self.centre)
        sines, cosines = (np.reshape(part, (n, -1)) for part in (self.sines, self.cosines))
        omega = 2 * np.pi * self.fundamental * np.arange(1.0, sines.shape[1] + 1)
        return Series(omega, np.hstack([sines, cosines]), np.array(self.centre))

    @staticmethod
    def of(series: Series, bandwidth: float) -> DesignedTracking:
        """The driver of a series with the harmonics 1 … h of its first frequency."""
        sines, cosines = np.hsplit(series.coefficients, 2)
        return DesignedTracking(
            fundamental=float(series.omega[0] / (2 * np.pi)),
            centre=tuple(series.centre.tolist()),
            sines=tuple(sines.ravel().tolist()),
            cosines=tuple(cosines.ravel().tolist()),
            bandwidth=bandwidth,
        )

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver; `rng` is not used.

        Raises:
            InvalidInput: the system is not an arm on a fixed base with as many joints.
        """
        from .series import follow

        wanted = f"an arm on a fixed base with {len(self.centre)} joints"
        system = tree(system, wanted, _REMEDY)
        if system.n != len(self.centre):
            raise InvalidInput("excitation", wanted, f"{system.n} joints", _REMEDY)
        return follow(system, prior, self.series, self.bandwidth, LIMIT)


@config
class DesignedSignals(DriverConfig):
    """A driver with given frequencies and phases in place of its random ones.

    Attributes:
        driver: any driver that draws its frequencies and phases uniformly.
        shares: each uniform draw, as a share of its range, in the order in which the driver draws.
    """

    driver: DriverConfig = field(default_factory=MultisineCommand)
    shares: tuple[PositiveShare, ...] = ()

    @staticmethod
    def draws_of(driver: DriverConfig, system: SecondOrderSystem, prior: Array) -> int:
        """How many uniform draws a driver takes, each of which needs a share; 0 for none."""
        given = _Given(np.empty(0))
        driver.build(system, prior, given)
        return given.used

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the driver needs another number of draws, or draws of another kind.
        """
        given = _Given(np.array(self.shares))
        driver = self.driver.build(system, prior, given)
        if given.used != len(self.shares):
            raise InvalidInput(
                "excitation.shares",
                f"{given.used} numbers, one for each draw of {type(self.driver).__name__}",
                len(self.shares),
                _REMEDY,
            )
        return driver


class _Given(np.random.Generator):
    """Returns given shares (k,) in [0, 1] in place of uniform draws; after the last one, 0.5."""

    def __init__(self, shares: Array):
        super().__init__(np.random.PCG64(0))
        self._shares = shares
        self.used = 0

    def uniform(self, low=0.0, high=1.0, size=None):  # type: ignore[override]  # fewer overloads
        """low + (high − low) · the next shares."""
        count = int(np.prod(size)) if size is not None else 1
        found = np.full(count, 0.5)
        left = self._shares[self.used : self.used + count]
        found[: len(left)] = left
        self.used += count
        values = low + (high - low) * found
        return values.reshape(size) if size is not None else float(values[0])
