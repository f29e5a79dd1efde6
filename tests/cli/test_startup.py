"""Packages that a run must not import at its start."""

import json
import subprocess
import sys
from pathlib import Path
from typing import get_args, get_type_hints

import example_robot_data
import pytest

from nsaid_mj.base.choices import CHOICES
from nsaid_mj.clinic.identify.choose.columns import COLUMNS, EXTRA
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.lab.control.adaptive.tracker import Law
from nsaid_mj.plans.baselines import BATCH
from nsaid_mj.robots.assets import scenarios
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.loading import load_robot
from scripts.entered import entered, files


def modules_after(code: str) -> set[str]:
    """What a fresh process has imported at its end, whatever else it prints."""
    program = f"import sys, atexit\natexit.register(lambda: print('\\n', *sys.modules))\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=120
    )
    return set(done.stdout.splitlines()[-1].split())


def test_a_run_and_its_report_import_only_what_they_use():
    modules = modules_after("import nsaid_mj.lab.postprocessing, nsaid_mj.lab.loop")
    assert "nsaid_mj.lab.evaluation.page" in modules
    assert not modules & {"rerun", "matplotlib", "jinja2", "pyarrow.compute", "pebble", "dask"}
    assert not modules & {"scipy.signal", "scipy.optimize", "scipy.interpolate", "scipy.stats"}


def test_meshes_are_loaded_on_first_access():
    robot, theirs = load_robot("solo12", "free"), example_robot_data.load("solo12")
    assert "parts" not in vars(robot.visuals)
    for model in (robot.model, theirs.model):  # the loader limits the base, which nothing reads
        model.lowerPositionLimit[:7] = model.upperPositionLimit[:7] = 0.0
    for pose in theirs.model.referenceConfigurations:  # nor these
        robot.model.referenceConfigurations[pose.key()] = pose.data()
    assert robot.model == theirs.model
    found = [(p.mesh.name, p.place, len(p.mesh.triangles)) for p in robot.visuals.parts]
    wanted = theirs.visual_model.geometryObjects
    assert found == [(g.name, g.placement, g.geometry.num_tris) for g in wanted]
    assert found


def test_a_fixed_base_robots_meshes_belong_to_its_fixed_base_model():
    robot = load_robot("solo12")
    assert robot.model.nv == 12
    parents = {part.joint for part in robot.visuals.parts}
    assert max(parents) == robot.model.njoints - 1


@pytest.mark.parametrize("name", ["cassie", "talos_legs"])
def test_a_robot_that_no_urdf_describes_is_refused(name):
    assert load_robot("ur5").visuals.parts
    with pytest.raises(BadRobot, match=name):
        load_robot(name)


# -- answers before anything heavy is imported ---------------------------------------------------

HEAVY = {"numba", "mujoco", "pinocchio", "scipy", "matplotlib", "pyarrow", "rerun", "lxml"}

WRONG = [
    "run nosuch",
    "run ur5 --nosuch 1",
    "run ur5 --duration abc",
    "run ur5 --duration -1",
    "run arm --robot nosuch",
    "run bluerov2 --vehicle nosuch",
    "run ur5 --excitation other",
    "run ur5 --excitation designed:nosuch",
    "identify nosuch",
    "identify --model nosuch.urdf --log log.csv",
    "identify tx40 --log nosuch.csv",
    "identify tx40 --log empty.csv",
    "identify tx40 --log log.csv --validate nosuch.csv",
    "identify tx40 --log log.csv --map nosuch.toml",
    "identify tx40 --log log.csv --map no.toml",
    "identify tx40 --log log.csv --map odd.toml",
    "identify tx40 --nosuch",
    "identify tx40 --law nosuch",
    "identify tx40 --delay abc",
    "identify tx40 --known abc",
    "identify tx40 --load abc",
    "identify tx40 --columns nosuch",
    "inspect nosuch.csv",
    "inspect log.csv --map nosuch.toml",
    "inspect log.csv --model nosuch",
    "live --model nosuch",
    "live --model ur5 --law nosuch",
    "live --model ur5 --frame nosuch",
    "track nosuch",
    "track track_ur5 --laws nosuch",
    "track track_ur5 --seeds abc",
    "excite nosuch",
    "excite --model nosuch",
    "excite ur5 --limits nosuch.toml",
    "excite ur5 --criterion nosuch",
    "excite ur5 --noise abc",
    "compare nosuch",
    "compare ur5 --methods nosuch",
    "compare ur5 --sensors nosuch",
    "compare --log nosuch.csv --models ur5",
    "compare --log log.csv --models nosuch.xml",
    "sweep nosuch",
    "sweep ur5 --vary nosuch=1",
    "sweep ur5 --vary identifier.gain=abc",
    "sweep ur5 --engine nosuch",
    "montecarlo ur5 --runs abc",
    "verify nosuch",
    "verify --run nosuch",
    "report nosuch",
    "view nosuch",
]


FILES = {"log.csv": "t,q\n0,0\n", "empty.csv": "", "no.toml": "a = [\n"}
FILES |= {"odd.toml": "[nonsense]\nx = 1\n"}

ONE_AFTER_ANOTHER = """
import contextlib, io, json, os, sys
from nsaid_mj.base.errors import NsaidError
from nsaid_mj.cli.commands import command
commands, heavy = json.loads(sys.argv[1])
found = []
for words in commands:
    unseen = io.StringIO()
    with contextlib.redirect_stdout(unseen), contextlib.redirect_stderr(unseen):
        try:
            code = command(words.split())
        except NsaidError:
            code = 2
        except SystemExit as end:
            code = end.code
    found.append([code, sorted(set(heavy) & set(sys.modules)), sorted(os.listdir())])
print(json.dumps(found))
"""
"""Executes commands in one process; prints codes, heavy modules that are imported, and files."""


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, list[str], list]]:
    """Exit code, heavy modules and files after each wrong command, in a process for all."""
    folder = tmp_path_factory.mktemp("wrong")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    given = json.dumps([WRONG, sorted(HEAVY)])
    done = subprocess.run(
        [sys.executable, "-c", ONE_AFTER_ANOTHER, given],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=240,
    )
    return dict(zip(WRONG, json.loads(done.stdout), strict=True))


@pytest.mark.parametrize("command", WRONG)
def test_a_wrong_argument_is_answered_before_anything_heavy_is_imported(
    command: str, answers: dict[str, tuple[int, list[str], list]]
) -> None:
    assert answers[command] == [2, [], sorted(FILES)]


@pytest.mark.parametrize("command", ["run nosuch", "identify tx40 --log nosuch.csv"])
def test_a_process_of_its_own_answers_so_too(command: str, tmp_path: Path) -> None:
    code, modules = entered(command.split(), tmp_path)
    assert code == 2 and not modules & HEAVY and not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["--help", "run --help", "identify --help", "list"])
def test_help_imports_neither_numpy_nor_pydantic(command: str) -> None:
    code, modules = entered(command.split())
    assert code == 0
    assert not modules & (HEAVY | {"numpy", "pydantic"})


def test_the_help_of_a_scenario_imports_nothing_that_simulates_or_compiles() -> None:
    code, modules = entered(["run", "uvms", "--help"])
    assert code == 0
    assert not modules & HEAVY


def test_scenarios_are_read_without_anything_that_simulates_or_compiles() -> None:
    names = sorted(scenarios())
    code = f"from nsaid_mj.lab.library import load\nfor name in {names!r}: load(name).to_json()"
    assert not modules_after(code) & HEAVY


def test_identify_is_imported_without_what_it_needs_to_fit() -> None:
    assert not modules_after("from nsaid_mj import identify") & HEAVY


def test_a_simulated_run_enters_nothing_of_logs_of_real_robots_or_of_other_plans(
    tmp_path: Path,
) -> None:
    short = ["--duration", "1", "--held-out", "0.5", "--pe-window", "0.5", "--out", "run"]
    code, modules = entered(["run", "double_pendulum", *short], tmp_path)
    assert code in (0, 1)
    houses = {name.partition(".")[0] for name in files(modules)}
    assert not houses & {"clinic", "plans"}
    others = {"plans.baselines", "lab.plants.uvms", "lab.control.quadrotor", "robots.mjcf"}
    assert not others & set(files(modules))


# -- words of commands ---------------------------------------------------------------------------


def test_words_to_choose_from_are_those_that_the_code_knows() -> None:
    assert get_args(get_type_hints(NullspaceAID)["law"]) == CHOICES["law of a run"]
    methods = ("conventional", *CHOICES["law of a run"], *BATCH, "sysid")
    assert methods == CHOICES["method"]
    assert get_args(Law) == CHOICES["tracking law"]
    assert set(CHOICES["column"]) == set(COLUMNS)
    assert set(CHOICES["column of a vehicle"]) == set(EXTRA)
