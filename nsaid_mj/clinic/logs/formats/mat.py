"""MATLAB files (.mat) up to version 7: arrays, and structs of them, through SciPy."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size
from .npz import grouped

_HDF5 = b"MATLAB 7.3"
_DEEPEST = 8  # structs in structs


def read(path: Path) -> list[Columns]:
    """Arrays grouped by their length; a struct's field is called `struct/field`.

    An array (1, N), or (k, N) with N more than k, is read as its transpose: MATLAB has no vectors.

    Raises:
        UnreadableLog: it is beyond the limit, of version 7.3, or has no array of numbers.
    """
    import scipy.io

    with path.open("rb") as stream:
        if stream.read(len(_HDF5)) == _HDF5:
            remedy = "Save it with `save(file, …, '-v7')`, or export a CSV (`writetable`)."
            raise UnreadableLog(path, "it is a MATLAB file of version 7.3 (HDF5)", remedy)
    check_size(path, path.stat().st_size)
    content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    found: dict[str, np.ndarray | None] = {}
    size = 0
    for name, value in content.items():
        if name.startswith("__"):  # header, version and globals
            continue
        for place, array in _arrays(name, value):
            size += 0 if array is None else array.nbytes
            check_size(path, size)
            found[place] = array
    return grouped(path, found)


def _arrays(name: str, value: Any, depth: int = 0) -> Iterator[tuple[str, np.ndarray | None]]:
    """The arrays of a variable by name; None for what is none."""
    fields = getattr(value, "_fieldnames", None)
    if fields is not None and depth < _DEEPEST:
        for field in fields:
            yield from _arrays(f"{name}/{field}", getattr(value, field), depth + 1)
        return
    array = np.asarray(value)
    if array.dtype == object:
        yield name, None
        return
    wide = array.ndim == 2 and array.shape[1] > array.shape[0]
    yield name, np.atleast_1d(array.T if wide else array)
