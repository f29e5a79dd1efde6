"""Charts as SVG: what is drawn where, and what the axes say."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from nsaid_mj.reporting.charts import Chart, svg

SVG = "{http://www.w3.org/2000/svg}"


def drawn(*charts: Chart) -> ElementTree.Element:
    return ElementTree.fromstring(svg(charts))


def curve(chart: ElementTree.Element, colour: str) -> list[np.ndarray]:
    """The pieces (N, 2) of the curve of a colour."""
    (path,) = (p for p in chart.iter(f"{SVG}path") if p.get("stroke") == colour)
    pieces = str(path.get("d")).split("M")[1:]
    return [np.array([point.split() for point in piece.split("L")], float) for piece in pieces]


def ticks(chart: ElementTree.Element, anchor: str) -> dict[float, float]:
    """Number to place, of the axis of the values (end) or of time (middle)."""
    across = anchor == "middle"
    found = {}
    for text in chart.iter(f"{SVG}text"):
        told = str(text.text)
        if text.get("text-anchor") == anchor and re.fullmatch(r"-?[\d.]+(e[+-]?\d+)?", told):
            found[float(told)] = float(str(text.get("x" if across else "y")))
    return found


@pytest.mark.parametrize("low,high", [(1e-8, 3.0), (0.11, 0.142), (0.4, 90.0), (1e3, 1.3e3)])
@pytest.mark.parametrize("logarithmic", [False, True])
def test_a_curve_is_where_its_axes_say(low, high, logarithmic):
    t, values = np.linspace(2, 7, 40), np.geomspace(low, high, 40)
    chart = Chart("y", logarithmic=logarithmic)
    chart.add(t, values, "#123456")
    whole = drawn(chart)
    (points,) = curve(whole, "#123456")
    across, up = ticks(whole, "middle"), ticks(whole, "end")
    assert 3 <= len(across) <= 8 and 2 <= len(up) <= 9
    scale = np.log10 if logarithmic else np.asarray
    times = np.polyval(np.polyfit(list(across.values()), list(across), 1), points[:, 0])
    np.testing.assert_allclose(times, t, atol=0.01)
    places = np.array([y - 4 for y in up.values()])  # text stands a little below its line
    line = np.polyfit(places, scale(np.array(list(up))), 1)
    np.testing.assert_allclose(np.polyval(line, places), scale(np.array(list(up))),
                               atol=0.01 * abs(line[0]) * 300)  # fmt: skip
    np.testing.assert_allclose(np.polyval(line, points[:, 1]), scale(values),
                               atol=0.005 * abs(line[0]) * 300)  # fmt: skip


def test_curves_of_one_chart_share_its_axes():
    chart = Chart("y")
    chart.add(np.arange(3.0), np.array([0.0, 1, 2]), "#000001")
    chart.add(np.arange(3.0), np.array([1.0, 2, 4]), "#000002")
    (one,), (other,) = (curve(drawn(chart), colour) for colour in ("#000001", "#000002"))
    assert one[1, 1] == other[0, 1] and one[2, 1] == other[1, 1] > other[2, 1]


@pytest.mark.parametrize("bad,logarithmic", [(np.nan, False), (np.inf, False), (0.0, True)])
def test_a_value_that_has_no_place_interrupts_its_curve(bad, logarithmic):
    values = np.array([1.0, 2, bad, 3, 4, 5])
    chart = Chart("y", logarithmic=logarithmic)
    chart.add(np.arange(6.0), values, "#123456")
    assert [len(piece) for piece in curve(drawn(chart), "#123456")] == [2, 3]


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize("values", [[], [np.nan, np.nan], [0.0, 0.0], [2.0, 2.0], [-1.0, -2.0]])
def test_few_or_equal_values_are_a_chart_too(values, logarithmic):
    chart = Chart("y", logarithmic=logarithmic)
    chart.add(np.arange(float(len(values))), np.array(values))
    assert "nan" not in svg([chart]) and "inf" not in svg([chart])


def test_charts_stand_in_rows_and_words_are_told():
    charts = [Chart("a < b", title=f"no {k}") for k in range(3)]
    for chart in charts:
        chart.add(np.arange(2.0), np.arange(2.0), name="A & B")
    whole = drawn(*charts)
    words = [text.text for text in whole.iter(f"{SVG}text")]
    assert words.count("a < b") == words.count("A & B") == 3 and "no 2" in words
    shifts = [g.get("transform") for g in whole.findall(f"{SVG}g")]
    assert shifts == ["translate(0 0)", "translate(600 0)", "translate(0 350)"]
