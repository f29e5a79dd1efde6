"""What every command ends with: one table, from the verdict that it prints and puts on its page.

| code | meaning |
|---|---|
| 0 | explained: the verdict is ✔ or ◐; or there was nothing to judge, as for `list` and `view` |
| 1 | not explained: the verdict is ✘, a run of a study has no result, or a statement fails |
| 2 | unusable input: a flag, a scenario, a model, a log or a folder |
| 130 | interrupted by Ctrl-C, SIGTERM or SIGHUP |
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..evaluation.result import Mark

EXPLAINED, NOT_EXPLAINED, UNUSABLE, INTERRUPTED = 0, 1, 2, 130


def code_of(verdict: Mark | None, complete: bool = True) -> int:
    """The exit code of a verdict; a study that is not complete is not explained either."""
    poor = verdict is not None and verdict.kind == "poor"
    return NOT_EXPLAINED if poor or not complete else EXPLAINED
