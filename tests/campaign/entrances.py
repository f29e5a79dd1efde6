"""What enters beside files: flags of `live`, data sets of LeRobot, summaries, the environment."""

from __future__ import annotations

import json
import os
import random
import shutil
import subprocess
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from nsaid_mj.clinic.logs.tables import read
from nsaid_mj.lab import postprocessing

from ..support import lerobot
from ..support.faulty import NSAID, strict
from .commands import ODD_NUMBERS, ODD_WORDS, REACHED, desk, reaching
from .folders import packed
from .tries import Draw, Kind, drawn_number, nsaid, typed

# -- live ------------------------------------------------------------------------------------------

_LIVE = ("rate", "position-noise", "velocity-noise", "prior-error", "gain", "every", "udp")
_WORDS = ("law", "frame", "lock", "joints", "out", "model")


def live(rng: random.Random, here: Path) -> Kind:
    """Flags of `nsaid live`, up to the first sample."""
    desk(here)
    words = ["live", "--model", "two.urdf"]
    for name in rng.sample(_LIVE, rng.choice((1, 1, 2))):
        number = repr(drawn_number(rng)) if rng.random() < 0.7 else rng.choice(ODD_NUMBERS)
        words.append(f"--{name}={number}")
    if rng.random() < 0.3:
        words.append(f"--{rng.choice(_WORDS)}={rng.choice(ODD_WORDS)}")

    def check() -> str:
        return reaching(words, here, REACHED)

    return Kind(" ".join(words), check)


# -- LeRobot ---------------------------------------------------------------------------------------

_VALUES: tuple[Any, ...] = (None, [], {}, "", "x", "../../x", True, -1, [[]], {"a": []}, ["a"] * 9)


def changed(value: Any, rng: random.Random) -> Any:
    """A JSON value with one value in it, at any depth, replaced by another one, or left out."""
    if isinstance(value, dict | list) and value and rng.random() < 0.8:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        key = rng.choice(keys)
        kept = dict(value) if isinstance(value, dict) else list(value)
        if rng.random() < 0.1:
            del kept[key]
        else:
            kept[key] = changed(value[key], rng)
        return kept
    return drawn_number(rng) if rng.random() < 0.4 else rng.choice(_VALUES)


def data_sets(rng: random.Random, here: Path) -> Kind:
    """Data sets of LeRobot with odd numbers, or an odd value in what they say of themselves."""
    version = rng.choice(("v2.1", "v3.0"))
    width = rng.choice((1, 2, 6))
    names: list[str] | None = rng.choice(
        (None, ["j1.pos"] * width, [f"j{k}" for k in range(width)])
    )
    episodes = []
    for _ in range(rng.choice((1, 3))):
        t = np.arange(rng.choice((1, 2, 60))) / 50
        state = np.sin(t[:, None] + np.arange(width))
        if rng.random() < 0.4:
            state[rng.randrange(len(t)), rng.randrange(width)] = drawn_number(rng)
        episodes.append((state, state + 0.01))
    with np.errstate(over="ignore"):  # they are written as float32
        folder = lerobot.write_dataset(here / "set", version, episodes, names)
    info = folder / "meta" / "info.json"
    said = changed(json.loads(info.read_text("utf-8")), rng)
    info.write_text(json.dumps(said), encoding="utf-8")

    def check() -> str:
        for path in folder.rglob("*.parquet"):
            typed(lambda path=path: str(read(path) and ""))
        with mock.patch("nsaid_mj.clinic.commands.identify._files_of_inspection", return_value={}):
            ended = nsaid(["inspect", "set", "--json", "--out", "out"], here)
        if not ended.wrong and ended.code != 2:
            strict(ended.out)
        return ended.wrong

    return Kind(f"{version}, {len(episodes)} episodes, {json.dumps(said)[:300]}", check)


# -- rebuilds --------------------------------------------------------------------------------------


def rebuilds(rng: random.Random, here: Path) -> Kind:
    """A run whose JSON has another value somewhere is rebuilt, or refused."""
    out = Path(shutil.copytree(packed("run"), here / "out"))
    name = rng.choice(("summary.json", "summary.json", "scenario.json", ".nsaid-mj.json"))
    found = changed(json.loads((out / name).read_text("utf-8")), rng)
    (out / name).write_text(json.dumps(found), encoding="utf-8")

    def rebuilt() -> str:
        json.dumps(postprocessing.rebuild(out).summary(), allow_nan=False)
        return ""

    return Kind(f"{name}: {json.dumps(found)[:600]}", lambda: typed(rebuilt))


# -- environment -----------------------------------------------------------------------------------

_VARIABLES = {
    "HOME": ("", "/none", "file", "~", "/dev/null", "/proc"),
    "XDG_CACHE_HOME": ("", "none", "/none", "file", "/dev/null", "/proc"),
    "NUMBA_CACHE_DIR": ("file", "/none", "/dev/null", "/proc", "a" * 300),
    "TMPDIR": ("/none", "file", ""),
    "COLUMNS": ("0", "-1", "1", "x", "9" * 30, ""),
    "LINES": ("0", "-1", "x"),
    "TERM": ("", "dumb", "x", "xterm-256color"),
    "LANG": ("C", "", "x.y", "de_DE.ISO-8859-1"),
    "LC_ALL": ("C", "POSIX", "x"),
    "PYTHONIOENCODING": ("ascii", "latin-1", "utf-16"),
    "PYTHONUTF8": ("0", "1"),
    "PYTHONWARNINGS": ("error", "ignore", "x"),
    "OMP_NUM_THREADS": ("0", "-1", "x", "1", "9999"),
    "NUMBA_NUM_THREADS": ("1", "2"),
    "MPLBACKEND": ("Agg", "x", "TkAgg"),
    "MPLCONFIGDIR": ("/none", "file"),
    "MUJOCO_GL": ("egl", "x", "disable"),
    "NO_COLOR": ("1",),
    "FORCE_COLOR": ("1",),
    "TZ": ("x", "UTC", ":"),
}


def environments(rng: random.Random, here: Path) -> Kind:
    """Odd values of environment variables, in a process of its own."""
    desk(here)
    (here / "file").write_text("", encoding="utf-8")
    names = rng.sample(list(_VARIABLES), rng.choice((1, 2, 4)))
    odd = {name: rng.choice(_VARIABLES[name]) for name in names}
    words = rng.choice(
        (["list"], ["list"], ["run", "none"], ["identify", "none.csv", "--model", "two.urdf"])
    )
    if rng.random() < 0.15:
        words = ["inspect", "log.csv", "--model", "two.urdf", "--json", "--out", "out"]

    def check() -> str:
        done = subprocess.run(
            [NSAID, *words],
            cwd=here,
            env=os.environ | odd,
            capture_output=True,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        said = done.stderr.decode(errors="replace") + done.stdout.decode(errors="replace")
        if "Traceback" in said:
            return f"a traceback: {said[-300:]}"
        return "" if done.returncode in (0, 1, 2) else f"exit code {done.returncode}: {said[-300:]}"

    return Kind(f"{odd} {' '.join(words)}", check)


FAMILIES: dict[str, Draw] = {
    "live": live,
    "data sets": data_sets,
    "rebuilds": rebuilds,
    "environments": environments,
}
