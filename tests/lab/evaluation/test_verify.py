"""`nsaid verify`: its verdicts on sound runs and on falsified ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj import ConventionalAID, Scenario
from nsaid_mj.base.errors import BadRun
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.evaluation.verify import StatementVerdict, Verification
from nsaid_mj.lab.loop import SimulatedRun, columns, run
from nsaid_mj.lab.record import RECORD_FILE, Record, RecordWriter
from tests.support.faulty import FILES, ROV, flat, shell, strict

LONG = replace(ROV, duration=60.0, pe_window=10.0)
NAMES = ["Theorem 1 (69)", "Theorem 1 (70)", "(30) in (45)", "Lemma 1 (74)", "(75)", "Theorem 2"]
FLAGS = ("--duration", "60", "--held-out", "0.5", "--pe-window", "10")


def judged(run: SimulatedRun) -> tuple[StatementVerdict, ...]:
    return Verification.of_run(run, Truth.of(run)).statements


def words(verdicts: tuple[StatementVerdict, ...]) -> dict[str, str]:
    assert [v.statement for v in verdicts] == NAMES
    return {v.statement: v.verdict for v in verdicts}


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> SimulatedRun:
    return run(LONG, tmp_path_factory.mktemp("honest"))


def altered(
    honest: SimulatedRun, change: Callable[[dict[str, Array], SimulatedRun], None]
) -> SimulatedRun:
    """The run with another record."""
    table = {name: column.copy() for name, column in honest.record.columns.items()}
    change(table, honest)
    return dataclasses.replace(honest, record=Record(table, honest.record.metadata, True))


def turned(table: dict[str, Array], honest: SimulatedRun) -> None:
    """From half-time on θ̂ is back where it began, at its length: Γ ∝ scale², so on its sphere."""
    scale, half = honest.plant.system.space.scale, len(table["t"]) // 2
    theta = table["theta_hat"]
    start = theta[0] / np.linalg.norm(theta[0] / scale)
    theta[half:] = start * np.linalg.norm(theta[half:] / scale, axis=1)[:, None]


def stretched(table: dict[str, Array], honest: SimulatedRun) -> None:
    """From half-time on θ̂ is 1 % longer: as good as before to (14), but not conserved."""
    table["theta_hat"][len(table["t"]) // 2 :] *= 1.01


def unsettled(table: dict[str, Array], honest: SimulatedRun) -> None:
    """At the end v̂ is off as it never was before."""
    table["v_hat"][-len(table["t"]) // 10 :] += 1.0


def test_every_statement_holds_on_a_sound_run(honest):
    verdicts = judged(honest)
    assert words(verdicts) == dict.fromkeys(NAMES, "holds")
    for v in verdicts:
        assert v.number is not None and v.bound is not None and v.words
        assert (v.number > v.bound) == (v.statement == "(75)")


@pytest.mark.parametrize(
    ("change", "fails"),
    [
        (turned, {"Theorem 1 (69)", "Lemma 1 (74)", "Theorem 2"}),
        (stretched, {"(30) in (45)"}),
        (unsettled, {"Theorem 1 (69)", "Theorem 1 (70)"}),
    ],
)
def test_a_falsified_record_fails_its_statements(honest, change, fails):
    said = words(judged(altered(honest, change)))
    found = {name for name, verdict in said.items() if verdict == "fails"}
    assert found == fails
    assert said["(75)"] == "holds"


def test_v_is_not_judged_where_integration_error_could_hide_a_rise(honest):
    said = {v.statement: v for v in judged(altered(honest, stretched))}
    assert said["Theorem 1 (69)"].verdict == "not applicable"
    assert "integrator" in said["Theorem 1 (69)"].words


def test_a_limit_not_yet_reached_is_reported_as_not_yet(tmp_path):
    slow = replace(LONG, identifier=replace(LONG.identifier, gain=0.01), duration=12.0)
    said = {v.statement: v for v in judged(run(slow, tmp_path))}
    assert said["Theorem 2"].verdict == "not yet"
    assert 0.1 < (said["Theorem 2"].number or 0) < 1
    assert said["Theorem 1 (69)"].verdict == said["(30) in (45)"].verdict == "holds"


def test_without_excitation_75_fails_and_theorem_2_does_not_apply(tmp_path):
    excitation = replace(LONG.excitation, amplitude=1e-12)
    said = words(judged(run(replace(LONG, excitation=excitation), tmp_path)))
    assert said["(75)"] == "fails" and said["Theorem 2"] == "not applicable"


@pytest.mark.parametrize(
    ("scenario", "why"),
    [
        (replace(LONG, sensors="noisy"), "sensor noise of 0.0001 m, "),
        (
            replace(
                LONG, plant=replace(LONG.plant, mismatch=replace(LONG.plant.mismatch, lag=0.1))
            ),
            "lag",
        ),
        (replace(LONG, identifier=ConventionalAID(K=10.0, gain=0.3)), "holds parameters"),
    ],
)
def test_under_a_mismatch_the_theorems_do_not_apply(tmp_path, scenario, why):
    verdicts = judged(run(replace(scenario, duration=15.0), tmp_path))
    said = words(verdicts)
    of_itself = said.pop("(30) in (45)")
    assert set(said.values()) == {"not applicable"}
    assert all(why in v.words for v in verdicts if v.statement != "(30) in (45)")
    conventional = isinstance(scenario.identifier, ConventionalAID)
    assert of_itself == ("not applicable" if conventional else "holds")


def test_theorem_2_does_not_apply_to_a_start_in_the_true_set(tmp_path):
    said = words(judged(run(replace(LONG, duration=15.0, initial_error=0.0), tmp_path)))
    assert said["Theorem 2"] == said["Theorem 1 (70)"] == "not applicable"
    assert said["(75)"] == said["(30) in (45)"] == "holds"


def test_windows_longer_than_the_run_judge_nothing(tmp_path):
    said = words(judged(run(replace(LONG, duration=2.0), tmp_path)))
    assert said["(75)"] == "not applicable" and said["Theorem 2"] == "not applicable"


def test_a_record_of_few_rows_is_refused(tmp_path):
    with pytest.raises(BadRun, match="20 are needed"):
        judged(run(replace(LONG, duration=0.1), tmp_path))


# -- the command ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def verified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """`nsaid verify scalar_rov --json`: its folder, and what it printed."""
    folder = tmp_path_factory.mktemp("verified")
    code, said = shell("verify", "scalar_rov", *FLAGS, "--out", folder, "--json")
    assert (code, said.err) == (0, "")
    return folder, strict(said.out)


def test_verify_runs_judges_and_writes(verified):
    folder, document = verified
    assert sorted(path.name for path in folder.iterdir()) == sorted((*FILES, "verify.json"))
    assert strict((folder / "verify.json").read_text(encoding="utf-8")) == document
    assert [s["statement"] for s in document["statements"]] == NAMES
    assert {s["verdict"] for s in document["statements"]} == {"holds"}
    summary = strict((folder / "summary.json").read_text(encoding="utf-8"))
    assert document["scenario_hash"] == summary["scenario_hash"]


def test_verify_gives_the_same_verdicts_from_a_recorded_folder(verified):
    folder, document = verified
    code, said = shell("verify", "--run", folder, "--json")
    assert (code, said.err) == (0, "")
    assert strict(said.out) == document


def test_verify_of_a_falsified_folder_exits_with_1_and_names_what_fails(honest, tmp_path):
    """`turned`, written as a run would write it."""
    record, scenario = altered(honest, turned).record, honest.scenario
    widths = columns(honest.plant.system, honest.scenario)
    writer = RecordWriter(tmp_path / RECORD_FILE, widths, honest.record.metadata, 100)
    writer.extend(*(record[name] for name in widths))
    writer.close()
    assert isinstance(scenario, Scenario)
    code, said = shell("verify", "--run", tmp_path)
    text = flat(said.out)
    assert code == 1 and said.err == ""
    assert "fails Theorem 1 (69): V decreases in every time step V rose in 1 of 6000" in text
    verdicts = strict((tmp_path / "verify.json").read_text(encoding="utf-8"))["statements"]
    assert verdicts[0]["verdict"] == "fails" and verdicts[0]["number"] > verdicts[0]["bound"]


def test_quiet_prints_nothing(verified):
    code, said = shell("verify", "--run", verified[0], "--quiet")
    assert (code, said.out, said.err) == (0, "", "")


@pytest.mark.parametrize("words", [(), ("scalar_rov", "--run", "x"), ("--run", "x", "--duration")])
def test_an_incomplete_command_names_the_help_that_completes_it(words):
    code, said = shell("verify", *words)
    assert code == 2 and said.out == ""
    assert "nsaid" in said.err and "--help" in said.err


def test_a_folder_that_is_no_run_is_refused_in_one_line(tmp_path):
    code, said = shell("verify", "--run", tmp_path)
    assert code == 2 and said.out == ""
    assert said.err.startswith("nsaid: ") and "record.arrow" in said.err
    assert len(said.err.splitlines()) == 1


def test_help_is_on_stdout():
    code, said = shell("verify", "--help")
    assert code == 0 and said.out.startswith("usage: nsaid verify") and "--run FOLDER" in said.out
    code, said = shell("verify", "scalar_rov", "--help")
    assert code == 0 and "nsaid verify scalar_rov" in said.out


def test_75_is_judged_against_what_the_sensors_noise_would_hide(honest):
    """An excitation above rounding errors, but below the noise, is not yet one."""
    said = {}
    for noise in (1e-9, 1e3):
        sensors = replace(honest.scenario.noise, velocity=noise)
        said[noise] = words(judged(replace(honest, scenario=replace(LONG, noise=sensors))))
    assert said[1e-9]["(75)"] == "holds" and said[1e3]["(75)"] == "not yet"
    assert said[1e3]["Theorem 2"] == "holds"
