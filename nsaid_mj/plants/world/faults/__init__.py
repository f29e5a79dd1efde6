"""Faults of a plant during a run: their kinds, as text, and their effect in time."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator

from .kinds import Fault
from .text import parse_faults


def _read(value: Any) -> Any:
    """Accepts text, and text among the items of a sequence."""
    if isinstance(value, str):
        return parse_faults(value)
    if isinstance(value, list | tuple):
        parts = [parse_faults(v) if isinstance(v, str) else (v,) for v in value]
        return tuple(fault for part in parts for fault in part)
    return value


Faults = Annotated[tuple[Fault, ...], BeforeValidator(_read)]
"""Any number of faults; also as text, see `text`."""
