"""The summary of a run as printed on the terminal."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

import nsaid_mj
from nsaid_mj.base.files import OutputFolder
from nsaid_mj.base.findings import Finding
from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.lab.evaluation.page import print_result
from nsaid_mj.lab.evaluation.run_result import STATISTICS
from nsaid_mj.lab.evaluation.statistics import Conditions, Dimensions, Unobservable
from nsaid_mj.report.page import Page, Section, Table, Text
from nsaid_mj.report.result import Mark, Result, gathered
from nsaid_mj.report.terminal import print_page
from tests.support.summaries import run_result


def printed(capsys: pytest.CaptureFixture[str], folder: str = "runs/a", **changes: Any) -> str:
    print_result("rov", run_result(**changes), Path(folder))
    return capsys.readouterr().out


def dimensions(p: int, r: int) -> Dimensions:
    return replace(run_result().dimensions, p=p, r=r)


@pytest.mark.parametrize(
    ("p", "r", "words"),
    [
        (4, 1, "3 of 4 directions of θ are observable; 1 is not"),
        (4, 3, "1 of 4 directions of θ is observable; 3 are not"),
        (4, 0, "4 of 4 directions of θ are observable; 0 are not"),
    ],
)
def test_the_count_of_directions_is_grammatical(p: int, r: int, words: str) -> None:
    assert run_result(dimensions=dimensions(p, r)).observable_in_words == words


def test_a_fault_found_is_printed_with_its_time_and_confidence(capsys) -> None:
    event = FaultEvent(12.0, 12.5, "loss", "thruster 3", (), 0.4, 0.3, 0.5, "1", 0.99)
    said = printed(capsys, faults=(event,))
    assert "found at 12.5 s: thruster 3 lost 40 % (30 … 50 %), 99 % sure" in said


def test_the_line_ends_in_a_colon_only_if_directions_follow(capsys) -> None:
    assert "1 is not:\n" in printed(capsys)
    assert "0 are not.\n" in printed(capsys, dimensions=dimensions(4, 0), unobservable=())


def test_a_long_list_is_cut_after_a_comma_and_a_short_one_is_not(capsys) -> None:
    names = [f"gain of joint_{i}" for i in range(40)]
    line = Unobservable(
        direction="common scale of motor gains",
        fix=f"one known number fixes it, and with it these 40: {', '.join(names)}",
        parameters=tuple(names),
        labels=tuple(names),
    )
    out = printed(capsys, unobservable=(line,))
    cut = next(row for row in out.splitlines() if "these 40" in row)
    assert cut.endswith("gain of joint_3, …") and len(cut) < 130
    assert "these 2: mass, drag.\n" in printed(capsys)


def test_sensor_noise_is_not_listed_as_unknown_to_the_structure(capsys) -> None:
    noise = "noise of 0.0001 rad, 0.005 rad/s"
    out = printed(capsys, conditions=Conditions(sensors="noisy", sensor_noise=noise))
    assert "  · sensors: noise of 0.0001 rad, 0.005 rad/s.\n" in out
    assert "not in the structure" not in out
    assert "sensors:" not in printed(capsys)


def test_the_view_command_can_be_pasted_into_a_shell(capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert "nsaid view" not in printed(capsys)  # there is nothing to view
    for name, words in {"my [red] run": "'runs/my [red] run'", "a": "runs/a"}.items():
        file = Path("runs") / name / OutputFolder.RECORDING
        file.parent.mkdir(parents=True)
        file.touch()
        assert f"(nsaid view {words})" in printed(capsys, f"runs/{name}")


def test_a_remedy_that_findings_share_is_printed_once() -> None:
    some = [Finding("refusal", f"code_{k}", f"joint_{k}", "far", "Say deg.") for k in (1, 2)]
    stream = io.StringIO()
    told = (*some, Finding("refusal", "x", "", "no", "Other."))
    print_page(Page("", Result(findings=told)), Console(file=stream))
    assert [line.split(": ")[-1] for line in stream.getvalue().splitlines()] == [
        "far.",
        "far. Say deg.",
        "  ✘ no. Other.",
    ]


def test_what_is_said_alike_of_many_channels_is_one_finding() -> None:
    """With the least and largest number; another remedy, or other words, is another finding."""
    rows = "{} rows are saturated and not used (rows {}, 4 …)"
    alike = [
        Finding("warning", "flat", f"a.csv, u{k}", rows.format(n, k)) for k, n in enumerate((9, 70))
    ]
    other = Finding("warning", "flat", "a.csv, u3", "3 rows are saturated", "Look.")
    small = [
        Finding("note", "s", f"j{k}", f"it is {n} kg") for k, n in enumerate(("2·10⁻⁶", "0.1"))
    ]
    assert [str(f) for f in gathered([*alike, other, *small])] == [
        "a.csv, u0, u1: 9 to 70 rows are saturated and not used.",
        "a.csv, u3: 3 rows are saturated. Look.",
        "j0, j1: it is 2·10⁻⁶ to 0.1 kg.",
    ]
    twelve = [Finding("warning", "flat", f"joint_{k}", "it is flat") for k in range(12)]
    assert gathered(twelve)[0].where == "joint_0, joint_1 … joint_11 (12)"
    assert gathered([alike[0]])[0] is alike[0]


def lines_of(width: int, terminal: bool) -> list[str]:
    table = Table(
        ["joint", "long word [rad]", "share", "status"],
        [
            ["elbow", "0.123", "7 %", Mark("◐", "fair", "only in combination")],
            ["wrist", "1", "–", ""],
        ],
        (0, 3),
        spare=(1,),
        most=1,
    )
    words = "the residuals of this joint are 12 % of the motion, see a/path/that/is/long.csv"
    stream = io.StringIO()
    console = Console(file=stream, width=width, force_terminal=terminal, color_system=None)
    page = Page("", Result(), sections=[Section("", [Text(words), table], brief=True)])
    print_page(page, console)
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("width", [40, 46, 60, 200])
def test_a_terminal_loses_no_column_and_breaks_no_word(width: int) -> None:
    lines = lines_of(width, terminal=True)
    assert max(map(len, lines)) <= width
    said = " ".join(" ".join(lines).split())
    for words in ("12 % of", "a/path/that/is/long.csv", "0.123", "7 %", "◐ only in combination"):
        assert words in said
    assert not any(line.lstrip().startswith("%") for line in lines)
    assert ("long word 0.123 rad" in said) == (width < 50)


def test_a_pipe_gets_all_columns_and_lines_whatever_its_width() -> None:
    assert lines_of(40, terminal=False) == lines_of(200, terminal=False)
    assert "wrist" in lines_of(40, terminal=False)[-1]


def test_a_percentage_is_written_in_one_way() -> None:
    """With a space; `{:.0%}` has none."""
    for file in Path(nsaid_mj.__file__).parent.rglob("*.py"):
        assert not re.search(r":\.\d%\}", file.read_text(encoding="utf-8")), file


def test_every_figure_has_a_label_of_its_own() -> None:
    labels = [label for label, _, _ in STATISTICS]
    assert len(set(labels)) == len(labels)
    assert not any(label.startswith("…") for label in labels)
