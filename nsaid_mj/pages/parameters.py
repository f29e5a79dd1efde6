"""Parameters of any result: tables, intervals and correlations, for page and terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..evaluation.result import STATUSES, Mark, Parameter, Result, counts
from ..evaluation.words import estimate
from ..parameters import ABSENT, Array, number
from .page import Cell, Fold, Link, Table
from .panels import Forest, HeatMap, Points

_OPEN = 12  # parameters in total, up to which no table is collapsed
_LINES = 16  # of a table on the terminal, at most
_CORRELATED = 36  # parameters whose correlations are drawn, at most
CORRELATIONS = (
    "Strong colours: two parameters that this motion determines together, so that one known value "
    "narrows the other. Correlations of at least 0.5 are written out."
)


def relative(parameter: Parameter) -> str:
    """The half-width of a gain's interval relative to the other gains, such as "±1.2 %"."""
    if parameter.relative is None:
        return ABSENT
    return f"±{number(float(f'{100 * parameter.relative:.2g}'))} %"


def table(parameters: Sequence[Parameter], numbers: Mapping[str, int] | None = None) -> Table:
    """Parameters, at least one, with intervals, prior and true values where known.

    `numbers` are those of the page's list of combinations, for parameters that are part of one.
    """
    judged = any(p.status for p in parameters)
    known = any(p.true is not None for p in parameters)
    before = np.isfinite([p.prior for p in parameters]).any()
    lines: list[list[Cell]] = []
    for p in parameters:
        value, interval = estimate(p.value, p.low, p.high)
        line: list[Cell] = [p.label, value, p.unit]
        line += [ABSENT if p.status == "known" else interval] if judged else []
        line += [number(p.prior)] if before else []
        line += [ABSENT if p.true is None else number(p.true)] if known else []
        lines.append([*line, _status(p, (numbers or {}).get(p.combination, 0))] if judged else line)
    heads = ["parameter", "estimate", "unit", *["95 % interval"] * judged]
    heads += [*["prior"] * bool(before), *["true"] * known, *["status"] * judged]
    return Table(heads, lines, (0, 2, len(heads) - 1) if judged else (0, 2))


def _status(p: Parameter, combination: int) -> Cell:
    found: list[Mark | Link | str] = [STATUSES[p.status]]
    if combination:
        found.append(Link(f"C{combination}", f"combination-{combination}"))
    apart = f"{relative(p)} of the other gains" if p.relative else ""
    more = "; ".join(filter(None, ("" if combination else p.combination, apart)))
    return (*found, more) if more else tuple(found)


def folds(result: Result, numbers: Mapping[str, int] | None = None) -> list[Fold]:
    """A table for each block of θ, with the number of parameters of each status."""
    few = len(result.parameters) <= _OPEN
    return [
        Fold(
            members[0].part if name in result.bodies else name,
            [table(members, numbers)], counts(members), str(len(members)),
            few or members[0].is_gain,
        )
        for name, members in result.blocks.items()
    ]  # fmt: skip


def brief_gains(result: Result) -> list[Table]:
    """The gains for the terminal; a narrow one leaves columns out. Empty without intervals."""
    gains = [p for p in result.gains if p.status]
    if not gains:
        return []
    names = [p.part for p in gains]
    known = gains[0].true is not None
    lines: list[list[Cell]] = []
    for name, p in zip(names, gains, strict=True):
        value, interval = estimate(p.value, p.low, p.high)
        line: list[Cell] = [name if names.count(name) == 1 else p.label, value]
        line += [ABSENT if p.status == "known" else interval, relative(p), number(p.prior)]
        if p.true is not None:  # with as many digits as the estimate
            half = (p.high - p.low) / 2
            line.append(estimate(p.true, p.true - half, p.true + half)[0])
        lines.append([*line, p.unit, STATUSES[p.status]])
    heads = ["gains", "estimate", "95 % interval", "relative", "prior", *["true"] * known]
    heads += ["unit", "status"]
    spare = (4, 2) if known and gains[0].relative is not None else (4, 3)
    return [Table(heads, lines, (0, len(heads) - 2, len(heads) - 1), spare=spare, most=_LINES)]


def forests(parameters: Sequence[Parameter]) -> list[Forest]:
    """Estimates with intervals, priors and true values, a figure for each kind and unit."""
    groups: dict[tuple[str, str], list[Parameter]] = {}
    for p in parameters:
        kind = p.label.partition(" of ")[0] if p.block.startswith("coupling") else p.block
        groups.setdefault((kind, p.unit), []).append(p)
    found = []
    for (kind, unit), members in groups.items():
        value, low, high, prior = np.array([(p.value, p.low, p.high, p.prior) for p in members]).T
        others = [Points("prior", prior)]
        true = np.array([p.true for p in members], dtype=float)
        others += [Points("true", true, "x")] if np.isfinite(true).any() else []
        firm, names = np.array([p.firm for p in members]), [p.part for p in members]
        title = kind[:1].upper() + kind[1:]
        found.append(Forest(title, f"{kind} [{unit}]", names, value, low, high, firm, others))
    return found


def correlations(labels: Sequence[str], r: Array) -> list[HeatMap]:
    """Correlations (k, k) as a heat map, of the first ones; empty for fewer than two."""
    labels, r = list(labels)[:_CORRELATED], r[:_CORRELATED, :_CORRELATED]
    return [HeatMap("", labels, r)] if len(labels) > 1 else []
