"""Remedies of findings as lines of map.toml: in words, and applied to a map's text."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any, cast

from ...base import Finding


def remedies(findings: Sequence[Finding]) -> dict[str, object]:
    """Values of map.toml, by table and key, that mend all refusals that state some."""
    found: dict[str, object] = {}
    for finding in findings:
        changes = finding.data.get("map")
        if finding.level == "refusal" and isinstance(changes, Mapping):
            found |= changes
    return found


def line_of(key: str, value: object) -> str:
    """A line of TOML, such as `scale = 2`."""
    return f"{key} = {_toml(value)}"


def _toml(value: object) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(k)} = {_toml(x)}" for k, x in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float):
        return f"{value:.9g}"
    return json.dumps(value, ensure_ascii=False)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name, ensure_ascii=False)


def mended(text: str, changes: Mapping[str, object]) -> str:
    """The text of map.toml with values set, by table and key: other lines stay as they are."""
    for name, value in changes.items():
        table, key = name.rsplit(".", 1)
        text = _with_line(text, table, key, line_of(_key(key), value))
    return text


def _with_line(text: str, table: str, key: str, line: str) -> str:
    lines = text.splitlines()
    header = re.compile(rf"\s*\[\s*{re.escape(table)}\s*\]\s*(#.*)?")
    start = next((k for k, one in enumerate(lines) if header.fullmatch(one)), None)
    if start is None:
        return "\n".join([*lines, "", f"[{table}]", line]) + "\n"
    another = re.compile(r"\s*\[[^\[\],]+\]\s*(#.*)?")  # a table's header, not a row of numbers
    end = next((k for k in range(start + 1, len(lines)) if another.fullmatch(lines[k])), len(lines))
    own = re.compile(rf"\s*{re.escape(_key(key))}\s*=")
    kept: list[str] = []
    depth = 0  # of the brackets of a value that is being left out: it may have several lines
    for one in lines[start + 1 : end]:
        leaves = depth > 0 or own.match(one) is not None
        if not leaves:
            kept.append(one)
            continue
        plain = re.sub(r'"[^"]*"|#.*', "", one)
        depth += sum(plain.count(x) for x in "[{") - sum(plain.count(x) for x in "]}")
    return "\n".join([*lines[: start + 1], line, *kept, *lines[end:]]) + "\n"


def remedy_of(changes: Mapping[str, object]) -> str:
    """The lines of map.toml that make changes, as a sentence."""
    if not changes:
        return "Correct map.toml."
    tables: dict[str, list[str]] = {}
    for name, value in changes.items():
        table, key = name.rsplit(".", 1)
        tables.setdefault(table, []).append(f"`{line_of(_key(key), value)}`")
    lines = "; ".join(f"`[{table}]` {' and '.join(own)}" for table, own in tables.items())
    return f"Set {lines} in map.toml, or run with --fix."


def words_of(changes: Mapping[str, object]) -> str:
    """Such as `[time] scale = 2`, several separated by semicolons."""
    parts = []
    for name, value in changes.items():
        table, key = name.rsplit(".", 1)
        parts.append(f"[{table}] {line_of(_key(key), value)}")
    return "; ".join(parts)


def composed(changes: Mapping[str, object], map_: Mapping[str, Any]) -> dict[str, object]:
    """Changes on top of what a parsed map states: factors multiply, swaps follow each other."""
    found: dict[str, object] = {}
    for name, value in changes.items():
        table, key = name.rsplit(".", 1)
        own: Any = map_
        for part in _parts_of(table):
            own = own.get(part, {})
        given = own.get(key)
        if given is None or table in ("vehicle", "base") or name == "order.joints":
            found[name] = value
        elif table == "order":
            swaps = cast(dict[str, str], value).items()
            found[name] = given | {joint: given.get(other, other) for joint, other in swaps}
        else:
            found[name] = _times(given, value)
    return found


def _parts_of(table: str) -> list[str]:
    """The names in a table's header, such as `files."a.csv"`."""
    match = re.fullmatch(r'(\w+)\."(.*)"', table)
    return [match[1], match[2]] if match else [table]


def _times(given: Any, value: Any) -> Any:
    """The product of two factors; a unit replaces a factor; by joint where one of them is."""
    if isinstance(given, Mapping) or isinstance(value, Mapping):
        if not (isinstance(given, Mapping) and isinstance(value, Mapping)):
            return value
        return {**given} | {k: _times(given[k], x) if k in given else x for k, x in value.items()}
    if isinstance(given, str) or isinstance(value, str):
        return value
    return given * value
