"""The results of an identification as Markdown, in the characters that the viewer's font has."""

from __future__ import annotations

from ..calibration import words
from ..calibration.result import Identification, Parameter
from ..evaluation.words import ABSENT, estimate
from .text import drawable

_TITLES = {
    "yes": "The model explains the log",
    "partly": "The model explains the log in part",
    "no": "The model does not explain the log",
}
_GAINS = 30  # printed at most


def verdict_text(result: Identification) -> str:
    """Text of the panel Verdict: verdict, warnings, quality per joint, gains."""
    lines = [f"## {_plain(result.robot.name)}: {_TITLES[result.explains]}", ""]
    lines += [f"**{_plain(result.verdict)}**", ""]
    lines += [
        f"- **{finding.level}**: {_plain(str(finding))}"
        for finding in result.findings
        if finding.level != "note"
    ]
    lines += ["", f"{_plain(words.logs_in_words(result))}.", ""]
    total = len(result.parameters)
    counts = ", ".join(f"{count} {status}" for status, count in words.counts(result.parameters))
    lines += [f"Of {total} parameters: {counts}.", ""]
    checked = any(j.validation is not None for j in result.joints)
    lines += _row("NRMSE", "fit", "held out", "least squares", *(["validation"] * checked))
    lines += ["|---|" + "---|" * (3 + checked)]
    for j in result.joints:
        cells = [words.nrmse(x) for x in (j.fit, j.held_out, j.least_squares)]
        lines += _row(_plain(j.name), *cells, *([words.nrmse(j.validation)] * checked))
    gains = [p for p in result.parameters if words.is_gain(p)][:_GAINS]
    if gains:
        lines += ["", *_table(gains)]
    if result.suggestion:
        lines += ["", _plain(result.suggestion)]
    lines += ["", f"The scale rests on {_plain(result.anchor)}."]
    return drawable("\n".join(lines) + "\n")


def parameters_text(result: Identification) -> str:
    """Text of the panel Parameters: all of them, by block."""
    lines: list[str] = []
    blocks: dict[str, list[Parameter]] = {}
    for parameter in result.parameters:
        blocks.setdefault(parameter.block, []).append(parameter)
    for block, members in blocks.items():
        lines += [f"### {_plain(block)}", "", *_table(members), ""]
    notes = [f for f in result.findings if f.level == "note"]
    if notes:
        lines += ["### What was done to the log", ""]
        lines += [f"- {_plain(str(finding))}" for finding in notes]
    return drawable("\n".join(lines) + "\n")


def _table(parameters: list[Parameter]) -> list[str]:
    lines = [
        *_row("parameter", "estimate", "95 % interval", "unit", "status"),
        "|---|" + "---|" * 4,
    ]
    for p in parameters:
        value, interval = estimate(p.value, p.low, p.high)
        interval = ABSENT if p.status == "known" else interval
        lines += _row(_plain(p.label), value, interval, p.unit, p.status)
    return lines


def _row(*cells: str) -> list[str]:
    return [f"| {' | '.join(cells)} |"]


def _plain(text: str) -> str:
    """Text without the characters that Markdown interprets."""
    for mark in "\\`*_{}[]<>#|":
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())
