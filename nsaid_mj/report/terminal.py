"""A page on the terminal: verdict, findings, and texts, tables and lists of brief sections.

On a terminal lines are broken between words, and columns that do not fit are folded into lines
below their row. A pipe or a file gets every column, row and finding, each statement on one line.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from textwrap import wrap

from rich import markup
from rich.console import Console
from rich.text import Text as Styled

from ..base import Finding, printable
from ..core import ABSENT
from .page import Badges, Cell, Items, Link, Page, PageItem, Table, Text, count, in_brief
from .result import LEVELS, Mark, gathered

_COLOURS = {"good": "green", "fair": "yellow", "poor": "red", "weak": "bright_black"}
_NOTES = 6  # largest printed number of notes, and of findings of any graver level
_GRAVE = 40
_LENGTH = 120  # characters of an entry of a list, at most
_GAP = "  "  # between columns


def escape(text: str) -> str:
    """A text as it is, for the console: no markup, no control characters."""
    return markup.escape(printable(text))


def print_page(page: Page, console: Console, files: Sequence[object] = ()) -> None:
    """Prints a page; the written files, or other last lines, come after a blank line."""
    mark = page.result.mark
    if mark is not None:
        name = f"[bold]{escape(page.heading)}[/]: " if page.heading else ""
        colour = _COLOURS[mark.kind]
        glyph = f"[bold {colour}]{mark.glyph}[/]"
        _say(console, f"{glyph} {name}[bold {colour}]{escape(mark.text)}[/]", 0)
    elif page.heading:
        _say(console, f"[bold]{escape(page.heading)}[/]: {escape(page.lead)}", 0)
    notes = [finding for finding in page.result.findings if finding.level == "note"]
    grave = [finding for finding in page.result.findings if finding.level != "note"]
    _print_findings(grave if page.detailed else page.result.findings, console, page.detailed)
    if mark is not None and page.lead:
        _say(console, escape(page.lead))
    for section in page.sections:
        if section.brief:
            _print_panels(section.panels, console)
    if page.detailed:
        console.print()
        _print_findings(notes, console, codes=True)
    for k, line in enumerate(files):
        console.print(
            f"{'' if k else chr(10)}  {printable(str(line))}", soft_wrap=True, markup=False
        )


def _say(console: Console, words: str, indent: int = 2) -> None:
    """Prints a paragraph in markup; what a terminal breaks is indented by two characters more."""
    text = Styled.from_markup(words)
    ends = _breaks(text.plain, console.width - indent - 2) if console.is_terminal else []
    for k, line in enumerate(text.divide(ends)):
        line.rstrip()
        console.print(Styled(" " * (indent + 2 * (k > 0))) + line, soft_wrap=True)


def _breaks(words: str, room: int) -> list[int]:
    """Where a line of at most `room` characters ends: between words, not before a % sign."""
    bound = words.replace(" %", "\N{NO-BREAK SPACE}%")  # where `wrap` breaks no line
    lines = wrap(bound, max(room, 20), break_long_words=False, break_on_hyphens=False)
    ends: list[int] = []
    for line in lines[1:]:
        ends.append(bound.index(line, ends[-1] if ends else 1))
    return ends


def _print_findings(findings: Sequence[Finding], console: Console, codes: bool) -> None:
    """Prints a line for each finding, notes dimmed; of many of one level it counts the rest.

    The gravest come first, and what is said of several joints or channels is said once. A remedy
    that several in a row share is printed after the last. With `codes`, a code follows the words;
    with them, or in a pipe, all are printed.
    """
    everything = codes or not console.is_terminal
    for level, mark in LEVELS.items():
        some = gathered(finding for finding in findings if finding.level == level)
        most = len(some) if everything else _NOTES if level == "note" else _GRAVE
        shown = [
            replace(f, remedy="") if f.remedy == after.remedy else f
            for f, after in pairwise([*some[:most], Finding(level, "", "", "")])
        ]
        lines = [f"{f} ({f.code})" if codes else str(f) for f in shown]
        lines += [f"and {count(len(some) - most, f'more {level}')}"] if len(some) > most else []
        for line in lines:
            words = f"[dim]{escape(line)}[/]" if level == "note" else escape(line)
            _say(console, f"[{_COLOURS[mark.kind]}]{mark.glyph}[/] {words}")


def _print_panels(panels: Sequence[PageItem], console: Console) -> None:
    """Prints badges, texts, lists and tables, each indented by two characters.

    Of a list's pairs long parts are cut, as the page has them all; see `in_brief` for what is left
    out.
    """
    shown = in_brief(panels)
    if shown and isinstance(shown[0], Text | Items | Badges):
        console.print()
    for panel in shown:
        if isinstance(panel, Text):
            _say(console, escape(_spoken(panel.words)))
        elif isinstance(panel, Badges):
            _say(console, escape(", ".join(f"{mark.glyph} {mark.text}" for mark in panel.marks)))
        elif isinstance(panel, Items):
            for entry in panel.entries:
                subject, *more = (entry,) if isinstance(entry, str) else map(_cut, entry)
                _say(console, escape(_spoken(subject)), 4)
                for words in more:
                    _say(console, escape(_spoken(words)), 6)
        elif isinstance(panel, Table) and panel.lines:
            _print_table(panel, console)


def _cut(words: str) -> str:
    """A list in words; a long one is cut after a comma."""
    if len(words) <= _LENGTH:
        return words
    end = words.rfind(", ", 0, _LENGTH)
    return f"{words[:end]}, …" if end > 0 else words


def _print_table(table: Table, console: Console) -> None:
    """Prints a table; columns that a terminal has no room for stand in a line below each row."""
    most = table.most if console.is_terminal else len(table.lines)
    heads = [table.heads[k].replace(" [", "\n[").split("\n") for k in range(len(table.heads))]
    cells = [[Styled.from_markup(_cell(cell)) for cell in line] for line in table.lines[:most]]
    widths = [max(map(len, head)) for head in heads]
    for line in cells:
        if len(line) > 1:
            widths = [max(old, cell.cell_len) for old, cell in zip(widths, line, strict=True)]
    room = console.width if console.is_terminal else math.inf
    shown = table.columns_within(room, [width + len(_GAP) for width in widths])
    folded = [k for k in range(len(widths)) if k not in shown]
    console.print()
    levels = max(len(heads[k]) for k in shown)
    for level in range(-levels, 0):
        titles = [heads[k][level] if len(heads[k]) >= -level else "" for k in range(len(heads))]
        _print_row(table, [Styled(title, "dim") for title in titles], widths, shown, console)
    for line in cells:
        if len(line) == 1:
            console.print(Styled("  ") + Styled(line[0].plain, "bold"), soft_wrap=True)
            continue
        _print_row(table, line, widths, shown, console)
        more = [
            _in_words(table.heads[k], line[k]) for k in folded if line[k].plain not in {"", ABSENT}
        ]
        if more:
            _say(console, ", ".join(more), 6)
    if len(table.lines) > most:
        console.print(f"    … and {len(table.lines) - most} more in the report")


def _in_words(head: str, cell: Styled) -> str:
    """A folded cell: its column's name, the value and the unit."""
    name, _, unit = head.removesuffix("]").partition(" [")
    return f"{escape(name)} {cell.markup} {escape(unit)}".rstrip()


def _print_row(
    table: Table, line: Sequence[Styled], widths: Sequence[int], shown: Sequence[int], to: Console
) -> None:
    """Prints the shown cells of a row, words to the left and numbers to the right."""
    made = Styled()
    for k in shown:
        space = " " * (widths[k] - line[k].cell_len)
        made += Styled(_GAP) + (line[k] + space if k in table.text else Styled(space) + line[k])
    made.rstrip()
    to.print(made, soft_wrap=True)


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
