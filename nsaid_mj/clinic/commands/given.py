"""What the commands of this house read of their command lines; `cli.grammar` declares the flags."""

from dataclasses import Field
from pathlib import Path
from typing import Any, ClassVar, Protocol


class ToIdentify(Protocol):
    """What `nsaid identify` was given: a dataclass with the defaults of its flags."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    model: str | None
    log: tuple[Path, ...]
    validate: tuple[Path, ...]
    map: Path | None
    validate_map: Path | None
    known: tuple[str, ...]
    load: tuple[str, ...]
    lock: str
    joints: str
    columns: str
    delay: str
    cutoff: float | None
    fix: bool
    law: str
    limit: float
    out: Path | None
    force: bool
    json: bool
    quiet: bool


class ToInspect(Protocol):
    """What `nsaid inspect` was given."""

    logs: tuple[Path, ...]
    model: str | None
    map: Path | None
    lock: str
    joints: str
    fix: bool
    limit: float
    out: Path
    json: bool


class ToFollow(Protocol):
    """What `nsaid live` was given."""

    model: str
    law: str
    rate: float
    udp: int | None
    frame: str
    position_noise: float
    velocity_noise: float
    prior_error: float
    gain: float | None
    lock: str
    joints: str
    every: float | None
    view: bool
    out: Path | None
    force: bool
    json: bool
    quiet: bool


class ToCompare(Protocol):
    """What `nsaid compare --log … --models …` was given."""

    log: tuple[Path, ...]
    models: tuple[str, ...]
    map: Path | None
    json: bool
    quiet: bool
