"""What a run prints and writes: JSON, the terminal, the summary, the same bytes again."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.faulty import FILES, NSAID, Heard, flat, shell, strict

ROV = ("run", "scalar_rov", "--duration", "1", "--held-out", "0.5", "--pe-window", "0.5")


@dataclass(frozen=True)
class Done:
    """A run of the vehicle, in a process of its own, with --json."""

    folder: Path
    code: int
    out: str
    err: str


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Done:
    desk = tmp_path_factory.mktemp("json")
    words = [str(NSAID), *ROV, "--out", "out", "--json"]
    ran = subprocess.run(words, cwd=desk, capture_output=True, text=True, check=False)
    return Done(desk / "out", ran.returncode, ran.stdout, ran.stderr)


KEYS: dict[str, type | tuple[type, ...]] = {  # design.md, "What a number is called"
    "status": str,
    "status_time": float,
    "n": int,
    "p": int,
    "r": int,
    "theta_perp_ratio": float,
    "theta_perp_ratio_initial": float,
    "actuator_ratio_error": float,
    "force_residual_ratio": float,
    "velocity_error_rms": float,
    "conserved_drift": float,
    "lyapunov_violations": int,
    "pe_level": float,
    "pe_level_perp": float,
    "law": str,
    "gamma": str,
    "sensors": str,
    "unobservable": list,
    "wall_s": float,
    "compile_s": float,
    "sim_s": float,
    "real_time_factor": float,
    "identifier_us_per_step": float,
    "plant_us_per_step": float,
    "seed": int,
    "versions": dict,
    "scenario_hash": str,
}


def test_json_is_one_document_and_nothing_else(done: Done) -> None:
    assert (done.code, done.err) == (0, "")
    summary = strict(done.out)
    assert summary == strict((done.folder / "summary.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("key", KEYS)
def test_the_summary_has_every_key_of_the_design(done: Done, key: str) -> None:
    value = strict(done.out)[key]
    assert isinstance(value, KEYS[key]) and not isinstance(value, bool)


def test_the_summarys_numbers_are_consistent(done: Done) -> None:
    summary = strict(done.out)
    assert (summary["status"], summary["status_time"], summary["status_signal"]) == (
        "completed",
        pytest.approx(1.0),
        "",
    )
    assert (summary["n"], summary["p"], summary["r"]) == (1, 4, 1)
    assert summary["law"] in ("paper", "cone", "memory")
    assert summary["gamma"] in ("scale", "simulated") and summary["sensors"] in ("ideal", "noisy")
    assert summary["real_time_factor"] == pytest.approx(summary["sim_s"] / summary["wall_s"])
    spent = summary["identifier_us_per_step"] + summary["plant_us_per_step"]
    assert 0 < spent * 100 * 1e-6 < summary["wall_s"]
    assert summary["actuator_ratio_error"] == 0 and summary["conserved_drift"] < 1e-6
    assert 0 < summary["theta_perp_ratio"] < summary["theta_perp_ratio_initial"] < 1
    assert summary["unobservable"] and all(
        line["direction"] and line["fix"] for line in summary["unobservable"]
    )
    assert {"mujoco", "pin", "numpy", "python"} <= set(summary["versions"])
    assert len(summary["scenario_hash"]) == 12 and int(summary["scenario_hash"], 16) >= 0


@pytest.fixture(scope="module")
def again(done: Done, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Heard]:
    """With --quiet in another process, nothing is printed."""
    folder = tmp_path_factory.mktemp("quiet") / "out"
    code, said = shell(*ROV, "--out", folder, "--quiet")
    assert code == 0
    return folder, said


def test_quiet_prints_nothing(again: tuple[Path, Heard]) -> None:
    folder, said = again
    assert (said.out, said.err, said.warned) == ("", "", [])
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)


@pytest.mark.parametrize("file", ["record.arrow", "scenario.json"])
def test_the_same_command_writes_the_same_bytes(
    done: Done, again: tuple[Path, Heard], file: str
) -> None:
    assert (done.folder / file).read_bytes() == (again[0] / file).read_bytes()


def test_another_seed_writes_other_bytes(done: Done, tmp_path: Path) -> None:
    code, _ = shell(*ROV, "--out", tmp_path, "--quiet", "--seed", "1")
    assert code == 0
    assert (done.folder / "record.arrow").read_bytes() != (tmp_path / "record.arrow").read_bytes()


def test_the_terminal_shows_the_result_and_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = shell(*ROV)
    printed = flat(said.out)
    assert code == 0 and "Traceback" not in said.err
    assert printed.startswith("◐ scalar_rov: still converging: ")
    assert "1 s simulated in" in printed
    assert "× real time" in printed and "3 of 4 directions of θ are observable" in printed
    assert "nsaid view runs/scalar_rov-paper" in printed
    assert sorted(path.name for path in (tmp_path / "runs/scalar_rov-paper").iterdir()) == sorted(
        FILES
    )


def test_the_progress_bar_shows_the_real_time_factor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    monkeypatch.setenv("COLUMNS", "120")
    code, said = shell(
        "run", "scalar_rov", "--duration", "20", "--held-out", "0.5", "--out", tmp_path
    )
    assert code == 0
    assert "of 20 s" in said.err and "× real time" in said.err and "rms Δv" in said.err


@pytest.mark.parametrize("flags", [[], ["-u"]], ids=["buffered", "unbuffered"])
def test_a_closed_pipe_is_no_error(flags: list[str]) -> None:
    listing = subprocess.Popen(
        [sys.executable, *flags, str(NSAID), "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert listing.stdout is not None and listing.stderr is not None
    listing.stdout.close()
    assert listing.stderr.read() == b""
    assert listing.wait() == 0
