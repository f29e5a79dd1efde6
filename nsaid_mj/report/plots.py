"""matplotlib plots in one style: SVG with colours defined by the page, and PNG.

Figures are created without pyplot, so they share no state. Equal data give equal bytes: no date, no
random ids, no settings from a user's matplotlibrc.
"""

import hashlib
import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Rectangle
from matplotlib.path import Path as Outline
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullLocator

from ..base import OutputFile
from .page import VARIABLES
from .page import Figure as PageFigure
from .panels import COLOURS, DASHES, GRID, INK, Panel, thin
from .svg import HUGE, number, numbers

CURVE = "curve:"
NAMES = "names"
"""Prefix of the gid of a curve's artists, before its name; gid of an axis of names."""

WIDTH = 4.3  # of a panel on a page, and of a wide one [inch]
WIDE = 6.2
_HEIGHT = 2.6
_DPI = 110  # of a PNG
_MAKER = "nsaid-mj"  # in a PNG file, by which `OutputFile` knows it
_LONG = 28  # characters of a category's label, at most
_STYLE: dict[str, Any] = {
    "font.size": 8,
    "axes.titlesize": 9,
    **{f"{of}size": 8 for of in ("axes.label", "legend.font", "xtick.label", "ytick.label")},
    **{f"{of}color": INK for of in ("text.", "axes.label", "axes.edge", "xtick.", "ytick.")},
    **{f"{of}width": 0.6 for of in ("axes.line", "grid.line", "xtick.major.", "ytick.major.")},
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "lines.linewidth": 1.2,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    **{f"boxplot.{of}props.color": INK for of in ("box", "whisker", "cap")},
    **{f"boxplot.{of}props.linewidth": 0.8 for of in ("box", "whisker", "cap")},
    "text.parse_math": False,  # a `$` in a name is a dollar
    "axes.formatter.useoffset": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "nsaid",
}


@contextmanager
def style() -> Iterator[None]:
    """Applies our settings over matplotlib's defaults and ignores the user's matplotlibrc."""
    default = matplotlib.rcParamsDefault.items()
    settings: Any = {key: value for key, value in default if not key.startswith("backend")}
    with matplotlib.rc_context(settings | _STYLE):
        yield


def curves(panel: Panel, axis: Axes) -> None:
    """Draws a panel's curves into axes."""
    if panel.level is not None:
        axis.axhline(panel.level, color=INK, linewidth=0.6, linestyle="--")
    for t in panel.events:
        axis.axvline(t, color=COLOURS[8], linestyle=":")
    for curve in panel.curves:
        rows = thin(len(curve.t))
        t = curve.t[rows]
        if curve.low is not None and curve.high is not None:
            low, high = (np.clip(end[rows], -HUGE, HUGE) for end in (curve.low, curve.high))
            axis.fill_between(t, low, high, color=curve.colour, alpha=0.2, linewidth=0)
        style = {"color": curve.colour, "label": curve.name or None}
        line(axis, t, curve.values[rows], curve.name, curve.dash, **style)
    axis.margins(x=0.0)
    axis.set_xlabel("t [s]")
    axis.set_ylabel(panel.label)
    if panel.logarithmic:
        logarithmic(axis)


def line(axis: Axes, x: Any, y: Any, name: str, dash: str = "-", **style: Any) -> None:
    """Draws a curve with its name, by which the page finds its values; huge ones are left out."""
    y = np.asarray(y, float)
    shown = np.where(np.abs(y) < HUGE, y, np.nan)
    axis.plot(x, shown, dash, gid=CURVE + name, **style)


def page_figure(title: str, draw: Callable[[Axes], None], wide: bool = False) -> PageFigure:
    """A figure of a page, drawn by a function of its axes; its legend has all labelled curves.

    Args:
        title: above the panel.
        draw: draws the panel.
        wide: whether the panel takes the whole width of the page.
    """
    with style():
        size = (WIDE if wide else WIDTH, _HEIGHT)
        figure = Figure(figsize=size, layout="constrained")
        axis = figure.add_subplot()
        draw(axis)
        legend = []
        for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
            first = handle[0] if isinstance(handle, tuple) else handle  # a bar, or a curve
            bar = isinstance(first, Rectangle)
            colour = to_hex(first.get_facecolor() if bar else first.get_color())
            legend.append((label, colour, _sign(first) if isinstance(first, Line2D) else "-"))
        return PageFigure(title, svg(figure, title), legend, wide)


def _sign(curve: Line2D) -> str:
    """What stands for a curve in a legend: its dash pattern, or an SVG path with its marker."""
    marker = curve.get_marker()
    if marker in {"", " ", "None", None}:
        return str(curve.get_linestyle())
    style = MarkerStyle(marker)
    shape = style.get_path().transformed(style.get_transform())
    # a legend's box is 24 × 8
    drawn = "M0 4H24" if curve.get_linestyle() in DASHES and np.size(curve.get_xdata()) > 1 else ""
    for points, code in shape.iter_segments(curves=False):
        if code == Outline.CLOSEPOLY:
            drawn += "Z"
            continue
        word = "M" if code == Outline.MOVETO else "L"
        drawn += f"{word}{12 + 7 * points[0]:.2f} {4 - 7 * points[1]:.2f}"
    return drawn


def categories(axis: Axes, labels: Sequence[str], name: str) -> None:
    """Labels columns 0, 1, 2 …; the labels are rotated if they are many or long."""
    short = [label if len(label) <= _LONG else label[: _LONG - 1] + "…" for label in labels]
    longest = max((len(part) for label in short for part in label.split("\n")), default=0)
    axis.set_xticks(range(len(short)), short, rotation=90 if longest * len(short) > 60 else 0)
    axis.set_xlim(-0.6, len(short) - 0.4)
    axis.set_xlabel(name)
    axis.xaxis.set_gid(NAMES)


def logarithmic(axis: Any, which: str = "y", most: int = 8) -> None:
    """Makes an axis logarithmic, with at most `most` ticks at round numbers over any range.

    An axis without any value > 0 stays linear. Call this after everything is drawn.
    """
    ruler = axis.xaxis if which == "x" else axis.yaxis
    shown = [line.get_xdata() if which == "x" else line.get_ydata() for line in axis.get_lines()]
    values = np.concatenate([np.asarray(data, float) for data in shown] or [np.zeros(0)])
    if not np.any(np.isfinite(values) & (values > 0)):
        return
    (axis.set_xscale if which == "x" else axis.set_yscale)("log", nonpositive="mask")
    low, high = sorted(axis.get_xlim() if which == "x" else axis.get_ylim())
    decades = np.log10(high / low)
    if decades > (2 if most > 4 else 1.2):
        ruler.set_major_locator(LogLocator(numticks=most))
    elif decades > 0.8 and most > 4:
        ruler.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=most))
    else:
        ticks = MaxNLocator(min(6, most - 1), steps=[1, 2, 5, 10]).tick_values(low, high)
        ruler.set_major_locator(FixedLocator(ticks))
    (axis.set_xlim if which == "x" else axis.set_ylim)(low, high)
    ruler.set_minor_locator(NullLocator())
    plain = decades <= 2 or (low >= 1e-3 and high < 1e4)
    ruler.set_major_formatter(FuncFormatter(lambda value, _: number(value, plain)))


# -- files -------------------------------------------------------------------------------------


def svg(figure: Figure, title: str) -> str:
    """Renders a figure as an SVG element for an HTML page with other drawings.

    Ids that are referenced are prefixed with a hash of the drawing, so that they are unique on the
    page; all others are removed. Colours in `page.VARIABLES` become CSS variables. The curves'
    values are in the element's metadata, from where the page's script reads them.

    Args:
        figure: the figure; text stays text.
        title: for screen readers.
    """
    stream = io.StringIO()
    with style():
        figure.savefig(stream, format="svg", transparent=True, metadata=_NO_METADATA)
    text = stream.getvalue()
    prefix = f"p{hashlib.sha256((title + text).encode()).hexdigest()[:10]}-"
    drawing = ElementTree.fromstring(text)
    for parent in list(drawing.iter()):
        for child in list(parent):
            if _local(child.tag) in {"metadata", "style"}:  # replaced by the page's style
                parent.remove(child)
    used = set(re.findall(r'url\(#([^)]*)\)|:href="#([^"]*)"', text))
    used = {one or other for one, other in used}
    for element in drawing.iter():
        element.tag = _local(element.tag)
        attributes = {_local(name): value for name, value in element.attrib.items()}
        name = attributes.pop("id", "")
        if name in used:
            attributes["id"] = prefix + name
        attributes |= _data_of(name)
        if "href" in attributes:
            attributes["href"] = f"#{prefix}{attributes['href'][1:]}"
        if "clip-path" in attributes:
            attributes["clip-path"] = attributes["clip-path"].replace("#", f"#{prefix}")
        if "d" in attributes:
            attributes["d"] = " ".join(re.sub(r"(\.\d\d)\d+", r"\1", attributes["d"]).split())
        if "style" in attributes:
            text = _FONT.sub(r"\1 system-ui, sans-serif", attributes["style"])
            attributes["style"] = _COLOUR.sub(lambda m: f"var({VARIABLES[m[0]]}, {m[0]})", text)
        element.attrib.clear()
        element.attrib.update(attributes)
    view = drawing.attrib["viewBox"]
    drawing.attrib.clear()
    size = f"--size: {float(view.split()[2]):.0f}px"  # at which its text is readable
    drawing.attrib.update(viewBox=view, role="img", style=size)
    drawing.set("aria-label", title)
    data = ElementTree.SubElement(drawing, "metadata")
    data.text = json.dumps(_curves(figure), separators=(",", ":"), ensure_ascii=False)
    return ElementTree.tostring(drawing, encoding="unicode")


def _data_of(name: str) -> dict[str, str]:
    """Attributes by which the page's script finds axes, ticks and curves, from matplotlib's ids."""
    kind, _, number = name.rpartition("_")
    if name.startswith(CURVE):
        return {"data-curve": name.removeprefix(CURVE)}
    if kind == "axes":
        return {"data-axes": str(int(number) - 1)}
    return {"data-tick": kind[0]} if kind in {"xtick", "ytick"} else {}


def _curves(figure: Figure) -> list[dict[str, Any]]:
    """Place, axes and named curves of every pair of axes, as the page's script reads them."""
    width, height = (72 * size for size in figure.get_size_inches())
    below = next((axis.get_xlabel() for axis in figure.axes if axis.get_xlabel()), "")
    found = []
    for axis in figure.axes:
        at = axis.get_position()
        tables = []
        curves = []
        for drawn in axis.get_lines():
            name = drawn.get_gid() or ""
            x, y = (numbers(side) for side in drawn.get_data())
            if not name.startswith(CURVE) or not len(x):
                continue
            if x not in tables:
                tables.append(x)
            curves.append({"name": name.removeprefix(CURVE), "x": tables.index(x), "y": y})
        named = axis.yaxis.get_gid() == NAMES
        found.append(
            {
                "box": [
                    round(float(end), 2)
                    for end in (
                        at.x0 * width,
                        (1 - at.y1) * height,
                        at.x1 * width,
                        (1 - at.y0) * height,
                    )
                ],
                "x": _side(axis.get_xlim(), axis.get_xscale(), below)
                | {"names": axis.xaxis.get_gid() == NAMES},
                "y": _side(axis.get_ylim(), axis.get_yscale(), axis.get_ylabel()),
                "names": [tick.get_text() for tick in axis.get_yticklabels()] if named else None,
                "cursor": below.startswith("t ["),
                "xs": tables,
                "curves": curves,
            }
        )
    return found


def _side(ends: tuple[float, float], scale: str, label: str) -> dict[str, Any]:
    return {"ends": [float(end) for end in ends], "log": scale == "log", "label": label}


_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))
_COLOUR = re.compile("|".join(VARIABLES))
_FONT = re.compile(r"(font: [\d.]+px|font-family:) [^;]*")


def _local(name: str) -> str:
    """A tag's or attribute's name without its namespace, as HTML requires."""
    return name.rpartition("}")[2]


def png_of(
    lines: Sequence[Mapping[str, Callable[[Axes], None]]],
    size: tuple[float, float],
    path: Path,
    names: Sequence[str] = (),
) -> Path:
    """Writes a grid of panels as PNG, atomically, each drawn by a function of its axes.

    They have one legend.

    Args:
        lines: drawing functions by title, from top to bottom; all lines have the same titles.
        size: size of the whole picture [inch].
        path: path of the file; it is returned.
        names: names of the lines, on their left; empty for none.
    """
    with OutputFile(path).atomically() as partial, style():
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(len(lines), len(lines[0]), squeeze=False)
        handles: dict[str, Any] = {}
        for row, line in zip(axes, lines, strict=True):
            for axis, draw in zip(row, line.values(), strict=True):
                draw(axis)
                for handle, label in zip(*axis.get_legend_handles_labels(), strict=True):
                    handles.setdefault(label, handle)
        for axis, title in zip(axes[0], lines[0], strict=True):
            axis.set_title(title)
        for row, name in zip(axes, names, strict=False):
            row[0].set_ylabel(name)
        if handles:
            figure.legend(handles.values(), handles.keys(), loc="outside right center")
        figure.savefig(partial, format="png", dpi=_DPI, metadata={"Software": _MAKER})
    return path
