"""A design on the terminal, and its page."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from ..design.trial import Trial
from ..evaluation.confidence import INTERVAL
from ..evaluation.summary import versions
from ..resources import write_text
from . import pages
from .panels import Panel, template_figure

HALVES = ("half", "before")
_ALONE = 0.5  # share of a parameter that motion must reveal for its own interval to mean anything


def print_design(
    name: str, document: dict[str, Any], files: Sequence[Path], noticed: Sequence[str] = ()
) -> None:
    """Prints what a design will tell.

    Args:
        name: of the robot.
        document: of `design.files.document`.
        files: that were written.
        noticed: remarks about the model file.
    """
    console = Console(highlight=False)
    for remark in noticed:
        console.print(f"  {remark}")
    own, random = document["predicted_deviation"], _of_random_motions(document)
    console.print(f"[bold]{name}[/]: {document['duration']:g} s for {document['asked']}")
    console.print(
        f"  predicted rms deviation {own:.2g}; random motions of the same limits "
        f"{random:.2g}, a factor {random / own:.2g}"
    )
    console.print(_intervals(document))
    console.print(_limits(document))
    for line in statements(document):
        console.print(f"  {line}")
    for path in files:
        console.print(f"  {path}")


def _of_random_motions(document: dict[str, Any]) -> float:
    """The predicted deviation of random motions, rms over draws as that of the design is."""
    return float(np.sqrt(np.mean(np.square(document["predicted_deviation_of_random_motions"]))))


def statements(document: dict[str, Any]) -> list[str]:
    """What the experiment will not tell, what would help, and how many harmonics it needs."""
    lines = []
    count = document["weak_directions"]
    needed = document["harmonics"]["dimension_of_P_perp"]
    lines.append(
        f"{needed - count} of {needed} observable directions will be known, "
        + (f"{count} stay weak" if count else "none stays weak")
    )
    lines += [_weak_line(direction) for direction in document["weak"]]
    lines += [
        f"With {other['words']}: predicted {other['predicted']:.2g} instead of "
        f"{document['predicted_deviation_of_prior']:.2g}, {other['weak']} weak directions"
        for other in document["remedies"]
    ]
    lines += [f"Not observable: {words}; {fix}" for words, fix in document["unobservable"][:3]]
    more = len(document["unobservable"]) - 3
    if more > 0:
        lines.append(f"and {more} more directions that are not observable, in design.json")
    measured = ", ".join(f"{h}: {rank}" for h, rank in document["harmonics"]["measured"])
    if measured:
        lines.append(f"rank by number of harmonics: {measured}, of p − r = {needed}")
    return lines


def _weak_line(direction: dict[str, Any]) -> str:
    """A weak direction and what helps it most."""
    line = (
        f"Weak: {direction['words']}, {100 * direction['left']:.0f} % of its prior deviation left"
    )
    if not direction["remedy"]:
        return f"{line}; nothing that was computed helps"
    return f"{line}; {100 * direction['after']:.0f} % with {direction['remedy']}"


def write_page(document: dict[str, Any], trial: Trial | None, folder: Path) -> Path:
    """Writes report.html atomically and returns its path.

    Args:
        document: of `design.files.document`.
        trial: of the design on a draw of the prior, or None.
        folder: an existing folder.
    """
    own, random = document["predicted_deviation"], _of_random_motions(document)
    better = random / own
    told = (
        f"Predicted rms deviation of the {document['asked']}: {own:.2g}, {better:.2g} times "
        f"smaller than with random motions of the same limits ({random:.2g})."
        if better > 1
        else f"No better than random motions: predicted rms deviation of the {document['asked']} "
        f"{own:.2g}, of random motions {random:.2g}."
    )
    page = pages.render(
        "design.html",
        eyebrow="design of an experiment",
        heading=document["title"],
        lead=f"{document['duration']:g} s of motion, before anything moves.",
        verdict=pages.verdict("good" if better > 1 else "fair", told),
        carrying=_figures(document, trial),
        alarms=[],
        lines=statements(document),
        intervals=_interval_rows(document),
        limits=_limit_rows(document),
        again=pages.again(
            [f"nsaid run {shlex.quote(str(folder / 'scenario.py'))}"],
            versions(),
            "motion.csv is the motion; scenario.py makes it in MuJoCo; all figures are in "
            "design.json.",
        ),
    )
    path = folder / "report.html"
    write_text(path, page)
    return path


def _figures(document: dict[str, Any], trial: Trial | None) -> list[dict[str, Any]]:
    """The trial's largest deviations and errors over time."""
    if trial is None:
        return []
    from .plots import over_time  # imported late: matplotlib takes half a second

    panel = Panel(f"Predicted and reached: {document['asked']}", "largest of all", True)
    for values, label in (
        (INTERVAL * trial.predicted, "predicted 95 %"),
        (INTERVAL * trial.stated, "stated by the law, 95 %"),
        (trial.error, "error in the trial"),
    ):
        panel.add(trial.t, values.max(axis=1), label)
    return [template_figure(panel.title, over_time(panel), panel.legend, wide=True)]


def _intervals(document: dict[str, Any]) -> Table:
    """The predicted intervals of gains, masses and frictions."""
    table = Table(
        title="predicted 95 % intervals, at a fixed common scale (–: motion does not reveal it)",
        title_justify="left",
    )
    for column in ("parameter", "prior", "±", "before ±", "unit"):
        table.add_column(column, justify="left" if column in ("parameter", "unit") else "right")
    for row in _interval_rows(document):
        table.add_row(*row)
    return table


def _interval_rows(document: dict[str, Any]) -> list[list[str]]:
    return [
        [
            row["label"],
            f"{row['value']:.3g}",
            *(f"{row[half]:.2g}" if row["observable"] > _ALONE else "–" for half in HALVES),
            row["unit"],
        ]
        for row in shown(document)
    ]


def shown(document: dict[str, Any]) -> list[dict[str, Any]]:
    """The intervals of gains, masses and frictions; all others are in design.json."""
    words = ("gain", "friction", "drag", "lift", "thrust")
    return [
        row
        for row in document["intervals"]
        if row["label"].startswith("mass") or any(word in row["kind"] for word in words)
    ]


def _limits(document: dict[str, Any]) -> Table:
    table = Table(title="limits, and what the simulated motions use of them", title_justify="left")
    for column in ("limit", "largest", "unit", "use", "from"):
        table.add_column(column, justify="right" if column in ("largest", "use") else "left")
    for row in _limit_rows(document):
        table.add_row(*row)
    return table


def _limit_rows(document: dict[str, Any]) -> list[list[str]]:
    return [
        [
            name,
            f"{np.max(np.abs([limit['low'], limit['high']])):.3g}",
            limit["unit"],
            f"{100 * document['uses'][name]:.0f} %",
            limit["source"],
        ]
        for name, limit in document["limits"].items()
    ]
