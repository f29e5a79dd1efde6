"""Caches of compiled kernels that are damaged, full or missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.faulty import CHECKOUT

KERNEL = """
import resource, sys, warnings
from nsaid_mj.core.numerics.kernels import f8, kernel
from nsaid_mj.base import Stopwatch
{before}
@kernel(f8(f8))
def twice(x):
    return 2 * x
@kernel(f8(f8))
def thrice(x):
    return 3 * x
@kernel(f8(f8))
def negative(x):
    return -x
for called in (twice, thrice, negative):
    watch = Stopwatch()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert called(2.0) == called.py_func(2.0)
    print(*(type(warning.message).__name__ for warning in said), watch.compiling > 0)
"""


def called(script: Path, cache: Path) -> set[str]:
    """What a process says that calls cached kernels: its warnings, and whether it compiled."""
    done = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": str(CHECKOUT), "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return set(done.stdout.splitlines())


@pytest.fixture
def script(tmp_path: Path) -> Path:
    path = tmp_path / "kernel.py"
    path.write_text(KERNEL.format(before=""))
    return path


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A script, and a cache that has its kernels."""
    folder = tmp_path_factory.mktemp("filled")
    script, cache = folder / "kernel.py", folder / "cache"
    script.write_text(KERNEL.format(before=""))
    assert called(script, cache) == {"True"}
    assert called(script, cache) == {"False"}
    return script, cache


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
def test_a_damaged_cache_is_told_and_compiled_anew(
    kind: str, filled: tuple[Path, Path], tmp_path: Path
) -> None:
    script, cache = filled[0], tmp_path / "cache"
    shutil.copytree(filled[1], cache)
    for file, damage in zip(
        cache.rglob(f"*.{kind}"), (b"", b"\x80\x04", b"not a pickle"), strict=True
    ):
        file.write_bytes(damage)
    assert called(script, cache) == {"DamagedKernelCache True"}
    assert called(script, cache) == {"False"}


def test_a_full_cache_is_told_and_the_kernel_works(script: Path, tmp_path: Path) -> None:
    full = "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))"
    cache, limited = tmp_path / "cache", tmp_path / "limited.py"
    limited.write_text(KERNEL.format(before=full))
    assert called(limited, cache) == {"NoKernelCache True"}
    assert called(script, cache) == {"True"}  # nothing was kept


SHARED = """
import sys
from nsaid_mj.core.numerics.kernels import kernel
from nsaid_mj.base import Stopwatch
watch = Stopwatch()
@kernel()
def count(x):
    return len(x)
for k in map(int, sys.argv[1:]):
    assert count((1.0,) * k) == k
print(watch.compiling > 0)
"""


def test_processes_that_compile_for_one_cache_lose_and_mix_up_nothing(tmp_path: Path) -> None:
    script, cache = tmp_path / "shared.py", tmp_path / "cache"
    script.write_text(SHARED)
    words = [sys.executable, str(script)]
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT), "NUMBA_CACHE_DIR": str(cache)}
    shares = [[str(k) for k in range(first, 7, 3)] for first in (1, 2, 3)]
    at_once = [subprocess.Popen([*words, *share], env=environment) for share in shares]
    assert [process.wait() for process in at_once] == [0, 0, 0]
    words += [str(k) for k in range(1, 7)]
    after = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert after.stdout.strip() == "False"


APART = """
import sys
from nsaid_mj.core.numerics.cache import one_process
from nsaid_mj.core.numerics.kernels import f8, kernel
from nsaid_mj.base import Stopwatch
watch = Stopwatch()
@kernel(f8(f8))
def first(x):
    return x + 1.0
@kernel(f8(f8))
def second(x):
    return x + 2.0
@kernel(f8(f8))
def both(x):
    return first(x) * second(x)
if sys.argv[1:] == ["hold"]:
    with one_process(first.symbol):
        print("held", flush=True)
        sys.stdin.readline()
else:
    assert second(1.0) == 3.0
    print("second is ready", flush=True)
    assert both(1.0) == 6.0
    print(watch.compiling > 0, flush=True)
"""


def test_a_process_waits_for_what_another_one_compiles_and_for_nothing_else(
    tmp_path: Path,
) -> None:
    script = tmp_path / "apart.py"
    script.write_text(APART)
    words, pipe = [sys.executable, str(script)], subprocess.PIPE
    environment = {
        **os.environ,
        "PYTHONPATH": str(CHECKOUT),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
    }
    with subprocess.Popen(
        [*words, "hold"], env=environment, stdin=pipe, stdout=pipe, text=True
    ) as holder:
        assert holder.stdin and holder.stdout and holder.stdout.readline() == "held\n"
        with subprocess.Popen(words, env=environment, stdout=pipe, text=True) as other:
            assert other.stdout and other.stdout.readline() == "second is ready\n"
            assert other.poll() is None  # it waits for the first
            holder.stdin.write("\n")
            holder.stdin.flush()
            assert other.stdout.readline() == "True\n"
            assert other.wait() == holder.wait() == 0


THREADS = """
import sys, threading, warnings
from concurrent.futures import ThreadPoolExecutor
from nsaid_mj.core.numerics.kernels import f8, kernel
def made(k):
    @kernel(f8(f8))
    def shifted(x):
        return x + k
    return shifted
sys.setswitchinterval(1e-5)
for k in range(5):
    one, start = made(float(k)), threading.Barrier(8)
    def call(_):
        start.wait()
        return one(1.0)
    with ThreadPoolExecutor(8) as pool, warnings.catch_warnings():
        warnings.simplefilter("error")
        assert set(pool.map(call, range(8))) == {1.0 + k}
print("same")
"""


def test_threads_that_want_one_kernel_at_once_get_it(tmp_path: Path) -> None:
    script = tmp_path / "threads.py"
    script.write_text(THREADS)
    assert called(script, tmp_path / "cache") == {"same"}
