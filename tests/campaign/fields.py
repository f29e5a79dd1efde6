"""Random values for the fields of the included scenarios, replaced in three ways.

A try replaces one to three fields by `dataclasses.replace`, in the scenario's JSON, or by flags. It
must end in a scenario that survives a round trip through JSON, or in an `InvalidInput` or
`UnknownName`; a command line may also exit with code 2.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
from collections.abc import Callable
from functools import cache
from typing import Any

from nsaid_mj import Scenario
from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.cli.grammar import RunOptions
from nsaid_mj.lab.library import load
from nsaid_mj.lab.options import parse_flags
from nsaid_mj.lab.scenario import field_at, field_paths, with_fields
from nsaid_mj.robots.assets import scenarios

from .tries import drawn_number

NAN, INF = float("nan"), float("inf")
VALUES: tuple[Any, ...] = (
    0,
    0.0,
    -0.0,
    1,
    -1,
    2,
    0.5,
    1.5,
    1e-3,
    -1e-3,
    1e-300,
    5e-324,
    1e15,
    1e16,
    1e300,
    2**31,
    2**63,
    2**64,
    2**64 + 1,
    -(2**63),
    10**400,
    10**5000,
    NAN,
    INF,
    -INF,
    True,
    False,
    None,
    1 + 2j,
    "",
    "x",
    "nan",
    "1",
    "paper",
    "noisy",
    "ünicode",
    "\0",
    "\udcff",
    "a" * 10_000,
    b"bytes",
    [],
    [1],
    [1, 2, 3],
    (1.0, 2.0),
    (0.0, 0.0, NAN),
    ["a", "b", "c"],
    range(3),
    {1, 2},
    {},
    {"a": {"b": {"c": 1}}},
    {1: 2},
    {None: 3},
    {"$type": ["NullspaceAID"]},
    {"$type": "Scenario"},
    {"$type": "ArmPlant"},
    {"$type": "FourierTracking", "reach": [1]},
    {"$type": "NullspaceAID", "memory": {"$type": "MemoryConfig", "pace": NAN}},
    object(),
    Scenario,
    print,
)


@cache
def packed(name: str) -> Scenario:
    """An included scenario, loaded once."""
    return load(name)


@cache
def places(name: str) -> list[str]:
    """Dotted names of a scenario's fields and of its nested parts."""
    leaves = field_paths(packed(name))
    parts = {path.rpartition(".")[0] for path in leaves} - {""}
    return [*leaves, *sorted(parts)]


def rewritten(scenario: Scenario, values: dict[str, Any]) -> Scenario:
    """A scenario with fields replaced in its JSON; values that JSON cannot hold become a list."""
    tree = json.loads(scenario.to_json())
    for path, value in values.items():
        *parents, last = path.split(".")
        node = tree
        for parent in parents:
            node = node[parent]
        node[last] = value
        try:
            json.dumps(value)
        except (TypeError, ValueError):
            node[last] = [1, [2]]
    return Scenario.from_json(json.dumps(tree))


def flagged(scenario: Scenario, values: dict[str, Any]) -> Scenario | None:
    """A scenario with fields replaced by flags; None where the command line is refused."""
    words = []
    for path, value in values.items():
        with contextlib.suppress(ValueError):  # an integer too long to be written
            items = value if isinstance(value, list | tuple) else (value,)
            words += [f"--{path}", *(str(item) for item in items)]
    try:
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            return parse_flags("x", scenario, words, "run", RunOptions)[0]
    except SystemExit as exit_:
        if exit_.code not in (0, 2):
            raise RuntimeError(f"exit code {exit_.code}") from exit_
        return None


WAYS: dict[str, Callable[[Scenario, dict[str, Any]], Scenario | None]] = {
    "replace": with_fields,
    "JSON": rewritten,
    "command line": flagged,
}


def outcome(way: str, name: str, values: dict[str, Any]) -> str:
    """The outcome of a try: `valid`, `refused`, or the unexpected error in words."""
    try:
        scenario = WAYS[way](packed(name), values)
        if scenario is not None:
            assert Scenario.from_json(scenario.to_json()) == scenario
            assert scenario.steps >= 2 and len(scenario.hash) == 12
    except (InvalidInput, UnknownName):
        return "refused"
    except Exception as error:
        return f"{type(error).__name__}: {str(error)[:150]}"
    return "refused" if scenario is None else "valid"


def drawn(rng: random.Random) -> tuple[str, str, dict[str, Any]]:
    """A random way to set fields, a scenario's name, and values for some of its fields."""
    way, name = rng.choice(list(WAYS)), rng.choice(list(scenarios()))
    chosen = rng.sample(places(name), rng.choice((1, 1, 1, 2, 3)))
    chosen = [p for p in chosen if not any(p.startswith(f"{q}.") for q in chosen)]
    values = {}
    for path in chosen:
        kind = rng.random()
        if kind < 0.1:  # a valid value of some scenario's field
            other = rng.choice(list(scenarios()))
            values[path] = field_at(packed(other), rng.choice(places(other)))
        elif kind < 0.2:
            values[path] = drawn_number(rng)
        elif kind < 0.35:
            values[path] = 10 ** rng.uniform(-6, 16)
        else:
            values[path] = rng.choice(VALUES)
    return way, name, values
