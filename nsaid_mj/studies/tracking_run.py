"""Carries out a tracking study: progress, files, page and recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ..evaluation.tracking import Motion
from ..reporting.progress import announcing
from .tracking import FILES, Course, Plan, courses, print_table, write
from .tracking_page import draw


def run(plan: Plan, folder: Path, quiet: bool = False) -> list[Course]:
    """Runs a study, writes its files, page and recording, and prints the table.

    After Ctrl-C it writes what is available.

    Args:
        plan: laws and seeds.
        folder: of the results; created if missing.
        quiet: print nothing.
    """
    done: list[Course] = []
    bar = Progress(
        TextColumn("{task.description:32}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True, quiet=quiet),
        transient=True,
        disable=quiet,
    )
    write(folder, plan, done)  # fails before the work if the folder cannot be written
    try:
        with bar, announcing(bar.console):
            task = bar.add_task("", total=len(plan.seeds) * len(plan.laws))
            for found in courses(plan, lambda words: bar.update(task, description=words)):
                first = found.seed == plan.seeds[0]
                done.append(found if first else replace(found, motion=_thinned(found.motion)))
                bar.advance(task)
    finally:
        write(folder, plan, done)
        pages = []
        if done:
            pages = draw(folder, plan, done)
    if not quiet:
        console = Console(highlight=False)
        print_table(plan, done, console)
        files = [folder / name for name in FILES] + pages
        console.print("\n".join(f"  {file}" for file in files), soft_wrap=True)
    return done


def _thinned(motion: Motion) -> Motion:
    """A motion without its rows, which only the first seed's page needs."""
    return replace(motion, theta_hat=motion.theta_hat[-1:])
