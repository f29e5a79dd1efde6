"""The study's tables, from the lines of its runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .cases import LAWS, TOGETHER
from .effects import EFFECTS, FAULTS
from .judging import COVERED, CRASH, FLAGGED, NOT_RUN, RIGHT

Line = dict[str, Any]
_MOVED = 3.0  # stated standard deviations from which an effect has moved a gain
_SEEN = 25.0  # least trace of an effect that could be seen: at 5 standard deviations, at best


def kind_of(line: Line) -> str:
    """Such as `right, confident`, `crash` or `not run`."""
    if line["outcome"] in (CRASH, NOT_RUN):
        return line["outcome"]
    return f"{line['truth']}, {line['manner']}"


def unseen(line: Line) -> bool:
    """Whether a run's effect leaves too little in the innovations for any test to see it."""
    return line.get("figures", {}).get("trace", np.inf) < _SEEN


def moved(line: Line, control: Line | None) -> bool | None:
    """Whether the effect moved a gain by more than it would be stated to deviate without it.

    None where either run has no gains to compare.
    """
    if control is None or not line.get("gain_errors") or not control.get("gain_deviations"):
        return None
    error, deviation = np.array(line["gain_errors"]), np.array(control["gain_deviations"])
    return bool(error.shape == deviation.shape and (np.abs(error) > _MOVED * deviation).any())


def admitted(line: Line) -> bool:
    """Whether a run is flagged or unsure, or its intervals are wide enough for its own errors."""
    if line["manner"] != "confident":
        return True
    error, deviation = np.array(line["gain_errors"]), np.array(line["gain_deviations"])
    return bool((np.abs(error) <= _MOVED * deviation).all())


def _share(hits: Iterable[bool]) -> str:
    values = list(hits)
    if not values:
        return "– (0)"
    return f"{100 * sum(values) / len(values):.1f} % ({sum(values)}/{len(values)})"


def overall(lines: Sequence[Line]) -> str:
    """The table of right and wrong, by law."""
    rows = [
        "| law | runs | right, confident | right, unsure or flagged | wrong, flagged "
        "| wrong, unsure | WRONG, CONFIDENT | crash | not run |",
        "|" + "---|" * 9,
    ]
    kinds = ("wrong, flagged", "wrong, unsure", "wrong, confident", CRASH, NOT_RUN)
    for law in (*LAWS, "all"):
        own = Counter(kind_of(line) for line in lines if law in (line["case"]["law"], "all"))
        hedged = own["right, unsure"] + own["right, flagged"]
        ran = own.total() - own[NOT_RUN]
        if own:
            rows.append(_row(law, ran, own["right, confident"], hedged, *(own[k] for k in kinds)))
    return "\n".join(rows)


def _row(*cells: object) -> str:
    return f"| {' | '.join(map(str, cells))} |"


def bars(lines: Sequence[Line]) -> str:
    """The other bars, by law."""
    by_number = {line["case"]["number"]: line for line in lines}
    rows = [
        "| law | exact: coverage ≥ .9 (≥ 95 %) | exact: right, confident (≥ 90 %) "
        "| exact: false faults per 100 (≤ 1) | healthy, flagged (≤ 3 %) "
        "| gain moved > 3 sd: flagged or widened (≥ 97 %) | true fault named |",
        "|" + "---|" * 7,
    ]
    judged = [line for line in lines if line["outcome"] == "judged"]
    for law in LAWS:
        own = [line for line in judged if line["case"]["law"] == law]
        if not own:
            continue
        exact = [line for line in own if line["case"]["effect"] == "none"]
        covered = [line["coverage"] >= 0.9 for line in exact if line["coverage"] is not None]
        false = sum(line["figures"].get("false_faults", 0) for line in exact)
        per = f"{100 * false / len(exact):.1f} ({false}/{len(exact)})" if exact else "–"
        confident = [kind_of(line) == "right, confident" for line in exact]
        hit = [
            line
            for line in own
            if line["case"]["effect"] not in ("none", *FAULTS)
            and moved(line, by_number.get(_control(line)))
        ]
        faulty = [bool(line["named"]) for line in own if line["case"]["effect"] in FAULTS]
        faulty = faulty if law == "efficient" else []  # the others name none
        flagged = [line["manner"] == FLAGGED for line in exact]
        shares = _share(covered), _share(confident), per, _share(flagged)
        rows.append(_row(law, *shares, _share(admitted(line) for line in hit), _share(faulty)))
    return "\n".join(rows)


def _control(line: Line) -> int:
    return line["case"]["number"] // TOGETHER * TOGETHER


def by_effect(lines: Sequence[Line]) -> str:
    """A line for every effect and size."""
    rows = [
        "| effect | size | runs | right | wrong, not confident | WRONG, CONFIDENT | flagged "
        f"| unsure | coverage < {COVERED:g} | false faults | crash |",
        "|" + "---|" * 11,
    ]
    for name in ("none", *EFFECTS):
        for size in EFFECTS[name].sizes if name in EFFECTS else (0.0,):
            own = [
                line
                for line in lines
                if (line["case"]["effect"], line["case"]["size"]) == (name, size)
                and line["outcome"] != NOT_RUN
            ]
            if not own:
                continue
            judged = [line for line in own if line["outcome"] == "judged"]
            kinds = [kind_of(line) for line in own]
            hedged = kinds.count("wrong, flagged") + kinds.count("wrong, unsure")
            covered = [line["coverage"] for line in judged if line["coverage"] is not None]
            false = sum(line["figures"].get("false_faults", 0) for line in judged)
            unit = EFFECTS[name].unit if name in EFFECTS else ""
            rows.append(
                _row(
                    name,
                    f"{size:g} {unit}",
                    len(own),
                    sum(k.startswith(RIGHT) for k in kinds),
                    hedged,
                    kinds.count("wrong, confident"),
                    sum(k.endswith("flagged") for k in kinds),
                    sum(k.endswith("unsure") for k in kinds),
                    sum(c < COVERED for c in covered),
                    false,
                    kinds.count(CRASH),
                )
            )
    return "\n".join(rows)


def worst(lines: Sequence[Line]) -> str:
    """The runs that are wrong and confident, and those that crashed, one line each."""
    found = [line for line in lines if kind_of(line) in ("wrong, confident", CRASH)]
    return "\n".join(
        f"{line['words']} → {'; '.join(line.get('wrong') or [line.get('error', '')])}"
        + (f"; trace {line['figures']['trace']:.3g}" if "trace" in line.get("figures", {}) else "")
        for line in sorted(found, key=lambda line: line["case"]["number"])
    )
