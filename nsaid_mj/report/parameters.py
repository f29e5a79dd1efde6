"""Parameters of any result: tables, intervals and correlations, for page and terminal."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..core import ABSENT, Array, number
from .page import Cell, Fold, Link, Table
from .panels import Forest, HeatMap, Points
from .result import Mark, Parameter, Result
from .wording import estimate

_OPEN = 12  # parameters in total, up to which no table is collapsed
_LINES = 16  # of a table on the terminal, at most
_CORRELATED = 20  # parameters whose correlations are drawn, at most: more labels are unreadable
_STRONG = 0.5  # correlation from which a pair is drawn
CORRELATIONS = (
    "Two parameters of strong colour are determined together by this motion: one known value "
    "narrows the other. Shown are the parameters with the strongest correlations, from 0.5 on."
)


def relative(parameter: Parameter) -> str:
    """The half-width of a gain's interval relative to the other gains, such as "±1.2 %"."""
    if parameter.relative is None:
        return ABSENT
    return f"±{number(float(f'{100 * parameter.relative:.2g}'))} %"


def table(parameters: Sequence[Parameter], numbers: Mapping[str, int] | None = None) -> Table:
    """Parameters, at least one, with intervals, prior and true values where known.

    `numbers` are those of the page's list of combinations, for parameters that are part of one. A
    narrow terminal folds the prior first, then what the other columns tell, too.
    """
    judged = any(p.status for p in parameters)
    known = any(p.true is not None for p in parameters)
    related = any(p.relative is not None for p in parameters)
    heads = ["parameter", "estimate", *["95 % interval"] * judged, *["relative"] * related]
    heads += ["prior"] * any(math.isfinite(p.prior) for p in parameters) + ["true"] * known
    heads += ["unit", *["status"] * judged]
    cells = [_cells(p, (numbers or {}).get(p.combination, 0)) for p in parameters]
    words = [k for k, head in enumerate(heads) if head in {"parameter", "unit", "status"}]
    spare = ["prior", "95 % interval" if known and related else "relative"]
    return Table(
        heads,
        [[line[head] for head in heads] for line in cells],
        words,
        spare=[heads.index(head) for head in spare if head in heads],
    )


def _cells(p: Parameter, combination: int) -> dict[str, Cell]:
    """The cells of a parameter's line, by column; `combination` is its number, 0 for none."""
    value, interval = estimate(p.value, p.low, p.high)
    half = (p.high - p.low) / 2
    status = Mark.of(p.status)
    numbered = Link(f"C{combination}", f"combination-{combination}")
    link = numbered if combination else Link(p.combination)
    return {
        "parameter": p.label,
        "estimate": value,
        "95 % interval": ABSENT if p.status == "known" else interval,
        "relative": relative(p),
        "prior": number(p.prior),
        # with as many digits as the estimate
        "true": ABSENT if p.true is None else estimate(p.true, p.true - half, p.true + half)[0],
        "unit": p.unit,
        "status": (status, link) if p.combination else status,
    }


def folds(
    result: Result, numbers: Mapping[str, int] | None = None, gains: bool = True
) -> list[Fold]:
    """A table for each block of θ, with the number of parameters of each status."""
    few = len(result.parameters) <= _OPEN
    return [
        Fold(
            members[0].part if name in result.bodies else _kind(name, members),
            [table(members, numbers)],
            Parameter.counted(members),
            str(len(members)),
            few or members[0].is_gain,
        )
        for name, members in result.blocks.items()
        if gains or not members[0].is_gain
    ]


def _kind(block: str, members: Sequence[Parameter]) -> str:
    """The kind of a block's parameters in words: the block's name where they differ by it."""
    kinds = {member.kind for member in members}
    return kinds.pop() if len(kinds) == 1 else block


def gains_of(result: Result, numbers: Mapping[str, int] | None = None) -> list[Table]:
    """The table of the gains, with `numbers` as in `table`; empty without gains."""
    gains = result.gains
    if not gains:
        return []
    parts = [p.part for p in gains]
    whole = table(gains, numbers)
    lines = [
        [(Link(p.label.removesuffix(p.part).strip()), p.part), *line[1:]]
        if parts.count(p.part) == 1 and p.part != p.label
        else line
        for p, line in zip(gains, whole.lines, strict=True)
    ]
    return [replace(whole, heads=["gains", *whole.heads[1:]], lines=lines, most=_LINES)]


def forests(parameters: Sequence[Parameter]) -> list[Forest]:
    """Estimates with intervals, priors and true values, a figure for each kind and unit."""
    groups: dict[tuple[str, str], list[Parameter]] = {}
    for p in parameters:
        kind = p.label.partition(" of ")[0] if p.block.startswith("coupling") else p.kind
        groups.setdefault((kind, p.unit), []).append(p)
    found = []
    for (kind, unit), members in groups.items():
        value, low, high, prior = np.array([(p.value, p.low, p.high, p.prior) for p in members]).T
        others = [Points("prior", prior)]
        true = np.array([p.true for p in members], dtype=float)
        others += [Points("true", true, "x")] if np.isfinite(true).any() else []
        firm = np.array([p.firm for p in members])
        names = [p.part for p in members]
        title = kind[:1].upper() + kind[1:]
        found.append(Forest(title, f"{kind} [{unit}]", names, value, low, high, firm, others))
    return found


def correlations(labels: Sequence[str], r: Array) -> list[HeatMap]:
    """Correlations (k, k) as a heat map, of those in the strongest pairs; empty if all are weak."""
    strongest = np.abs(r - np.diag(np.diag(r))).max(axis=1, initial=0.0)
    order = np.argsort(-strongest, kind="stable")[:_CORRELATED]
    rows = sorted(k for k in order.tolist() if strongest[k] >= _STRONG)
    strong = [labels[int(k)] for k in rows]
    return [HeatMap("", strong, r[np.ix_(rows, rows)])] if len(rows) > 1 else []
