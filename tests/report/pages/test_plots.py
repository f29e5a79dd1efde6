"""Plots: curves are where the axes say, and several drawings can share a page."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
import pytest

from nsaid_mj.report.drawings import draw, over_time
from nsaid_mj.report.page import MARKS, VARIABLES, Page, render_html
from nsaid_mj.report.panels import COLOURS, DASHES, POINTS, Comparison, Forest, Panel, Points
from nsaid_mj.report.result import Result
from nsaid_mj.report.svg import Axes, Side, number
from tests.report.pages.drawing import points_of, words_of
from tests.report.pages.markup import data_of


def panel(*curves: Sequence[float] | np.ndarray, logarithmic: bool = False) -> Panel:
    """Values of curves over the times 0, 1, 2 …"""
    made = Panel("what", "y [m]", logarithmic)
    for k, values in enumerate(curves):
        made.add(np.arange(float(len(values))), np.array(values, float), f"curve {k}")
    return made


def ticks(drawing: ElementTree.Element, across: bool) -> dict[float, float]:
    """Number to place of the ticks of one axis."""
    found = {}
    for text in drawing.iter("text"):
        middle = "text-anchor: middle" in str(text.get("style"))
        numeric = re.fullmatch(r"[-−\d.]+", str(text.text))
        if numeric and middle == across:
            found[float(str(text.text).replace("−", "-"))] = float(
                str(text.get("x" if across else "y"))
            )
    return found


@pytest.mark.parametrize("low,high", [(0.11, 0.142), (0.4, 90.0), (1e3, 1.3e3)])
@pytest.mark.parametrize("logarithmic", [False, True])
def test_a_curve_lies_where_its_axes_say(low, high, logarithmic):
    values = np.geomspace(low, high, 40)
    drawing = ElementTree.fromstring(over_time(panel(values, logarithmic=logarithmic)))
    points = points_of(drawing, COLOURS[0])
    scale = np.log10 if logarithmic else np.asarray
    for across, column, wanted in ((True, 0, np.arange(40.0)), (False, 1, scale(values))):
        marks = ticks(drawing, across)
        positions = np.array(list(marks)) if across else scale(np.array(list(marks)))
        assert len(marks) >= 3
        slope, start = np.polyfit(positions, list(marks.values()), 1)
        off = 0 if across else points[0, 1] - (slope * wanted[0] + start)  # text below its line
        assert abs(off) < 5
        ends = slope * wanted[[0, -1]] + start + off
        np.testing.assert_allclose(points[[0, -1], column], ends, atol=0.2)


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize(
    "low,high", [(1e-300, 2e-300), (0.03, 0.2), (1e-12, 1e12), (999.9999, 1000.0001), (1e7, 3e7)]
)
def test_ticks_of_any_range_are_several_lie_inside_and_have_texts_of_their_own(
    low: float, high: float, logarithmic: bool
) -> None:
    for most in (3, 6):
        ticks = Side((low, high), log=logarithmic, most=most).ticks
        assert 2 <= len(ticks) <= most + 2
        assert len({text for _, text in ticks}) == len(ticks)
        slack = 1e-8 * (high - low)
        assert all(low - slack <= at <= high + slack for at, _ in ticks)


def test_curves_of_one_panel_share_its_axes():
    drawing = ElementTree.fromstring(over_time(panel([0, 1, 2], [1, 2, 4])))
    one, other = (points_of(drawing, colour) for colour in COLOURS[:2])
    assert one[0, 1] > one[-1, 1] > other[-1, 1]
    assert one[-1, 0] == other[-1, 0]


@pytest.mark.parametrize("bad,logarithmic", [(np.nan, False), (np.inf, False), (0.0, True)])
def test_a_value_that_cannot_be_drawn_interrupts_its_curve(bad, logarithmic):
    drawing = ElementTree.fromstring(
        over_time(panel([1, 2.5, bad, 3, 4.7, 5], logarithmic=logarithmic))
    )
    (path,) = (p for p in drawing.iter("path") if VARIABLES[COLOURS[0]] in str(p.get("style")))
    assert str(path.get("d")).count("M") == 2


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize(
    "values", [[], [1.0], [np.nan, np.nan], [0.0, 0.0], [2.0, 2.0], [-1.0, -2.0], [1e-300, 1e300]]
)
def test_few_equal_or_extreme_values_are_drawn_without_a_warning(values, logarithmic):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        text = over_time(panel(values, logarithmic=logarithmic))
    assert "nan" not in text
    assert "inf" not in text
    assert {"t [s]", "y [m]"} <= words_of(text)


@pytest.mark.parametrize("t", [0.0, -3.0, 1e12, 1e18, -1e200])
def test_one_sample_is_drawn_whenever_it_was_measured(t: float) -> None:
    """At 1e18 s a second more is the same number."""
    made = Panel("what", "y [m]")
    made.add(np.array([t]), np.array([1.0]), "curve")
    assert {"t [s]", "y [m]"} <= words_of(over_time(made))


def test_of_a_long_curve_about_1500_points_are_drawn_with_its_ends_and_its_peak():
    values = np.sin(np.arange(40_000) / 3e3)
    values[12_345] = 9.0
    points = points_of(ElementTree.fromstring(over_time(panel(values))), COLOURS[0])
    assert len(points) <= POINTS + 4
    whole = points_of(ElementTree.fromstring(over_time(panel([values[0], 9.0, -1.0]))), COLOURS[0])
    assert points[:, 1].min() == whole[1, 1]
    assert points[0, 0] == whole[0, 0] and points[-1, 0] == whole[-1, 0]


def test_the_same_data_give_the_same_bytes_in_every_process():
    code = (
        "from nsaid_mj.report import Axes, Side\n"
        "axes = Axes.alone(Side((0.0, 2.0), 'x'), Side((0.0, 1.0)))\n"
        "axes.line([0, 1, 2], [0.1, 0.7, 1.0], '#0b6e99', 'curve')\n"
        "print(axes.figure('title').drawing)"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
        ).stdout
        for _ in range(2)
    }
    assert len(found) == 1 and "<svg" in found.pop()


def test_ids_of_several_drawings_do_not_collide_and_all_references_are_met():
    first, second = panel([0, 1, 2]), panel([0, 1, 2])
    second.title = "another"
    drawn = [over_time(first), over_time(second), over_time(panel([0, 1, 2], logarithmic=True))]
    ids = [set(re.findall(r' id="([^"]*)"', text)) for text in drawn]
    assert all(ids)
    assert len(set.union(*ids)) == sum(map(len, ids))
    for text, own in zip(drawn, ids, strict=True):
        assert {*re.findall(r"url\(#([^)]*)\)", text), *re.findall(r'href="#([^"]*)"', text)} == own
        assert text.count(' id="') == len(own)


def test_text_in_drawings_is_escaped():
    evil = '$x$ <script>alert(1)</script> & --> id="a" url(#b) d="1.2345"'
    axes = Axes.alone(Side((0.0, 1.0), evil, names=[evil, "b"]), Side((0.0, 1.0), evil))
    axes.line([0, 1], [0, 1], COLOURS[0], evil)
    axes.text(evil, 0.5, 0.5)
    text = axes.figure('<b>"title"').drawing
    assert "<script" not in text
    assert "<b>" not in text
    assert evil in words_of(text)
    assert ElementTree.fromstring(text).get("aria-label") == '<b>"title"'


def test_a_drawing_refers_to_nothing_outside():
    text = over_time(panel([0, 1, 2]))
    assert not re.findall(r"https?:|xmlns|@import|<style|<!--|creator|matplotlib", text)


def test_no_line_ends_within_a_flag_and_code_stays_escaped() -> None:
    told = Result(explains="yes", verdict="Give `--known m=1 <kg>` or --load; a--b")
    page = render_html(Page("r", told))
    assert '<code><span class="flag">--known</span> m=1 &lt;kg&gt;</code>' in page
    assert 'or <span class="flag">--load</span>; a--b' in page


def test_a_legend_shows_the_mark_and_the_dash_of_a_curve() -> None:
    axes = Axes.alone(Side((0.0, 3.0)), Side((0.0, 3.0)))
    axes.marks([1], [2], COLOURS[0], "one point", "⬢")
    axes.line([1, 2], [2, 3], COLOURS[0], "line with crosses", dash="--")
    axes.marks([1, 2], [2, 3], COLOURS[0], "line with crosses", "x")
    axes.line([1, 2], [2, 3], COLOURS[0], "line", dash=":")
    legend = [("one point", "⬢"), ("line with crosses", "--x"), ("line", ":"), ("dots", "-.●")]
    drawn = axes.figure("title", [(name, COLOURS[0], sign) for name, sign in legend])
    page = render_html(Page("r", Result(), carrying=[drawn]))
    one, crosses, line, dots = re.findall(r"<li>(.*?)</li>", page)
    assert MARKS["⬢"] in one and "M0 4H24" not in one
    assert MARKS["x"] in crosses and f'stroke-dasharray="{DASHES["--"]}"' in crosses
    assert "scale" not in line and f'stroke-dasharray="{DASHES[":"]}"' in line
    assert MARKS["●"] in dots and f'stroke-dasharray="{DASHES["-."]}"' in dots
    marked = {*re.findall(r'<path id="[^"]*" d="([^"]*)"', drawn.drawing)}
    assert marked == {MARKS["⬢"], MARKS["x"]}


def test_lines_beyond_the_palette_differ_by_dashes_and_are_in_the_legend():
    many = panel(*([k, k + 1] for k in range(len(COLOURS) + 2)))
    assert len({(c.colour, c.dash) for c in many.curves}) == len(many.curves)
    assert many.legend == [(c.name, c.colour, c.dash) for c in many.curves]
    assert not panel([1, 2]).legend  # its title says what it is


@pytest.mark.parametrize(
    "value,plain,power",
    [
        (0.02, "0.02", "2·10⁻²"),
        (300, "300", "3·10²"),
        (1e-5, "10⁻⁵", "10⁻⁵"),
        (0, "0", "0"),
        (2e4, "2·10⁴", "2·10⁴"),
        (1, "1", "10⁰"),
        (1.5e-7, "1.5·10⁻⁷", "1.5·10⁻⁷"),
    ],
)
def test_tick_numbers_are_written_plainly_or_as_powers_of_ten(value, plain, power):
    assert number(value) == plain
    assert number(value, plain=False) == power


def test_a_drawing_tells_its_curves_to_the_page_where_they_are_drawn():
    values = np.array([0.5, np.nan, 3.0, 40.0])
    for logarithmic in (False, True):
        text = over_time(panel(values, 2 * values, logarithmic=logarithmic))
        (axes,) = data_of(text)
        assert [curve["name"] for curve in axes["curves"]] == ["curve 0", "curve 1"]
        assert axes["curves"][1]["y"] == [1.0, None, 6.0, 80.0]
        assert axes["xs"] == [[0.0, 1.0, 2.0, 3.0]]  # once for both
        assert axes["x"]["label"] == "t [s]" and axes["y"]["label"] == "y [m]"
        left, top, right, bottom = axes["box"]
        scale = np.log10 if logarithmic else np.asarray
        low, high = scale(axes["y"]["ends"])
        points = points_of(ElementTree.fromstring(text), COLOURS[0])
        shown = values[np.isfinite(values)]
        place = bottom - (scale(shown) - low) / (high - low) * (bottom - top)
        np.testing.assert_allclose(points[[0, -2, -1], 1], place, atol=0.05)
        np.testing.assert_allclose(points[[0, -1], 0], [left, right], atol=0.05)


def test_every_entry_of_a_legend_switches_what_is_drawn_of_it():
    t = np.linspace(0, 3, 50)
    bands = Panel("what", "y [m]")
    for k in range(2):
        bands.add(t, np.sin(t + k), f"gain <{k}>", (np.sin(t + k) - 0.1, np.sin(t + k) + 0.1))
    ones, named = np.ones(3), ["a", "b", "c"]
    forest = Forest(
        "",
        "k [N]",
        named,
        ones,
        ones / 2,
        2 * ones,
        np.array([True, True, False]),
        [Points("before", 3 * ones)],
    )
    compared = Comparison("", "u", "A", t, np.sin(t), np.cos(t), np.full(50, 0.1), t > 1)
    for made in (bands, forest, compared):
        drawn = ElementTree.fromstring(draw(made))
        names = {element.get("data-curve") for element in drawn.iter()}
        shaded = {"not used"}  # rows that are left out are no curve
        assert {name for name, *_ in made.legend} - shaded <= names
