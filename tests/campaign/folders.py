"""Damaged files in the folders of runs and sweeps."""

from __future__ import annotations

import contextlib
import json
import random
import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

from nsaid_mj import Record, run
from nsaid_mj.base import NotWritten, OutputFile
from nsaid_mj.base.errors import NsaidError
from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.lab import postprocessing
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import FAULTS
from nsaid_mj.plans.studies import sweep, sweep_report
from nsaid_mj.plans.studies.engine import Engine
from nsaid_mj.plans.studies.folder import read
from tests.support import damaged

from .tries import Draw, Kind

SCENARIO = replace(load("scalar_rov"), duration=2.0, held_out=0.5, pe_window=0.5)
PLAN = sweep.sweep_plan("scalar_rov", SCENARIO, {"identifier.gain": (0.5, 1.0)}, seeds=2)
RUN = ("record.arrow", "summary.json", "scenario.json", "run.rrd", "report.html")
FAULT = FaultEvent(1.0, 1.2, "loss", "thrust", ("thrust",), 0.4, 0.3, 0.5, "1", 0.99)
SWEEP = ("manifest.json", "rows.jsonl", "results.parquet")
_OTHER = (b"[]", b"{}", b"null", b"3", b"[3]", b"[{}]", b"[" * 100_000, b"NaN", b"")


@cache
def packed(kind: str) -> Path:
    """A folder with a finished run or sweep, made once."""
    folder = Path(tempfile.mkdtemp(prefix="campaign-packed-")) / "out"
    if kind == "run":
        postprocessing.finish(run(SCENARIO, folder))
    else:
        sweep.run_sweep(PLAN, folder, Engine(jobs=1), quiet=True)
    return folder


def damage(path: Path, rng: random.Random) -> str:
    """Damages a file in one of several ways; returns which."""
    way = rng.random()
    if way < 0.15:
        path.unlink()
        return "missing"
    if way < 0.3:
        path.write_bytes(rng.choice(_OTHER))
        return f"is {path.read_bytes()[:9]!r}"
    edits = damaged.drawn(rng)
    path.write_bytes(damaged.damage(path.read_bytes(), edits))
    return ", ".join(edit[0] for edit in edits)


def damaged_run(rng: random.Random, here: Path) -> Kind:
    """A run's folder with a damaged file is read, rebuilt and overwritten."""
    out = Path(shutil.copytree(packed("run"), here / "out"))
    OutputFile(out / FAULTS).write_json([FAULT.keys()])
    name = rng.choice((RUN[0], RUN[0], RUN[1], RUN[2], FAULTS))
    way = damage(out / name, rng)

    def check() -> str:
        with contextlib.suppress(NsaidError):
            Record.read(out)
        with contextlib.suppress(NsaidError):
            json.dumps(postprocessing.rebuild(out).summary(), allow_nan=False)
        try:
            run(SCENARIO, out, force=True)
        except NotWritten:  # a file that was changed is the user's
            return "" if (out / name).is_file() else "an intact run was not replaced"
        return "" if Record.read(out).complete else "the record is not complete"

    return Kind(f"run, {name} {way}", check)


def damaged_sweep(rng: random.Random, here: Path) -> Kind:
    """A sweep's folder with a damaged file is read, reported and resumed."""
    out = Path(shutil.copytree(packed("sweep"), here / "out"))
    name = rng.choice(SWEEP)
    way = damage(out / name, rng)

    def rows() -> bytes:
        return (out / SWEEP[1]).read_bytes() if (out / SWEEP[1]).exists() else b""

    def check() -> str:
        before = rows()
        with contextlib.suppress(NsaidError):
            sweep_report.write_sweep_page(read(out))
        found = None
        with contextlib.suppress(NsaidError):
            found = sweep.run_sweep(PLAN, out, Engine(jobs=1), quiet=True)
        if found is None:
            return "" if rows() == before else "rows were lost"
        if [row["run"] for row in found.rows] != list(range(len(PLAN))):
            return "rows are missing"
        again = name == SWEEP[0] and rows() != before
        return "rows were made again without need" if again else ""

    return Kind(f"sweep, {name} {way}", check)


FAMILIES: dict[str, Draw] = {
    "damaged runs": damaged_run,
    "damaged sweeps": damaged_sweep,
}
