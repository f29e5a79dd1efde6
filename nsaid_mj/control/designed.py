"""Drivers whose motion is given as data, as `nsaid_mj.design` finds it."""

from __future__ import annotations

from dataclasses import field
from typing import Self

import numpy as np
from pydantic import model_validator

from ..bounds import Number, Positive, PositiveShare, config
from ..errors import InvalidInput
from ..parameters import Array
from ..system import SecondOrderSystem
from .driver import Driver, DriverConfig
from .multisine import MultisineCommand
from .signals import Series
from .tracking import LIMIT, ComputedTorque, fixed_arm

_REMEDY = "Take the excitation as `nsaid excite` wrote it, for the same robot."


@config
class DesignedTracking(DriverConfig):
    """Every joint tracks a given finite Fourier series, centre + Σ (a_k sin kωt + b_k cos kωt).

    Attributes:
        fundamental: frequency of the first harmonic, ω/2π [Hz].
        centre: of every joint's motion [rad or m].
        sines: a_1 … a_h of the first joint, then of the next [rad or m].
        cosines: b_1 … b_h of the first joint, then of the next [rad or m].
        bandwidth: of the tracking loop [Hz].
    """

    fundamental: Positive = 0.1
    centre: tuple[Number, ...] = (0.0,)
    sines: tuple[Number, ...] = (0.5,)
    cosines: tuple[Number, ...] = (0.0,)
    bandwidth: Positive = 2.0

    @model_validator(mode="after")
    def _check_lengths(self) -> Self:
        n, count = len(self.centre), len(self.sines)
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
        wanted = f"an arm on a fixed base with {len(self.centre)} joints"
        system = fixed_arm(system, wanted, _REMEDY)
        if system.n != len(self.centre):
            raise InvalidInput("excitation", wanted, f"{system.n} joints", _REMEDY)
        limit = LIMIT * system.scales.command
        return ComputedTorque(system, prior, self.series, 2 * np.pi * self.bandwidth, limit)


@config
class DesignedSignals(DriverConfig):
    """A driver with given frequencies and phases in place of its random ones.

    Attributes:
        driver: any driver that draws its frequencies and phases uniformly.
        shares: each uniform draw, as a share of its range, in the order in which the driver draws.
    """

    driver: DriverConfig = field(default_factory=MultisineCommand)
    shares: tuple[PositiveShare, ...] = ()

    def build(self, system: SecondOrderSystem, prior: Array, rng: np.random.Generator) -> Driver:
        """Makes the driver.

        Raises:
            InvalidInput: the driver needs another number of draws, or draws of another kind.
        """
        given = Given(np.array(self.shares))
        driver = self.driver.build(system, prior, given)
        if given.used != len(self.shares):
            raise InvalidInput(
                "excitation.shares",
                f"{given.used} numbers, one for each draw of {type(self.driver).__name__}",
                len(self.shares),
                _REMEDY,
            )
        return driver


class Given(np.random.Generator):
    """Hands out given shares (k,) in [0, 1] in place of uniform draws; after the last one, 0.5."""

    def __init__(self, shares: Array):
        super().__init__(np.random.PCG64(0))
        self._shares, self.used = shares, 0

    def uniform(self, low=0.0, high=1.0, size=None):  # type: ignore[override]  # fewer overloads
        """low + (high − low) · the next shares."""
        count = int(np.prod(size)) if size is not None else 1
        found = np.full(count, 0.5)
        left = self._shares[self.used : self.used + count]
        found[: len(left)] = left
        self.used += count
        values = low + (high - low) * found
        return values.reshape(size) if size is not None else float(values[0])
