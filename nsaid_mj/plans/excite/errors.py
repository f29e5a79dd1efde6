"""Errors of designs."""

from __future__ import annotations

from ...base import NothingFound


class NoMotion(NothingFound):
    """No motion within the limits was found for an experiment."""
