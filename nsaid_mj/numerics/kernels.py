"""Compiled kernels: where they are kept between processes, and how long compiling takes.

Numba's own default keeps compiled kernels beside the sources and checks only the file a kernel is
defined in: after an update a caller runs with the old code of what it calls, or its index names
modules that are gone. Here they go to a folder of the user's cache directory that is named by a
digest of everything they are compiled from, so that nothing stale is ever found.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import platform
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import llvmlite
import numba
import numpy as np
from numba.core import event  # its Event API is in numba's manual

from ..errors import NoKernelCache

PACKAGE = Path(__file__).resolve().parent.parent
WITHOUT_KERNELS = (
    "experiment", "evaluation", "recording", "reporting", "studies", "cli", "_assets", "_scenarios",
)  # fmt: skip
"""Rooms that define no kernel and that no kernel can depend on: they come later in the house."""

KEPT = 3  # folders of other digests that are left when a new one is made
IN_USE = 86400.0  # what was used this recently is never deleted [s]
_FOLDER = "nsaid-mj"


def digest(package: Path = PACKAGE) -> str:
    """Sixteen hexadecimal digits of all that kernels are compiled from.

    These are the sources of the package and the versions of Python, numpy, numba and llvmlite.

    Args:
        package: the package's folder.
    """
    found = hashlib.sha256(f"{platform.python_version()} {sys.implementation.cache_tag}".encode())
    for part in (np, numba, llvmlite):
        found.update(f" {part.__name__} {part.__version__}".encode())
    for folder, inner, files in os.walk(package):
        top = Path(folder) == package
        inner[:] = sorted(
            name for name in inner
            if name != "__pycache__" and not (top and name in WITHOUT_KERNELS)
        )  # fmt: skip
        for name in sorted(files):
            if name.endswith(".py"):
                path = os.path.join(folder, name)
                with open(path, "rb") as file:
                    content = hashlib.sha256(file.read()).hexdigest()
                found.update(f" {os.path.relpath(path, package)} {content}".encode())
    return found.hexdigest()[:16]


def cache_home() -> Path:
    """Where the folders of all digests lie.

    In NUMBA_CACHE_DIR or else XDG_CACHE_HOME where one is set, otherwise in ~/.cache.

    Raises:
        OSError: no home directory is known.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen).absolute() / _FOLDER
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):  # a relative one is to be ignored, says the standard
        return Path(base) / _FOLDER
    try:
        return Path.home() / ".cache" / _FOLDER
    except RuntimeError as error:
        raise OSError(str(error)) from error


def open_cache() -> Path:
    """The folder for this version's kernels, made and marked as used now; old ones are deleted.

    Where it cannot be written, a temporary folder serves this process and its children, and a
    warning says so.
    """
    try:
        home = cache_home()
        folder = home / digest()
        new = not folder.is_dir()
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()  # it may exist and still not be writable
        os.utime(folder)
    except OSError as error:
        return _temporary(error)
    if new:
        prune(home, folder)
    return folder


def _temporary(error: OSError) -> Path:
    """A folder that is deleted when this process ends."""
    folder = Path(tempfile.mkdtemp(prefix="nsaid-mj-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)  # so that children share it, and do not warn
    warnings.warn(NoKernelCache(error), stacklevel=2)
    return folder


def prune(home: Path, current: Path, now: float | None = None) -> None:
    """Deletes all folders of other digests but the newest ones and those in use.

    Args:
        home: where they lie.
        current: the folder of this version.
        now: the time [s since the epoch]; None asks the clock.
    """
    now = time.time() if now is None else now
    ages: list[tuple[float, Path]] = []
    for folder in home.iterdir():
        if folder == current or len(folder.name) != len(current.name):
            continue
        try:
            ages.append((now - folder.stat().st_mtime, folder))
        except OSError:  # another process was quicker
            continue
    for age, folder in sorted(ages)[KEPT:]:
        if age > IN_USE:
            shutil.rmtree(folder, ignore_errors=True)


FOLDER = open_cache()
"""Where this process keeps its kernels."""

numba.config.CACHE_DIR = str(FOLDER)


class _Stopwatch(event.Listener):
    """Adds up the time that this process spends compiling, kernels within kernels once."""

    def __init__(self) -> None:
        self.total, self.depth, self.begin = 0.0, 0, 0.0
        self.watchers: list[Callable[[], None]] = []

    def on_start(self, _: event.Event) -> None:
        """Called when numba begins to compile a kernel; a lock of numba's is held."""
        if not self.depth:
            self.begin = time.perf_counter()
            for watcher in self.watchers:
                watcher()
        self.depth += 1

    def on_end(self, _: event.Event) -> None:
        """Called when a kernel is compiled, or could not be."""
        self.depth -= 1
        if not self.depth:
            self.total += time.perf_counter() - self.begin


_STOPWATCH = _Stopwatch()
event.register("numba:compile", _STOPWATCH)


def compile_seconds() -> float:
    """How long this process has been compiling kernels up to now [s]; loading them is not in it."""
    return _STOPWATCH.total


def clock() -> float:
    """A clock for measuring what a run costs [s]: it stands still while kernels are compiled."""
    return time.perf_counter() - _STOPWATCH.total


@contextmanager
def on_compiling(call: Callable[[], None]) -> Iterator[None]:
    """Calls `call` whenever a kernel begins to be compiled, from whatever thread compiles it."""
    _STOPWATCH.watchers.append(call)
    try:
        yield
    finally:
        _STOPWATCH.watchers.remove(call)
