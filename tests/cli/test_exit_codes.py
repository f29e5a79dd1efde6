"""One table of exit codes: every command ends with what its verdict says."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import nsaid_mj.cli
from nsaid_mj.base.errors import NsaidError
from nsaid_mj.base.findings import Finding
from nsaid_mj.cli import commands
from nsaid_mj.clinic.identify.inspection import Inspection
from nsaid_mj.clinic.logs.unusable import UnusableLog
from nsaid_mj.core.laws.base import Status
from nsaid_mj.lab.evaluation.run_result import RunResult
from nsaid_mj.lab.evaluation.statistics import Accuracy, RunEnding
from nsaid_mj.lab.evaluation.verify import StatementVerdict, verification_of
from nsaid_mj.plans.studies.compare_report import PRIOR, result_of, row_of, runs_of
from nsaid_mj.plans.studies.runs import Runs
from nsaid_mj.report import ExitCode
from nsaid_mj.report.page import Page
from nsaid_mj.report.result import Result
from nsaid_mj.watch import Misfit
from tests.support.faulty import call, shell
from tests.support.identification import identification
from tests.support.summaries import run_result

ROOT = Path(nsaid_mj.cli.__file__).parents[2]
Patch = pytest.MonkeyPatch


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.chdir(tmp_path)


def put(patch: Patch, name: str, value: Any) -> None:
    patch.setattr(f"nsaid_mj.{name}", lambda *_, **__: value)


def run_of(patch: Patch, result: RunResult, status: Status = Status.completed) -> None:
    finished = SimpleNamespace(ending=SimpleNamespace(status=status), folder=Path("out"))
    output = SimpleNamespace(json=False, quiet=True)
    put(patch, "cli.commands._carry_out", ("rov", finished, result, output))


@pytest.mark.parametrize(("explains", "code"), [("yes", 0), ("partly", 0), ("no", 1), (None, 0)])
def test_a_verdict_that_is_poor_is_not_explained(explains: Any, code: int) -> None:
    assert ExitCode.of(Result(explains=explains)) == code
    assert ExitCode.of(Result(explains=explains, complete=False)) == ExitCode.NOT_EXPLAINED


def distances(first: float, last: float) -> Accuracy:
    return Accuracy(theta_perp_ratio_initial=first, theta_perp_ratio=last)


@pytest.mark.parametrize(
    ("verdict", "changes", "code"),
    [
        ("converged", {"accuracy": distances(0.9, 0.001)}, ExitCode.EXPLAINED),
        ("still converging", {"accuracy": distances(0.9, 0.08)}, ExitCode.EXPLAINED),
        ("not converging", {"accuracy": distances(0.1, 0.9)}, ExitCode.NOT_EXPLAINED),
        (
            "the motion contradicts this structure",
            {"misfit": Misfit("contradicts", (1.0,), 2.0, 3.0, 0.0)},
            ExitCode.NOT_EXPLAINED,
        ),
        (
            "ended early",
            {"ending": RunEnding(status="plant diverged", status_time=1.0)},
            ExitCode.NOT_EXPLAINED,
        ),
    ],
)
def test_run(verdict: str, changes: dict[str, Any], code: int, monkeypatch: Patch) -> None:
    result = run_result(**changes)
    assert result.verdict.startswith(f"{verdict}: ")
    run_of(monkeypatch, result)
    assert shell("run", "scalar_rov")[0] == code
    run_of(monkeypatch, result, Status.interrupted)
    assert shell("run", "scalar_rov")[0] == 130


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("holds", "not applicable"), ExitCode.EXPLAINED),
        (("holds", "not yet"), ExitCode.EXPLAINED),
        (("not applicable",), ExitCode.EXPLAINED),
        (("holds", "fails"), ExitCode.NOT_EXPLAINED),
    ],
)
def test_verify(words: tuple[Any, ...], code: int, monkeypatch: Patch) -> None:
    verdicts = tuple(
        StatementVerdict("Theorem 1", "Δv vanishes", word, None, None, "") for word in words
    )
    run = SimpleNamespace(
        ending=SimpleNamespace(status=Status.completed),
        record={"t": [0.0]},
        scenario=SimpleNamespace(hash=""),
        folder=Path("out"),
    )
    put(monkeypatch, "base.files.OutputFolder.record_file", None)
    put(monkeypatch, "lab.evaluation.verify.Verification.of_folder", verification_of(run, verdicts))  # pyright: ignore[reportArgumentType]
    assert shell("verify", "--run", "out", "--quiet")[0] == code


@pytest.mark.parametrize(
    ("failures", "code"),
    [(("", ""), ExitCode.EXPLAINED), (("", "lost"), ExitCode.EXPLAINED), (("lost", "lost"), 1)],
)
def test_compare(failures: tuple[str, str], code: int, monkeypatch: Patch) -> None:
    cells = [row_of(PRIOR, 0, 0.0, 1.0, 0.3, 0.1, None, 0.0)]
    cells += [
        row_of(name, 0, 0.0, 1.0, failure=why)
        if why
        else row_of(name, 0, 0.0, 1.0, 0.1, 0.1, 0.1, 1.0)
        for name, why in zip(("ols", "tls"), failures, strict=True)
    ]
    put(
        monkeypatch,
        "plans.studies.compare.run_comparison",
        (result_of(runs_of(Path("out"), {}, cells)), cells),
    )
    assert shell("compare", "scalar_rov", "--quiet")[0] == code


def rows(*converged: float | None, failure: str | None = None) -> list[dict[str, Any]]:
    found = [
        {
            "run": k,
            "draw": k,
            "seed": k,
            "failure": None,
            "status": "completed",
            "theta_perp_ratio": 0.1,
            "time_to_converge": t,
        }
        for k, t in enumerate(converged)
    ]
    return found + ([{"run": 9, "draw": 9, "seed": 9, "failure": failure}] if failure else [])


@pytest.mark.parametrize(
    ("found", "code"),
    [
        (rows(1.0, 2.0), ExitCode.EXPLAINED),
        (rows(1.0, None), ExitCode.EXPLAINED),
        (rows(None, None, 1.0), ExitCode.EXPLAINED),
        (rows(1.0, 2.0, failure="exit code 3"), ExitCode.NOT_EXPLAINED),
        (rows(failure="exit code 3"), ExitCode.NOT_EXPLAINED),
    ],
)
def test_sweep(found: list[dict[str, Any]], code: int, monkeypatch: Patch) -> None:
    manifest = {"vary": {}, "runs": len(found), "script": "scalar_rov", "arguments": []}
    put(monkeypatch, "plans.studies.sweep.run_sweep", Runs(Path("out"), manifest, found))
    code_, said = shell("sweep", "scalar_rov", "--vary", "law=paper", "--quiet")
    assert (code_, said.err) == (code, "")


@pytest.mark.parametrize(
    ("gone", "code"), [([], ExitCode.EXPLAINED), ([{"run": 1}], ExitCode.NOT_EXPLAINED)]
)
def test_montecarlo(gone: list[Any], code: int, monkeypatch: Patch) -> None:
    put(monkeypatch, "plans.studies.montecarlo_results.run_montecarlo", None)
    put(
        monkeypatch, "plans.studies.montecarlo_results.montecarlo_result", Result(complete=not gone)
    )
    assert shell("montecarlo", "scalar_rov", "--quiet")[0] == code


@pytest.mark.parametrize(
    ("status", "code"), [("completed", ExitCode.EXPLAINED), ("diverged", ExitCode.NOT_EXPLAINED)]
)
def test_track(status: str, code: int, monkeypatch: Patch) -> None:
    result = Result(explains="partly", complete=status == "completed")
    put(monkeypatch, "plans.track.run.run_tracking", (result, []))
    assert shell("track", "track_ur5", "--quiet")[0] == code


@pytest.mark.parametrize(("explains", "code"), [("yes", 0), ("partly", 0), ("no", 1)])
def test_excite(explains: Any, code: int, monkeypatch: Patch) -> None:
    for name in (
        "plans.excite.designing.design",
        "plans.excite.prediction.predict",
        "plans.excite.information.ranks",
        "plans.excite.files.scenario_of",
        "plans.excite.files.design_document",
        "plans.excite.prediction.tried",
        "plans.excite.recording.record_design",
        "report.page.Page.write_html",
    ):
        put(monkeypatch, name, SimpleNamespace(limits=None))
    put(monkeypatch, "plans.excite.files.write_design", [])
    put(monkeypatch, "plans.excite.experiment.Experiment.of", None)
    put(monkeypatch, "plans.excite.page.design_page", Page("", Result(explains=explains)))
    assert shell("excite", "scalar_rov", "--quiet", "--out", "out")[0] == code


@pytest.mark.parametrize(("explains", "code"), [("yes", 0), ("partly", 0), ("no", 1)])
def test_identify(explains: str, code: int, monkeypatch: Patch) -> None:
    result = identification(("one",), explains=explains)
    put(monkeypatch, "clinic.commands.identify.check_identify", None)
    put(monkeypatch, "clinic.commands.identify.servos_of", None)
    put(monkeypatch, "clinic.identify.identify.identify_forces", result)
    put(monkeypatch, "clinic.commands.identify.write", (Page("", result), []))
    assert shell("identify", "--model", "arm.urdf", "--log", "a.csv", "--quiet")[0] == code
    put(monkeypatch, "clinic.commands.identify.servos_of", object())
    put(monkeypatch, "clinic.commands.identify.identify_given", (Page("", result), []))
    assert shell("identify", "--model", "arm.urdf", "--log", "a.csv", "--quiet")[0] == code


def refused(level: Any, code: str) -> tuple[Finding, ...]:
    return (Finding(level, code, "elbow", "something is wrong"),)


@pytest.mark.parametrize(
    ("findings", "code"),
    [
        (refused("refusal", "dead_channel"), ExitCode.UNUSABLE),
        (refused("warning", "unmatched"), ExitCode.UNUSABLE),
        (refused("warning", "low_rate"), ExitCode.EXPLAINED),
        (refused("note", "targets"), ExitCode.EXPLAINED),
    ],
)
def test_inspect_ends_as_identify_does(
    findings: tuple[Finding, ...], code: int, monkeypatch: Patch
) -> None:
    found = Inspection((), (), findings, None, None)
    put(monkeypatch, "clinic.commands.identify.check_inspect", None)
    put(monkeypatch, "clinic.logs.tables.read_tables", ())
    put(monkeypatch, "clinic.identify.inspection.inspect", found)
    assert shell("inspect", "a.csv", "--out", "out")[0] == code

    def refuse(*_: Any, **__: Any) -> None:
        raise UnusableLog(findings)

    if findings[0].level == "refusal":
        put(monkeypatch, "clinic.commands.identify.check_identify", None)
        put(monkeypatch, "clinic.commands.identify.servos_of", None)
        monkeypatch.setattr("nsaid_mj.clinic.identify.identify.identify_forces", refuse)
        said = shell("identify", "--model", "arm.urdf", "--log", "a.csv", "--quiet")
        assert said[0] == code and "something is wrong" in said[1].err


@pytest.mark.parametrize("words", ["list", "--version", "--help"])
def test_what_judges_nothing_ends_well(words: str) -> None:
    assert shell(words)[0] == ExitCode.EXPLAINED


def test_an_error_of_ours_is_unusable_input(monkeypatch: Patch) -> None:
    def fail(*_: Any) -> None:
        raise NsaidError("this cannot be used")

    monkeypatch.setattr(commands, "_run", fail)
    assert shell("run", "scalar_rov")[0] == ExitCode.UNUSABLE


def test_the_documentation_has_the_table() -> None:
    text = (ROOT / "docs/usage.md").read_text(encoding="utf-8")
    from nsaid_mj.report import exit_codes

    table = [line for line in (exit_codes.__doc__ or "").splitlines() if line.startswith("|")]
    assert all(line in text for line in table)


def test_a_warning_is_a_line_for_users(tmp_path: Path) -> None:
    """Not a place in our code, as Python prints it."""
    leg = Path(__file__).parents[1] / "data" / "menagerie" / "leg.xml"
    done = call("run", "arm", "--robot", leg, "--duration", 0.1, "--out", "out", cwd=tmp_path)
    (line,) = [line for line in done.stderr.splitlines() if "free joint" in line]
    assert line.startswith("nsaid: robot ") and ".py:" not in done.stderr
