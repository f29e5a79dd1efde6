"""The family `logs`: draws every kind of a user's log, tries them, prints one table by kind."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scripts.machine import machine

from .command import attempt, in_processes
from .judging import CRASH, NOT_RUN
from .table import Line

LIMIT = 300.0  # computing time of a draw [s]
BARS = {"named": 0.90, "right": 0.95, "wrong": 0.01}
"""Least shares of causes named first and of remedies that end right; largest of wrong ones."""
_DETAILS = 200  # characters of what was said, in the list of draws that fail


def line_of(chosen: tuple[str, int], limit: float = LIMIT, verbose: bool = False) -> Line:
    """Tries one draw: its kind and seed, and what `field.Tried` says of it."""
    kind, seed = chosen

    def run() -> Line:
        from .field import KINDS

        with tempfile.TemporaryDirectory() as folder:
            return KINDS[kind](seed, Path(folder)).keys()

    return {"kind": kind, "seed": seed} | attempt(run, limit, verbose)


def wrong(line: Line) -> bool:
    """Whether a draw ended in a result that is wrong and that nothing doubts."""
    return bool(line.get("wrong")) and line["confident"]


GROUPS = {
    "robots that walk": ("walking",),
    "healthy": ("healthy", "gentle"),
    "clock": ("clock",),
    "signs": ("reversed", "signs of rates"),
    "units, motor side": ("degrees", "deg/s", "rpm", "motor side", "radians"),
    "order": ("swapped", "order"),
    "frames": ("frame", "NED", "FRD", "world velocities", "inverse"),
    "dead command": ("dead",),
    "phases": ("phases",),
}
"""Groups of kinds by words in their names, the first that holds; others stand alone."""


def group_of(kind: str) -> str:
    """The group of a kind."""
    some = (group for group, words in GROUPS.items() if any(word in kind for word in words))
    return next(some, kind)


def table(lines: Sequence[Line], name_of: Callable[[str], str] = group_of) -> str:
    """The table by group or by another name of each kind, with all kinds in its last row."""
    names = dict.fromkeys(name_of(line["kind"]) for line in lines)
    head = (
        f"| kind | draws | named first (≥ {100 * BARS['named']:.0f} %) | alone "
        f"| ends right (≥ {100 * BARS['right']:.0f} %) "
        f"| wrong, confident (≤ {100 * BARS['wrong']:.0f} %) | crash |"
    )
    rows = [_row(name, [line for line in lines if name_of(line["kind"]) == name]) for name in names]
    return "\n".join([head, "|---" * 7 + "|", *rows, _row("**all**", lines)])


def _row(name: str, lines: Sequence[Line]) -> str:
    ran = [line for line in lines if line["outcome"] != NOT_RUN]
    said = [line for line in ran if line["outcome"] != CRASH]
    cells = [
        _share(line["named"] for line in said),
        _share(line["alone"] for line in said),
        _share(line["right"] for line in said),
        _share(wrong(line) for line in said),
    ]
    crashed = len(ran) - len(said)
    return f"| {name} | {len(ran)} | {' | '.join(cells)} | {crashed} |"


def _share(hits: Iterable[bool | None]) -> str:
    """Such as `19/20`, of those that are not None."""
    known = [hit for hit in hits if hit is not None]
    return f"{sum(known)}/{len(known)}" if known else "–"


def failures(lines: Sequence[Line]) -> str:
    """A line for every draw that is not named first, does not end right, or is wrong."""
    found = []
    for line in lines:
        if line["outcome"] == CRASH:
            found.append(f"{line['kind']} {line['seed']}: crash: {line['error']}")
            continue
        if line["outcome"] == NOT_RUN:
            continue
        kinds = ["not named"] * (not line["named"])
        kinds += ["does not end right"] * (line["right"] is False)
        kinds += [f"WRONG, CONFIDENT: {'; '.join(line['wrong'])}"] * wrong(line)
        if kinds:
            said = f"{line['words']}: {line['said']}"[:_DETAILS]
            found.append(f"{line['kind']} {line['seed']}: {', '.join(kinds)} | {said}")
    return "\n".join(found)


def study(chosen: Sequence[tuple[str, int]], file: Path | None, jobs: int) -> list[Line]:
    """Tries the draws that are not in the file yet, and appends them to it."""
    known = read(file) if file is not None and file.is_file() else {}
    left = [one for one in chosen if one not in known]
    for line in in_processes(left, partial(line_of), jobs):
        known[line["kind"], line["seed"]] = line
        print(_shown(line), flush=True)
        if file is not None:
            with file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(line, ensure_ascii=False) + "\n")
    return [known[one] for one in chosen]


def read(file: Path) -> dict[tuple[str, int], Line]:
    """The lines of a study's file by kind and seed."""
    lines = [json.loads(text) for text in file.read_text("utf-8").splitlines() if text.strip()]
    return {(line["kind"], line["seed"]): line for line in lines}


def _shown(line: Line) -> str:
    failed = failures([line]).partition(": ")[2] or line["outcome"]
    return f"{line['kind']} {line['seed']} {line['seconds']:.1f} s: {failed}"


def main(words: Sequence[str], description: str | None) -> None:
    """The command line of `--family logs`."""
    from .field import KINDS

    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", default="0:20", help="such as 100:120")
    parser.add_argument(
        "--only", nargs="+", default=list(KINDS), choices=list(KINDS), metavar="KIND"
    )
    parser.add_argument("--json", type=Path, help="a line for each draw; a study goes on from it")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    chosen = parser.parse_args(words)
    first, last = map(int, chosen.seeds.split(":"))
    draws = [(kind, seed) for seed in range(first, last) for kind in chosen.only]
    lines = study(draws, chosen.json, chosen.jobs)
    tables = f"{table(lines, str)}\n\n{table(lines)}"
    print(f"\n{tables}\n\n{failures(lines)}\n\n{_stated(chosen.seeds)}")


def _stated(seeds: str) -> str:
    found: dict[str, Any] = machine()
    versions = ", ".join(f"{k} {found[k]}" for k in ("python", "mujoco", "pin", "numpy", "numba"))
    return f"Seeds {seeds}; {found['processors']} × {found['processor']}, {versions}."
