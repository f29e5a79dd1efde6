"""The one step in which all kernels are compiled, or loaded from the cache."""

from __future__ import annotations

from contextlib import suppress
from functools import cache

from numba import config

from ..numerics.kernels import FOLDER
from . import motion, regressor, transition  # noqa: F401 (marks all functions)
from .compiled import MARKED, Kernel


@cache
def ready() -> None:
    """Compiles all functions, callees first, or loads the kernels; done once in a process.

    numba caches kernels only: the other functions are part of them. A file in the cache folder,
    written last, says that all kernels are there. If it errs, numba compiles what is missing, with
    more specialisations than necessary.
    """
    if config.DISABLE_JIT:
        return
    complete = FOLDER / "structure.complete"
    found = complete.exists()
    for made in MARKED:
        if isinstance(made, Kernel):
            made.load()
        elif not found:
            function, signature = made
            function.compile(signature)
            function.disable_compile()
    for made in MARKED:
        if not isinstance(made, Kernel):
            made[0].disable_compile(False)  # for packs, see `numerics.packs`
    if not found:
        with suppress(OSError):
            complete.touch()
