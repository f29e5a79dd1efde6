"""The summary of an identification on the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ...calibration import words
from ...calibration.findings import Finding
from ...calibration.result import Identification, Parameter

_JOINTS, _GAINS, _NOTES = 16, 16, 6  # printed at most; the report has all of them
_WIDE, _COLUMN = 90, 14  # characters: of a wide terminal, and of a column of frictions


def print_identification(
    result: Identification, console: Console, files: Sequence[Path] = ()
) -> None:
    """Prints the verdict, warnings, quality per joint, gains and frictions.

    Args:
        result: of an identification.
        console: to print on.
        files: paths of the files written, which are listed last.
    """
    mark = words.EXPLAINS[result.explains]
    console.print(f"[bold {mark.colour}]{mark.glyph} {escape(result.verdict)}[/]", soft_wrap=True)
    print_findings(result.findings, console)
    console.print(
        f"  {escape(result.robot.name)}: {escape(words.logs_in_words(result))}; "
        f"identified in {result.seconds:.1f} s",
        soft_wrap=True,
    )
    _print_joints(console, result)
    _print_gains(console, result)
    _print_frictions(console, result)
    _print_counts(console, result)
    _print_law(console, result)
    if result.suggestion:
        console.print(f"\n  {escape(result.suggestion.replace('`', ''))}", soft_wrap=True)
    console.print(f"\n  The scale rests on {escape(result.anchor)}.", soft_wrap=True)
    for k, path in enumerate(files):
        console.print(f"{'' if k else chr(10)}  {path}", soft_wrap=True, markup=False)


def print_findings(findings: Sequence[Finding], console: Console) -> None:
    """Prints refusals, warnings and the first notes, except those on the choice of columns.

    Args:
        findings: of an identification, or of an `UnusableLog`.
        console: to print on.
    """
    for finding in findings:
        if finding.level != "note":
            mark = words.LEVELS[finding.level]
            console.print(
                f"  [{mark.colour}]{mark.glyph}[/] {escape(str(finding))}", soft_wrap=True
            )
    notes = [f for f in findings if f.level == "note" and f.code != "columns"]
    for finding in notes[:_NOTES]:
        console.print(f"  [dim]· {escape(str(finding))}[/]", soft_wrap=True)
    if len(notes) > _NOTES:
        more = len(notes) - _NOTES
        console.print(f"  [dim]· and {more} more {'note' if more == 1 else 'notes'}[/]")


def _print_joints(console: Console, result: Identification) -> None:
    """Prints the NRMSE of every joint; of many, the worst."""
    checked = any(j.validation is not None for j in result.joints)
    heads = ["fit", "held out", "least squares", *(["validation"] * checked), "delay"]
    table = _table("NRMSE of the command", *heads)
    kept = result.joints
    if len(kept) > _JOINTS:
        worst = sorted(kept, key=lambda j: j.held_out if math.isfinite(j.held_out) else math.inf)
        chosen = {id(j) for j in worst[-_JOINTS:]}
        kept = tuple(j for j in kept if id(j) in chosen)
    for j in kept:
        mark = words.quality(j.held_out)
        cells = [
            words.nrmse(j.fit),
            f"[{mark.colour}]{words.nrmse(j.held_out)}[/]",
            words.nrmse(j.least_squares),
        ]
        cells += [words.nrmse(j.validation)] * checked
        table.add_row(f"  {escape(j.name)}", *cells, words.delay(j.delay))
    console.print(table)
    if len(kept) < len(result.joints):
        console.print(f"    the worst of {len(result.joints)}; all are in the report")


def _print_gains(console: Console, result: Identification) -> None:
    """Prints the gains with intervals and statuses."""
    gains = [p for p in result.parameters if words.is_gain(p)]
    if not gains:
        return
    wide = console.width >= _WIDE
    names = [words.of_joint(p) for p in gains]
    names = names if len(set(names)) == len(names) else [p.label for p in gains]
    apart = wide or all(_told(p) for p in gains)  # beside the longest status there is no room
    heads = ["estimate", "95 % interval", *(["relative"] * apart), *(["before"] * wide)]
    table = _table("gains", *heads)
    table.add_column("\nunit", no_wrap=True)
    table.add_column("\nstatus", no_wrap=True)
    for name, p in zip(names[:_GAINS], gains, strict=False):
        value, interval = words.estimate(p.value, p.low, p.high)
        mark = words.STATUSES[p.status]
        table.add_row(
            f"  {escape(name)}",
            value,
            words.ABSENT if p.status == "known" else interval,
            *([words.relative(p)] * apart),
            *([words.number(p.prior)] * wide),
            escape(p.unit),
            f"[{mark.colour}]{mark.glyph} {p.status}[/]",
        )
    console.print(table)
    if len(gains) > _GAINS:
        console.print(f"    … and {len(gains) - _GAINS} more in the report")


def _print_frictions(console: Console, result: Identification) -> None:
    """Prints friction and rotor inertia, one line for each joint, one column for each kind.

    Values that the log does not determine by themselves are dimmed.
    """
    inertial, names = words.links(result.parameters), [j.name for j in result.joints]
    kinds: dict[str, dict[str, Parameter]] = {}
    for p in result.parameters:
        if p.block not in inertial and not words.is_gain(p) and words.of_joint(p) in names:
            kinds.setdefault(f"{p.block}\n{p.unit}", {})[words.of_joint(p)] = p
    room = console.width - 10 - max(map(len, names), default=0)
    kept = dict(list(kinds.items())[: max(2, room // _COLUMN)])
    if not kept:
        return
    heads = [escape(head.replace(" friction", "").replace("-dependent", "")) for head in kept]
    table = Table(box=None, pad_edge=False, padding=(0, 2), header_style="dim")
    table.add_column("\n  friction")
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for name in names[:_GAINS]:
        cells = []
        for members in kept.values():
            p = members.get(name)
            value = "" if p is None else words.estimate(p.value, p.low, p.high)[0]
            cells.append(f"[dim]({value})[/]" if p is not None and not _told(p) else value)
        table.add_row(f"  {escape(name)}", *cells)
    console.print()
    console.print(table)
    rest = len(kinds) > len(kept) or len(names) > _GAINS
    console.print(
        "    (in brackets: not identified by itself)" + ("; more in the report" if rest else "")
    )


def _print_law(console: Console, result: Identification) -> None:
    """Prints the gains of a law that followed the log, beside the batch fit's."""
    if result.law is None:
        return
    name = result.law.name
    heads = [f"law {name}", "95 % interval", "batch", "95 % interval", "agree"]
    table = _table("gains over their mean", *heads)
    for line in words.law_gains(result.law)[:_GAINS]:
        table.add_row(f"  {escape(line[0])}", *line[1:])
    if result.law.gains:
        console.print(table)
    ranges = []
    for values in (result.law.last, result.law.batch_last):
        known = values[np.isfinite(values)]
        ends = (known.min(), known.max()) if len(known) else (np.nan,)
        ranges.append(" to ".join(words.nrmse(float(x)) for x in ends))
    console.print(
        f"  the last fifth of the log, by the estimate before it: NRMSE {ranges[0]}, batch "
        f"{ranges[1]}",
        soft_wrap=True,
    )


def _told(parameter: Parameter) -> bool:
    return parameter.status in {"identified", "known"}


def _print_counts(console: Console, result: Identification) -> None:
    """Prints how many parameters have which status."""
    total = len(result.parameters)
    parts = [
        f"[{words.STATUSES[s].colour}]{words.STATUSES[s].glyph}[/] {n} {s}"
        for s, n in words.counts(result.parameters)
    ]
    console.print(f"\n  of {total} parameters: {', '.join(parts)}", soft_wrap=True)


def _table(title: str, *heads: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 2), header_style="dim")
    table.add_column("\n  " + title)
    for head in heads:
        table.add_column("\n" + head, justify="right")
    return table
