"""`--fix`: remedies of a log's findings applied to its map, tried, and kept only if they help."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...base import Finding, InvalidInput
from ...robots import RobotModel
from ..logs.mapping import map_of
from ..logs.remedies import composed, mended, remedies, words_of
from ..logs.tables import read_tables
from .inspection import Inspection, inspect

_ROUNDS = 3  # of remedies, each of which may bring the next contradiction to light
_HEAD = "# Written by `nsaid … --fix`: columns that no line names are matched by their names.\n"


@dataclass(frozen=True)
class Fix:
    """Remedies that were tried.

    Attributes:
        text: the map with them; that given, if they were withdrawn or there are none.
        changes: values set, by table and key.
        before: the log as it was.
        after: the log with the remedies; `before` without any.
        withdrawn: why they were taken back; "" if they are kept.
    """

    text: str
    changes: dict[str, object]
    before: Inspection
    after: Inspection
    withdrawn: str = ""

    @property
    def kept(self) -> bool:
        """Whether the map was changed."""
        return bool(self.changes) and not self.withdrawn

    @property
    def lines(self) -> list[str]:
        """What was tried, and the refusals before and after."""
        if not self.changes:
            return ["--fix: no finding states a line of map.toml that would mend it"]
        said = [f"--fix: {words_of(self.changes)}"]
        said += [f"  before: {finding}" for finding in _refusals(self.before)]
        if self.withdrawn:
            return [*said, f"  withdrawn: {self.withdrawn}"]
        left = [f"  after: {finding}" for finding in _refusals(self.after)]
        return said + (left or ["  after: no contradiction is left"])

    def document(self) -> dict[str, object]:
        """What was changed, and why it was taken back, as plain data."""
        return {"changes": self.changes, "withdrawn": self.withdrawn}


def fix(files: Sequence[Path], text: str, robot: RobotModel) -> Fix:
    """Applies the remedies of a log's findings to the text of its map, "" for none.

    They are withdrawn if a contradiction remains that was not there before.

    Raises:
        NsaidError: the logs cannot be read, or the map cannot be used.
    """
    mapping = map_of(tomllib.loads(text)) if text else None
    before = inspect(read_tables(files, mapping), mapping, robot)
    known = {(f.code, f.where) for f in _refusals(before)}
    current = before
    made = text
    changes: dict[str, object] = {}
    for _ in range(_ROUNDS):
        wanted = remedies(current.findings)
        if not wanted:
            break
        try:
            own = composed(wanted, tomllib.loads(made))
            made = mended(made or _HEAD, own)
            mapping = map_of(tomllib.loads(made))
            current = inspect(read_tables(files, mapping), mapping, robot)
        except (InvalidInput, tomllib.TOMLDecodeError) as error:  # such as a table in one line
            return Fix(
                text, changes | wanted, before, before, f"the map cannot be changed: {error}"
            )
        changes |= own
    new = [f for f in _refusals(current) if (f.code, f.where) not in known]
    worse = new or (changes and len(_refusals(current)) >= len(_refusals(before)))
    if worse:
        left = new or _refusals(current)
        return Fix(text, changes, before, before, f"another contradiction follows: {left[0]}")
    return Fix(made, changes, before, current)


def _refusals(found: Inspection) -> list[Finding]:
    return [finding for finding in found.findings if finding.level == "refusal"]
