"""NumPy archives (.npz): arrays (N,) or (N, k), without pickled objects."""

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..unusable import UnreadableLog
from . import Columns, check_size


def read(path: Path) -> list[Columns]:
    """Arrays grouped by their length; column k of an array (N, width) is called `name_k`.

    Raises:
        UnreadableLog: it is beyond the limit, or has no array of numbers.
    """
    with zipfile.ZipFile(path) as archive:
        check_size(path, sum(member.file_size for member in archive.infolist()))
    with np.load(path, allow_pickle=False) as archive:
        return grouped(path, {name: _loaded(archive, name) for name in archive.files})


def grouped(path: Path, arrays: Mapping[str, np.ndarray | None]) -> list[Columns]:
    """Columns of arrays by name, grouped by their length; None stands for objects.

    Raises:
        UnreadableLog: there is no array of numbers.
    """
    groups: dict[int, dict[str, np.ndarray]] = {}
    dropped = []
    for name, array in arrays.items():
        if array is None or array.ndim not in (1, 2) or array.dtype.kind not in "fiubM":
            what = "objects" if array is None else f"{array.dtype} of shape {array.shape}"
            dropped.append((name, f"{what}, not columns of numbers"))
        elif len(array) < 2:
            dropped.append((name, "a single row"))
        elif array.ndim == 1 or array.shape[1] == 1:
            groups.setdefault(len(array), {})[name] = _plain(array.reshape(-1))
        else:
            columns = {f"{name}_{k}": _plain(column) for k, column in enumerate(array.T)}
            groups.setdefault(len(array), {}).update(columns)
    if not groups:
        raise UnreadableLog(path, "there is no array of numbers", "Write (N,) or (N, k) arrays.")
    first, *others = groups.values()
    return [Columns(first, dropped=tuple(dropped)), *map(Columns, others)]


def _loaded(archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray | None:
    """An array of the archive; None if it holds pickled objects, such as strings."""
    try:
        return archive[name]
    except ValueError as error:
        if "allow_pickle" in str(error):
            return None
        raise


def _plain(column: np.ndarray) -> np.ndarray:
    if column.dtype.kind == "M":
        return column.astype("datetime64[ns]")
    return column.astype(np.int64 if column.dtype.kind in "iu" else np.float64)
