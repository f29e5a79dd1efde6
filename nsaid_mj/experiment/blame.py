"""Errors in a user's script, told with its file and line. Imports nothing heavy."""

from __future__ import annotations

import inspect
import sysconfig
import traceback
from pathlib import Path

from ..errors import BadScript, NsaidError

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
