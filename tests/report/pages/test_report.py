"""report.html shows the recorded data, complete, escaped and self-contained."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from nsaid_mj.core.parameters import number
from nsaid_mj.lab.evaluation import page as report
from nsaid_mj.lab.evaluation.run_result import OWN, RunResult, judged
from nsaid_mj.lab.evaluation.statistics import (
    Conditions,
    Correlations,
    KnownDirection,
    KnownParameter,
    LawUsed,
    Origin,
    RunEnding,
    StatedConfidence,
    Unobservable,
)
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.evaluation.verify import Verification
from nsaid_mj.lab.loop import SimulatedRun, run
from nsaid_mj.report.page import render_html
from nsaid_mj.report.panels import COLOURS, LAWS
from tests.report.pages.drawing import points_of, words_of
from tests.report.pages.markup import Page, unscripted
from tests.support.faulty import WITH_RIVAL as ROV
from tests.support.summaries import evaluated, unknown


def render(*arguments: Any) -> str:
    return render_html(report.page(*arguments))


EVIL = "<script>alert('x')</script>\"&"


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return run(ROV, tmp_path_factory.mktemp("rov"))


@pytest.fixture(scope="module")
def result(done: SimulatedRun) -> RunResult:
    return evaluated(done, Truth.of(done))


@pytest.fixture(scope="module")
def summary(result: RunResult) -> dict[str, Any]:
    return result.summary()


@pytest.fixture(scope="module")
def text(done: SimulatedRun, result: RunResult) -> str:
    return render(done, result, Verification.of_run(done, Truth.of(done), result))


def value_of(text: str) -> float:
    """The number that `calibration.words.number` has written."""
    digits, _, power = text.replace("−", "-").partition("·10")
    return float(digits) * 10.0 ** int(
        power.translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 0
    )


def drawings(text: str) -> list[ElementTree.Element]:
    """Its plots, without the small ones of legends."""
    return [
        ElementTree.fromstring(svg)
        for svg in re.findall(r'<svg[^>]*role="img".*?</svg>', text, flags=re.DOTALL)
    ]


def test_every_identifiers_distance_is_drawn_as_recorded(done: SimulatedRun, text: str) -> None:
    first = drawings(text)[0]
    assert first.get("aria-label") == "Distance to the true set"
    assert {OWN, "conventional"} <= set(Page.of(text).legends[0])
    drawn, wanted = [], []
    for suffix, colour in (
        ("", COLOURS[LAWS["paper"]]),
        ("_conventional", COLOURS[LAWS["conventional"]]),
    ):
        ratio = Truth.of(done).distance(done.record["t"], done.record[f"theta_hat{suffix}"])
        drawn += [*points_of(first, colour)[[0, -1], 1]]
        wanted += [*np.log10(ratio[[0, -1]])]
    slope, start = np.polyfit(wanted, drawn, 1)  # one axis for both curves, upwards
    assert slope < 0
    np.testing.assert_allclose(slope * np.array(wanted) + start, drawn, atol=0.1)


def test_the_page_is_well_formed_and_has_its_title(text: str) -> None:
    page = Page.of(text)  # raises where a tag is not closed
    assert page.heading == "ScalarRov"
    assert len(page.ids) == len(set(page.ids))


def test_the_page_needs_no_other_file_and_runs_its_own_script_alone(text: str) -> None:
    # the robot's picture is inside, and the script is ours
    inside = unscripted(text).replace('<img src="data:image/png;base64,', "")
    assert not re.findall(
        r"<(?:script|link|img|iframe|object)\b|\bsrc=|@import|javascript:", inside
    )
    assert re.findall(r"https?:[^\"]*", text) == ["http://www.w3.org/2000/svg"]  # a namespace
    (script,) = re.findall("<script>(.*?)</script>", text, flags=re.DOTALL)
    assert not re.findall(r"\b(?:fetch|XMLHttpRequest|WebSocket|import|eval)\b", script)
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', text))
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))


def test_every_parameter_and_unobservable_direction_is_listed(
    summary: dict[str, Any], text: str
) -> None:
    page = Page.of(text)
    assert sorted(row["label"] for row in summary["parameters"]) == sorted(
        row[0].strip() for table in page.tables for row in table.rows if "estimate" in table.heads
    )
    words = unescape(text)
    assert summary["unobservable"]
    for entry in summary["unobservable"]:
        assert entry["direction"] in words or all(n in words for n in entry["parameters"])


def test_truth_prior_and_estimate_are_in_their_columns(summary: dict[str, Any], text: str) -> None:
    tables = [table for table in Page.of(text).tables if "estimate" in table.heads]
    rows = sorted(summary["parameters"], key=lambda row: "gain" not in row["label"])  # gains first
    told = [dict(zip(table.heads, row, strict=True)) for table in tables for row in table.rows]
    assert [line["true"] for line in told] == [number(row["true"]) for row in rows]
    assert [line["unit"] for line in told] == [row["unit"] for row in rows]
    factors = {
        value_of(line[key]) / row[key]
        for line, row in zip(told, rows, strict=True)
        for key in ("prior", "estimate")
        if row[key]
    }
    assert max(factors) / min(factors) == pytest.approx(1.0, abs=1e-3)  # one common scale


def test_no_table_can_be_clipped(text: str) -> None:
    """Each scrolls on a screen by itself, and is whole and open on paper."""
    page = Page.of(text)
    assert page.tables
    assert all("scroll" in table.around for table in page.tables)
    style, print_style = re.split(r"@media print", text.partition("</style>")[0])
    assert re.search(r"\.scroll \{[^}]*overflow-x: auto", style)
    assert re.search(r"\.scroll \{ overflow: visible", print_style)
    assert re.search(r"details::details-content \{ content-visibility: visible", print_style)
    assert not re.findall(r"max-height|text-overflow|overflow: hidden", style + print_style)


def test_on_a_phone_every_cell_says_which_column_it_is_in(text: str) -> None:
    """Rows become cards there: the heads are gone, and nothing has to be scrolled sideways."""
    phone = text[text.index("@media screen and (max-width: 40rem)") : text.index("@media print")]
    assert re.search(r"thead \{ display: none", phone)
    assert "content: attr(data-head)" in phone
    assert re.search(r"td\.number \{ white-space: nowrap; min-width: max-content", phone)
    for table in re.findall(r"<table>.*?</table>", text, flags=re.DOTALL):
        heads = re.findall(r"<th(?: [^>]*)?>(.*?)</th>", table)
        for line in re.findall(r"<tr><td.*?</tr>", table):
            assert re.findall(r'<td [^>]*data-head="(.*?)"', line) == heads


def test_everything_is_unfolded_on_paper(summary: dict[str, Any], text: str) -> None:
    printed = text[text.index("@media print") : text.index("</style>")]
    assert "details::details-content { content-visibility: visible" in printed
    for controls in ("summary::-webkit-details-marker", ".tools, .tip"):  # of a screen
        printed = printed.replace(f"{controls} {{ display: none; }}", "")
    assert not re.search(r"display: none|max-height|overflow: hidden", printed)
    assert not re.search(r"(?<!aria-)\bhidden\b", unscripted(text).partition("<main>")[2])
    cells = [row[0] for table in Page.of(text).tables for row in table.rows]
    assert all(row["label"] in cells for row in summary["parameters"])


def test_the_verdict_comes_first_then_gains_then_statistics_and_the_robots_picture(
    text: str,
) -> None:
    order = [
        text.index(part)
        for part in (
            'class="banner verdict',
            'class="carrying"',
            "Distance to the true set",
            "<h2>Actuator gains",
            "<h2>Statistics",
            "data:image/png;base64,",
            "Predicted against measured forces",
            "What cannot be known",
            "<h2>Parameters",
            "<h2>The paper&#39;s statements",
            "Running this again",
        )
    ]
    assert order == sorted(order)
    for verdict in ("Theorem 1 (69)", "Lemma 1 (74)", "Theorem 2"):
        assert verdict in text


def test_everything_from_outside_is_escaped(
    done: SimulatedRun, result: RunResult, tmp_path: Path
) -> None:
    known = KnownParameter(deviation=0.1, below_noise=False)
    stated = StatedConfidence(
        directions=2,
        below_noise=0,
        covered=1.0,
        deviation_median=0.1,
        deviation_largest=0.2,
        independent_samples=(1.0,),
        actuators={EVIL: 0.1},
        parameters={EVIL: known},
        correlations=Correlations(parameters=(EVIL, EVIL), lower=((), (0.5,))),
        worst_known=(KnownDirection(deviation=0.2, below_noise=True, parameters={EVIL: 1.0}),),
    )
    one_direction = Unobservable(
        direction=EVIL, fix=EVIL, parameters=(EVIL, EVIL), labels=(EVIL, EVIL)
    )
    told = judged(
        replace(
            result,
            ending=RunEnding(status=EVIL, status_time=1.0, status_signal=EVIL, status_remedy=EVIL),
            conditions=Conditions(sensors=EVIL, sensor_noise=EVIL, mismatch=(EVIL,), fault=EVIL),
            law=LawUsed(law=EVIL),
            origin=Origin(seed=0, versions={EVIL: EVIL}, scenario_hash=EVIL),
            unobservable=(one_direction,),
            rivals={EVIL: result.rivals["conventional"]},
            confidence=stated,
            estimates=tuple(
                replace(row, name=EVIL, label=EVIL, unit=EVIL) for row in result.estimates
            ),
        )
    )
    evil = replace(done, folder=tmp_path / EVIL.replace("/", "|"))
    text = render(evil, told, Verification.of_run(evil, Truth.of(done), told))
    assert "<script" not in unscripted(text)
    assert unescape(text).count("<script>") > 20
    Page.of(text)


def test_commands_on_the_page_quote_the_folder(
    done: SimulatedRun, result: RunResult, tmp_path: Path
) -> None:
    folder = tmp_path / "it's a run"
    text = unescape(render(replace(done, folder=folder), result))
    for command in ("nsaid view", "nsaid verify --run"):
        assert f"{command} {shlex.quote(str(folder))}" in text


def test_without_a_truth_everything_but_the_comparison_is_there(
    done: SimulatedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    def nobody_knows(*args: object) -> None:
        raise AssertionError("the truth was asked for")

    monkeypatch.setattr("nsaid_mj.lab.evaluation.curves.energy_of", nobody_knows)
    for name in ("distance", "theta_at", "nullspace_at"):
        monkeypatch.setattr(Truth, name, nobody_knows)
    monkeypatch.setattr(type(done.plant), "truth_at", nobody_knows)
    result = evaluated(unknown(done), None)
    text = render(unknown(done), result)
    page = Page.of(text)
    labels = [drawing.get("aria-label") for drawing in drawings(text)]
    assert labels[:2] == [
        "Velocity error, rms over short intervals",
        "Actuators relative to the prior",
    ]
    assert re.match(r"heave: error [\d.]+ %", str(labels[2]))  # on the run's own last tenth
    assert "On the last tenth of the run" in text
    assert "true" not in {head for table in page.tables for head in table.heads}
    assert "Lyapunov" not in text
    assert "rms Δv over the last tenth of the run [m/s]" in text
    told_estimates = [
        row[1] for table in page.tables for row in table.rows if "estimate" in table.heads
    ]
    rows = sorted(result.estimates, key=lambda row: "gain" not in row.label)  # gains first
    assert told_estimates == [number(row.estimate) for row in rows]


def test_a_verdict_is_shown_where_there_is_one(done: SimulatedRun, result: RunResult) -> None:
    said = render(done, replace(result, verdict="converged: all is well"))
    assert "converged: all is well" in said
    assert 'class="banner' not in render(done, replace(result, explains=None))


def test_a_run_of_one_row_has_a_report(done: SimulatedRun, tmp_path: Path) -> None:
    columns = {name: rows[:1] for name, rows in done.record.columns.items()}
    short = replace(done, folder=tmp_path, record=replace(done.record, columns=columns))
    text = render(short, evaluated(short, Truth.of(done)))
    assert len(drawings(text)) >= 4
    assert "nan" not in "".join(re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL))


def test_axes_have_labels_with_units(text: str) -> None:
    for svg in re.findall(r'<svg[^>]*role="img".*?</svg>', text, flags=re.DOTALL):
        named = [words for words in words_of(svg) if re.search(r"\[.+\]$", words)]
        assert len(named) in {2, 3}, named  # three where a difference is drawn below


def test_reporting_a_run_twice_gives_the_same_page(
    done: SimulatedRun, result: RunResult, text: str
) -> None:
    verdicts = Verification.of_run(done, Truth.of(done), result)
    assert render(done, evaluated(done, Truth.of(done)), verdicts) == text
