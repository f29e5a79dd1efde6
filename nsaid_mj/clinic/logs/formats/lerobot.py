"""LeRobot datasets: a folder with `meta/info.json` and Parquet files, versions 2 and 3.

Version 2 has a file for every episode, version 3 files of many; both have the columns
`episode_index`, `frame_index` and `timestamp`, and one column of lists for each feature.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ....base import InputFile, json_of
from ..unusable import UnreadableLog
from . import Columns
from .arrow import flat, table_of

_PAUSE = 1.0  # between episodes [s]: the log is split there
_OWN = ("episode_index", "frame_index", "timestamp")
_REMEDY = "Download the whole dataset, with its folders `meta` and `data`."


def read(path: Path) -> list[Columns]:
    """Every vector of numbers as one column for each entry, called `FEATURE/NAME`.

    Times are those of the frames, at the nominal rate; episodes follow one another after a pause.

    Raises:
        UnreadableLog: a part of the dataset is missing, damaged or empty.
    """
    try:
        info = json_of(InputFile(path / "meta" / "info.json").read())
        names = {
            key: _names(key, feature)
            for key, feature in info["features"].items()
            if feature["dtype"] in ("float32", "float64") and len(feature["shape"]) == 1
        }
        wanted = [*_OWN, *(key for key in names if key not in _OWN)]
        files = sorted((path / "data").rglob("*.parquet"))
        tables = [table_of(file, wanted) for file in files]
        table = pa.concat_tables(tables, promote_options="permissive")
        table = table.sort_by([("episode_index", "ascending"), ("frame_index", "ascending")])
        time = _times(*(table.column(name).to_numpy().ravel() for name in _OWN[::2]))
    except (pa.ArrowException, OSError, ValueError, LookupError, TypeError) as error:
        raise UnreadableLog(path, f"unreadable dataset ({error})", _REMEDY) from error
    values: dict[str, np.ndarray] = {}
    for key, own in names.items():
        if key not in _OWN:
            values |= flat(key, table.column(key), own)
    if not values:
        raise UnreadableLog(path, "the dataset has no vector of numbers", _REMEDY)
    return [Columns(values, time)]


def _names(key: str, feature: dict[str, Any]) -> list[str]:
    """Names of a feature's columns: `action/elbow_flex.pos`; a bare name means a position."""
    given: Any = feature.get("names")
    if isinstance(given, dict):  # {"motors": [...]}
        given = next(iter(given.values()), None)
    width = feature["shape"][0]
    if not isinstance(given, list) or len(given) != width:
        given = list(range(width))
    return [f"{key}/{name}" if "." in str(name) else f"{key}/{name}.pos" for name in given]


def _times(episode: np.ndarray, stamp: np.ndarray) -> np.ndarray:
    """(N,) times [ns] of rows in the order of episodes."""
    if not len(episode) or not np.isfinite(stamp).all():
        raise ValueError("no frames, or frames without a timestamp")
    t = stamp.astype(np.float64)
    starts = np.flatnonzero(np.diff(episode)) + 1
    steps = np.diff(t)
    steps[starts - 1] = _PAUSE
    return np.round(np.r_[0.0, np.cumsum(steps)] * 1e9).astype(np.int64)
