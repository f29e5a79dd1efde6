"""Damaged files, planted links and foreign files in the folders of runs and sweeps."""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

from nsaid_mj import Record, run
from nsaid_mj.errors import NsaidError
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import FAULTS
from nsaid_mj.identifiers.faults import FaultEvent
from nsaid_mj.recording import postprocessing
from nsaid_mj.studies import sweep, sweep_report, sweep_results
from nsaid_mj.studies.sweep_engine import Engine
from scripts.campaign_tries import Draw, Kind, Try, carried_out

SCENARIO = replace(load("scalar_rov"), duration=2.0, held_out=0.5, pe_window=0.5)
PLAN = sweep.Plan("scalar_rov", SCENARIO, {"identifier.gain": (0.5, 1.0)}, seeds=2)
RUN = ("record.arrow", "summary.json", "scenario.json", "run.rrd", "report.html")
FAULT = FaultEvent(1.0, 1.2, "loss", "thrust", ("thrust",), 0.4, 0.3, 0.5, "1", 0.99)
SWEEP = ("manifest.json", "rows.jsonl", "results.parquet")


@cache
def packed(kind: str) -> Path:
    """A folder with a finished run or sweep, made once."""
    folder = Path(tempfile.mkdtemp(prefix="campaign-packed-")) / "out"
    if kind == "run":
        postprocessing.finish(run(SCENARIO, folder))
    else:
        sweep.run(PLAN, folder, Engine(jobs=1), quiet=True)
    return folder


def damage(path: Path, rng: random.Random) -> str:
    """Damages a file in one of several ways; returns which."""
    data = path.read_bytes()
    at = rng.randrange(len(data))
    junk = rng.randbytes(rng.choice((1, 8, 200)))
    others = (b"[]", b"{}", b"null", b"3", b"[3]", b"[{}]", b"[" * 100_000, b"NaN")
    other = rng.choice(others)
    ways: dict[str, Callable[[], object]] = {
        "of other JSON": lambda: path.write_bytes(other),
        "cut short": lambda: path.write_bytes(data[:at]),
        "overwritten inside": lambda: path.write_bytes(data[:at] + junk + data[at + len(junk) :]),
        "emptied": lambda: path.write_bytes(b""),
        "missing": path.unlink,
        "zeros at the end": lambda: path.write_bytes(data[:at] + bytes(len(data) - at)),
    }
    way = rng.choice(list(ways))
    ways[way]()
    return way


def damaged_run(rng: random.Random, folder: Path) -> Kind:
    """A run's folder with a damaged file is read, rebuilt and overwritten."""
    out = Path(shutil.copytree(packed("run"), folder / "out"))
    (out / FAULTS).write_text(json.dumps([FAULT.keys()]), encoding="utf-8")
    name = rng.choice((RUN[0], RUN[0], RUN[1], RUN[2], FAULTS))
    way = damage(out / name, rng)

    def check() -> str:
        with contextlib.suppress(NsaidError):
            Record.read(out)
        with contextlib.suppress(NsaidError):
            found = postprocessing.rebuild(out)
            json.dumps(found, allow_nan=False)
        run(SCENARIO, out)
        return "" if Record.read(out).complete else "the record is not complete"

    return Kind(f"run, {name} {way}", check)


def damaged_sweep(rng: random.Random, folder: Path) -> Kind:
    """A sweep's folder with a damaged file is read, reported and resumed."""
    out = Path(shutil.copytree(packed("sweep"), folder / "out"))
    name = rng.choice(SWEEP)
    way = damage(out / name, rng)

    def check() -> str:
        before = (out / SWEEP[1]).read_bytes() if (out / SWEEP[1]).exists() else b""
        with contextlib.suppress(NsaidError):
            sweep_report.write(sweep_results.read(out))
        found = None
        with contextlib.suppress(NsaidError):
            found = sweep.run(PLAN, out, Engine(jobs=1), quiet=True)
        if found is None:
            kept = (out / SWEEP[1]).read_bytes() if (out / SWEEP[1]).exists() else b""
            return "" if kept == before else "rows were lost"
        if [row["run"] for row in found.rows] != list(range(len(PLAN))):
            return "rows are missing"
        if name == SWEEP[0] and (out / SWEEP[1]).read_bytes() != before:
            return "rows were made again without need"
        return ""

    return Kind(f"sweep, {name} {way}", check)


def planted(rng: random.Random, folder: Path) -> Kind:
    """Links in the place of files to be written do not lead to other files."""
    out, victim = folder / "out", folder / "victim"
    of_run = rng.random() < 0.5
    names = RUN if of_run else SWEEP
    out.mkdir()
    victim.write_text("dear")
    name = rng.choice([f".{name}.part" for name in names])
    os.symlink(victim, out / name)

    def check() -> str:
        with contextlib.suppress(NsaidError):
            if of_run:
                postprocessing.finish(run(SCENARIO, out))
            else:
                sweep.run(PLAN, out, Engine(jobs=1), quiet=True)
        return "" if victim.read_text() == "dear" else "the link was followed"

    return Kind(f"{'run' if of_run else 'sweep'}, planted {name}", check)


FAMILIES: dict[str, Draw] = {
    "damaged runs": damaged_run,
    "damaged sweeps": damaged_sweep,
    "planted links": planted,
}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family."""
    return carried_out(family, FAMILIES[family], tries, seed)
