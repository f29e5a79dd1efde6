"""Errors in a user's script, told with its file and line, and what a user's driver must return."""

from __future__ import annotations

import inspect
import sysconfig
import traceback
from pathlib import Path
from typing import Any

import numpy as np

from ..control import Driver, DriverConfig
from ..control.computed_torque import Tracking
from ..errors import BadScript, NsaidError
from ..parameters import Array
from ..system import SecondOrderSystem

_LONGEST = 300  # characters of an exception's text
_PACKAGE = Path(__file__).resolve().parent.parent
_INSTALLED = tuple(
    {str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib", "purelib")}
)


def blame(error: BaseException) -> BadScript | None:
    """The error to raise for an exception that passed through a user's code.

    None for errors of this package, and where no user's code is involved.
    """
    if isinstance(error, NsaidError):
        return None
    if isinstance(error, SyntaxError) and error.filename and _is_users(error.filename):
        line = (error.text or "").strip()
        return BadScript(error.filename, error.lineno or 0, f"SyntaxError: {error.msg}", line)
    frames = [f for f in traceback.extract_tb(error.__traceback__) if _is_users(f.filename)]
    if not frames:
        return None
    what = f"{type(error).__name__}: {error}".removesuffix(": ")
    if len(what) > _LONGEST:
        what = f"{what[:_LONGEST]}…"
    return BadScript(frames[-1].filename, frames[-1].lineno or 0, what, frames[-1].line or "")


def _is_users(file: str) -> bool:
    """Whether a file is neither part of this package nor installed with Python."""
    path = Path(file)
    if not path.is_file():
        return False
    path = path.resolve()
    return not (path.is_relative_to(_PACKAGE) or str(path).startswith(_INSTALLED))


def place_of(thing: object) -> tuple[str, int, str]:
    """File, line and first line of code of a function or class; "" and 0 where there is none."""
    try:
        file = inspect.getsourcefile(thing)  # type: ignore[arg-type]  # raises for other things
        lines, first = inspect.getsourcelines(thing)  # type: ignore[arg-type]
    except (OSError, TypeError):
        return "", 0, ""
    return file or "", first, lines[0].strip()


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
        """See `Driver.start`.

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
        """See `Driver.command`.

        Raises:
            BadScript: it is not an (n_u,) array of numbers.
        """
        return self._array("command", self._driver.command(t, q, v), self._n_u)

    def compiled(self, t: Array) -> Array | Tracking | None:
        """See `Driver.compiled`.

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
