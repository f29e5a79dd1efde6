"""README and docs: the Python runs, the commands exist, and every reference resolves."""

import json
import os
import re
import shlex
from functools import cache
from importlib import import_module
from pathlib import Path
from unittest import mock

import mujoco
import numpy as np
import pytest

from nsaid_mj import ArmPlant, FourierTracking, Scenario
from nsaid_mj.lab.evaluation.summary import result_from
from nsaid_mj.report import ExitCode
from nsaid_mj.robots.assets import known_robots, scenarios
from tests.support.faulty import shell

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"
PAGES = (README, ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md")))

FENCE = re.compile(r"^```(\w*)(?: title=\"\S+\")?\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PICTURE = r"!\[[^\]]*\]\(([^)\s]+)\)"
LINK = r"(?<!!)\[(?:!\[[^\]]*\]\([^)\s]+\)|[^\]!])*\]\(([^)\s]+)\)"  # of text or of a picture
DEFINITION = r"^\[[^\]]+\]: (\S+)"
CODE = re.compile(r"`((?:[^`\n]|\n(?!\n))+)`")  # it may run over the end of a line


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(page: Path, language: str) -> list[str]:
    """The fenced blocks of a page in one language."""
    return [body for kind, body in FENCE.findall(page.read_text("utf-8")) if kind == language]


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return FENCE.sub("", page.read_text("utf-8"))


def inline(page: Path) -> list[str]:
    """The pieces of code in the prose of a page, each on one line."""
    return sorted({" ".join(code.split()) for code in CODE.findall(prose(page))})


def commands(page: Path) -> list[list[str]]:
    """The command lines of a page, without comments, and without those for a NAME to fill in."""
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    lines += [code for code in inline(page) if re.match(r"(nsaid|make|python scripts)\b.", code)]
    return [
        words
        for line in lines
        if (words := shlex.split(line, comments=True)) and not any(map(str.isupper, words))
    ]


# -- the README's own robot --------------------------------------------------------------------

LINKS = (
    ("shoulder", "0 0 0.2", "0 0 1", 4.0, "0 0.02 0.1", 0.02),
    ("elbow", "0 0 0.2", "0 1 0", 2.5, "0.2 0 0.03", 0.03),
    ("wrist", "0.4 0 0", "0 1 0", 1.2, "0.15 0.01 0", 0.008),
)
DT = 0.002


def arm_urdf() -> str:
    """A three-joint arm: place and axis of each joint; mass, centre and inertia of its link."""
    parts, parent = ['<robot name="my_arm"><link name="base"/>'], "base"
    for name, place, axis, mass, centre, inertia in LINKS:
        parts.append(
            f'<link name="{name}_link"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
            f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>'
            f'</inertial></link><joint name="{name}" type="revolute"><origin xyz="{place}"/>'
            f'<parent link="{parent}"/><child link="{name}_link"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="100" velocity="3"/></joint>'
        )
        parent = f"{name}_link"
    return "".join([*parts, "</robot>"])


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder with the URDF that the README speaks of."""
    (tmp_path / "my_arm.urdf").write_text(arm_urdf())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def execute(code: str) -> dict[str, object]:
    """The names that a piece of code defines."""
    names: dict[str, object] = {"__name__": "readme"}
    exec(compile(code, str(README), "exec"), names)
    return names


def example_with(text: str) -> str:
    """The one Python block of the README with a given piece of text."""
    (found,) = [code for code in blocks(README, "python") if text in code]
    return found


@pytest.fixture
def true_gains(workplace: Path) -> np.ndarray:
    """Writes my_log.csv, a noisy log of another arm; returns its gains.

    Gains and friction are up to 30 % off the nominal ones. The recorded current is in other units.
    """
    real = ArmPlant(
        robot="my_arm.urdf", damping=1.0, friction=0.5, armature=0.05, spread=0.3
    ).build(DT, seed=1)
    driver = FourierTracking(fundamental=0.2, harmonics=10).build(
        real.system, real.truth, np.random.default_rng(0)
    )
    with real.running():
        log = real.trajectory(driver, round(20 / DT))
    rng = np.random.default_rng(2)
    q = log.q + 1e-4 * rng.standard_normal(log.q.shape)
    v = log.v + 5e-3 * rng.standard_normal(log.v.shape)
    names = [f"{kind}{i}" for kind in ("q", "dq", "current") for i in (1, 2, 3)]
    table = np.column_stack([log.t, q, v, log.u])
    np.savetxt("my_log.csv", table, delimiter=",", header=",".join(["t", *names]), comments="")
    true = real.truth[real.system.space.actuators]
    assert np.abs(true / true[0] - 1).max() > 0.1  # else equal gains would pass
    return true


def test_the_readmes_log_example_finds_the_motor_gains(true_gains: np.ndarray) -> None:
    found = np.asarray(execute(example_with("my_log.csv"))["gains"])
    assert found / found[0] == pytest.approx(true_gains / true_gains[0], rel=0.03)


def test_the_newcomers_path_leads_to_a_calibrated_robot(
    true_gains: np.ndarray, workplace: Path
) -> None:
    """Every command of docs/your_robot.md, in its order, and its Python."""
    page = ROOT / "docs" / "your_robot.md"
    for block in blocks(page, "sh"):
        for line in block.splitlines():
            code, said = shell(*shlex.split(line)[1:])
            assert code == 0, said.err
    assert (workplace / "map.toml").is_file() and (workplace / "inspection.html").is_file()
    for name in (
        "report.html",
        "run.rrd",
        "my_arm.urdf",
        "my_arm.xml",
        "calibrated.yaml",
        "identification.json",
        "sysid.yaml",
    ):
        assert (workplace / "calibrated" / name).is_file()
    model = mujoco.MjModel.from_xml_path("calibrated/my_arm.xml")
    gains = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0]
    assert gains == pytest.approx(true_gains * 0.72 / true_gains[0], rel=0.03)
    for code in blocks(page, "python"):
        found = execute(code)["found"]
        gains = np.array([gain.value for gain in found.of("motor gain")])
        assert gains == pytest.approx(true_gains * 0.72 / true_gains[0], rel=0.03)
        assert mujoco.MjModel.from_xml_path("from_python/my_arm.xml").nu == len(gains)


def test_every_python_block_of_the_readme_is_run_here() -> None:
    assert len(blocks(README, "python")) == 1


def test_the_scenario_of_the_usage_page_runs_from_python(workplace: Path) -> None:
    script, more = blocks(ROOT / "docs" / "usage.md", "python")
    names = execute(script + more)
    assert isinstance(names["scenario"], Scenario)
    theta_hat = np.asarray(names["theta_hat"])
    assert theta_hat.shape == (2001, 84)
    assert np.isfinite(theta_hat).all() and (theta_hat[0] != theta_hat[-1]).any()
    assert (workplace / "runs" / "ur5-from-python" / "record.arrow").is_file()


# -- commands ----------------------------------------------------------------------------------


@cache
def help_of(*words: str) -> str:
    """The help of a command line, on a wide terminal."""
    with mock.patch.dict(os.environ, COLUMNS="200"):
        code, said = shell(*words, "--help")
    assert code == 0, said.err
    return said.out


def flags(*words: str) -> frozenset[str]:
    """The flags that the help of a command line names."""
    return frozenset(re.findall(r"--([A-Za-z][\w.-]*)", help_of(*words)))


def known(flag: str, offered: frozenset[str]) -> bool:
    """Whether a flag is offered, in full or by its last name."""
    return any(full == flag or full.endswith(f".{flag}") for full in offered)


VERBS = ("run", "verify", "compare", "sweep", "montecarlo", "track")  # they take a scenario
COMMANDS = {name_of(page): commands(page) for page in PAGES if commands(page)}


def test_the_readme_gives_make_demo_and_make_test() -> None:
    assert {("make", "demo"), ("make", "test")} <= {tuple(words) for words in COMMANDS["README.md"]}


@pytest.mark.parametrize("page", COMMANDS)
def test_every_make_target_in_the_docs_exists(page: str) -> None:
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for program, *words in COMMANDS[page]:
        if program == "make":
            assert re.search(rf"^{words[0]}:", makefile, re.MULTILINE), words[0]


@pytest.mark.parametrize("page", COMMANDS)
def test_every_script_in_the_docs_takes_its_flags(page: str) -> None:
    for words in (words for words in COMMANDS[page] if words[0] == "python"):
        script = words[2].replace(".", "/") + ".py" if words[1] == "-m" else words[1]
        text = (ROOT / script).read_text("utf-8")
        used = {word for word in words if word.startswith("--")}
        assert {flag for flag in used if f'"{flag}"' not in text} == set(), script


@pytest.mark.parametrize("page", COMMANDS)
def test_every_nsaid_command_in_the_docs_takes_its_flags(page: str) -> None:
    offered = flags()
    listed = help_of()
    for program, *words in COMMANDS[page]:
        if program != "nsaid":
            continue
        used = {word.removeprefix("--").partition("=")[0] for word in words if word[:2] == "--"}
        if words[0].startswith("--"):
            assert used <= offered, words
            continue
        verb, *rest = words
        assert verb in listed, verb
        offered_here = flags(verb)
        if verb in VERBS and rest and rest[0][:2] != "--":
            assert rest[0] in scenarios() or rest[0].endswith((".py", ".json")), rest[0]
            scenario = rest[0] if rest[0] in scenarios() else "ur5"
            offered_here |= flags(verb, scenario) | flags("run", scenario)
        assert {flag for flag in used if not known(flag, offered_here | {"help"})} == set(), words


@pytest.mark.parametrize("page", [name_of(page) for page in PAGES if page.name != "CHANGELOG.md"])
def test_every_flag_named_in_the_docs_exists(page: str) -> None:
    used = {
        words[0].removeprefix("--").partition("=")[0]
        for code in inline(ROOT / page)
        if (words := code.split()) and words[0].startswith("--")
    }
    offered = flags().union(
        *map(flags, VERBS),
        flags("identify"),
        flags("inspect"),
        flags("excite"),
        flags("live"),
        flags("track"),
        flags("run", "ur5"),
        flags("run", "bluerov2"),
    )
    assert {flag for flag in used if not known(flag, offered)} == set()


def robots_named() -> set[str]:
    lines = [words for page in COMMANDS.values() for words in page]
    return {words[words.index("--robot") + 1] for words in lines if "--robot" in words}


def test_every_robot_in_the_docs_is_known() -> None:
    packed = {name for name in robots_named() if not name.endswith((".urdf", ".xml"))}
    assert packed <= set(known_robots())


def test_the_readmes_commands_identify_the_users_own_urdf(workplace: Path) -> None:
    runs = [
        words[1:]
        for words in COMMANDS["README.md"]
        if "my_arm.urdf" in words and words[1] == "run" and "--help" not in words
    ]
    assert len(runs) == 3
    for number, words in enumerate(runs):
        short = ["--duration", "0.3", "--held-out", "0.2", "--pe-window", "0.1"]
        code, said = shell(*words, *short, "--out", f"out{number}", "--quiet")
        summary = json.loads((workplace / f"out{number}" / "summary.json").read_text("utf-8"))
        assert code == ExitCode.of(result_from(summary)), said.err  # so short a run may end with ✘


# -- links and references ----------------------------------------------------------------------


def targets(text: str) -> set[str]:
    """Where the links and pictures of a text lead; a picture inside a link counts as well."""
    patterns = (PICTURE, LINK, DEFINITION)
    return {target for each in patterns for target in re.findall(each, text, re.MULTILINE)}


def slugs(page: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(page: Path) -> list[str]:
    """The relative links of a page that lead nowhere."""
    found = []
    for target in sorted(targets(prose(page))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = page.parent / path if path else page
        if not file.exists() or (anchor and anchor not in slugs(file)):
            found.append(target)
    return found


def test_the_link_checker_sees_pictures_links_and_anchors(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# A page: here\n[a](#a-page-here) [b](#elsewhere) [![c](c.png)](page.md) "
        "![d](d.png) [e](https://example.org/x) [f](page.md#nowhere) [h]\n\n[h]: h.md\n"
        "```sh\n[g](g.md)\n```\n"
    )
    assert broken(page) == ["#elsewhere", "c.png", "d.png", "h.md", "page.md#nowhere"]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_relative_links_and_pictures_lead_somewhere(page: Path) -> None:
    assert broken(page) == []


def test_the_readme_has_at_most_120_lines() -> None:
    assert len(README.read_text("utf-8").splitlines()) <= 120


# A changelog speaks of files as they were: what it names may be gone.
REFERENCES = {name_of(page): inline(page) for page in PAGES if page.name != "CHANGELOG.md"}


def exists(path: str) -> bool:
    """Whether a path, `*` and <placeholders> allowed, is in the checkout or the package."""
    pattern = re.sub(r"<[^>]*>", "*", path).rstrip("/")
    return any(True for base in (ROOT, ROOT / "nsaid_mj") for _ in base.glob(pattern))


@pytest.mark.parametrize("page", REFERENCES)
def test_files_named_in_the_docs_exist(page: str) -> None:
    files = [
        code
        for code in REFERENCES[page]
        if re.fullmatch(r"[\w./*<>-]+", code)
        and (
            code.endswith(".py")
            or code.split("/")[0] in {"scripts", "tests", "assets", "scenarios"}
        )
        and not code.startswith("my_")
    ]
    assert [code for code in files if not exists(code)] == []


def test_the_architecture_page_lists_every_house() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text("utf-8").partition("## The street")[2]
    first_cells = re.findall(r"^\|([^|]*)\|", text.partition("\n## ")[0], re.MULTILINE)
    listed = {code.rstrip("/") for cell in first_cells for code in CODE.findall(cell)}
    package = ROOT / "nsaid_mj"
    rooms = {path.stem for path in package.glob("*.py")} - {"__init__"}
    assert listed == rooms | {path.parent.name for path in package.glob("*/__init__.py")}


@pytest.mark.parametrize("page", REFERENCES)
def test_functions_named_in_the_docs_exist(page: str) -> None:
    for code in REFERENCES[page]:
        head, *rest = code.split(".")
        if not re.fullmatch(r"[a-z_]+(\.\w+)+", code) or code.endswith((".py", ".json", ".html")):
            continue
        if not exists(head) and not exists(f"{head}.py"):
            continue
        *modules, name = rest
        module = import_module(".".join(["nsaid_mj", head, *modules]))
        assert hasattr(module, name), code


@pytest.mark.parametrize("page", REFERENCES)
def test_tests_named_in_the_docs_exist(page: str) -> None:
    """A name that ends in … stands for all tests that begin so."""
    text = "".join(path.read_text("utf-8") for path in (ROOT / "tests").rglob("test_*.py"))
    named = {code for code in REFERENCES[page] if re.fullmatch(r"test_\w+…?", code)}
    begun = {name: f"def {name[:-1]}" if name[-1] == "…" else f"def {name}(" for name in named}
    assert {name for name, start in begun.items() if start not in text} == set()
