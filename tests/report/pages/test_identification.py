"""Page and terminal summary of an identification are complete, escaped and self-contained."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from nsaid_mj.base.findings import Finding
from nsaid_mj.clinic.identify import wording
from nsaid_mj.clinic.identify.page import identification_page
from nsaid_mj.clinic.identify.result import Identification
from nsaid_mj.report.drawings import extremes
from nsaid_mj.report.page import render_html
from nsaid_mj.report.result import Explains, Mark
from nsaid_mj.report.terminal import print_page
from nsaid_mj.report.wording import estimate
from tests.report.pages.markup import Page, unscripted
from tests.support.identification import identification

WARNING = Finding("warning", "reversed_sign", "elbow", "the sign is reversed", "Negate it.")
NOTE = Finding("note", "cut", "log 0.csv", "rows 3 to 9 were left out")


@pytest.fixture(scope="module")
def result() -> Identification:
    return identification(validated=True, law=True, findings=(WARNING, NOTE))


@pytest.fixture(scope="module")
def text(result: Identification) -> str:
    return page(result)


def page(result: Identification) -> str:
    return render_html(identification_page(result))


def printed(result: Identification, *files: Path) -> str:
    stream = io.StringIO()
    print_page(identification_page(result), Console(file=stream, width=120, highlight=False), files)
    return stream.getvalue()


def cells(text: str) -> set[str]:
    return {cell for table in Page.of(text).tables for row in table.rows for cell in row}


def test_every_parameter_is_in_a_table(result: Identification, text: str) -> None:
    assert {p.label for p in result.parameters} <= cells(text)
    assert {p.label for p in result.parameters if p.is_gain} <= cells(text)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("share", [0.00123, 0.034, 0.5])
def test_the_half_width_of_a_gains_ratio_is_printed_in_per_cent(
    share: float, result: Identification
) -> None:
    first, *others = result.gains
    told = (replace(first, relative=share), *(replace(p, relative=0.099) for p in others))
    rest = tuple(p for p in result.parameters if not p.is_gain)
    text = page(replace(result, parameters=(*told, *rest)))
    found = {x for cell in cells(text) for x in re.findall(r"±\s*([\d.]+)\s*%", cell)}
    assert sorted(map(float, found)) == pytest.approx(sorted([100 * share, 9.9]), rel=0.05)


def test_the_verdict_stands_before_any_figure_and_findings_follow_it(text: str) -> None:
    assert text.index("The structure explains the log") < text.index("the sign is reversed")
    assert text.index("the sign is reversed") < text.index("<figure") < text.index("<h2>")
    assert "rows 3 to 9 were left out" in text


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("explains", "kind"), [("yes", "good"), ("partly", "fair"), ("no", "poor")]
)
def test_the_verdict_has_colour_and_glyph(explains: Explains, kind: str) -> None:
    text = page(identification(("only",), explains=explains))
    assert f'class="banner verdict {kind}"' in text
    assert Mark.of(explains).glyph in text


def test_a_combination_is_linked_from_its_parameters(text: str) -> None:
    assert 'id="combination-1"' in text
    assert '<a href="#combination-1">C1</a>' in text


def test_the_page_needs_no_other_file(text: str) -> None:
    assert not re.search(r"(src|href)=\"(?!#)", unscripted(text))
    assert "url(" not in re.sub(r"url\(#", "", text)
    assert "<script" not in unscripted(text)
    assert not re.search(r"data:(?!image/png;base64,)", text.replace("img-src data:", ""))


def test_names_are_escaped() -> None:
    evil = "<script>alert(1)</script>"
    finding = Finding("warning", "x", evil, f"{evil} [bold]", evil)
    result = identification((evil, "two"), findings=(finding,), validated=True, law=True)
    text = page(result)
    assert "<script" not in unscripted(text)
    assert evil in unescape(text)
    assert evil in printed(result)


def test_closed_tables_are_printed(text: str) -> None:
    assert "<details>" in text
    printing = text[text.index("@media print") :]
    assert "details::details-content { content-visibility: visible" in printing


def test_ids_are_unique(text: str) -> None:
    ids = Page.of(text).ids
    assert len(ids) == len(set(ids))


def test_every_joint_has_a_figure_with_its_error_in_the_title(text: str) -> None:
    for name in ("base", "shoulder", "elbow"):
        assert f"<h3>{name}: NRMSE 5\xa0% held out, 7\xa0% validation</h3>" in text
        assert f"<h3>{name}: NRMSE 7\xa0% on the validation log</h3>" in text
    assert text.count("u [A]") >= 6


def broken() -> Identification:
    """An identification in which no row of one joint was used and nothing is known of it."""
    found = identification(held_out=np.nan)
    found.predictions.predicted[:, 1] = np.nan
    found.predictions.usable[:, 1] = False
    first = replace(found.parameters[0], value=np.nan, low=-np.inf, high=np.inf)
    return replace(
        found, parameters=(first, *found.parameters[1:]), covariance=0 * found.covariance
    )


@pytest.mark.parametrize(
    "result",
    [
        identification(("only",), segments=1),
        identification(tuple(f"joint_{k}" for k in range(7)), validated=True),
        identification(vehicle=True),
        identification(explains="no", held_out=3.0),
        broken(),
        replace(identification(), combinations=(), suggestion="", parameters=()),
    ],
    ids=["one joint", "7 joints", "vehicle", "not explained", "nan", "no parameters"],
)
def test_unusual_identifications_are_reported(result: Identification, tmp_path: Path) -> None:
    text = identification_page(result).write_html(tmp_path).read_text(encoding="utf-8")
    Page.of(text)
    assert {p.label for p in result.parameters} <= cells(text)
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", text, flags=re.DOTALL).lower()
    assert printed(result).splitlines()[0].endswith(result.verdict)


@pytest.mark.usefixtures("undrawn")
def test_the_terminal_has_the_verdict_first_then_warnings(result: Identification) -> None:
    lines = printed(result, Path("out/report.html")).splitlines()
    assert lines[0] == f"✔ test arm: {result.verdict}"
    assert "elbow: the sign is reversed. Negate it." in lines[1]
    assert lines[-1].strip() == "out/report.html"
    whole = "\n".join(lines)
    gains = whole[whole.index("  gains") : whole.rindex("  friction ")]
    for name in ("base", "shoulder", "elbow"):
        assert re.search(rf"{name} .* N·m/A .* identified", gains)
    assert "3 joints, 42 parameters" in whole


@pytest.mark.parametrize(
    ("value", "low", "high", "wanted"),
    [
        (0.9656, 0.8169, 1.141, ("0.97", "0.82 … 1.14")),
        (-0.4526, -1.662, 0.7573, ("−0.5", "−1.7 … 0.8")),
        (2.2e-5, -8e-6, 5.3e-5, ("2.2·10⁻⁵", "−8·10⁻⁶ … 5.3·10⁻⁵")),
        (0.0012, 0.0001, 0.0023, ("0.0012", "0.0001 … 0.0023")),
        (12345.6, 12000.0, 12700.0, ("12350", "12000 … 12700")),
        (3.0, 3.0, 3.0, ("3", "–")),
        (0.0, -0.026, 0.026, ("0", "−0.026 … 0.026")),
    ],
)
def test_an_estimate_is_rounded_to_its_interval(
    value: float, low: float, high: float, wanted: tuple[str, str]
) -> None:
    assert estimate(value, low, high) == wanted


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("width", [60, 80, 200])
def test_the_terminals_lines_are_not_broken_inside_a_status(width: int) -> None:
    stream = io.StringIO()
    console = Console(file=stream, width=width, force_terminal=True, color_system=None)
    print_page(identification_page(identification()), console)
    assert len(re.findall("● identified", stream.getvalue())) == 3
    assert max(map(len, stream.getvalue().splitlines())) <= width


@pytest.mark.usefixtures("undrawn")
def test_the_anchor_of_the_scale_is_on_page_and_terminal(result: Identification, text: str) -> None:
    assert "rests on the known mass_1 = 2" in text
    assert "rests on the known mass_1 = 2" in printed(result)


def test_curves_of_a_vehicle_are_forces_on_its_velocities() -> None:
    result = identification(("surge", "yaw"), vehicle=True)
    system = SimpleNamespace(velocity_units=("m/s", "rad/s"))
    robot = replace(result.robot, system=system, joints=("rotor 1", "rotor 2"))
    vehicle = replace(result, robot=robot)
    assert [wording.quantity(vehicle, j) for j in (0, 1)] == [("force", "N"), ("torque", "N·m")]
    assert wording.quantity(result, 0) == ("u", "A")


def test_thinning_keeps_every_peak() -> None:
    values = np.zeros(10_001)
    values[[17, 4003, 9999]] = 1.0, -2.0, 3.0
    rows = extremes(values, 200)
    assert len(rows) <= 210
    assert {0, 17, 4003, 9999, 10_000} <= set(rows.tolist())
