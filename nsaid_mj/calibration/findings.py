"""Findings about logs and fits, and the error that carries them."""

from __future__ import annotations

from collections.abc import Iterable

from ..errors import NsaidError
from ..robot.findings import Finding, Level

__all__ = ["Finding", "Level", "UnusableLog", "refused"]


def refused(findings: Iterable[Finding]) -> bool:
    """Whether one of the findings is a refusal."""
    return any(finding.level == "refusal" for finding in findings)


class UnusableLog(NsaidError):
    """A model and log from which nothing can be identified.

    Attributes:
        findings: all findings, the refusals included.
    """

    def __init__(self, findings: tuple[Finding, ...]):
        self.findings = findings
        refusals = [f for f in findings if f.level == "refusal"]
        super().__init__("\n".join(str(f) for f in refusals))
