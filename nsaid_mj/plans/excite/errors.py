"""Errors of designs."""

from __future__ import annotations

from ...base import NsaidError


class NoMotion(NsaidError):
    """No motion within the limits was found for an experiment.

    Attributes:
        reason: why.
        remedy: what to do about it.
    """

    def __init__(self, reason: str, remedy: str):
        self.reason = reason
        self.remedy = remedy
        super().__init__(f"{reason}. {remedy}")
