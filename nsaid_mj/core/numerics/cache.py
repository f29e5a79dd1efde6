"""The folder of compiled kernels.

By default numba caches compiled kernels beside the sources and checks only the file that defines a
kernel: after an update, a caller may run with outdated code of its callees, or the index may name
modules that no longer exist. Here the cache is a folder in the user's cache directory, named by a
digest of everything that kernels are compiled from, so that no stale kernel is ever loaded.
"""

import atexit
import hashlib
import os
import platform
import re
import shutil
import stat
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import llvmlite
import numba
import numpy as np

from ...base import NotWritten
from .errors import NoKernelCache

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

PACKAGE = Path(__file__).resolve().parents[2]
WHOLE = ("core/numerics", "core/structure")
"""Packages included in full: nearly all of their files define kernels, or parts of kernels."""

_IMPORTS = re.compile(rb"from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)")
_NUMBA = (b"import numba", b"from numba")
_OFFERS = re.compile(r"from \.([\w.]+) import (\w+)")

KEPT = 3  # folders of other digests that survive when a new one is made
IN_USE = 86400.0  # folders used more recently than this are never deleted [s]
_FOLDER = "nsaid-mj"
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


def digest(package: Path = PACKAGE) -> str:
    """Sixteen hexadecimal digits that identify everything kernels are compiled from.

    These are the sources of `kernel_sources`, and the versions of Python, numpy, numba and
    llvmlite.
    """
    found = hashlib.sha256(f"{platform.python_version()} {sys.implementation.cache_tag}".encode())
    for part in (np, numba, llvmlite):
        found.update(f" {part.__name__} {part.__version__}".encode())
    found.update(f" {sources_digest(package)}".encode())
    return found.hexdigest()[:16]


def sources_digest(package: Path = PACKAGE) -> str:
    """Sixteen hexadecimal digits that identify the sources of kernels."""
    found = hashlib.sha256()
    for name, text in sorted(kernel_sources(package).items()):
        found.update(f" {name} {hashlib.sha256(text).hexdigest()}".encode())
    return found.hexdigest()[:16]


def kernel_sources(package: Path = PACKAGE) -> dict[str, bytes]:
    """Files that kernels can depend on: those of `WHOLE`, those that define one, and their imports.

    Returns their contents, by path relative to the package's folder, without the suffix.
    """
    texts: dict[str, bytes] = {}
    for folder, inner, files in os.walk(package):
        inner[:] = [name for name in inner if name not in ("__pycache__", "_assets", "_scenarios")]
        for name in (name for name in files if name.endswith(".py")):
            path = os.path.join(folder, name)
            with open(path, "rb") as file:
                texts[path[len(str(package)) + 1 : -3].replace(os.sep, "/")] = file.read()
    doors = {
        path.parent.name: {
            name: f"{path.parent.name}/{module.replace('.', '/')}"
            for module, name in _OFFERS.findall(path.read_text("utf-8"))
        }
        for path in package.glob("*/__init__.pyi")
    }
    left = [
        name
        for name, text in texts.items()
        if name.startswith(WHOLE) or b"kernel(" in text or any(words in text for words in _NUMBA)
    ]
    found: dict[str, bytes] = {}
    while left:
        name = left.pop()
        if name not in found:
            found[name] = texts[name]
            left += _imported(name, texts, doors)
    return found


def _imported(name: str, texts: dict[str, bytes], doors: dict[str, dict[str, str]]) -> list[str]:
    """The modules of `texts` that a module imports relative to itself.

    A house's `doors` give the modules in which the names that it offers are defined.
    """
    found: list[str] = []
    for dots, module, names in _IMPORTS.findall(texts[name]):
        base = "/".join([*name.split("/")[: -len(dots)], *module.decode().split(".")]).rstrip("/")
        package = f"{base}/__init__".lstrip("/")
        if package in texts:
            each = [part.split(" as ")[0].strip() for part in names.decode().strip("()").split(",")]
            offered = doors.get(base, {})
            found += [package, *(f"{base}/{part}".lstrip("/") for part in each)]
            found += [offered[part] for part in each if part in offered]
        else:
            found.append(base)
    return [each for each in found if each in texts]


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

    If it is not writable, or others can write into it, a temporary folder serves this process and
    its children, with a `NoKernelCache` warning.
    """
    try:
        home = cache_home()
        folder = home / digest()
        new = not folder.is_dir()
        home.mkdir(mode=0o700, parents=True, exist_ok=True)
        _check_owner(home)
        if home.stat().st_mode & _OTHERS:  # made with the user's umask by an earlier version
            home.chmod(0o700)
        folder.mkdir(mode=0o700, exist_ok=True)
        _check_owner(folder)
        if hasattr(os, "getuid") and folder.stat().st_mode & _OTHERS:
            raise PermissionError(f"others can write into {folder}; delete it")
        tempfile.TemporaryFile(dir=folder).close()  # raises if the folder is not writable
        os.utime(folder)
    except OSError as error:
        return _temporary(error)
    if new:
        prune(home, folder)
    return folder


def _check_owner(folder: Path) -> None:
    """Numba's cache consists of pickles, which run code when they are read.

    Raises:
        PermissionError: the folder belongs to another user.
    """
    if hasattr(os, "getuid") and folder.stat().st_uid != os.getuid():  # not on Windows
        raise PermissionError(f"{folder} belongs to another user")


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
    """Deletes the folders of other digests in `home`, except `current` and new or recent ones.

    `now` is the current time [s since the epoch]; None reads the clock.
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


def use_folder() -> None:
    """Has numba cache the functions that are defined next in this process's folder.

    Numba reads the environment again when it compiles, and then forgets the folder.
    """
    numba.config.CACHE_DIR = str(FOLDER)


use_folder()

_THREADS = threading.RLock()


@contextmanager
def one_process(name: str) -> Iterator[None]:
    """Context that one thread of one process enters at a time, for each `name` of a kernel.

    Without file locks, one thread of each process.
    """
    with ExitStack() as stack:
        stack.enter_context(_THREADS)
        if fcntl is not None:
            with suppress(OSError):
                file = stack.enter_context(open(FOLDER / f"{name}.lock", "w"))
                fcntl.flock(file, fcntl.LOCK_EX)  # until the file is closed
        yield
