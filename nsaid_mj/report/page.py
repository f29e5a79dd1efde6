"""A command's page as data: its `Result`, and sections made of panels.

A command builds one `Page`; `render_html` makes one self-contained HTML file of it, with every
value escaped, `markdown` a text for recordings, and `terminal.print_page` prints it; these two show
the verdict, the findings and the sections that are `brief`. Any text may have `code` in backticks.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

from ..base import OutputFile
from ..core import ABSENT
from .panels import BAD, BAND, COLOURS, DASHES, GRID, INK, PALE
from .result import LEVELS, Mark, Result, gathered

_TEMPLATES = Path(__file__).parent / "templates"
_ROOM = 88  # of a table on a recording's first page [characters], and between two columns
_GAP = 1
_FLAG = re.compile(r"(?<![\w-])--\w[\w-]*")
_EMPTY: set[object] = {"", ABSENT}

DARK = (
    "#4fb3dc",
    "#ff8f5e",
    "#a791ff",
    "#69c77c",
    "#ff7aa8",
    "#d9b949",
    "#5fd3e3",
    "#d191e6",
    "#9fb3c3",
    "#cf9a6b",
)
"""Colours of curves on a dark page, in the order of `COLOURS`."""

VARIABLES = {INK: "--ink", GRID: "--grid", BAD: "--bad"} | {
    colour: f"--c{k}" for k, colour in enumerate(COLOURS)
}
"""CSS variable of each colour, which a page redefines on dark screens."""

_DISK = "M-2.6 0A2.6 2.6 0 1 0 2.6 0A2.6 2.6 0 1 0 -2.6 0Z"
MARKS = {
    "o": _DISK,
    "D": "M0 -3.2L3.2 0L0 3.2L-3.2 0Z",
    "x": "M-2.4 -2.4L2.4 2.4M-2.4 2.4L2.4 -2.4",
    "|": "M0 -4.5V4.5",
    "_": "M-4.5 0H4.5",
    "●": _DISK,
    "·": "M-1.3 0A1.3 1.3 0 1 0 1.3 0A1.3 1.3 0 1 0 -1.3 0Z",
    "◆": "M0 -3.2L3.2 0L0 3.2L-3.2 0Z",
    "■": "M-2.4 -2.4H2.4V2.4H-2.4Z",
    "▲": "M0 -3L3 2.4H-3Z",
    "▼": "M0 3L3 -2.4H-3Z",
    "◀": "M-3 0L2.4 -3V3Z",
    "▶": "M3 0L-2.4 -3V3Z",
    "✚": "M-1 -3H1V-1H3V1H1V3H-1V1H-3V-1H-1Z",
    "★": "M0 -3.8L1 -1.2L3.6 -1.2L1.5 .5L2.3 3.2L0 1.6L-2.3 3.2L-1.5 .5L-3.6 -1.2L-1 -1.2Z",
    "⬢": "M0 -3.2L2.8 -1.6V1.6L0 3.2L-2.8 1.6V-1.6Z",
}
"""Paths of marks around a point, by a letter or a sign that looks like them [points]."""

FILLED = set(list(MARKS)[5:])
"""Marks that are drawn filled."""


class Link(NamedTuple):
    """What a page adds to a cell, and the terminal omits; a link if there is a row of id `to`."""

    text: str
    to: str = ""


Cell = str | Mark | Link | tuple[str | Mark | Link, ...]
"""A cell of a table; a `Mark` becomes a badge."""


@dataclass(frozen=True)
class Text:
    """A paragraph; a `note` is small, and for the page only; a `head` is the title of the next."""

    words: str
    note: bool = False
    head: bool = False


@dataclass(frozen=True)
class Items:
    """A list; an entry is a text, or a pair of its subject and the rest."""

    entries: Sequence[str | tuple[str, str]]
    ordered: bool = False


@dataclass(frozen=True)
class Badges:
    """Counts side by side, such as how many parameters are identified."""

    marks: Sequence[Mark]


@dataclass(frozen=True)
class Table:
    """A table."""

    heads: Sequence[str]  # titles of the columns; the first names the table on the terminal
    # cells; a line of one cell is the title of those below it
    lines: Sequence[Sequence[Cell]]
    text: Sequence[int] = (0,)  # indices of the columns that are not numbers
    ids: str = ""  # prefix of the lines' ids, the targets of `Link`; empty for none
    # indices of the columns that a narrow terminal folds into a line below each row, in this order
    spare: Sequence[int] = ()
    most: int = 40  # number of lines on the terminal; the others are counted

    def without_empty_columns(self) -> Table:
        """The table without the columns that have no entry in any line."""
        kept = [k for k, cells in enumerate(zip(*self.lines, strict=True)) if {*cells} - _EMPTY]
        at = {k: place for place, k in enumerate(kept)}
        return replace(
            self,
            heads=[self.heads[k] for k in kept],
            lines=[[line[k] for k in kept] for line in self.lines],
            text=[at[k] for k in self.text if k in at],
            spare=[at[k] for k in self.spare if k in at],
        )

    def columns_within(self, room: float, widths: Sequence[int]) -> list[int]:
        """Indices of the columns that stand side by side: all, or as many as there is room for.

        The `spare` ones are left out first, then those on the right.

        Args:
            room: width of the table [characters].
            widths: of the columns, with the space between two [characters].
        """
        shown = list(range(len(widths)))
        order = [*self.spare, *(k for k in reversed(shown) if k not in self.spare and k)]
        while order and sum(widths[k] for k in shown) > room:
            shown.remove(order.pop(0))
        return shown


@dataclass(frozen=True)
class Figure:
    """A drawing with its title and legend."""

    title: str  # above the drawing
    drawing: str  # an SVG element of `svg.drawing`, or an image
    # (name, colour, sign) of each entry; a sign is a line's dash pattern, one of `MARKS` or both,
    # as "--●"; `BAND` is a shaded area
    legend: Sequence[tuple[str, str, str]] = ()
    wide: bool = False  # whether it takes the whole width of the page


@dataclass(frozen=True)
class Figures:
    """Figures side by side; those beyond `most` are folded, under a title with their `kind`."""

    figures: Sequence[Figure]
    kind: str = "plots"
    most: int = 8


@dataclass(frozen=True)
class Fold:
    """Panels that are folded on a screen, and open on paper."""

    title: str  # that opens and closes them
    panels: Sequence[PageItem]  # what is folded
    counts: Sequence[Mark] = ()  # marks beside the title
    small: str = ""  # words beside the title
    open: bool = False  # whether they are open at first


PageItem = Text | Items | Badges | Table | Figures | Fold


@dataclass(frozen=True)
class Section:
    """Panels below a title; without a title they form a separate card."""

    title: str  # above the panels
    panels: Sequence[PageItem]  # from top to bottom
    beside: Figure | None = None  # on their right where the page is wide
    brief: bool = False  # whether the terminal and recordings show them, too, without drawings


@dataclass(frozen=True)
class Page:
    """The results of a command."""

    heading: str  # the robot, or the name of the study
    result: Result  # has the verdict, and the findings that qualify it
    eyebrow: str = ""  # the command that made the page
    lead: str = ""  # one line below the heading
    tab: str = ""  # title of the browser's tab; the heading if empty
    carrying: Sequence[Figure] = ()  # figures, the first of which supports the verdict
    sections: Sequence[Section] = ()  # in order
    commands: Sequence[str] = ()  # command lines or code that reproduce the results, one block each
    notes: Sequence[str] = ()  # paragraphs below the commands
    # by name, of this package and of those that affect its results
    versions: dict[str, str] = field(default_factory=dict)
    # whether the terminal shows all findings with their codes, and notes below the sections
    detailed: bool = False
    FILE: ClassVar = "report.html"

    def write_html(self, folder: Path, name: str = FILE) -> Path:
        """Writes the page atomically into a folder and returns its path."""
        path = folder / name
        OutputFile(path).write_text(render_html(self))
        return path

    def markdown(self) -> str:
        """The verdict and findings, and texts, lists and tables of its brief sections."""
        mark = self.result.mark
        lines = [f"## {plain(self.heading)}", ""] if self.heading else []
        lines += [f"**{plain(mark.text)}**", ""] if mark else []
        lines += [plain(self.lead), ""] if self.lead else []
        said = list[str]()
        notes = list[str]()
        for finding in gathered(self.result.findings):
            where = f"**{plain(finding.where)}**: " if finding.where else ""
            line = f"- {where}{plain(f'{finding.text}. {finding.remedy}')}"
            (notes if finding.level == "note" else said).append(line)
        lines += said
        for section in self.sections:
            if section.brief and (shown := in_brief(section.panels)):
                lines += ["", *([f"### {plain(section.title)}", ""] if section.title else [])]
                lines += item_lines([_narrow(p) if isinstance(p, Table) else p for p in shown])
        lines += ["", "### Notes", "", *notes] if notes else []
        return "\n".join(lines) + "\n"


def count(number: int, singular: str, plural: str = "") -> str:
    """A number with its noun: 1 seed, 2 seeds, 0 seeds."""
    return f"{number} {singular if number == 1 else plural or singular + 's'}"


def render_html(page: Page) -> str:
    """The page as one self-contained HTML file; the only script that may run is our own."""
    return _environment().get_template("page.html").render(page=page)


def shared_legend(figures: Sequence[Figure]) -> Sequence[tuple[str, str, str]]:
    """The legend of several figures, each of which has all or part of it; empty if there is none.

    It stands above them once, and switches a curve of all of them.
    """
    legends = [figure.legend for figure in figures]
    longest = max(legends, key=len, default=())
    inside = all(legend and set(legend) <= set(longest) for legend in legends)
    return longest if len(legends) > 1 and inside else ()


@cache
def _environment() -> Any:
    import jinja2  # imported late: needed only after a run
    from markupsafe import Markup, escape

    def unbroken(value: Any) -> Any:
        return value.replace(" %", "\N{NO-BREAK SPACE}%") if type(value) is str else value

    def spoken(text: object) -> Markup:
        parts = [whole_flags(escape(part)) for part in unbroken(str(text)).split("`")]
        code = Markup("<code>{}</code>")
        return Markup("").join(code.format(p) if k % 2 else p for k, p in enumerate(parts))

    def whole_flags(escaped: Markup) -> Markup:
        """Text in which no line ends within a flag such as --load."""
        return Markup(_FLAG.sub(r'<span class="flag">\g<0></span>', str(escaped)))

    def kind(value: object) -> str:
        return type(value).__name__

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=unbroken,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    script = (_TEMPLATES / "plots.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    environment.filters.update(
        spoken=spoken, kind=kind, plain=Markup, gathered=gathered, parts_of=parts_of
    )
    environment.globals.update(
        light=COLOURS,
        dark=DARK,
        variables=VARIABLES,
        band=BAND,
        pale=PALE,
        marks=MARKS,
        filled=FILLED,
        script=Markup(script),
        digest=digest,
        levels=LEVELS,
        shared_legend=shared_legend,
    )
    return environment


def parts_of(sign: str) -> tuple[str, str]:
    """The SVG dash pattern of a legend's sign, and its mark; either may be empty."""
    line = max((dash for dash in DASHES if sign.startswith(dash)), key=len, default="")
    return DASHES.get(line, ""), sign.removeprefix(line)


def in_brief(panels: Sequence[PageItem]) -> list[PageItem]:
    """What terminal and recording show of a brief section: no notes, drawings or folded panels."""
    shown = (panel for panel in panels if not isinstance(panel, Figures | Fold))
    return [panel for panel in shown if not (isinstance(panel, Text) and panel.note)]


def item_lines(some: Sequence[PageItem]) -> list[str]:
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
            lines += [f"#### {plain(panel.title)}", "", *item_lines(panel.panels)]
    return lines


def _narrow(table: Table) -> Table:
    """A table as wide as a recording's first page has room for; the report has all of it."""
    cells = [[_cell(cell, links=False) for cell in line] for line in table.lines]
    rows = [list(table.heads), *(line for line in cells if len(line) > 1)]
    widths = [max(map(len, column)) + _GAP for column in zip(*rows, strict=True)]
    kept = table.columns_within(_ROOM, widths)
    return replace(
        table,
        heads=[table.heads[k] for k in kept],
        lines=[[line[k] for k in kept] if len(line) > 1 else line for line in cells],
    )


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(map(plain, cells))} |"


def _cell(cell: Cell, links: bool = True) -> str:
    if isinstance(cell, Link):
        return cell.text if links else ""
    if isinstance(cell, Mark):
        return cell.text
    if isinstance(cell, tuple):
        return " ".join(filter(None, (_cell(part, links) for part in cell)))
    return str(cell)


def plain(text: str) -> str:
    """Text without the characters that Markdown interprets."""
    for mark in "\\`*_{}[]<>#|":
        text = text.replace(mark, f"\\{mark}")
    return " ".join(text.split())
