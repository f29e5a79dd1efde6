"""Fields of a scenario by dotted name: `plant.robot`, or `robot` if that is unambiguous."""

import contextlib
import io
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, get_type_hints

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from ..errors import InvalidInput, UnknownName
from ..plants import Fault, fault_text, parse_faults
from .scenario import Scenario

REGISTRY = ConstructorRegistry()
"""How tyro reads and writes a scenario's fields, beyond the types that it knows."""


@REGISTRY.primitive_rule
def _faults(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[tuple[Fault, ...]] | None:
    """Faults are given as text: "loss 0.4 of 2 at 5 s; payload 1 at 10 s"."""
    if info.type != tuple[Fault, ...]:
        return None
    return PrimitiveConstructorSpec(
        nargs="*",
        metavar='"KIND NUMBER of WHICH at TIME s; …"',
        instance_from_str=lambda words: parse_faults(" ; ".join(words)),
        is_instance=lambda value: (
            isinstance(value, tuple) and all(isinstance(fault, Fault) for fault in value)
        ),
        str_from_instance=lambda value: [fault_text(fault) for fault in value],
    )


def field_paths(value: Any, prefix: str = "") -> list[str]:
    """Dotted names of all leaf fields of nested dataclasses and mappings."""
    parts = (
        value
        if isinstance(value, Mapping)
        else {f.name: getattr(value, f.name) for f in fields(value)}
    )
    paths = []
    for name, item in parts.items():
        nested = is_dataclass(item) or isinstance(item, Mapping)
        paths += field_paths(item, f"{prefix}{name}.") if nested else [f"{prefix}{name}"]
    return paths


def field_path(name: str, scenario: Scenario) -> str:
    """The full dotted path of a field, given by any unambiguous end of it.

    Raises:
        UnknownName: there is no such field, or several; lists near matches.
    """
    paths, wanted = field_paths(scenario), name.replace("-", "_")
    if wanted in paths:
        return wanted
    same = same_end(wanted, paths)
    if len(same) == 1:
        return same[0]
    if same:
        raise UnknownName("field", name, same, f"It is one of {', '.join(same)}.")
    alike = paths if "." in wanted else {path.rpartition(".")[2] for path in paths}
    raise UnknownName("field", name, alike, "`nsaid run NAME --help` lists all.")


def same_end(name: str, paths: Sequence[str]) -> list[str]:
    """The dotted names that end with a name."""
    return [path for path in paths if path.endswith("." + name)]


def field_value(path: str, text: str, scenario: Scenario) -> Any:
    """Parses a field's value from command-line words, by the field's type.

    Raises:
        InvalidInput: the words are not a value of that type.
    """
    parent, _, name = f".{path}".rpartition(".")
    hint = get_type_hints(type(field_at(scenario, parent[1:])))[name]

    def parsed(value: Any) -> Any:
        return value

    parsed.__annotations__["value"] = tyro.conf.FlagConversionOff[hint]
    try:
        words = shlex.split(text)
        args = [f"--value={words[0]}"] if len(words) == 1 else ["--value", *words]
        with contextlib.redirect_stderr(io.StringIO()):
            return tyro.cli(parsed, args=args, console_outputs=False, registry=REGISTRY)
    except (SystemExit, ValueError) as error:
        kind = hint.__name__ if isinstance(hint, type) else str(hint).replace("typing.", "")
        remedy = "`nsaid run NAME --help` lists the types of all fields."
        raise InvalidInput(path, f"a value of type {kind}", repr(text), remedy) from error


def field_at(value: Any, path: str) -> Any:
    """The value at a dotted path in nested dataclasses and mappings; "" is the whole."""
    for name in filter(None, path.split(".")):
        value = value[name] if isinstance(value, Mapping) else getattr(value, name)
    return value


def with_fields(value: Any, new: Mapping[str, Any]) -> Any:
    """A copy of nested dataclasses and mappings with fields replaced, by dotted name."""
    parts: dict[str, dict[str, Any]] = {}
    for path, item in new.items():
        name, _, rest = path.partition(".")
        parts.setdefault(name, {})[rest] = item
    changed = {
        name: inner[""] if "" in inner else with_fields(field_at(value, name), inner)
        for name, inner in parts.items()
    }
    return {**value, **changed} if isinstance(value, Mapping) else replace(value, **changed)
