"""Loads scenarios by name or by the path of their script; its errors name file and line."""

from __future__ import annotations

import importlib.util
import inspect
import sys
import sysconfig
import traceback
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import TYPE_CHECKING

from ..base import InputFile, InvalidInput, NsaidError, UnknownName, path_of
from ..robots import scenarios

if TYPE_CHECKING:
    from .scenario import Scenario


_LONGEST = 300  # characters of an exception's text
_PACKAGE = Path(__file__).resolve().parent.parent
_INSTALLED = tuple(
    {str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib", "purelib")}
)


def script_error(error: BaseException) -> BadScript | None:
    """The error to raise for an exception in a user's code.

    None for errors of this package, and if no user's code is in the traceback.
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
    """Whether a file belongs to neither this package nor an installed one."""
    path = Path(file)
    if not path.is_file():
        return False
    path = path.resolve()
    return not (path.is_relative_to(_PACKAGE) or str(path).startswith(_INSTALLED))


def place_of(thing: object) -> tuple[str, int, str]:
    """File, line and first line of code of a function or class; "" and 0 if there is none."""
    try:
        file = inspect.getsourcefile(thing)  # type: ignore[arg-type]  # raises for other things
        lines, first = inspect.getsourcelines(thing)  # type: ignore[arg-type]
    except (OSError, TypeError):
        return "", 0, ""
    return file or "", first, lines[0].strip()


_GUARD = "Call it under `if __name__ == '__main__':`, which does not hold while a script is loaded."


class _Script(SourceFileLoader):
    """Loads a script without leaving its bytecode in the user's folder."""

    def set_data(self, path: str, data: object, *, _mode: int = 0o666) -> None:
        pass


def load(name: str) -> Scenario:
    """Loads a scenario by the name of a packaged one, from a script, or from a run's scenario.json.

    Raises:
        UnknownName: there is no such scenario; lists near matches.
        BadScript: the script raises an exception, or exits.
        InvalidInput: the script defines no `scenario`, or the JSON is none.
    """
    known = scenarios()
    if name.endswith(".json") and path_of(name).is_file():
        from .scenario import Scenario

        return Scenario.from_json(InputFile(path_of(name)).read())
    path = Path(name) if name.endswith(".py") or name not in known else known[name]
    path = path_of(path)
    if path.suffix != ".py" or not path.is_file():
        remedy = "The name comes before all flags; a script or scenario.json is given by its path."
        raise UnknownName("scenario", name, known, remedy)
    InputFile(path).check(text=True)
    name = f"_scenario_{path.stem}"
    loader = _Script(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    assert spec is not None  # of a .py file
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses of the script resolve their annotations here
    from .scenario import Scenario

    try:
        loader.exec_module(module)
    except SyntaxError as error:
        raise script_error(error) or BadScript(path, 0, f"SyntaxError: {error.msg}") from error
    except Exception as error:
        if found := script_error(error):
            raise found from error
        raise
    except SystemExit as error:
        frames = traceback.extract_tb(error.__traceback__)
        at = next(f for f in reversed(frames) if Path(f.filename).resolve() == path.resolve())
        reason = "it exits while it is loaded"
        raise BadScript(path, at.lineno or 0, reason, at.line or "", _GUARD) from error
    found = getattr(module, "scenario", None)
    if not isinstance(found, Scenario):
        expected = "a script that defines `scenario = Scenario(…)`"
        got = type(found).__name__ if hasattr(module, "scenario") else "none"
        raise InvalidInput(str(path), expected, got, "See scenarios/ur5.py.")
    return found


class BadScript(NsaidError):
    """An error in a user's script.

    Attributes:
        path: the file.
        line: number of the line at fault; 0 if there is none.
        reason: what is wrong with it.
        code: the line at fault; "" if there is none.
        remedy: what to do about it.
    """

    def __init__(
        self, path: object, line: int, reason: str, code: str = "", remedy: str = "Correct it."
    ):
        self.path, self.line, self.reason, self.code = path, line, " ".join(reason.split()), code
        self.remedy = remedy
        where = f"{path}, line {line}" if line else f"{path}"
        lines = f"{where}: {self.reason}", code and f"  {code}", remedy
        super().__init__("\n".join(filter(None, lines)))
