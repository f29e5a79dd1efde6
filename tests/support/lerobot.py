"""LeRobot datasets, versions 2.1 and 3.0, as their documentation lays them out.

The library itself needs PyTorch, so that the layout is written here with pyarrow: `meta/info.json`;
one Parquet file for an episode (2.1) or for all of them (3.0), with lists of float32 for vectors.
"""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet


def write_dataset(folder: Path, version, episodes, names, fps=50) -> Path:
    """Writes a dataset.

    Args:
        folder: to write into.
        version: "v2.1" or "v3.0".
        episodes: pairs of states and actions (N, n).
        names: of their entries; None to state none, a list, or {"motors": list} as in version 2.
        fps: nominal frames per second.
    """
    width = episodes[0][0].shape[1]
    vector = {"dtype": "float32", "shape": [width], "names": names}
    scalar = {"dtype": "int64", "shape": [1], "names": None}
    info = {
        "codebase_version": version,
        "fps": fps,
        "total_episodes": len(episodes),
        "features": {
            "action": vector,
            "observation.state": vector,
            "observation.images.front": {"dtype": "video", "shape": [480, 640, 3], "names": None},
            "timestamp": {"dtype": "float32", "shape": [1], "names": None},
            "frame_index": scalar,
            "episode_index": scalar,
        },
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    tables = [_table(k, state, action, fps) for k, (state, action) in enumerate(episodes)]
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    if version == "v3.0":
        pa.parquet.write_table(pa.concat_tables(tables), chunk / "file-000.parquet")
    else:
        for k, table in enumerate(tables):
            pa.parquet.write_table(table, chunk / f"episode_{k:06d}.parquet")
    return folder


def _table(episode, state, action, fps):
    count, width = state.shape
    lists = pa.list_(pa.float32(), width)
    return pa.table(
        {
            "action": pa.array(action.astype(np.float32).tolist(), lists),
            "observation.state": pa.array(state.astype(np.float32).tolist(), lists),
            "timestamp": pa.array(np.arange(count) / fps, pa.float32()),
            "frame_index": pa.array(np.arange(count)),
            "episode_index": pa.array(np.full(count, episode)),
        }
    )
