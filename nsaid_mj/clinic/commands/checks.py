"""Checks of these commands' arguments before anything heavy is imported.

They raise the errors that the work itself would raise, a second or more later.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...base import CHOICES, LARGEST, InvalidInput, numbers_in, path_of
from ...robots import asset, check_model

if TYPE_CHECKING:
    from .given import ToFollow, ToIdentify, ToInspect


_LEAST_NOISE = 1e-10  # standard deviation [SI units]: finer than any sensor of a robot
_MOST_NOISE = 1e3  # [SI units]: of such signals nothing can be identified


def names_in(text: str) -> tuple[str, ...]:
    """The parts of a comma-separated text."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


def known_number(text: str) -> tuple[str, float]:
    """Name and value of a known parameter, of `NAME=VALUE`; raises `InvalidInput` otherwise."""
    name, equals, value = text.rpartition("=")
    try:
        if not equals or not abs(float(value)) <= LARGEST:
            raise ValueError
        return name.strip(), float(value)
    except ValueError as error:
        raise InvalidInput("--known", "NAME=VALUE", text, "Such as gain_1=0.11.") from error


def check_logs(paths: Sequence[Path]) -> None:
    """Raises `UnreadableLog` if a file is missing, empty, or of no known format."""
    if paths:
        from ..logs.formats import files, form_of

        for path in paths:
            for file in files(path_of(path)):
                form_of(file)


def check_map(path: Path | None) -> None:
    """Raises `InvalidInput` unless the file is a map of columns; None is none."""
    if path is not None:
        from ..logs.mapping import read_map

        read_map(path)


def check_identify(chosen: ToIdentify, model: str) -> None:
    """Checks what `nsaid identify` was given."""
    CHOICES.check("law", chosen.law)
    if chosen.delay != "auto":
        numbers_in("--delay", chosen.delay, "Such as 0.01.")
    known = [known_number(text)[0] for text in chosen.known]
    for name in known:
        if known.count(name) > 1:
            both = ", ".join(text for text in chosen.known if known_number(text)[0] == name)
            raise InvalidInput("--known", f"one value of {name}", both, "Leave out all but one.")
    if chosen.columns != "auto":
        for name in names_in(chosen.columns):
            if name not in CHOICES["column of a vehicle"]:
                CHOICES.check("column", name)
    check_model(model)
    if chosen.load:
        from ..identify.loads import load_of

        for text in chosen.load:
            load_of(text)
    check_map(chosen.map)
    check_map(chosen.validate_map)
    check_logs(chosen.log)
    check_logs(chosen.validate)


def check_inspect(chosen: ToInspect) -> None:
    """Checks what `nsaid inspect` was given."""
    check_map(chosen.map)
    first = chosen.logs[0]
    packed = len(chosen.logs) == 1 and asset(str(first), "log.csv.gz").is_file()
    if first.exists() or not packed:
        check_logs(chosen.logs)
    if chosen.model is not None:
        check_model(chosen.model)


def check_live(chosen: ToFollow) -> None:
    """Checks what `nsaid live` was given."""
    if chosen.law not in CHOICES["law of a run"]:
        from ...core import NullspaceAID

        NullspaceAID(law=chosen.law)  # type: ignore[arg-type]  # raises
    CHOICES.check("frame", chosen.frame)
    for flag, value, least, most in (
        ("--position-noise", chosen.position_noise, _LEAST_NOISE, _MOST_NOISE),
        ("--velocity-noise", chosen.velocity_noise, _LEAST_NOISE, _MOST_NOISE),
        ("--prior-error", chosen.prior_error, 1e-6, 1e3),
        ("--gain", chosen.gain, 1e-9, 1e9),
        ("--every", chosen.every or None, 1e-6, 1e6),
    ):
        if value is not None and not least <= value <= most:
            raise InvalidInput(flag, f"a number from {least:g} to {most:g}", value, "Correct it.")
    check_model(chosen.model)
