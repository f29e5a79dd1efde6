"""Where scenarios and assets lie: beside the package in a checkout, inside it in a wheel."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_PACKAGE = Path(__file__).resolve().parent


def folder(name: str) -> Path:
    """The folder `assets` or `scenarios`."""
    packed = _PACKAGE / f"_{name}"
    return packed if packed.is_dir() else _PACKAGE.parent / name


def asset(vehicle: str, file: str) -> Path:
    """The path of a vehicle's asset."""
    return folder("assets") / vehicle / file


def scenarios() -> dict[str, Path]:
    """All scenario scripts by name."""
    return {path.stem: path for path in sorted(folder("scenarios").glob("[!_]*.py"))}


def numbers(vehicle: str) -> dict[str, Any]:
    """A vehicle's published numbers, from its vehicle.toml; sources are in its SOURCE.md."""
    with asset(vehicle, "vehicle.toml").open("rb") as stream:
        return tomllib.load(stream)


def write_json(path: Path, value: Any) -> None:
    """Writes JSON, whole or not at all.

    Raises:
        ValueError: a number is NaN or infinite.
    """
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Writes text, whole or not at all."""
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Gives a temporary path to write to; then syncs it and renames it to `path`.

    A reader finds the old file or the whole new one. Where writing fails, nothing is left behind.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        yield partial
        with partial.open("rb") as stream:
            os.fsync(stream.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
