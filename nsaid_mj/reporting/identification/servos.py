"""The summary of identified servos on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ...calibration import words
from ...calibration.result import Parameter
from ...calibration.servos import ServoIdentification
from .terminal import print_findings

_SCALE = {"T": 1e3, "f": 1e3, "kp": 1.0, "a": 1e3, "d": 1e3}
_HEADS = ("kv/kp\n[ms]", "f/kp\n[mrad]", "kp\n", "arm./kp\n[s²/1000]", "delay\n[ms]")


def print_servos(
    result: ServoIdentification, console: Console, files: Sequence[Path] = ()
) -> None:
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
    for head in (*_HEADS, "error\n[mrad]", "late\n[mrad]"):
        table.add_column("\n" + head, justify="right", no_wrap=True)
    for k, servo in enumerate(result.servos):
        cells = [_cell(p) for p in result.parameters[5 * k : 5 * k + 5]]
        errors = (f"{servo.error * 1e3:.1f}", f"{servo.delayed * 1e3:.1f}")
        table.add_row(f" {escape(servo.name)}", *cells, *errors)
    console.print(table)
    if any(parameter.combination for parameter in result.parameters):
        console.print("\n  ~ only in combination with others; identification.json says which.")
    console.print("  error of the open-loop simulation; late: of the target at its best delay.")
    for k, path in enumerate(files):
        console.print(f"{'' if k else chr(10)}  {path}", soft_wrap=True, markup=False)


def _cell(parameter: Parameter) -> str:
    """A value with its interval, or marked where only a combination is identified."""
    scale = _SCALE[parameter.name.rpartition("_")[0]]
    if parameter.status != "identified":
        return f"~ {scale * parameter.value:.3g}"
    half = 50 * (parameter.high - parameter.low) / parameter.value
    return f"{scale * parameter.value:.3g} ±{half:.0f} %"
