"""The cache of compiled kernels, and the time spent compiling.

By default numba caches compiled kernels beside the sources and checks only the file that defines a
kernel: after an update, a caller may run with outdated code of its callees, or the index may name
modules that no longer exist. Here the cache is a folder in the user's cache directory, named by a
digest of everything that kernels are compiled from, so that no stale kernel is ever loaded.

numba's files also mix up kernels if two processes write one index at the same time. Here they write
one after the other, so that any number of processes can share the folder.
"""

from __future__ import annotations

import atexit
import gc
import hashlib
import os
import platform
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba.core import caching, event  # the Event API is in numba's manual

from ..errors import DamagedKernelCache, NoKernelCache, NotWritten

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

PACKAGE = Path(__file__).resolve().parent.parent
WITHOUT_KERNELS = (
    "experiment",
    "evaluation",
    "design",
    "recording",
    "reporting",
    "studies",
    "cli",
    "_assets",
    "_scenarios",
)
"""Subpackages that define no kernel and that no kernel can depend on, by the order of imports."""

KEPT = 3  # folders of other digests that survive when a new one is made
IN_USE = 86400.0  # folders used more recently than this are never deleted [s]
_FOLDER = "nsaid-mj"


def digest(package: Path = PACKAGE) -> str:
    """Sixteen hexadecimal digits that identify everything kernels are compiled from.

    That is the package's sources and the versions of Python, numpy, numba and llvmlite.

    Args:
        package: the package's folder.
    """
    found = hashlib.sha256(f"{platform.python_version()} {sys.implementation.cache_tag}".encode())
    for part in (np, numba, llvmlite):
        found.update(f" {part.__name__} {part.__version__}".encode())
    for folder, inner, files in os.walk(package):
        top = Path(folder) == package
        inner[:] = sorted(
            name
            for name in inner
            if name != "__pycache__" and not (top and name in WITHOUT_KERNELS)
        )
        for name in sorted(files):
            if name.endswith(".py"):
                path = os.path.join(folder, name)
                with open(path, "rb") as file:
                    content = hashlib.sha256(file.read()).hexdigest()
                found.update(f" {os.path.relpath(path, package)} {content}".encode())
    return found.hexdigest()[:16]


def cache_home() -> Path:
    """The folder that contains the folders of all digests.

    It is in NUMBA_CACHE_DIR if set, else in XDG_CACHE_HOME if set, else in ~/.cache.

    Raises:
        OSError: the home directory cannot be determined.
    """
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen).absolute() / _FOLDER
    base = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(base):  # the XDG specification says to ignore relative paths
        return Path(base) / _FOLDER
    try:
        return Path.home() / ".cache" / _FOLDER
    except RuntimeError as error:
        raise OSError(str(error)) from error


def open_cache() -> Path:
    """Creates the folder of this version's kernels, or marks it as used, and deletes old folders.

    If it is not writable, a temporary folder serves this process and its children, with a
    `NoKernelCache` warning.
    """
    try:
        home = cache_home()
        folder = home / digest()
        new = not folder.is_dir()
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()  # raises if the folder is not writable
        os.utime(folder)
    except OSError as error:
        return _temporary(error)
    if new:
        prune(home, folder)
    return folder


def _temporary(error: OSError) -> Path:
    """A cache folder that is deleted when this process ends; warns with the error's reason."""
    try:
        folder = Path(tempfile.mkdtemp(prefix="nsaid-mj-"))
    except OSError:
        remedy = "Set NUMBA_CACHE_DIR and TMPDIR to writable folders"
        raise NotWritten("compiled kernels", "no folder is writable", remedy) from error
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)  # so that children share it, and do not warn
    warnings.warn(NoKernelCache(error), stacklevel=2)
    return folder


def prune(home: Path, current: Path, now: float | None = None) -> None:
    """Deletes the folders of other digests, except the newest ones and those recently used.

    Args:
        home: the folder that contains them.
        current: the folder of this version.
        now: the current time [s since the epoch]; None reads the clock.
    """
    now = time.time() if now is None else now
    ages: list[tuple[float, Path]] = []
    for folder in home.iterdir():
        if folder == current or len(folder.name) != len(current.name):
            continue
        try:
            ages.append((now - folder.stat().st_mtime, folder))
        except OSError:  # deleted by another process
            continue
    for age, folder in sorted(ages)[KEPT:]:
        if age > IN_USE:
            shutil.rmtree(folder, ignore_errors=True)


FOLDER = open_cache()
"""The folder of this process's compiled kernels."""

numba.config.CACHE_DIR = str(FOLDER)


@contextmanager
def _turn(to_write: bool) -> Iterator[None]:
    """Waits until no other process writes to the cache; a writer also until no other one reads.

    Where the file system has no locks, nobody waits.
    """
    descriptor = None
    try:
        if fcntl is not None:
            with suppress(OSError):
                descriptor = os.open(FOLDER, os.O_RDONLY)
                fcntl.flock(descriptor, fcntl.LOCK_EX if to_write else fcntl.LOCK_SH)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)  # frees the lock


def guard(cache: Any) -> None:
    """Makes a class of caches survive damaged files, a full disk and other processes.

    Damage and a full disk are told with a warning.

    numba has no interface for that. It would raise the error of the unpickling, or of the operating
    system, at every call of a kernel whose files are damaged or cannot be written.

    Args:
        cache: the class, with numba's `load_overload`, `save_overload` and `flush`.
    """
    load, save = cache.load_overload, cache.save_overload

    def load_overload(self: Any, sig: Any, target_context: Any) -> Any:
        try:
            with _turn(to_write=False):
                return load(self, sig, target_context)
        except Exception as error:  # unpickling damaged bytes may raise anything
            warnings.warn(DamagedKernelCache(f"{type(error).__name__}: {error}"), stacklevel=2)
            with suppress(OSError), _turn(to_write=True):
                self.flush()  # else the damaged index would be read again
            return None

    def save_overload(self: Any, sig: Any, data: Any) -> None:
        with _turn(to_write=True):
            try:
                save(self, sig, data)
            except Exception as error:  # as above, of the index
                if isinstance(error, OSError):
                    warnings.warn(NoKernelCache(error.strerror), stacklevel=2)
                with suppress(OSError):
                    self.flush()

    cache.load_overload, cache.save_overload = load_overload, save_overload


guard(caching.Cache)


class _Stopwatch(event.Listener):
    """Accumulates the time this process spends compiling; nested compilations count once.

    Meanwhile Python does not search for cyclic garbage, which takes 7 % of the time.
    """

    def __init__(self) -> None:
        self.total, self.depth, self.begin, self.collecting = 0.0, 0, 0.0, False
        self.watchers: list[Callable[[], None]] = []

    def on_start(self, _: event.Event) -> None:
        """Called by numba, under its compiler lock, when it begins to compile a kernel."""
        if not self.depth:
            self.begin, self.collecting = time.perf_counter(), gc.isenabled()
            gc.disable()
        self.depth += 1
        for watcher in self.watchers:
            watcher()

    def on_end(self, _: event.Event) -> None:
        """Called by numba when a compilation ends, successfully or not."""
        self.depth -= 1
        if not self.depth:
            self.total += time.perf_counter() - self.begin
            if self.collecting:
                gc.enable()


_STOPWATCH = _Stopwatch()
event.register("numba:compile", _STOPWATCH)


def compile_seconds() -> float:
    """Time this process has spent compiling kernels so far [s], without loading cached ones."""
    return _STOPWATCH.total


def clock() -> float:
    """A clock [s] that stops while kernels are compiled, to measure the cost of a run."""
    return time.perf_counter() - _STOPWATCH.total


@contextmanager
def on_compiling(call: Callable[[], None]) -> Iterator[None]:
    """Within the context, calls `call` whenever the compilation of a function begins.

    It is called in the thread that compiles, for functions that others call as well.
    """
    _STOPWATCH.watchers.append(call)
    try:
        yield
    finally:
        _STOPWATCH.watchers.remove(call)
