"""NumPy archives (.npz): arrays (N,) or (N, k), without pickled objects."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from ..errors import UnreadableLog
from . import Columns


def recognises(_path: Path, head: bytes) -> bool:
    """Whether it is a zip archive."""
    return head.startswith(b"PK\x03\x04")


def read(path: Path) -> list[Columns]:
    """Arrays grouped by their length; column k of an array (N, width) is called `name_k`.

    Raises:
        UnreadableLog: it is no archive of NumPy arrays, or has none of numbers.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: _loaded(archive, name) for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise UnreadableLog(path, f"unreadable ({error})", "Write it with np.savez.") from error
    groups: dict[int, dict[str, np.ndarray]] = {}
    for name, array in arrays.items():
        if array is None or array.ndim not in (1, 2) or array.dtype.kind not in "fiubM":
            continue
        group = groups.setdefault(len(array), {})
        if array.ndim == 1 or array.shape[1] == 1:
            group[name] = _plain(array.reshape(-1))
        else:
            group |= {f"{name}_{k}": _plain(array[:, k]) for k in range(array.shape[1])}
    groups = {length: group for length, group in groups.items() if length > 1}
    if not groups:
        raise UnreadableLog(path, "there is no array of numbers", "Write (N,) or (N, k) arrays.")
    return [Columns(group) for group in groups.values()]


def _loaded(archive: np.lib.npyio.NpzFile, name: str) -> np.ndarray | None:
    """An array of the archive; None if it holds pickled objects, such as strings of names."""
    try:
        return archive[name]
    except ValueError:
        return None


def _plain(column: np.ndarray) -> np.ndarray:
    if column.dtype.kind == "M":
        return column.astype("datetime64[ns]")
    return column.astype(np.int64 if column.dtype.kind in "iu" else np.float64)
