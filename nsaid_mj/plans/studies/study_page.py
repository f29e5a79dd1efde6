"""The page of a study: its verdict with the plots that carry it, its table, and more plots."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ...report import Figure, Figures, Page, Result, Section, Text
from .runs import Runs


def study_page(
    runs: Runs,
    result: Result,
    table: Section,
    lead: str,
    *,
    drawn: Sequence[Figure] = (),
    carrying: int = 1,
    legend: str = "",
    eyebrow: str = "",
    commands: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> Page:
    """The page of a study.

    Args:
        runs: all runs of the study.
        result: what they show.
        table: the figures of all groups of runs.
        lead: what was run, in one sentence.
        drawn: all plots; none on the terminal.
        carrying: number of the first plots, which stand beside the verdict.
        legend: how the plots are read.
        eyebrow: the kind of study, above the heading.
        commands: command lines that repeat the study.
        notes: where its files are.
    """
    sections = [table]
    more = drawn[carrying:]
    if more:
        sections.append(Section("More plots", [Figures(more), Text(legend, note=True)]))
    elif drawn:
        sections = [replace(table, panels=[*table.panels, Text(legend, note=True)])]
    name = Path(runs.manifest["script"]).stem
    return Page(
        heading=name,
        result=result,
        eyebrow=eyebrow,
        tab=f"{name} · {runs.folder.name}",
        lead=lead,
        carrying=drawn[:carrying],
        sections=sections,
        commands=commands,
        notes=notes,
        versions=runs.manifest["versions"],
    )
