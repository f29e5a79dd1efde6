"""The command line: what it lists, accepts, prints and exits with."""

from __future__ import annotations

import re
import runpy
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import nsaid_mj
from nsaid_mj import ArmPlant, NullspaceAID, Scenario
from nsaid_mj.base import OutputFile
from nsaid_mj.cli import grammar
from nsaid_mj.cli.commands import title_of
from nsaid_mj.cli.grammar import RunOptions
from nsaid_mj.clinic.commands import identify as identifying
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.lab.folders import ResultsFolder
from nsaid_mj.lab.library import load
from nsaid_mj.lab.options import MAIN, ScenarioFlags, parse_flags
from nsaid_mj.lab.scenario import field_paths
from nsaid_mj.report import ExitCode
from nsaid_mj.robots.assets import known_robots, scenarios
from tests.support.faulty import FILES, code_of, flat, shell, strict

HEAVY = (
    "numpy",
    "scipy",
    "numba",
    "mujoco",
    "pinocchio",
    "pyarrow",
    "rerun",
    "matplotlib",
    "example_robot_data",
    "pebble",
)
SCRIPTS = sorted((Path(__file__).parents[2] / "scenarios").glob("*.py"))


# -- list and help -------------------------------------------------------------------------------


def test_list_shows_every_scenario_with_its_title_and_every_robot() -> None:
    code, said = shell("list")
    assert (code, said.err) == (0, "")
    shown = said.out.partition("Robots")[0].splitlines()
    lines = [line.split(maxsplit=1) for line in shown if line.startswith("  ")]
    titles = {line[0]: line[1] for line in lines if len(line) > 1}
    for name, path in scenarios().items():
        assert titles[name].strip() in path.read_text(encoding="utf-8").splitlines()[0]
    robots = said.out.partition("Robots")[2].split()
    assert set(known_robots()) <= set(robots)
    assert {"scalar_rov", "double_pendulum", "ur5", "panda", "arm", "wrong_gains"} <= set(titles)


def loaded_by(*arguments: str) -> tuple[set[str], str]:
    """Which heavy modules a command has imported, and what it has said."""
    code = (
        "import sys, nsaid_mj.cli as cli\n"
        f"sys.argv = ['nsaid', *{list(arguments)!r}]\n"
        "try: cli.run_from_shell()\n"
        "except SystemExit: pass\n"
        f"print('LOADED', *({set(HEAVY)!r} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    out, _, names = done.stdout.partition("LOADED")
    return set(names.split()), out + done.stderr


@pytest.mark.parametrize(
    "words",
    ["--help", "--version", "list", "run --help", "sweep --help", "view --help", "run no", "fly"],
)
def test_light_commands_import_no_heavy_package(words: str) -> None:
    loaded, said = loaded_by(*words.split())
    assert "nsaid" in said
    assert loaded == set()


def test_the_check_for_heavy_modules_detects_them() -> None:
    loaded, _ = loaded_by("run", "ur5", "--help")  # reads the scenario, and simulates nothing
    assert loaded == {"numpy"}


@pytest.mark.parametrize(
    "words", ["--help", "-h", "run --help", "run -h", "view --help", "list -h"]
)
def test_help_is_on_stdout_and_no_error(words: str) -> None:
    code, said = shell(*words.split())
    assert (code, said.err) == (0, "")
    assert said.out.startswith("usage: nsaid")


def test_a_scenarios_help_shows_every_field_with_unit_and_default() -> None:
    code, said = shell("run", "ur5", "--help")
    text = flat(said.out)
    assert code == 0
    for flag in (
        "--duration",
        "--dt",
        "--robot",
        "--plant.damping",
        "--excitation.fundamental",
        "--identifier.K",
        "--noise.velocity",
        "--out",
        "--live",
    ):
        assert flag in text
    assert "simulated time [s]. (default: 60.0)" in text


@pytest.mark.parametrize("words", ["", "fly", "run", "run --quiet", "view", "view a b", "list all"])
def test_an_incomplete_command_names_the_help_that_completes_it(words: str) -> None:
    code, said = shell(*words.split())
    assert code == 2
    assert said.out == "" and "nsaid" in said.err and "--help" in said.err


def test_the_flags_that_matter_come_first() -> None:
    _, said = shell("run", "ur5", "--help")
    flags = re.findall(r"^│ (--[\w.-]+)", said.out, re.MULTILINE)
    assert flags[:8] == [
        "--law",
        "--robot",
        "--duration",
        "--sensors",
        "--seed",
        "--out",
        "--force",
        "--backend",
    ]


@pytest.mark.parametrize("name", ["scalar_rov", "wrong_gains", "bluerov2"])
def test_every_field_of_a_scenario_is_in_its_help(name: str) -> None:
    _, said = shell("run", name, "--help")
    for path in field_paths(load(name)):
        flag = MAIN.get(path, path).replace("_", "-")
        assert f"--{flag} " in said.out or f"--{flag}, " in said.out


def test_the_version_is_printed() -> None:
    code, said = shell("--version")
    assert (code, said.out, said.err) == (0, f"nsaid {nsaid_mj.__version__}\n", "")


# -- which scenario ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "near"), [("scalar_rv", "scalar_rov"), ("UR5", "ur5"), ("pnada", "panda")]
)
def test_an_unknown_scenario_gives_the_near_ones(name: str, near: str) -> None:
    code, said = shell("run", name)
    assert code == 2 and said.out == ""
    assert said.err.startswith(f"nsaid: unknown scenario: '{name}'.")
    assert near in said.err and "is given by its path" in said.err
    assert len(said.err.splitlines()) == 1


def test_an_unknown_scenario_without_near_names_lists_all() -> None:
    _, said = shell("run", "q")
    assert all(name in said.err for name in scenarios())


OWN = '''"""A scenario of one's own, with an excitation of its own."""
from __future__ import annotations
from dataclasses import dataclass
from nsaid_mj import MultisineCommand, NullspaceAID, ScalarRovPlant, Scenario

@dataclass(frozen=True)
class Calm(MultisineCommand):
    """A multisine, gentler.

    Attributes:
        share: of the amplitude.
    """
    share: float = 0.5

    def build(self, system, prior, rng):
        assert self.share == 0.25
        return super().build(system, prior, rng)

scenario = Scenario(
    plant=ScalarRovPlant(), excitation=Calm(), identifier=NullspaceAID(K=10.0, gain=0.3),
    duration=0.5, dt=0.01, pe_window=0.2, held_out=0.2,
)
'''


def test_a_file_is_run_and_its_own_fields_are_flags(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    code, said = shell("run", "mine.py", "--share", "0.25")
    assert code == 0
    assert said.out.startswith("◐ mine: still converging: ")
    assert sorted(path.name for path in (tmp_path / "runs" / "mine-paper").iterdir()) == sorted(
        FILES
    )


def test_a_file_beside_a_known_name_is_asked_for_by_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ur5.py").write_text(OWN)
    (tmp_path / "ur5").write_text("not a scenario")
    monkeypatch.chdir(tmp_path)
    assert isinstance(load("ur5").plant, ArmPlant)
    assert not isinstance(load("ur5.py").plant, ArmPlant)


# -- options -------------------------------------------------------------------------------------


def options(name: str, *arguments: str) -> tuple[Scenario, RunOptions]:
    return parse_flags(name, load(name), arguments, "run", RunOptions)


@pytest.mark.parametrize(
    ("name", "short", "full", "value"),
    [
        ("arm", "--robot", "--plant.robot", "panda"),
        ("ur5", "--friction-speed", "--plant.friction-speed", "0.1"),
        ("ur5", "--friction_speed", "--plant.friction-speed", "0.1"),
        ("ur5", "--armature", "--plant.armature", "0.0"),
        ("ur5", "--K", "--identifier.K", "7.5"),
        ("ur5", "--interpolation", "--identifier.interpolation", "linear"),
        ("ur5", "--velocity", "--noise.velocity", "0.5"),
        ("scalar_rov", "--amplitude", "--excitation.amplitude", "0.2"),
        ("scalar_rov", "--mass", "--plant.mass", "12"),
        ("wrong_gains", "--robot", "--plant.robot", "ur5"),
    ],
)
def test_a_flag_may_be_the_last_part_of_a_fields_name(
    name: str, short: str, full: str, value: str
) -> None:
    one, other = options(name, short, value), options(name, full, value)
    assert one == other == options(name, f"{short}={value}") != options(name)


@pytest.mark.parametrize(
    ("flag", "field", "value"),
    [
        ("--duration", "duration", 7.0),
        ("--seed", "seed", 3),
        ("--dt", "dt", 0.005),
        ("--substeps", "substeps", 4),
        ("--prior", "prior", "nominal"),
        ("--sensors", "sensors", "noisy"),
        ("--record-every", "record_every", 4),
        ("--gain-error", "gain_error", 0.1),
        ("--pe-window", "pe_window", 9.0),
    ],
)
def test_a_scenarios_field_is_a_flag(flag: str, field: str, value: float | str) -> None:
    scenario, output = options("scalar_rov", flag, str(value))
    assert getattr(scenario, field) == value != getattr(load("scalar_rov"), field)
    assert output == RunOptions(scenario="scalar_rov")


def test_out_quiet_json_and_live_are_flags() -> None:
    scenario, output = options("ur5", "--out", "there", "--quiet", "--json", "--live")
    assert scenario == load("ur5")
    assert output == RunOptions(Path("there"), quiet=True, json=True, live=True, scenario="ur5")


def test_a_rivals_fields_are_flags() -> None:
    scenario, _ = options("wrong_gains", "--rivals.conventional.K", "3")
    assert scenario.rivals["conventional"].K == 3.0  # type: ignore[attr-defined]
    assert scenario.identifier == load("wrong_gains").identifier


@pytest.mark.parametrize(
    "words",
    [
        "ur5 --robot panda --friction 2 --law memory --seed 3",
        "astrobee --no-one-sided",
        "bluerov2 --flow 0.1 0 -0.2 --lag 0.05",
        "wrong_gains --rivals.conventional.known actuators mass --gain-error None",
    ],
)
def test_the_reported_flags_reproduce_the_scenario(words: str) -> None:
    name, *flags = words.split()
    scenario, _ = options(name, *flags)
    again = ScenarioFlags(name, load(name)).of(scenario)
    assert options(name, *again)[0] == scenario != load(name)
    assert ScenarioFlags(name, load(name)).of(load(name)) == ()


@pytest.mark.parametrize("flag", ["--plant.mismatch.lag", "--mismatch.lag", "--lag"])
def test_a_flag_may_be_any_unique_end_of_a_fields_name(flag: str) -> None:
    assert options("bluerov2", flag, "0.5")[0].plant.mismatch.lag == 0.5


def test_law_sets_the_identifiers_law_and_not_a_rivals() -> None:
    scenario = Scenario(rivals={"other": NullspaceAID(law="cone")})
    found, _ = parse_flags("x", scenario, ["--law", "memory"], "run", RunOptions)
    assert found.identifier == NullspaceAID(law="memory") and found.rivals == scenario.rivals


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("scalar_rov --dration 3", ("--dration", "--duration")),
        ("ur5 --robt panda", ("--robt", "--robot")),
        ("scalar_rov --dt soon", ("--dt", "'soon'")),
        ("scalar_rov --seed 1.5", ("--seed", "1.5")),
        ("scalar_rov --sensors perfect", ("--sensors", "perfect", "ideal", "noisy")),
        ("scalar_rov --duration", ("--duration",)),
        ("scalar_rov --no-such-flag 3", ("--no-such-flag",)),
        ("scalar_rov --robot ur5", ("--robot",)),
        ("scalar_rov --gain 3", ("--gain", "--identifier.gain", "--plant.gain")),
        ("wrong_gains --K 3", ("--K", "--identifier.K", "--rivals.conventional.K")),
        ("scalar_rov twice", ("twice",)),
    ],
)
def test_a_wrong_option_lists_the_valid_ones(
    words: str, expected: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said = shell("run", *words.split())
    text = flat(said.err)
    assert code == 2 and said.out == ""
    assert all(part in text for part in expected)
    assert f"nsaid run {words.partition(' ')[0]} --help" in text
    assert not list(tmp_path.iterdir())


# -- which folder --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "flags", "title"),
    [
        ("arm", "--robot panda", "panda"),
        ("arm", "--robot robots/my_arm.urdf", "my_arm"),
        ("ur5", "", "ur5"),
        ("ur5", "--law memory", "ur5"),
        ("ur5", "--robot z1", "z1"),
        ("wrong_gains", "", "wrong_gains"),
        ("scalar_rov", "", "scalar_rov"),
    ],
)
def test_a_run_is_named_after_its_robot_or_scenario(
    name: str, flags: str, title: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("nsaid_mj.lab.options._check_plant", lambda _: None)  # no such file
    assert title_of(name, load(name), options(name, *flags.split())[0]) == title


def folder_of(title: str, scenario: Scenario, out: Path | None, force: bool) -> Path:
    with ResultsFolder(out, force).of_run(title, scenario) as folder:
        return folder


@pytest.mark.parametrize(("law", "end"), [("paper", "paper"), ("memory", "memory")])
def test_the_default_folder_is_named_by_robot_and_law(
    law: str, end: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scenario, _ = options("arm", "--robot", "panda", "--law", law)
    assert folder_of("panda", scenario, None, False) == Path(f"runs/panda-{end}")


def pretend(folder: Path, status: str) -> Path:
    """Leaves what a run of this status leaves."""
    folder.mkdir(parents=True)
    (folder / "record.arrow").write_bytes(b"dear")
    OutputFile(folder / "summary.json").write_json({"status": status})
    OutputFile(folder / "record.arrow").sign()
    return folder


def test_a_run_after_a_completed_one_gets_a_numbered_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    scenario = load("scalar_rov")
    first = pretend(Path("runs/scalar_rov-paper"), "completed")
    assert folder_of("scalar_rov", scenario, None, False) == Path("runs/scalar_rov-paper-2")
    pretend(Path("runs/scalar_rov-paper-2"), "completed")
    assert folder_of("scalar_rov", scenario, None, False) == Path("runs/scalar_rov-paper-3")
    assert folder_of("scalar_rov", scenario, None, True) == first


@pytest.mark.parametrize("status", ["plant diverged", "interrupted"])
def test_an_incomplete_run_is_overwritten(
    status: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    first = pretend(Path("runs/scalar_rov-paper"), status)
    assert folder_of("scalar_rov", load("scalar_rov"), None, False) == first
    assert folder_of("scalar_rov", load("scalar_rov"), first, False) == first


@pytest.mark.parametrize("command", ["run", "verify"])
def test_a_named_folder_with_a_completed_run_needs_force(command: str, tmp_path: Path) -> None:
    short = "scalar_rov --duration 1 --held-out 0.5 --pe-window 0.5 --quiet"
    words = (command, *short.split(), "--out", pretend(tmp_path / "out", "completed"))
    code, said = shell(*words)
    assert code == 2 and "--force" in said.err and str(tmp_path / "out") in flat(said.err)
    assert (tmp_path / "out" / "record.arrow").read_bytes() == b"dear"
    assert shell(*words, "--force")[0] in (0, 1)  # 1: a statement fails on so short a run
    assert (tmp_path / "out" / "record.arrow").read_bytes() != b"dear"


# -- scenario scripts ----------------------------------------------------------------------------


def test_every_script_in_scenarios_is_a_packed_scenario() -> None:
    assert [path.stem for path in SCRIPTS] == sorted(scenarios())


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_scenario_is_at_most_forty_lines(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 40


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_scenario_script_is_a_scenario_and_the_same_two_lines(path: Path) -> None:
    """`load` reads the first part of all of them, and the two lines are run below."""
    text = path.read_text(encoding="utf-8")
    assert text.endswith('\n)\n\nif __name__ == "__main__":\n    main(scenario)\n')
    assert load(path.stem) == runpy.run_path(str(path))["scenario"]


LIKE_ANOTHER = {
    "ur5": (
        "arm",
        "kinova",
        "panda",
        "xarm7",
        "z1",
        "double_pendulum",
        "wrist_first",
        "quadruped_stand",
    ),
    "one_axis_at_a_time": ("servo_arm", "wrong_gains"),
    "f1tenth": ("bmw320i", "straight_then_slalom", "catamaran"),
    "crazyflie": ("hummingbird",),
    "quadruped": ("biped",),
    "uvms": ("borinot",),
    "track_payload": ("track_uvms", "track_ur5", "track_bluerov2", "track_astrobee"),
}
"""Scenarios whose pages have the panels of another's, and whose scripts differ in data alone."""
LIKE = {name for names in LIKE_ANOTHER.values() for name in names}
RUN = [pytest.param(path, marks=pytest.mark.slow if path.stem in LIKE else ()) for path in SCRIPTS]


@pytest.mark.parametrize("path", RUN, ids=lambda path: path.stem)
def test_a_scenario_script_runs_as_main(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path), *ALONE])
    code, said = code_of(lambda: runpy.run_path(str(path), run_name="__main__"))
    check_alone(tmp_path, code, said.out, said.err)


def test_a_scenario_script_runs_in_a_process_of_its_own(tmp_path: Path) -> None:
    words = [sys.executable, str(SCRIPTS[0].with_name("scalar_rov.py")), *ALONE]
    ran = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    check_alone(tmp_path, ran.returncode, ran.stdout, ran.stderr)


ALONE = ("--duration", "0.2", "--held-out", "0.5", "--out", "out", "--pe-window", "0.1", "--json")


def check_alone(folder: Path, code: int, out: str, err: str) -> None:
    """What a script with the flags above says and leaves in an empty folder."""
    summary = strict(out)
    assert (code, err) == (ExitCode.of(result_from(summary)), "")
    assert summary["status"] == "completed" and summary["sim_s"] == pytest.approx(0.2, abs=0.01)
    assert sorted(file.name for file in (folder / "out").iterdir()) == sorted(FILES)
    assert [file.name for file in folder.iterdir()] == ["out"]
    stored = Scenario.from_json((folder / "out" / "scenario.json").read_text(encoding="utf-8"))
    assert stored.hash == summary["scenario_hash"]


@pytest.mark.parametrize(
    "words",
    [
        "tx40",
        "tx40 --lock joint_1,joint_2 --cutoff 9",
        "--model a.urdf --log a.csv 'b c.csv' --known gain_1=0.7 --known m=2 --law efficient",
        "--model a.xml --log logs --load x.csv:0.2kg --map m.toml --validate v.csv --limit 8",
    ],
)
def test_the_command_on_a_page_of_identify_repeats_it(words):
    chosen = grammar.parse(shlex.split(f"identify {words} --out there --quiet"))
    again = grammar.parse(shlex.split(identifying.repeated(chosen))[1:])
    assert again == replace(chosen, out=None, quiet=False)
