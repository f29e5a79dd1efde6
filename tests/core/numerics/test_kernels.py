"""Where compiled kernels are cached, and what counts as compile time."""

import ast
import os
import subprocess
import sys
import time
from functools import cache as once
from pathlib import Path

import pytest

import nsaid_mj
from nsaid_mj.core.laws.cone.law import ConeMetric
from nsaid_mj.core.laws.metric import ConstantMetric
from nsaid_mj.core.laws.rk4 import flow_in
from nsaid_mj.core.numerics import cache
from nsaid_mj.core.numerics.errors import NoKernelCache
from nsaid_mj.core.numerics.kernels import callees, named

PACKAGE = Path(nsaid_mj.__file__).parent
SHOW = "from nsaid_mj.core.numerics import cache; import numba; print(numba.config.CACHE_DIR)"


def process(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    clean = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    return subprocess.run(
        [sys.executable, "-c", code],
        env=clean | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A small package laid out as ours is."""
    texts = {
        "__init__": "",
        "base/__init__": "",
        "base/units": "",
        "base/clock": "",
        "core/__init__": "",
        "core/structure/tree": "",
        "core/laws/filter": "import numba\n\n\ndef late():\n    from ..lately import LENGTH\n",
        "core/lately": "",
        "lab/__init__": "",
        "lab/plants/forces": "from .world import sheet\n\n\n@kernel()\ndef push(): ...\n",
        "lab/plants/world/__init__": "",
        "lab/plants/world/sheet": "from ....base import (\n    METRE,\n    SECOND,\n)\n",
        "lab/plants/arm": "from .forces import thrust\n",
        "cli/commands": "",
    }
    for name, text in texts.items():
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(exist_ok=True, parents=True)
        path.write_text(f'"""Doc."""\n{text}')
    door = "from .units import METRE as METRE\nfrom .clock import now as now\n"
    (tmp_path / "base" / "__init__.pyi").write_text(door)
    return tmp_path


@pytest.mark.parametrize(
    "changed",
    [
        "core/structure/tree",
        "core/structure/new",
        "lab/plants/forces",
        "lab/plants/world/sheet",
        "lab/plants/world/__init__",
        "base/units",
        "core/laws/filter",
        "core/lately",
    ],
)
def test_digest_changes_with_any_source_that_a_kernel_may_depend_on(package: Path, changed: str):
    before = cache.digest(package)
    with (package / f"{changed}.py").open("a") as file:
        file.write("LENGTH = 2\n")
    assert cache.digest(package) != before


def test_digest_stays_where_no_kernel_can_depend_on_the_change(package: Path):
    before = cache.digest(package)
    for name in (
        "cli/commands.py",
        "lab/plants/arm.py",
        "base/clock.py",
    ):  # importing a kernel does not change it
        with (package / name).open("a") as file:
            file.write("LENGTH = 2\n")
    (package / "core" / "structure" / "__pycache__").mkdir()
    (package / "core" / "structure" / "__pycache__" / "tree.py").write_text("LENGTH = 2\n")
    os.utime(package / "base" / "units.py", (0, 0))
    assert cache.digest(package) == before


def test_digest_of_the_whole_package_takes_less_than_20_ms():
    cache.digest()
    times = []
    for _ in range(5):
        begin = time.process_time()  # other processes do not count
        cache.digest()
        times.append(time.process_time() - begin)
    assert min(times) < 0.02


@once
def rooms_with_kernels() -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "numba" in text else ():
            names = (
                [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            )
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if any(name.partition(".")[0] == "numba" for name in names):
                found.setdefault(path.relative_to(PACKAGE).parts[0], []).append(path)
    return found


def test_sources_of_kernels_contain_every_file_that_imports_numba_and_all_that_it_imports():
    """By syntax trees, imports inside functions included, where the digest searches the text."""
    counted = set(cache.kernel_sources())
    left = {str(p.relative_to(PACKAGE)) for paths in rooms_with_kernels().values() for p in paths}
    left |= {str(path.relative_to(PACKAGE)) for path in PACKAGE.rglob("*.py") if compiles(path)}
    seen: set[str] = set()
    while left:
        path = left.pop()
        seen.add(path)
        left |= imports(path) - seen
    assert {path.removesuffix(".py") for path in seen} <= counted


MARKS = ("kernel(", "helper(", "routine(", "njit(")


def compiles(path: Path) -> bool:
    """Whether a file marks a function as compiled."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    marks = [
        mark
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        for mark in node.decorator_list
    ]
    return any(ast.unparse(mark).startswith(MARKS) for mark in marks)


def imports(path: str) -> set[str]:
    """Files of the package that a file of it imports."""
    found = set()
    for node in ast.walk(ast.parse((PACKAGE / path).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = (
                (PACKAGE / path).parents[node.level - 1].joinpath(*(node.module or "").split("."))
            )
            found |= {base.with_suffix(".py"), base / "__init__.py"}
            found |= {base / f"{alias.name}.py" for alias in node.names}
    return {str(each.relative_to(PACKAGE)) for each in found if each.is_file()}


def test_files_with_kernels_set_the_cache_directory_before_they_define_one():
    """By a decorator of `core.numerics.kernels`, which the file imports at its top."""
    for path in (path for paths in rooms_with_kernels().values() for path in paths):
        if path.parent.name == "numerics" or not compiles(path):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        own = [node for node in tree.body if isinstance(node, ast.ImportFrom) and node.level]
        names = {alias.name for node in own for alias in node.names}
        assert names & {"kernel", "helper", "routine", "kernel_for", "composed"}, path


def test_kernels_are_kept_in_the_users_cache_directory(tmp_path: Path):
    folder = Path(process(SHOW, XDG_CACHE_HOME=str(tmp_path)).stdout.strip())
    assert folder == tmp_path / "nsaid-mj" / cache.digest()
    assert folder.is_dir()


def test_numba_cache_dir_is_respected(tmp_path: Path):
    mine, other = tmp_path / "mine", tmp_path / "other"
    told = process(SHOW, NUMBA_CACHE_DIR=str(mine), XDG_CACHE_HOME=str(other))
    assert Path(told.stdout.strip()).is_relative_to(mine)
    assert not other.exists()


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders have an owner and a mode")
@pytest.mark.parametrize("whose", ["another user", "others can write"])
def test_kernels_that_somebody_else_may_have_written_are_not_read(
    whose: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Numba's cache consists of pickles: reading them runs them."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    own = cache.open_cache()
    assert own.is_relative_to(tmp_path) and own.stat().st_mode & 0o777 == 0o700
    assert cache.open_cache() == own
    if whose == "another user":
        monkeypatch.setattr(os, "getuid", lambda: own.stat().st_uid + 1)
    else:
        own.chmod(0o770)
    with pytest.warns(NoKernelCache, match=whose):
        assert not cache.open_cache().is_relative_to(tmp_path)


def test_a_folder_of_folders_made_under_another_umask_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    home = tmp_path / "nsaid-mj"
    home.mkdir()
    home.chmod(0o775)
    assert cache.open_cache().parent == home and home.stat().st_mode & 0o777 == 0o700


def test_a_relative_cache_home_is_ignored(tmp_path: Path):
    told = process(SHOW, XDG_CACHE_HOME="here", HOME=str(tmp_path))
    assert Path(told.stdout.strip()).is_relative_to(tmp_path / ".cache")


def test_without_a_writable_cache_kernels_work_with_one_warning(
    tmp_path: Path,
):
    blocked, scratch = tmp_path / "a file", tmp_path / "scratch"
    blocked.write_text("")
    scratch.mkdir()
    code = f"""
import subprocess, sys
{SHOW}
from nsaid_mj.core.numerics.linalg import *
from nsaid_mj.core.numerics import linalg
if len(sys.argv) == 1:
    child = subprocess.run([sys.executable, "-c", {SHOW!r}], capture_output=True, text=True)
    assert not child.stderr, child.stderr
    print(child.stdout)
"""
    told = process(code, XDG_CACHE_HOME=str(blocked), TMPDIR=str(scratch))
    folder, child = (Path(line) for line in told.stdout.split())
    assert child.is_relative_to(folder)
    assert folder.is_relative_to(scratch)
    assert told.stderr.count("NoKernelCache: compiled kernels cannot be cached") == 1
    assert "Traceback" not in told.stderr
    assert not list(scratch.iterdir())


def test_no_kernel_is_kept_beside_the_sources(tmp_path: Path):
    code = """
import numpy as np
from nsaid_mj.core.numerics import spatial
spatial.bracket(6, np.ones(6), np.ones(6))
"""
    process(code, XDG_CACHE_HOME=str(tmp_path))
    kept = list(tmp_path.rglob("*.nbi"))
    assert any("bracket" in path.name for path in kept)


def test_pruning_keeps_the_newest_folders_and_those_in_use(tmp_path: Path):
    now, day = 1e9, cache.IN_USE
    ages = {"current": 9, "a": 0.1, "b": 2, "c": 3, "d": 4, "e": 5}
    folders = {name: tmp_path / name.ljust(16, "0") for name in ages}
    for name, folder in folders.items():
        folder.mkdir()
        (folder / "kernel.nbc").write_text("")
        os.utime(folder, (now - ages[name] * day,) * 2)
    (tmp_path / "somebody else's").mkdir()
    os.utime(tmp_path / "somebody else's", (0, 0))
    cache.prune(tmp_path, folders["current"], now)
    left = {name for name, folder in folders.items() if folder.exists()}
    assert left == {"current", "a", "b", "c"}
    assert (tmp_path / "somebody else's").exists()


def test_folders_in_use_are_never_pruned_however_many(tmp_path: Path):
    folders = [tmp_path / f"{k:016x}" for k in range(8)]
    for folder in folders:
        folder.mkdir()
    cache.prune(tmp_path, folders[0])
    assert all(folder.exists() for folder in folders)


def test_compile_time_excludes_loading_and_counts_nothing_twice(tmp_path: Path):
    code = """
import time
import numpy as np
from nsaid_mj.base import Stopwatch
from nsaid_mj.core.numerics import spatial
watch = Stopwatch()
calls, ones = [], np.ones(6)
times = [time.perf_counter(), watch.seconds, time.perf_counter()]
with Stopwatch.on_compiling(lambda: calls.append(1)):
    spatial.bracket(6, ones, ones)
spatial.bracket(6, ones, ones)
times += [time.perf_counter(), watch.seconds, time.perf_counter()]
print(watch.compiling, len(calls), *times)
"""
    first, second = (
        [float(word) for word in process(code, XDG_CACHE_HOME=str(tmp_path)).stdout.split()]
        for _ in "12"
    )
    compiling, calls, before, ours, begin, end, theirs, after = first
    assert compiling > 0.01
    assert end - begin <= compiling + theirs - ours <= after - before
    assert calls >= 1
    assert second[:2] == [0.0, 0.0]


def test_code_from_the_cache_finds_every_kernel_that_it_calls():
    """A process that compiles nothing must know all addresses, of parts' kernels too."""
    chart = {"confine", "from_chart_into", "height", "to_chart_into"}
    cone = {"natural_rate_into", "dense_rate_into"} | chart
    for metric, expected in ((ConeMetric, cone), (ConstantMetric, set())):
        names = named(flow_in(metric).py_func)
        kernels = {kernel.symbol.rpartition(".")[2] for kernel in callees(names)}
        assert kernels == {"stage"} | expected
