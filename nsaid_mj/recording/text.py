"""What a run has found, in words and a few numbers, as Markdown."""

from __future__ import annotations

from typing import Any

from ..evaluation import FIGURES, OWN, figure, unobservable_lines
from ..experiment.loop import Run

_SPELLED = {"θ̄": "θ", "θ̂": "θ^", "_P⊥": "_perp", "P⊥": "P_perp", "⊥": "perp", "ᵀ": "'"}
_FONT = (  # of Inter, the viewer's font, what a robot's names and units may need
    (0x20, 0x7E), (0xA0, 0x148), (0x300, 0x31E), (0x388, 0x38A), (0x38E, 0x3A1), (0x3A3, 0x3C9),
    (0x400, 0x45F), (0x1E00, 0x1EFF), (0x2010, 0x2027), (0x2030, 0x205E), (0x2070, 0x2071),
    (0x2074, 0x208E), (0x2190, 0x2199), (0x2202, 0x2202), (0x2206, 0x2206), (0x2211, 0x2212),
    (0x221A, 0x221A), (0x221E, 0x221E), (0x2248, 0x2248), (0x2260, 0x2260), (0x2264, 0x2265),
)  # fmt: skip


def result(run: Run, summary: dict[str, Any]) -> str:
    """The text of a run that has ended.

    Args:
        run: a run that has ended.
        summary: its summary.json.
    """
    r, p = summary["r"], summary["p"]
    identifiers = {OWN: summary, **summary["rivals"]}
    lines = [
        f"## {run.folder.resolve().name}: {summary['status']}",
        "",
        f"{summary['sim_s']:.4g} s, {summary['sensors']} sensors. "
        f"**{p - r} of {p}** directions of θ can be known from motion, **{r}** cannot.",
        "",
        *_conditions(summary),
        f"| | {' | '.join(identifiers)} |",
        "|---|" + "---|" * len(identifiers),
    ]
    for label, key, unit in FIGURES:
        if any(key in s for s in identifiers.values()):
            cells = " | ".join(figure(s.get(key), unit) for s in identifiers.values())
            lines.append(f"| {label} | {cells} |")
    if summary["status"] != "completed":
        lines[2:2] = [
            f"**Ended at t = {summary['status_time']:.4g} s** {summary['status_signal']}. "
            f"{summary['status_remedy']}",
            "",
        ]
    lines += ["", "### What motion cannot tell, and what would", ""]
    lines += [f"- **{what}**: {fix}" for what, fix in unobservable_lines(summary)]
    return drawable("\n".join(lines) + "\n")


def _conditions(summary: dict[str, Any]) -> list[str]:
    """What the plant did that the structure does not know, as far as anybody knows."""
    if "mismatch" not in summary:
        return ["The true θ is not known: the estimate is judged by what it predicts.", ""]
    lines = []
    if summary["mismatch"]:
        lines += [f"Not in the structure: {'; '.join(summary['mismatch'])}.", ""]
    if summary["fault"]:
        lines += [f"Fault: {summary['fault']}.", ""]
    return lines


def drawable(text: str) -> str:
    """The text in characters that the viewer's font has.

    Rerun brings one font and asks no other: a missing character is a box in its window, and ends
    its screenshots. The font sets a hat upon θ's bar, where nobody sees it.
    """
    for mark, words in _SPELLED.items():
        text = text.replace(mark, words)
    return "".join(c if c == "\n" or any(a <= ord(c) <= z for a, z in _FONT) else "?" for c in text)
