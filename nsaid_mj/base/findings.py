"""Findings about a model, a log or a fit, in words and as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """A finding about the input, for the user."""

    # `note`: the data were changed. `warning`: the result may suffer. `refusal`: no result from
    # this input could be trusted
    level: Literal["note", "warning", "refusal"]
    code: str  # a short constant name for scripts, such as "reversed_sign" or "dead_channel"
    where: str  # the file, channel or joint concerned; "" if none
    text: str  # the finding, with figures, units and row numbers
    remedy: str = ""  # what to do about it; "" if nothing needs to be done
    # the figures of the text, for scripts; values are plain numbers, strings and lists
    data: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        where = f"{self.where}: " if self.where else ""
        return f"{where}{self.text}. {self.remedy}".rstrip()

    @staticmethod
    def gravest_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
        """Findings ordered by level."""
        levels = ("refusal", "warning", "note")
        return tuple(sorted(findings, key=lambda finding: levels.index(finding.level)))

    @staticmethod
    def refused(findings: Iterable[Finding]) -> bool:
        """Whether one of the findings is a refusal."""
        return any(finding.level == "refusal" for finding in findings)

    @staticmethod
    def missing_files(
        path: Path, kind: str, names: list[str], remark: str, remedy: str
    ) -> list[Finding]:
        """One note on all meshes (or another `kind` of file) that a model lacks, if any."""
        if not names:
            return []
        others = f" and {len(names) - 1} more" if names[1:] else ""
        were = "files were" if names[1:] else "file was"
        text = f"{len(names)} {kind} {were} not found ({names[0]}{others}), so {remark}"
        return [Finding("note", "mesh_missing", path.name, text, remedy, {"files": names})]
