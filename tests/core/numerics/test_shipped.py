"""The code of kernels that the package brings: of these sources, to the bit, and dispensable."""

from __future__ import annotations

import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

import nsaid_mj
from nsaid_mj.core.numerics import linalg, shipped
from nsaid_mj.core.numerics.kernels import FAST, KERNELS

ROOT = Path(__file__).parents[3]

SOLVED = """
import numpy as np
from nsaid_mj.base import Stopwatch
from nsaid_mj.core.numerics import linalg, shipped
from nsaid_mj.core.numerics.cache import FOLDER
M, L = np.array([[2.0, 0.0], [0.5, 3.0]]), np.zeros((2, 2))
pivot = linalg.cholesky(M, L)
print(pivot, *L.ravel(), (FOLDER / f"{linalg.cholesky.symbol}.o").exists())
"""


def solved(cache: Path, code: str = SOLVED) -> str:
    """What a process prints that factorises a matrix."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    ).stdout


@pytest.fixture(scope="module")
def cached(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A cache that has the machine code, and what the process has printed that filled it."""
    folder = tmp_path_factory.mktemp("cache")
    return folder, solved(folder)


def test_the_package_brings_every_kernel_of_its_sources():
    for module in pkgutil.walk_packages(nsaid_mj.__path__, "nsaid_mj."):
        importlib.import_module(module.name)
    own = {
        name
        for name, kernel in KERNELS.items()
        if kernel.py_func.__module__.startswith("nsaid_mj.") and not kernel.py_func.__closure__
    }
    brought = shipped._kernels()
    assert brought, "python scripts/kernels.py after an edit of a kernel"
    assert own <= set(brought)


def test_code_that_is_brought_gives_the_numbers_of_numba_s():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((6, 6))
    M = root @ root.T + np.eye(6)
    ours, theirs = np.zeros((2, 6, 6))
    compiled = njit(linalg.cholesky.signature, **FAST)(linalg.cholesky.py_func)
    assert linalg.cholesky(M, ours) == compiled(M, theirs)
    assert (ours == theirs).all()


def test_without_the_file_numba_compiles_and_gives_the_same(
    cached: tuple[Path, str], tmp_path: Path
):
    without = f"from nsaid_mj.core.numerics import shipped\nshipped._kernels = dict\n{SOLVED}"
    one, other = cached[1], solved(tmp_path, without)
    assert one.split()[-1] == "True"
    assert other.split()[-1] == "False"
    assert one.split()[:-1] == other.split()[:-1]


@pytest.mark.parametrize("damage", [b"", b"nothing", b"\0" * 5000])
def test_damaged_machine_code_is_made_again(cached: tuple[Path, str], damage: bytes):
    folder, first = cached
    (code,) = folder.rglob(f"{linalg.cholesky.symbol}.o")
    whole = code.read_bytes()
    code.write_bytes(damage)
    assert solved(folder) == first
    assert code.read_bytes() == whole


def test_a_file_of_other_sources_is_not_used(monkeypatch):
    shipped._kernels.cache_clear()
    monkeypatch.setattr(shipped, "origin", lambda: ["other", "0", "0"])
    assert shipped._kernels() == {}
    monkeypatch.undo()
    shipped._kernels.cache_clear()


TWO = """
import numpy as np
from nsaid_mj.base import Stopwatch
from nsaid_mj.core.numerics import linalg, spatial
watch = Stopwatch()
linalg.cholesky(np.eye(2), np.zeros((2, 2)))
spatial.bracket(6, np.ones(6), np.ones(6))
print(watch.compiling > 0)
"""


def test_what_is_compiled_after_another_function_is_cached_in_our_folder_too(tmp_path: Path):
    """Numba reads its environment again when it compiles, and forgets where its cache is."""
    assert solved(tmp_path, TWO).split() == ["True"]
    assert solved(tmp_path, TWO).split() == ["False"]
    (home,) = tmp_path.iterdir()
    assert home.name == "nsaid-mj"
