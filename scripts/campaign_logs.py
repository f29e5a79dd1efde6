"""Damaged logs of every format, bombs, odd names, and folders with poisoned modules."""

from __future__ import annotations

import gzip
import json
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from nsaid_mj.calibration.findings import UnusableLog
from nsaid_mj.calibration.logs import limited_to
from nsaid_mj.calibration.logs.tables import read
from scripts.campaign_files import GOOD
from scripts.campaign_tries import Draw, Kind, Try, carried_out
from tests.support import damaged
from tests.support.faulty import shell

_NAMES = (
    "universe",
    "world",
    "a---b",
    "a---><link name='evil'/>",
    "[/red]",
    "\x1b[31mq",
    "\x9b2J",
    "q\u202eevil",
    "{{ 7 }}",
    "<script>",
    "&amp;",
    "../../x",
    "a" * 3000,
    "%s%n",
    "名",
)
_POISON = ("json", "numpy", "pydantic", "pyarrow", "rich", "typing", "numba", "scipy", "tyro")


def binaries(rng: random.Random, folder: Path) -> Kind:
    """A damaged log of any format is read, or refused with its name, and prints nothing."""
    kind = rng.choice(damaged.FORMATS)
    path = folder / (kind if kind == "record.arrow" else f"log.{kind}")
    path.write_bytes(damaged.damage(damaged.good(kind), damaged.drawn(rng)))

    def check() -> str:
        try:
            return "" if read(path).channels else "a table without channels"
        except UnusableLog as error:
            return "" if path.name in str(error) else f"unnamed: {error}"

    return Kind(f"damaged {kind}", check)


def bombs(rng: random.Random, folder: Path) -> Kind:
    """A small file that becomes a large one is refused by the limit."""
    kind, count = rng.choice(("gz", "npz", "parquet", "arrow")), rng.randrange(300_000, 3_000_000)
    path, zeros = folder / f"log.{kind}", np.zeros(count)
    if kind == "gz":
        path.write_bytes(gzip.compress(b"t,q\n" + b"0,0\n" * count, 1))
    elif kind == "npz":
        np.savez_compressed(path, t=zeros, q=zeros)
    elif kind == "parquet":
        pa.parquet.write_table(pa.table({"t": zeros, "q": zeros}), path)
    else:
        table, packed = pa.table({"t": zeros}), pa.ipc.IpcWriteOptions(compression="zstd")
        with pa.ipc.new_file(str(path), table.schema, options=packed) as stream:
            stream.write_table(table, max_chunksize=50_000)

    def check() -> str:
        with limited_to(1e6):
            try:
                read(path)
            except UnusableLog as error:
                return "" if "--limit" in str(error) else f"refused otherwise: {error}"
        return "it was read"

    return Kind(f"bomb of {count} numbers, {kind}", check)


def names(rng: random.Random, folder: Path) -> Kind:
    """Odd names of columns and joints are data on the terminal, in JSON, and in maps."""
    column, joint = rng.choice(_NAMES), rng.choice(_NAMES)
    text = GOOD.decode().replace('"j1"', f'"{_escaped(joint)}"')
    (folder / "two.urdf").write_text(text, encoding="utf-8")
    rows = "".join(f"{0.01 * k:.2f},{k % 7},{k % 5},{k % 3}\n" for k in range(200))
    quoted = column.replace('"', "")
    head = f't,"{quoted}","q_{quoted}",tau_j2\n'
    (folder / "log.csv").write_text(head + rows, encoding="utf-8")
    words = ["inspect", str(folder / "log.csv"), "--out", str(folder / "out")]
    words += rng.choice(([], ["--model", str(folder / "two.urdf")]))
    words += rng.choice(([], ["--json"]))

    def check() -> str:
        code, said = shell(*words)
        if "Traceback" in said.err or code not in (0, 1, 2):
            return f"exit code {code}: {said.err[-300:]}"
        if any(control in said.out + said.err for control in "\x1b\x9b\u202e"):
            return "a control character reaches the terminal"
        if "--json" in words and code != 2:
            json.loads(said.out, parse_constant=_refuse)
        return ""

    return Kind(f"names {column[:20]!r} and {joint[:20]!r}", check)


def _escaped(name: str) -> str:
    """A name for an attribute of XML, which holds no control characters."""
    plain = "".join(c for c in name if c.isprintable())
    return plain.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


def poisoned(rng: random.Random, folder: Path) -> Kind:
    """Modules of the current folder are not imported."""
    chosen = rng.sample(_POISON, 3)
    for name in chosen:
        text = f"open({str(folder / 'trace')!r}, 'a').write({name!r})\n"
        (folder / f"{name}.py").write_text(text, encoding="utf-8")
    (folder / "log.csv").write_text("t,q\n0,1\n1,2\n2,3\n", encoding="utf-8")
    words = rng.choice((("list",), ("inspect", "log.csv"), ("identify", "--log", "log.csv")))
    program = Path(sys.executable).with_name("nsaid")

    def check() -> str:
        ran = subprocess.run([program, *words], cwd=folder, capture_output=True, check=False)
        if (folder / "trace").exists():
            return f"imported: {(folder / 'trace').read_text(encoding='utf-8')}"
        return "" if ran.returncode in (0, 1, 2) else f"exit code {ran.returncode}"

    return Kind(f"{words[0]} beside {', '.join(chosen)}", check)


FAMILIES: dict[str, Draw] = {
    "damaged binaries": binaries,
    "bombs": bombs,
    "names": names,
    "poisoned folders": poisoned,
}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family."""
    return carried_out(family, FAMILIES[family], tries, seed)
