"""Sweeps: results do not depend on the workers, failures stay isolated, and runs resume."""

from __future__ import annotations

import os
import re
import shlex
import signal
import sys
import time
from dataclasses import replace
from html import unescape
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from nsaid_mj.base.errors import BadRun, InvalidInput, UnknownName
from nsaid_mj.core.laws.base import Status
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run as run_alone
from nsaid_mj.lab.scenario import Scenario, field_at
from nsaid_mj.plans.studies.engine import Engine
from nsaid_mj.plans.studies.folder import ROWS, TABLE, _column, read
from nsaid_mj.plans.studies.one_run import time_to_converge
from nsaid_mj.plans.studies.runs import Runs
from nsaid_mj.plans.studies.study import seed_of
from nsaid_mj.plans.studies.sweep import run_sweep, scenario_of
from nsaid_mj.plans.studies.sweep import sweep_plan as plan_of
from nsaid_mj.plans.studies.sweep_report import write_sweep_page
from nsaid_mj.report import ExitCode
from tests.report.pages.markup import Page, unscripted
from tests.support.faulty import ROV, shell, start, strict
from tests.support.studies import COSTS
from tests.support.summaries import summarize

PATIENCE = 90.0  # on a busy machine [s]
FIELDS = {"identifier.gain": (0.1, 1.0), "sensors": ("ideal", "noisy")}
PLAN = plan_of("scalar_rov", ROV, FIELDS, seeds=2)
SHORT = ("--duration", "2", "--pe-window", "0.5", "--held-out", "0.5")

# A driver that may do away with its process or with everybody's time.
FATES = """
import os, signal, time
from dataclasses import dataclass
from nsaid_mj import MultisineCommand, NullspaceAID, ScalarRovPlant, Scenario

@dataclass(frozen=True)
class Fated(MultisineCommand):
    fate: str = "lives"

    def build(self, system, prior, rng):
        print("what a scenario prints is no answer", flush=True)
        if self.fate == "dies":
            os._exit(3)
        if self.fate == "is_killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.fate == "hangs":
            time.sleep(3600)
        if self.fate == "errs" and not os.path.exists(__file__ + ".mended"):
            raise ZeroDivisionError("by nought")
        return super().build(system, prior, rng)

scenario = Scenario(
    plant=ScalarRovPlant(), excitation=Fated(low=0.1, high=1.0, amplitude=0.4),
    identifier=NullspaceAID(K=10.0, gain=0.3), dt=0.01, duration=2.0, held_out=0.5, pe_window=0.5,
)
"""


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return run_sweep(PLAN, tmp_path_factory.mktemp("sweep"), Engine(jobs=2), quiet=True)


@pytest.fixture(scope="module")
def fates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    script = tmp_path_factory.mktemp("fates") / "fates.py"
    script.write_text(FATES)
    return script


def results(sweep: Runs) -> list[dict]:
    """Rows without what a repetition changes."""
    return [{key: value for key, value in row.items() if key not in COSTS} for row in sweep.rows]


# -- what is run ---------------------------------------------------------------------------------


def test_every_combination_is_run_with_every_seed(sweep: Runs) -> None:
    seen = [(row["draw"], row["identifier.gain"], row["sensors"]) for row in sweep.rows]
    assert seen == [(d, g, s) for d in range(2) for g in (0.1, 1.0) for s in ("ideal", "noisy")]
    assert all(row["failure"] is None and row["status"] == "completed" for row in sweep.rows)
    assert len({row["theta_perp_ratio"] for row in sweep.rows}) == len(PLAN)


def test_seeds_come_from_the_master_by_spawn_key(sweep: Runs) -> None:
    for row in sweep.rows:
        words = np.random.SeedSequence(0, spawn_key=(row["draw"],)).generate_state(1, np.uint64)
        assert row["seed"] == int(words[0]) >> 1
    many = {seed_of(master, draw) for master in range(3) for draw in range(1000)}
    assert len(many) == 3000
    assert min(many) >= 0
    assert max(many) < 2**63


def test_a_run_of_a_sweep_equals_the_run_alone(sweep: Runs, tmp_path: Path) -> None:
    done = run_alone(scenario_of(PLAN, 3), tmp_path)
    summary = summarize(done, Truth.of(done))
    row = sweep.rows[3]
    same = {key for key in row if key in summary} - set(COSTS)
    assert {"theta_perp_ratio", "conserved_drift", "status", "scenario_hash"} <= same
    assert {key: row[key] for key in same} == {key: summary[key] for key in same}


def test_the_command_listed_for_a_run_repeats_it(sweep: Runs, tmp_path: Path) -> None:
    arguments = [*SHORT, "--identifier.K=12"]
    plan = plan_of("scalar_rov", load("scalar_rov"), FIELDS, 2, arguments=tuple(arguments))
    line = Runs(Path(), plan.manifest, []).command(sweep.rows[2])
    words = shlex.split(line)
    assert words[:2] == ["nsaid", "run"]
    code, _ = shell("run", *words[2:], "--quiet", "--out", tmp_path)
    scenario = strict((tmp_path / "scenario.json").read_text())
    assert code == 0
    assert scenario["seed"] == sweep.rows[2]["seed"]
    assert scenario["identifier"]["gain"] == 1.0
    assert scenario["identifier"]["K"] == 12.0
    assert scenario["sensors"] == "ideal"


def test_the_number_of_workers_changes_no_result(sweep: Runs, tmp_path: Path) -> None:
    assert results(run_sweep(PLAN, tmp_path, Engine(jobs=1), quiet=True)) == results(sweep)


@pytest.mark.slow  # tests/faults/test_sweep_faults.py has a cluster in memory
def test_a_dask_cluster_gives_the_same_results(sweep: Runs, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        engine = Engine("dask", cluster.scheduler_address)
        assert results(run_sweep(PLAN, tmp_path, engine, quiet=True)) == results(sweep)


# -- what goes wrong -----------------------------------------------------------------------------


def test_a_killed_sweep_resumes(tmp_path: Path) -> None:
    words = (
        "scalar_rov",
        "--vary",
        "identifier.gain=0.1,1",
        "--seeds",
        "3",
        "--jobs",
        "1",
        *SHORT,
        "--duration",
        "8",
        "--out",
        tmp_path / "out",
    )
    rows = tmp_path / "out" / ROWS
    process = start("sweep", *words, cwd=tmp_path)
    end = time.monotonic() + PATIENCE
    while not (rows.is_file() and rows.read_bytes().count(b"\n") >= 2):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end, "no run is done"
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    before = rows.read_bytes()
    assert 2 <= before.count(b"\n") < 6
    rows.write_bytes(before + b'{"run": 5, "dra')  # the line that it was at
    code, _ = shell("sweep", *words, "--quiet")
    after = rows.read_bytes()
    assert code == 0
    assert after.startswith(before)  # wall times too: no run was made again
    assert after.count(b"\n") == 6
    assert [row["run"] for row in read(tmp_path / "out").rows] == list(range(6))


@pytest.mark.parametrize("changed", ["vary", "seeds", "master_seed", "scenario", "versions"])
def test_another_sweeps_folder_is_refused(
    sweep: Runs, changed: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = {
        "vary": plan_of("scalar_rov", ROV, {"identifier.gain": (0.1, 2.0)}, 2),
        "seeds": plan_of("scalar_rov", ROV, FIELDS, 3),
        "master_seed": plan_of("scalar_rov", replace(ROV, seed=1), FIELDS, 2),
        "scenario": plan_of("scalar_rov", replace(ROV, duration=3.0), FIELDS, 2),
        "versions": PLAN,
    }[changed]
    if changed == "versions":
        monkeypatch.setattr("nsaid_mj.plans.studies.study.versions", lambda: {"python": "2.7"})
    with pytest.raises(BadRun, match=f"another sweep.*{changed}") as caught:
        run_sweep(other, sweep.folder, quiet=True)
    assert caught.value.path == sweep.folder
    assert read(sweep.folder).rows == sweep.rows


@pytest.mark.parametrize(
    "text,error,said",
    [
        ("identifier.gian=1,2", UnknownName, "gain"),
        ("gain=1,2", UnknownName, "identifier.gain"),  # the plant has one too
        ("colour=1", UnknownName, "field"),
        ("identifier.gain=1,two", InvalidInput, "float"),
        ("identifier.gain=", InvalidInput, "float"),
        ("identifier.gain", InvalidInput, "field=value"),
        ("sensors=ideal,deaf", InvalidInput, "noisy"),
        ("plant.mismatch.flow='1 2", InvalidInput, "tuple"),
    ],
)
def test_a_bad_field_or_value_is_refused(text: str, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        ROV.varied([text])


def test_swept_values_have_their_fields_types() -> None:
    base = load("bluerov2")
    found = base.varied(
        ["law=paper,cone", "gain_error=None,0.1", "mismatch.flow=0 0 0,1 2 3", "tones=3"]
    )
    assert found == {
        "identifier.law": ("paper", "cone"),
        "gain_error": (None, 0.1),
        "plant.mismatch.flow": ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)),
        "excitation.tones": (3,),
    }
    study = plan_of("bluerov2", base, found)
    last = scenario_of(study, len(study.combinations) - 1)
    assert {path: field_at(last, path) for path in found} == {
        path: values[-1] for path, values in found.items()
    }


def test_an_impossible_plan_is_refused() -> None:
    with pytest.raises(InvalidInput, match="duplicates"):
        plan_of("scalar_rov", ROV, {"identifier.gain": (1.0, 1.0)})
    with pytest.raises(InvalidInput, match="every field once"):
        ROV.varied(["tones=3", "excitation.tones=4"])
    with pytest.raises(InvalidInput, match="master"):
        plan_of("scalar_rov", ROV, {"seed": (1, 2)})
    with pytest.raises(InvalidInput, match="seeds"):
        plan_of("scalar_rov", ROV, {}, seeds=0)
    with pytest.raises(InvalidInput, match="duration"):
        plan_of("scalar_rov", ROV, {"duration": (1.0, -1.0)})


@pytest.mark.parametrize(
    "settings",
    [{"jobs": 0}, {"timeout": 0.0}, {"timeout": np.nan}, {"name": "dask"}, {"address": "tcp://a"}],
)
def test_an_impossible_engine_is_refused(settings: dict) -> None:
    with pytest.raises(InvalidInput):
        Engine(**settings)
    with pytest.raises(UnknownName, match="local"):
        Engine("locale")


def test_the_time_after_which_a_run_hangs_is_the_one_given_or_grows_with_the_run() -> None:
    assert Engine(timeout=7.0).time(ROV) == 7.0
    assert Engine().time(ROV) == 120.0 + 20.0 * (ROV.duration + ROV.held_out)


def test_an_engine_that_is_not_installed_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)  # as if it were not installed
    with pytest.raises(InvalidInput, match=r"nsaid-mj\[dask\]"):
        run_sweep(PLAN, tmp_path, Engine("dask", "tcp://localhost:1"), quiet=True)


# -- what is found -------------------------------------------------------------------------------


def test_the_table_holds_every_row_and_the_manifest(sweep: Runs) -> None:
    table = pq.read_table(sweep.folder / TABLE)
    assert table.to_pylist() == sweep.rows
    assert str(table.schema.field("seed").type) == "int64"
    assert str(table.schema.field("failure").type) == "string"
    assert str(table.schema.field("identifier.gain").type) == "double"
    manifest = strict((table.schema.metadata or {})[b"nsaid"].decode())
    assert manifest == strict((sweep.folder / "manifest.json").read_text()) == sweep.manifest
    assert {"scenario", "vary", "master_seed", "versions"} <= manifest.keys()


def test_a_run_that_ended_early_has_not_converged(tmp_path: Path) -> None:
    near = replace(ROV, initial_error=1e-6, duration=1.0)
    done = run_alone(near, tmp_path)
    truth = Truth.of(done)
    assert time_to_converge(done, truth) == 0.0
    done.ending.status = Status.plant_diverged
    assert time_to_converge(done, truth) is None


def test_runs_that_never_converged_count_as_infinite(sweep: Runs) -> None:
    group = sweep.by("sensors")[0]
    assert group.values == {"sensors": "ideal"}
    assert [row["run"] for row in group.rows] == [0, 2, 4, 6]
    rows = [
        {**row, "time_to_converge": time}
        for row, time in zip(group.rows, (None, 3.0, 1.0, 2.0), strict=True)
    ]
    group = type(group)(group.values, rows)
    assert [group.quantile("time_to_converge", share) for share in (0.05, 0.5, 0.75, 0.95)] == [
        1.0,
        2.0,
        3.0,
        np.inf,
    ]


# -- the page ------------------------------------------------------------------------------------


def test_the_page_shows_every_combination_and_is_well_formed(sweep: Runs) -> None:
    page = write_sweep_page(sweep)
    text = page.read_text(encoding="utf-8")
    shown = Page.of(text)
    assert len(shown.ids) == len(set(shown.ids))
    (table,) = shown.tables
    assert table.around == "scroll"
    assert table.heads[:2] == ["gain", "sensors"]
    assert [row[:2] for row in table.rows] == [
        [str(g.values[path]) for path in FIELDS] for g in sweep.groups
    ]
    converged = any(np.isfinite(g.column("time_to_converge")).any() for g in sweep.groups)
    panels = 2 if converged else 1  # no run failed: no panel of failures
    assert text.count('role="img"') == panels * len(FIELDS)
    assert not re.findall(r"https?:|<script|<link|<img|src=", unscripted(text))
    write_sweep_page(sweep)
    assert page.read_text(encoding="utf-8") == text


def test_the_page_escapes_all_text_of_manifest_and_rows(sweep: Runs, tmp_path: Path) -> None:
    evil = "<script>alert('x')</script>\"&$x$"
    manifest = sweep.manifest | {
        "script": evil,
        "seeds": evil,
        "master_seed": evil,
        "versions": {evil: evil},
        "arguments": [evil],
        "vary": {evil: [evil, "other"]},
    }
    rows = [{**row, evil: value, "seed": evil} for row in sweep.rows for value in (evil, "other")]
    rows[0] |= {"failure": evil}
    rows[1] |= {"status": evil}
    folder = tmp_path / evil.replace("/", "|")
    folder.mkdir()
    text = write_sweep_page(Runs(folder, manifest, rows)).read_text(encoding="utf-8")
    assert "<script" not in unscripted(text)
    assert unescape(text).count("<script>") > 15
    shown = Page.of(text)
    assert sorted(shown.legends[0]) == sorted([evil, "no result"])


# -- the command line ----------------------------------------------------------------------------


def test_sweep_lists_every_combination_and_exits_with_0(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("sweep", "scalar_rov", "--vary", "identifier.gain=0.1,1", "--seeds", "2", *SHORT)
    code, said = shell(*words, "--out", out, "--jobs", "2", "--json")
    document = strict(said.out)
    assert (code, said.err) == (0, "")
    assert (document["runs"], document["results"], document["failures"]) == (4, 4, [])
    values = [line["values"] for line in document["combinations"]]
    assert values == [{"identifier.gain": 0.1}, {"identifier.gain": 1.0}]
    ratios = [row["theta_perp_ratio"] for row in read(out).rows[::2]]
    assert document["combinations"][0]["theta_perp_ratio_low"] == min(ratios)
    code, said = shell("report", out)
    assert (code, said.err) == (0, "")
    assert "identifier.gain" in Path(said.out.strip()).read_text()


@pytest.mark.parametrize(
    "words,said",
    [
        (("sweep", "scalar_rov", "--vary", "gian=1"), "Did you mean gain"),
        (("sweep", "scalar_rov", "--seeds", "0"), "seeds: expected"),
        (("sweep", "scalar_rov", "--engine", "slurm"), "unknown engine: 'slurm'"),
        (("report", "nowhere"), "not a sweep folder"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    words: tuple[str, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, heard = shell(*words)
    assert code == ExitCode.UNUSABLE
    assert said in heard.err
    assert heard.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


# -- what is lost --------------------------------------------------------------------------------


def test_failures_are_retried_only_on_request(fates: Path, tmp_path: Path) -> None:
    plan = plan_of(str(fates), load(str(fates)), {"excitation.fate": ("errs",)}, seeds=1)
    (row,) = run_sweep(plan, tmp_path / "out", Engine(jobs=1), quiet=True).lost
    assert row["failure"] == "ZeroDivisionError: by nought"
    mended = Path(f"{fates}.mended")
    mended.touch()
    assert run_sweep(plan, tmp_path / "out", Engine(jobs=1), quiet=True).lost
    found = run_sweep(plan, tmp_path / "out", Engine(jobs=1), quiet=True, retry=True)
    mended.unlink()
    assert len(found.rows) == 1
    assert not found.lost


def test_a_failed_run_is_listed_with_its_command_and_exits_with_1(
    fates: Path, tmp_path: Path
) -> None:
    code, said = shell(
        "sweep",
        fates,
        "--vary",
        "fate=lives,dies",
        "--seeds",
        "1",
        "--jobs",
        "1",
        "--out",
        tmp_path / "out",
    )
    assert code == ExitCode.NOT_EXPLAINED
    assert "1 of 2 runs have a result" in said.out
    assert "exit code 3" in said.out
    assert f"nsaid run {fates} --excitation.fate=dies --seed={seed_of(0, 0)}" in said.out


def test_a_run_that_dies_or_hangs_does_not_affect_the_others(
    fates: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = ("dies", "hangs", "is_killed", "lives")

    def timeout(engine: Engine, scenario: Scenario) -> float:
        return 1.0 if scenario.excitation.fate == "hangs" else PATIENCE

    monkeypatch.setattr(Engine, "time", timeout)
    plan = plan_of(str(fates), load(str(fates)), {"excitation.fate": named}, seeds=1)
    found = run_sweep(plan, tmp_path / "out", Engine(jobs=2), quiet=True)
    why = {
        "lives": None,
        "dies": "its process died: exit code 3",
        "is_killed": "its process died: Killed",
        "hangs": "not finished within 1 s",
    }
    assert [row["run"] for row in found.rows] == list(range(len(plan)))
    assert [row["failure"] for row in found.rows] == [
        why[row["excitation.fate"]] for row in found.rows
    ]
    assert found.rows[-1]["theta_perp_ratio"] > 0
    assert "is_killed" in found.command(found.rows[2])
    assert str(found.rows[2]["seed"]) in found.command(found.rows[2])
    page = write_sweep_page(found).read_text()
    assert all(words in page for words in why.values() if words)
    table = pq.read_table(tmp_path / "out" / TABLE)
    assert table["failure"].null_count == 1


@pytest.mark.parametrize("command", ["sweep", "montecarlo"])
def test_flags_of_single_runs_are_refused_for_sweeps(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = shell(command, "scalar_rov", "--live")
    assert code == ExitCode.UNUSABLE and "--live" in said.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["run", "identifier.gain", "time_to_converge"])
def test_an_integer_beyond_64_bits_is_kept_as_text(name: str):
    assert _column(name, [1, 10**400, None]).to_pylist() == ["1", str(10**400), None]
