"""Carries out a tracking study: progress, files, page and recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rich.console import Console

from ..evaluation.tracking import Motion
from ..numerics.threads import single_threaded
from ..reporting.progress import announcing, counted
from ..resources import check_own, locked
from .tracking import FILES, Course, Plan, courses, print_table, write
from .tracking_page import draw


@single_threaded
def run(plan: Plan, folder: Path, quiet: bool = False) -> list[Course]:
    """Runs a study, writes its files, page and recording, and prints the table.

    After Ctrl-C it writes what is available.

    Args:
        plan: laws and seeds.
        folder: of the results; created if missing.
        quiet: print nothing.

    Raises:
        FolderInUse: another process is writing into the folder.
        NotWritten: the folder cannot be written.
    """
    check_own(folder, FILES[:1])
    with locked(folder):
        return _run(plan, folder, quiet)


def _run(plan: Plan, folder: Path, quiet: bool) -> list[Course]:
    done: list[Course] = []
    bar = counted(quiet)
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
