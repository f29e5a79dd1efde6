"""A page as Markdown, for the text panels of a recording: all of it but its figures."""

from __future__ import annotations

from collections.abc import Sequence

from ..evaluation.result import Mark
from .pages import Badges, Cell, Fold, Items, Link, Page, Panel, Table, Text


def markdown(page: Page) -> str:
    """A page's verdict, findings, texts, lists and tables; its commands are left out."""
    lines = [f"## {plain(page.heading)}", ""] if page.heading else []
    lines += [f"**{plain(page.verdict.text)}**", ""] if page.verdict else []
    lines += [plain(page.lead), ""] if page.lead else []
    for finding in page.findings:
        where = f"**{plain(finding.where)}**: " if finding.where else ""
        lines.append(f"- {where}{plain(f'{finding.text}. {finding.remedy}')}")
    for section in page.sections:
        lines += ["", *([f"### {plain(section.title)}", ""] if section.title else [])]
        lines += panels(section.panels)
    return "\n".join(lines) + "\n"


def panels(some: Sequence[Panel]) -> list[str]:
    """The lines of texts, lists, tables and folded panels."""
    lines: list[str] = []
    for panel in some:
        if isinstance(panel, Text):
            lines += [f"{'#### ' * panel.head}{plain(panel.words)}", ""]
        elif isinstance(panel, Items):
            for entry in panel.entries:
                what, more = (entry, "") if isinstance(entry, str) else entry
                lines.append(f"- {f'**{plain(what)}**: {plain(more)}' if more else plain(what)}")
            lines.append("")
        elif isinstance(panel, Badges):
            lines += [", ".join(plain(mark.text) for mark in panel.marks), ""]
        elif isinstance(panel, Table) and panel.lines:
            lines += [_row(panel.heads), "|---" * len(panel.heads) + "|"]
            lines += [_row([_cell(cell) for cell in line]) for line in panel.lines] + [""]
        elif isinstance(panel, Fold):
            lines += [f"#### {plain(panel.title)}", "", *panels(panel.panels)]
    return lines


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(map(plain, cells))} |"


def _cell(cell: Cell) -> str:
    if isinstance(cell, Mark | Link):
        return cell.text
    return " ".join(map(_cell, cell)) if isinstance(cell, tuple) else str(cell)


def plain(text: str) -> str:
    """Text without the characters that Markdown interprets."""
    for mark in "\\`*_{}[]<>#|":
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())
