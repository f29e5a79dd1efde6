"""The exit codes of commands.

A command's exit code follows from the verdict that it prints and puts on its page.

| code | meaning |
|---|---|
| 0 | explained: the verdict is ✔ or ◐; or the command has no verdict, as `list` and `view` |
| 1 | not explained: the verdict is ✘, a run of a study has no result, or a statement fails |
| 2 | unusable input: a flag, a scenario, a model, a log or a folder |
| 130 | interrupted by Ctrl-C, SIGTERM or SIGHUP |
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .result import Result


class ExitCode(IntEnum):
    """The exit code of a command."""

    EXPLAINED = 0  # the verdict explains, or there is none
    NOT_EXPLAINED = 1  # the verdict does not explain, or is missing
    UNUSABLE = 2  # the input cannot be used
    INTERRUPTED = 130

    @classmethod
    def of(cls, result: Result) -> ExitCode:
        """The exit code of a result; an incomplete study is not explained either."""
        failed = result.explains == "no" or not result.complete
        return cls.NOT_EXPLAINED if failed else cls.EXPLAINED
