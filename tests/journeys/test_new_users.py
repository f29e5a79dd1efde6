"""First paths of new users: the commands of the docs, word for word, and what they lead to.

The owner of an arm with a CSV is in tests/test_readme.py
(`test_the_newcomers_path_leads_to_a_calibrated_robot`), the owner of an arm of position servos in
tests/cli/test_servos.py (`test_three_commands_lead_from_a_lerobot_dataset_to_a_calibrated_file`),
of a robot of MuJoCo Menagerie in tests/clinic/servos/test_menagerie.py, the owner of a
quadrotor with a ULog in tests/clinic/identify/test_flight.py
(`test_two_commands_lead_from_a_px4_log_to_thrust_ratios`).
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from nsaid_mj.report import ExitCode
from tests.support.faulty import CHECKOUT, Heard, shell, strict


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's empty folder, in which commands are given."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def give(page: str, words: str) -> tuple[int, Heard]:
    """Gives a command that a page shows, in a block of its own line or amid a text."""
    text = (CHECKOUT / page).read_text(encoding="utf-8")
    shown = re.findall(r"^(nsaid [^#\n]*?) *(?:#.*)?$|`(nsaid [^`]*)`", text, re.MULTILINE)
    assert words in {line or code for line, code in shown}, f"{page} does not show: {words}"
    return shell(*shlex.split(words)[1:])


def test_a_reader_of_the_paper_checks_its_theorems_on_a_run(folder: Path):
    code, said = give("docs/usage.md", "nsaid verify scalar_rov --out runs/verified")
    assert code == ExitCode.EXPLAINED
    for statement in ("Theorem 1 (70)", "Lemma 1 (74)", "Theorem 2", "(30) in (45)"):
        assert statement in said.out
    found = strict((folder / "runs/verified/verify.json").read_text(encoding="utf-8"))
    assert {each["verdict"] for each in found["statements"]} == {"holds"}


def test_an_rov_engineer_finds_a_thruster_that_loses_thrust(folder: Path):
    command = 'nsaid run bluerov2 --law efficient --faults "loss 0.4 of 3 at 20 s"'
    code, said = give("README.md", command)
    assert code == ExitCode.EXPLAINED
    assert re.search(r"fault found at 20\.\d s: thrust of thruster 3 lost 40 %", said.out)
    summary = strict((folder / "runs/bluerov2-efficient/summary.json").read_text("utf-8"))
    assert summary["actuator_ratio_error"] < 1e-6


@pytest.mark.slow
def test_the_fault_that_the_docs_show_is_what_a_run_prints(folder: Path):
    text = (CHECKOUT / "docs/faults.md").read_text(encoding="utf-8")
    command, _, shown = text.partition("$ nsaid ")[2].partition("```")[0].partition("\n")
    _, said = shell(*shlex.split(command))
    assert all(line in said.out.splitlines() for line in shown.splitlines() if line)


def test_a_reviewer_finds_an_unmodelled_lag_contradicted(folder: Path):
    command = "run bluerov2 --law efficient --sensors noisy --duration 20"
    code, said = give("docs/results.md", f"nsaid {command} --plant.mismatch.lag 0.05")
    assert code == ExitCode.NOT_EXPLAINED
    assert "✘ bluerov2: the motion contradicts this structure" in said.out
    assert shell(*command.split(), "--quiet")[0] == ExitCode.EXPLAINED  # without the lag
