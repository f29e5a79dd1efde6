"""Rerun recordings read back, and a vehicle to be recorded."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from nsaid_mj import BlueROV2Plant, MultisineCommand, NullspaceAID, Scenario
from nsaid_mj.lab.loop import SimulatedRun

VEHICLE = Scenario(
    plant=BlueROV2Plant(),
    excitation=MultisineCommand(low=0.2, high=2.0, tones=4, amplitude=0.9),
    identifier=NullspaceAID(K=10.0, gain=0.3),
    duration=2.0,
    dt=0.01,
    pe_window=0.5,
    held_out=0.5,
)


@cache
def entities_of(file: Path) -> dict[str, dict[str, list]]:
    """Column name to values, by entity, over all of a recording's chunks.

    Mesh vertices are large and have one None in place of their values; `log_time` is left out,
    since its nanoseconds since 1970 do not fit a `datetime`.
    """
    entities: dict[str, dict[str, list]] = {}
    for chunk in RrdReader(file).stream():
        columns = entities.setdefault(str(chunk.entity_path), {})
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.startswith("Mesh3D:vertex_"):
                columns[name] = [None]
            elif name != "log_time":
                column = batch.column(name)
                if pa.types.is_duration(column.type):  # `timedelta` has no nanoseconds
                    column = column.cast(pa.duration("us"), safe=False)
                columns.setdefault(name, []).extend(column.to_pylist())
    return entities


def seconds(time: object) -> float:
    return time.total_seconds() if hasattr(time, "total_seconds") else float(time) * 1e-9  # type: ignore


def column(entities: dict[str, dict[str, list]], entity: str, name: str) -> np.ndarray:
    """The values of an entity's column, where it has any."""
    return np.array([value for value in entities[f"/{entity}"][name] if value is not None])


def drawn_rows(
    result: SimulatedRun, entities: dict[str, dict[str, list]], entity: str
) -> np.ndarray:
    """The record's rows that an entity's values are of, by their times."""
    times = [seconds(t) for t in entities[f"/{entity}"]["sim_time"] if t is not None]
    rows = np.round(np.array(times) / result.scenario.dt).astype(int)
    np.testing.assert_allclose(result.record["t"][rows], times, atol=1e-9)
    return rows
