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

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .result import Result

EXPLAINED = 0
"""The exit code of a command whose verdict explains, or that has none."""

NOT_EXPLAINED = 1
"""The exit code of a command whose verdict does not explain, or is missing."""

UNUSABLE = 2
"""The exit code of a command whose input cannot be used."""

INTERRUPTED = 130
"""The exit code of a command that was interrupted."""


def code_of(result: Result) -> int:
    """The exit code of a result; an incomplete study is not explained either."""
    return NOT_EXPLAINED if result.explains == "no" or not result.complete else EXPLAINED
