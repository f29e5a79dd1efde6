"""The architecture: which module may import which, and which may read the truth."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import nsaid_mj
from scripts import mutants

PACKAGE = Path(nsaid_mj.__file__).parent
FILES = {
    ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
    if path != PACKAGE / "__init__.py"
}
HEAVY = {"mujoco", "pinocchio", "rerun", "tyro", "matplotlib", "pyarrow", "rich"}

ORDER = (
    ("errors", "bounds", "parameters", "paper", "log", "resources"),
    ("numerics",),
    ("structure",),
    ("nullspace",),
    ("quotient",),
    ("laws",),
    ("watch",),
    ("robot",),
    ("control",),
    ("plants",),
    ("baselines",),  # below plants: mujoco.sysid wants a MuJoCo model to fit
    ("experiment",),
    ("evaluation",),
    ("logs",),  # below the record: a run can be read as a log
    ("calibration",),
    ("design",),
    ("pages",),
    ("recording",),
    ("studies",),
    ("cli",),
)
"""The house from its foundation up: a part imports from its own line and those before it."""

LINE = {room: number for number, line in enumerate(ORDER) for room in line}


def part(module: str) -> str:
    """The top-level module or package of a module of ours."""
    return module.partition(".")[0]


@cache
def tree_of(path: Path) -> ast.Module:
    """A file's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file's syntax tree."""
    return tuple(ast.walk(tree_of(path)))


@cache
def imports_of(module: str) -> set[str]:
    """All modules of ours that a module's text imports, lazily and for types alone included."""
    names = module.split(".")
    package = names if FILES[module].name == "__init__.py" else names[:-1]
    found = set()
    for node in nodes(FILES[module]):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            base += node.module.split(".") if node.module else []
            for alias in node.names:
                whole = ".".join([*base, alias.name])
                found.add(whole if whole in FILES else ".".join(base))
        elif isinstance(node, ast.Import | ast.ImportFrom):
            absolute = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            absolute += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            assert not [m for m in absolute if part(m) == "nsaid_mj"], (
                f"{module}: write it relative"
            )
    return found - {module, ""}


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Groups of nodes that reach one another."""
    reach = {node: set(graph[node]) for node in graph}
    for middle in graph:
        for node in graph:
            if middle in reach[node]:
                reach[node] |= reach[middle]
    found: list[set[str]] = []
    for node in graph:
        group = {other for other in reach[node] if node in reach.get(other, set())}
        if node in group and group not in found:
            found.append(group)
    return found


def test_every_package_folder_is_in_the_order_of_imports():
    assert {part(module) for module in FILES} == set(LINE)


def test_there_are_at_most_25_rooms():
    assert len(LINE) <= 25


@pytest.mark.parametrize("module", FILES)
def test_a_module_imports_only_from_its_own_line_and_earlier_ones(module):
    later = {m for m in imports_of(module) if LINE[part(m)] > LINE[part(module)]}
    assert not later


def test_no_modules_import_each_other_even_inside_functions():
    own = {m: {n for n in imports_of(m) if not n.startswith(f"{m}.")} for m in FILES}
    assert circles(own) == []


def test_no_two_rooms_import_each_other():
    graph: dict[str, set[str]] = {part(m): set() for m in FILES}
    for module in FILES:
        graph[part(module)] |= {part(m) for m in imports_of(module)} - {part(module)}
    assert circles(graph) == []


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


def test_the_lower_rooms_load_nothing_heavy():
    rooms = ("numerics", "structure", "nullspace", "laws")
    assert not imported("import " + ", ".join(f"nsaid_mj.{room}" for room in rooms)) & HEAVY
    assert not imported("import nsaid_mj.lab.control") & (HEAVY - {"pinocchio"})


def test_structures_import_neither_mujoco_nor_plants():
    structures = [f"nsaid_mj.{module}" for module in FILES if part(module) == "structure"]
    modules = imported(f"import {', '.join(structures)}")
    assert modules.issuperset(structures)
    assert not modules & (HEAVY - {"pinocchio"})


@pytest.mark.parametrize("module", ["experiment.scenario", "experiment.loop", "cli.commands"])
def test_a_run_imports_the_viewer_only_when_it_is_shown(module):
    modules = imported(f"import nsaid_mj.{module}")
    assert not modules & {"rerun", "matplotlib"}
    assert module != "cli.commands" or not modules & (HEAVY | {"numpy", "numba"})


@pytest.mark.parametrize(
    "package,homes",
    [
        ("mujoco", {"robot", "plants", "baselines", "calibration"}),
        ("rerun", {"recording", "logs"}),  # which reads recordings of others
        ("tyro", {"cli", "experiment"}),
        (
            "pinocchio",
            {"robot", "plants", "structure", "recording", "baselines", "calibration", "logs"},
        ),
        ("matplotlib", {"pages"}),
        ("pyarrow", {"experiment", "recording", "studies", "logs"}),
        ("pebble", {"studies"}),
    ],
)
def test_heavy_packages_are_named_only_in_their_own_folders(package, homes):
    assert {part(m) for m, path in FILES.items() if package in written(path)} <= homes


def named(node: ast.Import | ast.ImportFrom) -> list[str]:
    """The modules that an absolute import names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if not node.level else []


def test_pinocchio_is_imported_lazily_wherever_it_is_used():
    """Vehicles run without it: only `structure.optional` names it in an import of a module."""
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
    assert users <= {"plants", "baselines"}


def test_only_experiment_setup_imports_the_expected_gramian():
    """An identifier is handed a Gramian; it does not simulate one."""
    users = {
        m
        for m, path in FILES.items()
        for node in nodes(path)
        if isinstance(node, ast.ImportFrom) and node.module == "expected_gramian"
    }
    assert users == {"experiment.setup"}


def test_identifiers_are_numpy_numba_and_declared_configurations():
    for module, path in FILES.items():
        if part(module) == "laws":
            foreign = written(path) - set(sys.stdlib_module_names) - {"."}
            assert foreign <= {"numpy", "numba", "pydantic", "scipy", "lazy_loader"}, module


SYSID = {"baselines.sysid": {"mujoco", "pinocchio", "numba"}}


def test_laws_import_nothing_of_what_watches_them_and_few_names_cross():
    """A supervisor is a guest: the laws know its protocol only."""
    assert not [m for m, path in FILES.items() if part(m) == "laws" and "watch" in names_from(m)]
    taken = {name for m in FILES if part(m) == "watch" for name in names_from(m).get("laws", ())}
    assert len(taken) <= 14, sorted(taken)


def names_from(module: str) -> dict[str, set[str]]:
    """The names that a module imports from each room."""
    names = module.split(".")
    package = names if FILES[module].name == "__init__.py" else names[:-1]
    found: dict[str, set[str]] = {}
    for node in nodes(FILES[module]):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            base += node.module.split(".") if node.module else []
            if base:
                found.setdefault(base[0], set()).update(alias.name for alias in node.names)
    return found


def test_baselines_are_numpy_and_scipy():
    for module, path in FILES.items():
        if part(module) == "baselines":
            foreign = written(path) - set(sys.stdlib_module_names) - {"."}
            assert foreign <= {"numpy", "scipy"} | SYSID.get(module, set()), module


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


def test_only_evaluation_and_recording_read_the_truth():
    after = {"evaluation", "recording", "pages", "studies"}
    readers = {m for m, path in FILES.items() if readers_of_truth(path)}
    assert {part(m) for m in readers} <= {"plants", "experiment"} | after


def test_the_experiment_reads_the_truth_for_the_prior_only():
    readers = {m for m, path in FILES.items() if readers_of_truth(path)}
    assert {m for m in readers if part(m) == "experiment"} == {"experiment.setup"}
    readers = readers_of_truth(FILES["experiment.setup"])
    assert readers == {"prior_for", "published"}  # the latter of a plant with the published values


def test_evaluation_reads_a_plants_truth_in_one_place():
    """`evaluation.truth.Truth`: everybody else is handed one, or None."""
    readers = {m for m, path in FILES.items() if "truth_at" in attributes(path)}
    assert {m for m in readers if part(m) != "plants"} == {"evaluation.truth"}
    after = {m for m in FILES if part(m) in {"evaluation", "recording", "pages"}}
    assert {m for m in after if "setup" in attributes(FILES[m])} == {"evaluation.truth"}


def test_studies_read_the_truth_only_to_evaluate_runs():
    readers = {"__post_init__", "ratio", "_row", "rows_of"}
    assert readers_of_truth(FILES["studies.montecarlo"]) == readers


def test_a_truth_object_is_made_only_after_a_run():
    makers = {m for m, path in FILES.items() if calls(path) & {"Truth", "truth_of"}}
    assert makers == {
        "cli.commands",
        "evaluation.truth",
        "evaluation.verify",
        "recording.postprocessing",
        "studies.compare",
        "studies.montecarlo",
        "studies.one_run",
        "studies.tracking",
    }


def test_files_and_functions_are_short():
    for path in FILES.values():
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 400, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef):
                assert (node.end_lineno or 0) - node.lineno < 60, (path, node.name)


@pytest.mark.parametrize("file", sorted(mutants.FOLDER.glob("*.toml")), ids=lambda file: file.stem)
def test_every_mutant_changes_a_text_that_its_file_has_once(file: Path):
    assert mutants.mutants_of(file.stem)
