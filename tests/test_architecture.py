"""The house's rules: who may import whom, and who may read the truth."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import nsaid_mj

PACKAGE = Path(nsaid_mj.__file__).parent
FILES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path != PACKAGE / "__init__.py"
}
HEAVY = {"mujoco", "pinocchio", "rerun", "tyro", "matplotlib", "pyarrow", "rich"}
SHOWING = {"cli", "compare", "compare_plots", "finish", "metrics", "options", "progress",
           "recording", "report", "sweep", "sweep_engine", "sweep_report", "sweep_results",
           "sweep_worker", "verify"}  # fmt: skip
RUNNING = {"plants", "scenario", "experiment", "record"} | SHOWING


def part(module: str) -> str:
    """The top-level module or package of a module of ours."""
    return module.partition(".")[0]


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
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add("." if node.level else str(node.module).split(".")[0])
    return found


def test_the_package_itself_is_weightless():
    modules = imported("import nsaid_mj")
    assert ours(modules) == set()
    assert not modules & (HEAVY | {"numpy", "scipy", "numba"})


@pytest.mark.parametrize(
    ("module", "allowed"),
    [
        ("errors", {"errors"}),
        ("parameters", {"errors", "parameters"}),
        ("kernels", {"kernels"}),
        ("spatial", {"spatial"}),
        ("triples", {"triples"}),
        ("recursion", {"kernels", "spatial", "triples", "recursion"}),
        ("loaded", {"kernels", "spatial", "triples", "recursion", "loaded"}),
        ("system", {"errors", "parameters", "kernels", "system"}),
        ("excitation", {"errors", "parameters", "excitation"}),
        ("persistence", {"errors", "parameters", "persistence"}),
        ("nullspace", {"errors", "parameters", "kernels", "system", "nullspace"}),
        ("cone", {"errors", "parameters", "kernels", "cone"}),
        ("rehearsal", {"errors", "parameters", "kernels", "system", "rehearsal"}),
        ("identifiers",
         {"errors", "parameters", "kernels", "spatial", "triples", "recursion", "loaded", "cone",
          "system", "identifiers"}),
        ("baselines",
         {"errors", "parameters", "kernels", "spatial", "triples", "recursion", "loaded", "cone",
          "system", "nullspace", "identifiers", "baselines"}),
    ],
)  # fmt: skip
def test_the_lower_parts_know_arrays_and_the_protocol_only(module, allowed):
    modules = imported(f"import nsaid_mj.{module}")
    assert {part(m) for m in ours(modules)} <= allowed
    assert not modules & HEAVY


@pytest.mark.parametrize("module", [m for m in FILES if part(m) == "systems"])
def test_a_system_knows_no_world(module):
    modules = imported(f"import nsaid_mj.{module}")
    assert {part(m) for m in ours(modules)} <= {"errors", "parameters", "kernels", "spatial",
                                                "triples", "recursion", "loaded", "system",
                                                "systems"}  # fmt: skip
    assert not modules & (HEAVY - {"pinocchio"})


@pytest.mark.parametrize(
    "module,forbidden",
    [
        ("control", RUNNING | {"identifiers"}),
        ("plants", {"identifiers", "control", "scenario", "experiment", "record"} | SHOWING),
        ("scenario", SHOWING | {"experiment", "record"}),
        ("experiment", SHOWING),
        ("record", RUNNING - {"record"} | {"system", "identifiers", "control"}),
        ("cli", RUNNING - {"cli"} | {"system", "identifiers", "control"}),
    ],
)
def test_the_upper_parts_import_one_way(module, forbidden):
    modules = imported(f"import nsaid_mj.{module}")
    assert not {part(m) for m in ours(modules)} & forbidden
    world = {"mujoco"} if module in {"plants", "scenario", "experiment"} else set()
    assert "mujoco" not in modules - world
    assert not modules & {"rerun", "tyro", "matplotlib"}


@pytest.mark.parametrize(
    "package,homes",
    [
        ("mujoco", {"plants"}),
        ("rerun", {"recording"}),
        ("tyro", {"options", "cli"}),
        ("pinocchio", {"plants", "systems", "recording"}),
        ("matplotlib", {"compare_plots", "sweep_report"}),
        ("pyarrow", {"record", "recording", "sweep_results"}),
        ("joblib", {"sweep_engine"}),
    ],
)
def test_a_heavy_package_has_its_home(package, homes):
    assert {part(m) for m, path in FILES.items() if package in written(path)} <= homes


def test_a_sweeps_workers_wait_light():
    """An engine's worker makes no run: its child does."""
    modules = imported("import nsaid_mj.sweep_worker")
    assert ours(modules) == {"errors", "resources", "sweep_worker"}
    assert not modules & (HEAVY | {"numpy", "scipy", "numba"})


def test_mujocos_coordinates_stay_with_the_plants():
    """Everybody else gets the system's: see plants/coordinates.py."""
    theirs = {"qpos", "qvel", "qacc", "xpos", "xquat"}
    users = {
        part(m)
        for m, path in FILES.items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in theirs
    }
    assert users == {"plants"}


def test_only_the_experiment_rehearses():
    """An identifier is handed a Gramian; it does not simulate one."""
    users = {
        m
        for m, path in FILES.items()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module == "rehearsal"
    }
    assert users == {"experiment"}


def test_identifiers_are_numpy_and_numba():
    for module, path in FILES.items():
        if part(module) == "identifiers":
            foreign = written(path) - set(sys.stdlib_module_names) - {"."}
            assert foreign <= {"numpy", "numba"}, module


def test_baselines_are_numpy_and_scipy():
    for module, path in FILES.items():
        if part(module) == "baselines":
            foreign = written(path) - set(sys.stdlib_module_names) - {"."}
            assert foreign <= {"numpy", "scipy"}, module


# -- the wall --------------------------------------------------------------------------------


def readers_of_truth(path: Path) -> set[str]:
    """The functions of a file that read an attribute called `truth` or `truth_at`."""
    tree, found = ast.parse(path.read_text(encoding="utf-8")), set()

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


def test_the_truth_is_read_after_the_fact_only():
    after = {"metrics", "recording", "report", "montecarlo"}
    readers = {m for m, path in FILES.items() if readers_of_truth(path)}
    assert {part(m) for m in readers} <= {"plants", "experiment"} | after


def test_the_experiment_reads_the_truth_for_the_prior_only():
    assert readers_of_truth(FILES["experiment"]) == {"draw_for"}


def test_many_runs_read_the_truth_to_judge_them_only():
    assert readers_of_truth(FILES["montecarlo"]) == {"truth", "nullspace", "_row"}
