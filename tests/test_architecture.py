"""The architecture: houses and their doors, and which module may read the truth."""

import ast
import random
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from scripts import drawn, mutants
from scripts.houses import STREET, Street, cycles, house_of

OURS = Street()
FILES = OURS.files
HEAVY = {"mujoco", "pinocchio", "rerun", "tyro", "matplotlib", "pyarrow", "rich"}

DOORS = {
    "base": 33,
    "core": 74,
    "watch": 5,
    "robots": 33,
    "report": 45,
    "lab": 55,
    "clinic": 5,
    "plans": 7,
    "cli": 0,
}
"""The most names that other houses may take from each: it only goes down. `python -m scripts.houses
--names HOUSE` lists them."""


def part(module: str) -> str:
    """The place of a module: its house, or in a house of several rooms the room."""
    first, _, rest = module.partition(".")
    room, _, inner = rest.partition(".")
    return f"{first}.{room}" if inner or (OURS.package / first / room).is_dir() else first


@cache
def tree_of(path: Path) -> ast.Module:
    """A file's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file's syntax tree."""
    return tuple(ast.walk(tree_of(path)))


def test_every_folder_of_the_package_is_a_house_of_the_street():
    assert {house_of(module) for module in FILES} == set(STREET)


@pytest.mark.parametrize("house", STREET)
def test_a_house_imports_only_from_houses_before_it(house):
    after = STREET[STREET.index(house) + 1 :]
    taken = {(t.by, t.module, t.name) for t in OURS.crossing if house_of(t.by) == house}
    assert {(by, module, name) for by, module, name in taken if house_of(module) in after} == set()


@pytest.mark.parametrize("house", STREET)
def test_a_house_is_entered_through_its_door_only(house):
    entered = [t for t in OURS.crossing if house_of(t.module) == house]
    assert {(t.by, t.module, t.name) for t in entered if not t.through} == set()


@pytest.mark.parametrize("house", STREET)
def test_a_door_offers_just_the_names_that_others_take(house):
    taken = {name for _, name in OURS.door(house)}
    assert set(OURS.doors.get(house, {})) - {"main", "run_from_shell"} == taken
    assert len(taken) <= DOORS.get(house, 0)


def test_no_modules_import_each_other_even_inside_functions():
    assert cycles(OURS.imports) == []


def imported(statement: str) -> set[str]:
    """What a fresh process has in sys.modules after a statement."""
    code = f"import sys; {statement}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    return set(done.stdout.split())


def ours(modules: set[str]) -> set[str]:
    prefix = "nsaid_mj."
    return {m.removeprefix(prefix) for m in modules if m.startswith(prefix)}


def written(path: Path) -> set[str]:
    """Top-level packages a file imports anywhere; `.` for this one."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("." if node.level else str(node.module).split(".")[0])
    return found


def test_importing_the_package_loads_nothing_heavy():
    modules = imported("import nsaid_mj")
    assert ours(modules) == set()
    assert not modules & (HEAVY | {"numpy", "scipy", "numba"})


@pytest.mark.parametrize("house", ["base", "core", "watch"])
def test_the_lower_houses_load_nothing_heavy(house):
    own = [f"nsaid_mj.{module}" for module in FILES if house_of(module) == house]
    modules = imported(f"import {', '.join(own)}")
    assert modules.issuperset(own)
    assert not modules & (HEAVY - {"pinocchio"})


@pytest.mark.parametrize("house", STREET)
def test_entering_a_door_loads_nothing_behind_it(house):
    modules = imported(f"import nsaid_mj.{house}")
    assert not modules & (HEAVY | {"numpy", "scipy", "numba"})


@pytest.mark.parametrize(
    "module", ["lab.scenario", "lab.loop", "cli.commands", "report.drawings", "report.picture"]
)
def test_a_run_imports_the_viewer_only_when_it_is_shown(module):
    modules = imported(f"import nsaid_mj.{module}")
    assert not modules & {"rerun", "matplotlib"}
    assert module != "cli.commands" or not modules & (HEAVY | {"numpy", "numba"})


@pytest.mark.parametrize(
    "package,homes",
    [
        ("mujoco", {"robots", "lab", "clinic"}),
        ("rerun", {"report", "lab", "clinic", "plans"}),
        ("tyro", {"cli", "lab"}),
        ("pinocchio", {"base", "core", "robots", "report", "lab", "clinic"}),
        ("matplotlib", set()),
        ("pyarrow", {"report", "lab", "clinic", "plans"}),
        ("joblib", {"plans"}),
    ],
)
def test_heavy_packages_are_named_only_in_their_own_houses(package, homes):
    assert {house_of(m) for m, path in FILES.items() if package in written(path)} <= homes


def named(node: ast.Import | ast.ImportFrom) -> list[str]:
    """The modules that an absolute import names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if not node.level else []


def test_pinocchio_is_imported_lazily_wherever_it_is_used():
    """Vehicles run without it: only `base.optional` names it in an import of a module."""
    users = {
        m
        for m, path in FILES.items()
        for node in tree_of(path).body
        if isinstance(node, ast.Import | ast.ImportFrom)
        and {"pinocchio", "coal"} & set(named(node))
    }
    assert users == set()


def test_mujoco_coordinates_are_converted_only_in_plants():
    """Everybody else gets the system's: see plants/coordinates.py."""
    theirs = {"qpos", "qvel", "qacc", "xpos", "xquat"}
    users = {
        part(m)
        for m, path in FILES.items()
        for node in nodes(path)
        if isinstance(node, ast.Attribute) and node.attr in theirs
    }
    assert users == {"lab.plants"}


def test_only_experiment_setup_imports_the_expected_gramian():
    """An identifier is handed a Gramian; it does not simulate one."""
    users = {
        m
        for m, path in FILES.items()
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom) and node.module == "expected_gramian"
    }
    assert users == {"lab.setup"}


def test_identifiers_are_numpy_numba_and_declared_configurations():
    for module, path in FILES.items():
        if part(module) == "core.laws":
            foreign = written(path) - set(sys.stdlib_module_names) - {"."}
            assert foreign <= {"numpy", "numba", "pydantic", "scipy"}, module


def test_baselines_are_numpy_and_scipy():
    for module, path in FILES.items():
        if part(module) == "plans.baselines":
            foreign = written(path) - set(sys.stdlib_module_names) - {"."}
            assert foreign <= {"numpy", "scipy"}, module


# -- the wall --------------------------------------------------------------------------------


@cache
def readers_of_truth(path: Path) -> set[str]:
    """The functions of a file that read an attribute called `truth` or `truth_at`."""
    tree, found = tree_of(path), set()

    def visit(node: ast.AST, function: str) -> None:
        nonlocal found
        if isinstance(node, ast.FunctionDef):
            function = function or node.name
        if isinstance(node, ast.Attribute) and node.attr in {"truth", "truth_at"}:
            attribute = ast.unparse(node)  # `seeds.truth` is a stream of seeds, no true number
            found |= set() if attribute == "seeds.truth" else {function}
        if isinstance(node, ast.Constant) and node.value in {"truth", "truth_at"}:  # getattr
            found.add(function)
        for child in ast.iter_child_nodes(node):
            visit(child, function)

    visit(tree, "")
    return found


def attributes(path: Path) -> set[str]:
    """The names of all attributes that a file reads or writes."""
    return {node.attr for node in nodes(path) if isinstance(node, ast.Attribute)}


def calls(path: Path) -> set[str]:
    """The last names of what a file calls."""
    called = [node.func for node in nodes(path) if isinstance(node, ast.Call)]
    return {f.attr for f in called if isinstance(f, ast.Attribute)} | {
        f.id for f in called if isinstance(f, ast.Name)
    }


AFTER = {"lab.evaluation", "plans.studies", "plans.track", "report", "report.recording"}
"""Where finished runs are evaluated and shown."""


def test_only_evaluation_and_recording_read_the_truth():
    readers = {m for m, path in FILES.items() if readers_of_truth(path)}
    assert {part(m) for m in readers} - {"lab.plants"} - AFTER == {"lab"}


def test_the_wiring_of_a_run_reads_the_truth_for_the_prior_only():
    readers = {m for m, path in FILES.items() if readers_of_truth(path)}
    assert {m for m in readers if part(m) == "lab"} == {"lab.setup"}
    readers = readers_of_truth(FILES["lab.setup"])
    assert readers == {"prior_for"}


def test_evaluation_reads_a_plants_truth_in_one_place():
    """`lab.evaluation.truth.Truth`: everybody else is handed one, or None."""
    readers = {m for m, path in FILES.items() if "truth_at" in attributes(path)}
    assert {m for m in readers if part(m) != "lab.plants"} == {"lab.evaluation.truth"}
    after = {m for m in FILES if part(m) in AFTER - {"plans.studies", "plans.track"}}
    assert {m for m in after if "setup" in attributes(FILES[m])} == {"lab.evaluation.truth"}


def test_studies_read_the_truth_only_to_evaluate_runs():
    readers = {"__post_init__", "ratio", "_row", "rows_of"}
    assert readers_of_truth(FILES["plans.studies.montecarlo"]) == readers


def test_a_truth_object_is_made_only_after_a_run():
    makers = {
        m
        for m, path in FILES.items()
        for node in nodes(path)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in {"Truth", "Truth.of"}
    }
    assert makers == {
        "cli.commands",
        "lab.evaluation.truth",
        "lab.evaluation.verify",
        "lab.postprocessing",
        "plans.studies.compare",
        "plans.studies.montecarlo",
        "plans.studies.one_run",
        "plans.track.tracking",
    }


@pytest.mark.parametrize("file", sorted(mutants.FOLDER.glob("*.toml")), ids=lambda file: file.stem)
def test_every_mutant_changes_a_text_that_its_file_has_once(file: Path):
    assert mutants.mutants_of(file.stem)


def test_a_drawn_fault_is_one_wrong_line_of_a_module_and_has_tests_near():
    files = drawn.rooms()["base"]
    for seed in range(3):
        fault = drawn.drawn(files, random.Random(seed))
        assert fault.before != fault.after
        compile(fault.text, fault.file, "exec")
        assert all((drawn.ROOT / test).is_file() for test in drawn.nearest(fault.file))
