"""The fault campaign: random input of many kinds, which must end well or in a typed error.

`scripts/campaign.py` prints the tries that went wrong, and a table of tried and failed per family.
Killed processes, signals, full disks, closed streams and planted links are in tests/faults.
"""

from __future__ import annotations

from collections.abc import Iterator

from . import commands, entrances, files, folders
from .tries import Draw, Try, carried_out

FAMILIES: dict[str, Draw] = {
    **commands.FAMILIES,
    **files.FAMILIES,
    **folders.FAMILIES,
    **entrances.FAMILIES,
}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family."""
    return carried_out(family, FAMILIES[family], tries, seed)
