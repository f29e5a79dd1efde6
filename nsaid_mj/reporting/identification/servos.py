"""The summary of identified servos on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ...calibration import words
from ...calibration.result import Parameter
from ...calibration.servos import Score, ServoIdentification
from .terminal import print_findings

_SHOWN = {"T": 1e3, "f": 1e3, "kp": 1.0, "d": 1e3}  # factor to the unit in the head
_HEADS = ("kv/kp\nms", "f/kp\nmrad", "kp\n", "delay\nms")
_PER_SERVO = 5  # parameters


def print_servos(result: ServoIdentification, console: Console, files: Sequence[Path] = ()) -> None:
    """Prints the verdict, what was noticed, and every servo with its 95 % intervals.

    Args:
        result: of an identification of servos.
        console: to print on.
        files: paths of the files written, which are listed last.
    """
    mark = words.EXPLAINS[result.explains]
    console.print(f"[bold {mark.colour}]{mark.glyph} {escape(result.verdict)}[/]", soft_wrap=True)
    print_findings(result.findings, console)
    table = Table(box=None, pad_edge=False, padding=(0, 1), header_style="dim")
    table.add_column("\n\n servo", no_wrap=True)
    for head in (*_HEADS, "error\nmrad", "simple\nmrad"):
        table.add_column("\n" + head, justify="right", no_wrap=True)
    for k, servo in enumerate(result.servos):
        own = result.parameters[_PER_SERVO * k : _PER_SERVO * (k + 1)]
        cells = [_cell(p) for p in own if _kind(p) in _SHOWN]
        errors = (f"{servo.error * 1e3:.1f}", f"{servo.simple * 1e3:.1f}")
        table.add_row(f" {escape(servo.name)}", *cells, *errors)
    console.print(table)
    if any(parameter.combination for parameter in result.parameters):
        console.print("\n  ~ only in combination with others; identification.json says which.")
    console.print("  error: of the open-loop simulation; simple: of the late target or a constant.")
    for k, path in enumerate(files):
        console.print(f"{'' if k else chr(10)}  {path}", soft_wrap=True, markup=False)


def print_scores(scores: Sequence[Score], console: Console) -> None:
    """Prints how far models depart from logs: means over all joints.

    Args:
        scores: of `compare_models`.
        console: to print on.
    """
    table = Table(box=None, pad_edge=False, padding=(0, 1), header_style="dim")
    table.add_column("\n model")
    for head in ("0.2 s\nmrad", "2 s\nmrad", "log\nmrad", "one step\nNRMSE", "\ns"):
        table.add_column(head, justify="right", no_wrap=True)
    for score in scores:
        numbers = [*(1e3 * score.errors.mean(axis=1)), score.one_step.mean()]
        cells = ["–" if np.isnan(x) else f"{x:.2f}" for x in numbers]
        table.add_row(f" {escape(score.model)}", *cells, f"{score.seconds:.1f}")
    console.print(table)
    console.print(
        "\n  Mean absolute errors of open-loop simulations that start again after this time."
    )
    console.print("  identified: each half of the logs is predicted from the other.")


def _kind(parameter: Parameter) -> str:
    """Which of a servo's parameters it is, such as "kp" of kp_2."""
    return parameter.name.partition("_")[0]


def _cell(parameter: Parameter) -> str:
    """A value with its interval, or marked where only a combination is identified."""
    scale = _SHOWN[_kind(parameter)]
    if parameter.status != "identified":
        return f"~ {scale * parameter.value:.3g}"
    half = 50 * (parameter.high - parameter.low) / parameter.value
    return f"{scale * parameter.value:.3g} ±{half:.0f} %"
