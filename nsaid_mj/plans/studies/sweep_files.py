"""Which files make a folder that of a sweep; it imports nothing heavy."""

from pathlib import Path

from ...base import BadRun

MANIFEST = "manifest.json"
"""What the sweep is."""
ROWS = "rows.jsonl"
"""One row for every run."""
TABLE = "results.parquet"
"""A table of the rows."""


def check_sweep(folder: Path) -> None:
    """Raises `BadRun` unless a folder has a file of a sweep."""
    if not any((folder / name).is_file() for name in (MANIFEST, ROWS, TABLE)):
        raise no_sweep(folder)


def no_sweep(folder: Path) -> BadRun:
    """The error to raise for a folder without a sweep."""
    return BadRun(
        folder,
        f"not a sweep folder: {MANIFEST} is missing",
        "Give a folder that `nsaid sweep` has written",
    )
