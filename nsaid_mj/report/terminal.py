"""A page on the terminal: verdict, findings, and texts, tables and lists of brief sections."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from rich import markup
from rich.console import Console
from rich.table import Table as Grid

from ..base import Finding, printable
from .page import Badges, Cell, Items, Link, Page, PageItem, Table, Text, count, in_brief
from .result import LEVELS, Mark

_COLOURS = {"good": "green", "fair": "yellow", "poor": "red", "weak": "bright_black"}
_NOTES = 6  # largest printed number of notes, and of findings of any graver level
_GRAVE = 40
_LENGTH = 120  # characters of an entry of a list, at most


def escape(text: str) -> str:
    """A text as it is, for the console: no markup, no control characters."""
    return markup.escape(printable(text))


def print_page(page: Page, console: Console, files: Sequence[object] = ()) -> None:
    """Prints a page; the written files, or other last lines, come after a blank line."""
    mark = page.result.mark
    if mark is not None:
        name = f"[bold]{escape(page.heading)}[/]: " if page.heading else ""
        colour = _COLOURS[mark.kind]
        console.print(
            f"[bold {colour}]{mark.glyph}[/] {name}[bold {colour}]{escape(mark.text)}[/]",
            soft_wrap=True,
        )
    elif page.heading:
        console.print(f"[bold]{escape(page.heading)}[/]: {escape(page.lead)}", soft_wrap=True)
    print_findings(page.result.findings, console)
    if mark is not None and page.lead:
        console.print(f"  {escape(page.lead)}", soft_wrap=True)
    for section in page.sections:
        if section.brief:
            print_panels(section.panels, console)
    for k, line in enumerate(files):
        console.print(
            f"{'' if k else chr(10)}  {printable(str(line))}", soft_wrap=True, markup=False
        )


def print_findings(findings: Sequence[Finding], console: Console, codes: bool = False) -> None:
    """Prints a line for each finding, notes dimmed; of many of one level it counts the rest.

    The gravest come first. A remedy that several in a row share is printed after the last. With
    `codes`, levels and codes precede the words, and all are printed.
    """
    for level, mark in LEVELS.items():
        some = [finding for finding in findings if finding.level == level]
        most = len(some) if codes else _NOTES if level == "note" else _GRAVE
        shown = [
            replace(f, remedy="") if f.remedy == after.remedy else f
            for f, after in pairwise([*some[:most], Finding(level, "", "", "")])
        ]
        lines = [f"{f.level} {f.code}: {f}" if codes else str(f) for f in shown]
        lines += [f"and {count(len(some) - most, f'more {level}')}"] if len(some) > most else []
        for line in lines:
            words = f"[dim]{escape(line)}[/]" if level == "note" else escape(line)
            console.print(f"  [{_COLOURS[mark.kind]}]{mark.glyph}[/] {words}", soft_wrap=True)


def print_panels(panels: Sequence[PageItem], console: Console) -> None:
    """Prints badges, texts, lists and tables, each indented by two characters.

    Of a list's pairs long parts are cut, as the page has them all; see `in_brief` for what is left
    out.
    """
    shown = in_brief(panels)
    if shown and isinstance(shown[0], Text | Items | Badges):
        console.print()
    for panel in shown:
        if isinstance(panel, Text):
            console.print(f"  {escape(_spoken(panel.words))}", soft_wrap=True)
        elif isinstance(panel, Badges):
            marks = ", ".join(f"{mark.glyph} {mark.text}" for mark in panel.marks)
            console.print(f"  {escape(marks)}", soft_wrap=True)
        elif isinstance(panel, Items):
            for entry in panel.entries:
                words = entry if isinstance(entry, str) else "\n      ".join(map(_cut, entry))
                console.print(f"    {escape(_spoken(words))}", soft_wrap=True)
        elif isinstance(panel, Table) and panel.lines:
            _print_table(panel, console)


def _cut(words: str) -> str:
    """A list in words; a long one is cut after a comma."""
    if len(words) <= _LENGTH:
        return words
    end = words.rfind(", ", 0, _LENGTH)
    return f"{words[:end]}, …" if end > 0 else words


def _print_table(table: Table, console: Console) -> None:
    """Prints a table, on a narrow terminal without its spare columns."""
    hidden: set[int] = set()
    unlimited = console.options.update(max_width=10_000)
    for column in [None, *table.spare]:
        hidden |= set() if column is None else {column}
        grid = _grid(table, hidden)
        if console.measure(grid, options=unlimited).maximum <= console.width:
            break
    console.print()
    console.print(grid)
    if len(table.lines) > table.most:
        console.print(f"    … and {len(table.lines) - table.most} more in the report")


def _grid(table: Table, hidden: set[int]) -> Grid:
    grid = Grid(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    shown = [k for k in range(len(table.heads)) if k not in hidden]
    for k in shown:
        head = f"{'' if k else '  '}{table.heads[k]}".replace(" [", "\n[")
        justify = "left" if k in table.text else "right"
        grid.add_column(escape(head), justify=justify, no_wrap=True)
    for line in table.lines[: table.most]:
        if len(line) == 1:
            grid.add_row(f"[bold]{_cell(line[0])}[/]")
        else:
            grid.add_row(*(f"{'' if k else '  '}{_cell(line[k])}" for k in shown))
    return grid


def _cell(cell: Cell) -> str:
    """A cell in the markup of rich; a mark is coloured."""
    if isinstance(cell, Mark):
        return f"[{_COLOURS[cell.kind]}]{escape(f'{cell.glyph} {cell.text}'.strip())}[/]"
    if isinstance(cell, Link):
        return ""
    return (
        " ".join(filter(None, map(_cell, cell))) if isinstance(cell, tuple) else escape(str(cell))
    )


def _spoken(words: str) -> str:
    return words.replace("`", "")
