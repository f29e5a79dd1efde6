"""Errors and warnings. Messages state what was expected, what was received, and the remedy.

Every error that this package raises on purpose derives from `NsaidError` and has its data as
attributes, so that a script can act on it without parsing the message.
"""

import difflib
import errno
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


def printable(text: str) -> str:
    """A text with U+FFFD for each control character, such as the escape that steers a terminal.

    Lines and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join("\ufffd" if _controls(c) else c for c in text)


def _controls(character: str) -> bool:
    """Whether a character is a control, a direction of writing, or half a surrogate pair."""
    return character not in "\n\t" and unicodedata.category(character) in ("Cc", "Cf", "Cs")


class NsaidError(Exception):
    """Root of all errors raised on purpose by nsaid_mj."""


_LONG = 80
_LONG_TEXT = 400


def _short(value: object) -> object:
    """A value for a message, shortened if its text is long or cannot be formed."""
    try:
        text = str(value)
    except ValueError:  # Python writes no integer of more than 4300 digits
        return "a whole number of thousands of digits"
    except RecursionError:
        return "thousands of values inside each other"
    most = _LONG_TEXT if isinstance(value, str) else _LONG
    return value if len(text) <= most else f"{text[: most - 3]}…"


class InvalidInput(NsaidError, ValueError):
    """A value that cannot be used.

    Attributes:
        name: name of the value, as the caller knows it.
        expected: what would have been accepted.
        got: the value, or what is wrong with it; shortened where its text is long.
        remedy: what to do about it.
    """

    def __init__(self, name: str, expected: str, got: object, remedy: str):
        self.name = name
        self.expected = expected
        self.got = _short(got)
        self.remedy = remedy
        super().__init__(f"{name}: expected {expected}, got {self.got}. {remedy}")


_LISTED = 40  # names that a message lists, at most


class UnknownName(NsaidError, KeyError):
    """A name that does not exist, with similar names that do.

    Attributes:
        kind: what was looked up ("robot", "scenario").
        name: the name that was given.
        near: the most similar valid names, best first.
        choices: all valid names.
    """

    def __init__(self, kind: str, name: str, choices: Iterable[str], remedy: str = ""):
        self.kind = kind
        self.name = name
        self.choices = tuple(sorted(set(choices)))
        self.near = tuple(difflib.get_close_matches(name, self.choices, n=5, cutoff=0.5))
        more = len(self.choices) - _LISTED
        hint = f"Known: {', '.join(self.choices[:_LISTED])}{f' and {more} more' * (more > 0)}."
        if self.near:
            hint = f"Did you mean {', '.join(self.near)}?"
        super().__init__(f"unknown {kind}: {name!r}. {hint} {remedy}".rstrip())

    def __str__(self) -> str:
        return str(self.args[0])  # KeyError would print the repr


_DEBIAN = {"libgomp": "libgomp1", "libGL": "libgl1", "libEGL": "libegl1"}
"""Packages of Debian that hold a library which slim images lack."""


class MissingPackage(NsaidError, ImportError):
    """A package that one of the extras installs is missing, or a library of the system's.

    Attributes:
        package: its import name.
        extra: the extra that installs it.
        library: file name of the system's library that the package lacks; empty if it is absent.
    """

    def __init__(self, package: str, extra: str, purpose: str, library: str = ""):
        self.package = package
        self.extra = extra
        self.library = library
        lacks = f"the package {package}, which is not installed"
        remedy = f"Install it: pip install 'nsaid-mj[{extra}]'"
        if library:
            lacks = f"the package {package}, which needs {library} of the system"
            name = library.partition(".so")[0]
            remedy = f"Install it: on Debian and Ubuntu `apt-get install {_DEBIAN.get(name, name)}`"
        super().__init__(f"{purpose} needs {lacks}. {remedy}")


class EnginesDisagree(NsaidError):
    """Two engines compute different dynamics for the same robot.

    Attributes:
        robot: its name.
        link: the link or joint at which they differ most.
        quantity: "mass matrix", "bias force" or "torque regressor".
        difference: largest relative difference.
        tolerance: largest relative difference that is accepted.
        engines: the two engines.
    """

    def __init__(
        self,
        robot: str,
        link: str,
        quantity: str,
        difference: float,
        tolerance: float,
        engines: tuple[str, str] = ("MuJoCo", "Pinocchio"),
        remedy: str = "The plant is not the system the identifier assumes; check the link's "
        "inertia and joint in the URDF.",
    ):
        self.robot = robot
        self.link = link
        self.quantity = quantity
        self.difference = difference
        self.tolerance = tolerance
        self.engines = engines
        super().__init__(
            f"robot {robot}: {engines[0]} and {engines[1]} differ in the {quantity} at {link} by "
            f"{difference:.2g} (relative; at most {tolerance:.0e} is accepted). {remedy}"
        )


class BadRun(NsaidError):
    """A run folder or file that cannot be read.

    Attributes:
        path: the folder or file.
        reason: what is wrong with it.
        remedy: what to do about it.
    """

    def __init__(self, path: object, reason: str, remedy: str):
        self.path = path
        self.reason = reason
        self.remedy = remedy
        super().__init__(f"{path}: {reason}. {remedy}")


class NotWritten(BadRun):
    """A file that cannot be written: the disk is full, or its folder is gone or read-only."""

    @classmethod
    @contextmanager
    def on_failure(cls, path: object, remedy: str = "") -> Iterator[None]:
        """Context in which an error of the operating system, while writing to a path, is this one.

        The default remedy depends on the error.
        """
        try:
            yield
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
            remedy = remedy or (
                "Make room on the disk, or give another folder with --out"
                if full
                else "Give another folder, with --out"
            )
            reason = error.strerror or str(error)
            raise cls(path, f"it cannot be written: {reason}", remedy) from error


class FolderInUse(BadRun):
    """A folder into which another process or thread is writing, or whose results would be lost."""

    def __init__(
        self,
        path: object,
        reason: str = "another run is writing into it",
        remedy: str = "Wait until that has ended, or give another folder with --out",
    ):
        super().__init__(path, reason, remedy)


class NoEstimate(NsaidError):
    """A method found no estimate on a log.

    Attributes:
        reason: why.
        remedy: what to do about it.
    """

    def __init__(self, reason: str, remedy: str):
        self.reason = reason
        self.remedy = remedy
        super().__init__(f"{reason}. {remedy}")
