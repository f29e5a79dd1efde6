"""The results of a run as Markdown, in the characters that the viewer's font has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..evaluation import FIGURES, OWN, figure, observable_line, unobservable_lines
from ..evaluation.verify import Verdict
from ..experiment.loop import Run

_CLAIMS = {
    "W(t, x, v, θ) P̄_⊥ θ̄_P⊥ vanishes": "the observable error excites no force any more",
    "every window excites all of P_⊥": "every window excites all observable directions",
    "θ̂ converges to P(θ)": "the estimate converges to the true set",
}
_WORDS = {
    " ‖θ̄_P⊥‖/‖θ̂‖": "",
    "‖θ̄_P⊥‖/‖θ̂‖": "distance to the true set",
    "‖θ̂‖": "the estimate's size",
    "W θ̂": "the force residual",
    "P_⊥": "the observable directions",
}
_SPELLED = {"θ̄": "θ", "θ̂": "θ^", "_P⊥": "_perp", "P⊥": "P_perp", "⊥": "perp", "ᵀ": "'"}
_FONT = (  # ranges of Inter, the viewer's font, that names and units may need
    (0x20, 0x7E), (0xA0, 0x148), (0x300, 0x31E), (0x388, 0x38A), (0x38E, 0x3A1), (0x3A3, 0x3C9),
    (0x400, 0x45F), (0x1E00, 0x1EFF), (0x2010, 0x2027), (0x2030, 0x205E), (0x2070, 0x2071),
    (0x2074, 0x208E), (0x2190, 0x2199), (0x2202, 0x2202), (0x2206, 0x2206), (0x2211, 0x2212),
    (0x221A, 0x221A), (0x221E, 0x221E), (0x2248, 0x2248), (0x2260, 0x2260), (0x2264, 0x2265),
)  # fmt: skip


def result(run: Run, summary: dict[str, Any]) -> str:
    """The text of the Result panel.

    Args:
        run: a finished run.
        summary: the content of its summary.json.
    """
    identifiers = {OWN: summary, **summary["rivals"]}
    lines = [
        f"## {run.folder.resolve().name}: {summary['status']}",
        "",
        *([f"**{summary['verdict']}**", ""] if summary["status"] == "completed" else []),
        f"{summary['sim_s']:.4g} s, {summary['sensors']} sensors. {observable_line(summary)}.",
        "",
        *_conditions(summary),
    ]
    for label, key, unit in FIGURES:
        if any(key in s for s in identifiers.values()):
            told = [(name, figure(s.get(key), unit)) for name, s in identifiers.items()]
            values = ", ".join(f"{n} {v}" for n, v in told) if len(told) > 1 else told[0][1]
            lines.append(f"- {_worded(label)}: **{values}**")
    if summary["status"] != "completed":
        lines[2:2] = [
            f"**Ended at t = {summary['status_time']:.4g} s** {summary['status_signal']}. "
            f"{summary['status_remedy']}",
            "",
        ]
    return drawable("\n".join(lines) + "\n")


def statements(verdicts: Sequence[Verdict]) -> str:
    """The paper's statements with their verdicts."""
    if not verdicts:
        return "The run is too short for a verdict.\n"
    lines = []
    for v in verdicts:
        claim, told = _CLAIMS.get(v.claim, v.claim), _worded(v.words)
        lines += [
            f"### {v.verdict.capitalize()}: {claim}",
            "",
            f"{v.statement}. {told[:1].upper()}{told[1:]}.",
            "",
        ]
    return drawable("\n".join(lines) + "\n")


def unknown(summary: dict[str, Any]) -> str:
    """What cannot be known, and which number would fix it."""
    lines = [f"{observable_line(summary)}.", ""]
    lines += [f"- **{what}**: {fix}" for what, fix in unobservable_lines(summary)]
    return drawable("\n".join(lines) + "\n")


def _worded(text: str) -> str:
    """A text with symbols that the viewer's font lacks replaced by their meaning."""
    for symbol, meaning in _WORDS.items():
        text = text.replace(symbol, meaning)
    return text


def _conditions(summary: dict[str, Any]) -> list[str]:
    """Sensor noise, mismatches and faults; without a truth, how the estimate is judged instead."""
    lines = []
    if summary["sensor_noise"]:
        lines += [f"Sensors: {summary['sensor_noise']}.", ""]
    for fault in summary.get("faults", []):
        lines += [f"Found at {fault['found']:.4g} s: {fault['words']}.", ""]
    if "mismatch" not in summary:
        return [*lines, "The true θ is unknown: the estimate is judged by its predictions.", ""]
    if summary["mismatch"]:
        lines += [f"Not in the structure: {'; '.join(summary['mismatch'])}.", ""]
    if summary["fault"]:
        lines += [f"Fault: {summary['fault']}.", ""]
    return lines


def drawable(text: str) -> str:
    """Replaces the characters that the viewer's font lacks.

    Rerun uses its own font only. A missing character is drawn as a box and makes its screenshots
    fail. A combining hat over θ̄ is drawn on top of the bar and is invisible, so both are spelled.
    """
    for mark, words in _SPELLED.items():
        text = text.replace(mark, words)
    return "".join(c if c == "\n" or any(a <= ord(c) <= z for a, z in _FONT) else "?" for c in text)
