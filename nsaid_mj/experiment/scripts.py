"""What a user's driver must return."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..control import Driver, DriverConfig
from ..control.computed_torque import Tracking
from ..errors import BadScript
from ..parameters import Array
from ..system import SecondOrderSystem
from .blame import place_of


def driver_of(
    config: DriverConfig, system: SecondOrderSystem, prior: Array, rng: np.random.Generator
) -> Driver:
    """Builds a driver; one that this package does not define is checked at every call.

    Raises:
        BadScript: `build` does not return a driver.
        NsaidError: the driver cannot be built.
    """
    driver = config.build(system, prior, rng)
    if not isinstance(driver, Driver):
        raise _wrong(type(config).build, "a Driver", type(driver).__name__)
    packed = type(driver).__module__.startswith("nsaid_mj.")
    return driver if packed else CheckedDriver(driver, system)


def _wrong(function: object, expected: str, got: object) -> BadScript:
    file, line, code = place_of(function)
    return BadScript(file, line, f"expected {expected}, got {got}", code)


class CheckedDriver(Driver):
    """A user's driver, whose results are checked for their shape.

    Args:
        driver: the driver.
        system: the structure of the plant.
    """

    def __init__(self, driver: Driver, system: SecondOrderSystem):
        self._driver, self._n, self._n_u = driver, system.n, system.n_u

    def start(self) -> tuple[Array, Array]:
        """Position and velocity from which the driver starts, checked.

        Raises:
            BadScript: it is not a pair of (n,) arrays.
        """
        found = self._driver.start()
        if not isinstance(found, tuple | list) or len(found) != 2:
            function = type(self._driver).start
            raise _wrong(function, "positions and velocities to start from", type(found).__name__)
        position, velocity = (self._array("start", part, self._n) for part in found)
        return position, velocity

    def command(self, t: float, q: Array, v: Array) -> Array:
        """The driver's command (n_u,) at a time and measured state, checked.

        Raises:
            BadScript: it is not an (n_u,) array of numbers.
        """
        return self._array("command", self._driver.command(t, q, v), self._n_u)

    def compiled(self, t: Array) -> Array | Tracking | None:
        """What compiled loops take from the driver for times t (k,), checked.

        Raises:
            BadScript: it is neither None, nor a `Tracking`, nor a (k, n_u) array of numbers.
        """
        found = self._driver.compiled(t)
        if found is None or isinstance(found, Tracking):
            return found
        return self._array("compiled", found, len(t), self._n_u)

    def _array(self, method: str, found: Any, *shape: int) -> Array:
        """A result of a method as an array of floats, checked for its shape."""
        expected = f"an array of shape {shape}"
        try:
            array = np.array(found, dtype=np.float64)
            if np.iscomplexobj(found):
                raise TypeError("complex numbers")
        except (TypeError, ValueError) as error:
            function = getattr(type(self._driver), method)
            raise _wrong(function, expected, f"{type(found).__name__} ({error})") from error
        if array.shape != shape:
            raise _wrong(getattr(type(self._driver), method), expected, f"shape {array.shape}")
        return array
