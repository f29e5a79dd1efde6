"""Packages that an extra installs, imported on first use.

A vehicle needs no Pinocchio, and a computer without a screen no Rerun: each is an extra of
`pip install nsaid-mj`. Modules import `pin` from here.
"""

from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .errors import MissingPackage


def installed(package: str) -> bool:
    """Whether a package can be imported."""
    return find_spec(package) is not None


def require(package: str, extra: str, purpose: str) -> ModuleType:
    """Imports a package that an extra installs; `purpose` says what needs it.

    Raises:
        MissingPackage: it is not installed, or lacks a library of the system, as slim images do;
            the message names the extra, or the library.
    """
    if not installed(package):
        raise MissingPackage(package, extra, purpose)
    try:
        return import_module(package)
    except ImportError as error:
        library, found, _ = str(error).partition(": cannot open shared object file")
        if not found:
            raise
        raise MissingPackage(package, extra, purpose, library) from error


class _Lazy:
    """A stand-in for a package, imported when one of its attributes is first used."""

    def __init__(self, package: str):
        self._package = package

    def __getattr__(self, name: str) -> Any:
        value = getattr(require(self._package, "arms", "A robot with joints"), name)
        self.__dict__[name] = value  # found without this call from now on
        return value


if TYPE_CHECKING:
    import pinocchio as pin
else:
    pin = _Lazy("pinocchio")
