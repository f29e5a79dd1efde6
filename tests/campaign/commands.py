"""Odd values of fields, flags and options, and samples that `nsaid live` cannot use."""

from __future__ import annotations

import contextlib
import io
import json
import random
import shutil
import tempfile
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np

from nsaid_mj.base import InvalidInput
from nsaid_mj.clinic.identify.measured import LiveRobot, measured_scenario
from nsaid_mj.clinic.session import Session
from nsaid_mj.lab.postprocessing import finish
from nsaid_mj.lab.scenario import field_at
from nsaid_mj.robots.assets import scenarios

from ..support.faulty import strict
from . import fields, texts
from .tries import Draw, Kind, drawn_number, nsaid, typed

ODD_NUMBERS = (
    "0",
    "-1",
    "nan",
    "inf",
    "1e300",
    "5e-324",
    "1e12",
    "2**31",
    "1.5",
    "9" * 400,
    "-0.0",
)
ODD_WORDS = (
    "",
    "x",
    "[/x]",
    "[red]",
    "\udcff",
    "ünicode",
    "a" * 3000,
    "--",
    "-",
    "None",
    "{}",
    "*",
)
_LAWS = ("paper", "cone", "memory", "efficient")


def of_fields(rng: random.Random, here: Path) -> Kind:
    """Values of fields, replaced in Python, in JSON, or by flags."""
    way, name, values = fields.drawn(rng)

    def check() -> str:
        end = fields.outcome(way, name, values)
        return "" if end in ("valid", "refused") else end

    words = ", ".join(
        f"{path}={InvalidInput(path, '', value, '').got}" for path, value in values.items()
    )
    return Kind(f"{way}, {name}, {words}", check)


_SHORT = ("--duration", "0.06", "--held-out", "0.05", "--pe-window", "0.02")


def runs(rng: random.Random, here: Path) -> Kind:
    """Whole runs of a few steps, with one or two fields set to odd numbers."""
    name = rng.choice(("scalar_rov", "double_pendulum"))
    scenario = fields.packed(name)
    numbers = (int, float, type(None))
    paths = [path for path in fields.field_paths(scenario) if path not in ("duration", "seed")]
    paths = [path for path in paths if isinstance(field_at(scenario, path), numbers)]
    words = ["run", name, *_SHORT, "--quiet", "--law", rng.choice(_LAWS), "--out", "run"]
    for path in rng.sample(paths, rng.choice((1, 1, 2))):
        number = repr(drawn_number(rng)) if rng.random() < 0.5 else rng.choice(ODD_NUMBERS)
        words.append(f"--{path}={number}")
    if rng.random() < 0.3:
        words += ["--sensors", "noisy"]

    def check() -> str:
        ended = nsaid(words, here)
        if ended.wrong or ended.code:
            return ended.wrong
        summary = strict((here / "run" / "summary.json").read_text("utf-8"))
        done = summary["status"] == "completed" and summary["theta_perp_ratio"] is not None
        return "" if done else "exit code 0 of a run that is not completed"

    return Kind(" ".join(words), check)


_FLAGS = {
    "run": ("--out", "--force", "--quiet", "--json"),
    "verify": ("--run", "--quiet", "--json"),
    "compare": ("--methods", "--seeds", "--durations", "--sensors", "--noise-scales", "--budget"),
    "sweep": ("--vary", "--seeds", "--jobs", "--timeout", "--engine", "--address", "--retry"),
    "montecarlo": ("--runs", "--jobs", "--own-plants", "--out"),
    "identify": ("--model", "--log", "--map", "--known", "--lock", "--columns", "--delay", "--out"),
    "inspect": ("--model", "--map", "--lock", "--joints", "--out"),
    "report": (),
    "list": (),
}
_PLACES = ("[/x]", "file", "file/below", "/proc/x", "\0", "a" * 300, ".", "")
_OF_FLAGS = {
    "--vary": (
        "identifier.gain=nan",
        "identifier.gain=",
        "=",
        "a=b",
        "dt=1,2,x",
        "identifier.gain=1,1",
    ),
    "--seeds": ("0:", ":", "3:1", "0,0", "x", "1e3", "-5:0", "0:1000000000000", "1,", ""),
    "--out": _PLACES,
    "--run": _PLACES,
}
REACHED = (
    "nsaid_mj.lab.run",
    "nsaid_mj.clinic.session.Session",
    "nsaid_mj.clinic.commands.identify._identify",
    "nsaid_mj.clinic.commands.identify._inspected",
    "nsaid_mj.plans.excite.command._designed_in",
    "nsaid_mj.plans.studies.compare.compare",
    "nsaid_mj.plans.studies.sweep.run_sweep",
    "nsaid_mj.plans.studies.montecarlo_results.rows_of",
    "nsaid_mj.plans.track.run.courses",
)
"""Functions that do the work of commands."""


class Reached(Exception):
    """A command line got as far as the work itself."""


def reaching(words: list[str], folder: Path, work: tuple[str, ...]) -> str:
    """What goes wrong in a command up to where it would call one of the functions `work`."""
    with contextlib.ExitStack() as stack:
        for name in work:
            stack.enter_context(mock.patch(name, side_effect=Reached))
        try:
            return nsaid(words, folder).wrong
        except Reached:
            return ""


def commands(rng: random.Random, here: Path) -> Kind:
    """Command lines with odd flags and values, up to where the work would begin."""
    (here / "file").write_text("")
    word = rng.choice(list(_FLAGS))
    line = [word]
    if word in ("run", "verify", "compare", "sweep", "montecarlo"):
        line.append(rng.choice([*scenarios(), "no_such", "", "file", "x.py"]))
    for flag in rng.choices(_FLAGS[word] or ("--x",), k=rng.choice((0, 1, 1, 2, 3))):
        values = _OF_FLAGS.get(flag, ()) + ODD_NUMBERS + ODD_WORDS
        line += [flag, *rng.choice(([], [rng.choice(values)]))]
    if word in ("run", "sweep") and line[1] in scenarios() and rng.random() < 0.5:
        line += [f"--{rng.choice(fields.places(line[1]))}", rng.choice(ODD_NUMBERS + ODD_WORDS)]
    if rng.random() < 0.1:
        rng.shuffle(line)

    return Kind(repr(line), lambda: reaching(line, here, REACHED))


_OPTIONS = {
    "--known": (
        "gain_1=nan",
        "gain_1=-1",
        "gain_1=0",
        "gain_1=1e300",
        "x=1",
        "=",
        "mass of l1=2",
        "mass of l1=-2",
        "gain_1=1",
        "gain_1=1e-300",
        "gain_j1=inf",
    ),
    "--load": (
        "log.csv:1kg@tool",
        "log.csv:-1kg@tool",
        "x:1kg@tool",
        "log.csv:nankg@l2",
        "",
        "log.csv:1e300kg@l2",
        "log.csv:1kg@",
        "1kg",
        "log.csv:1 kg@l2@l1",
    ),
    "--lock": ("j1", "j1,j2", "x", ",", "j1,j1", "weld"),
    "--joints": ("j1", "j2,j1", "x", "j1,j1", "weld"),
    "--columns": ("load", "", "x", "load,load", "quadratic,cubic,offset", "viscous", "auto,load"),
    "--delay": ("nan", "-1", "1e300", "0.01", "0.01,0.02", "1,2,3", "", "inf", "3"),
    "--cutoff": ("nan", "-1", "0", "1e-9", "1e300", "5", "inf", "49.9"),
    "--law": ("paper", "efficient", "memory", "cone", "x", ""),
    "--limit": ("0", "-1", "nan", "1e-9", "inf"),
    "--validate": ("log.csv", "two.urdf", "none.csv", ".", "empty.csv"),
    "--map": ("two.urdf", ".", "none", "empty.csv"),
    "--validate-map": ("none", "empty.csv"),
}


def desk(folder: Path, log: str = "log.csv", model: str = "two.urdf") -> None:
    """Puts a log and a model into a folder."""
    (folder / log).write_bytes(texts.sound_log())
    (folder / model).write_text(texts.URDF, encoding="utf-8")


def options(rng: random.Random, here: Path) -> Kind:
    """`nsaid identify` on a good log with odd options ends well or typed, with strict JSON."""
    desk(here)
    (here / "empty.csv").write_bytes(b"")
    words = ["identify", "--model", "two.urdf", "--log", "log.csv", "--json", "--out", "out"]
    for option in rng.sample(list(_OPTIONS), rng.choice((1, 1, 2))):
        words.append(f"{option}={rng.choice(_OPTIONS[option])}")
    if rng.random() < 0.3:
        option = rng.choice(("--known=gain_1", "--delay", "--cutoff", "--limit"))
        words.append(f"{option}={drawn_number(rng)!r}")

    def check() -> str:
        ended = nsaid(words, here)
        if not ended.wrong and ended.out.strip():
            strict(ended.out)
        return ended.wrong

    return Kind(" ".join(words[7:]), check)


# -- samples ---------------------------------------------------------------------------------------


@cache
def _session(law: str) -> Session:
    """A live identification of the planar arm, of which each try takes a new cleaner."""
    model = Path(tempfile.mkdtemp(prefix="campaign-session-")) / "two.urdf"
    model.write_text(texts.URDF, encoding="utf-8")
    return Session(measured_scenario(LiveRobot(robot=str(model)), law, 100.0, (1e-4, 5e-3), 0.5))


_LINES = (
    b"",
    b"{}",
    b"[]",
    b"null",
    b"[" * 50_000,
    b'{"t":' * 20_000,
    b"\xff\xfe",
    b"\0",
    b"NaN",
    b'{"end": true}',
    b'{"t": 1, "q": [1], "v": [1], "u": [1]}',
    b'{"end": false}',
    b"1" * 9999,
)
_PARTS = (
    None,
    "x",
    [],
    [1],
    [[1], [2]],
    {},
    True,
    "1",
    [None, 1],
    ["a", "b"],
    [True, False],
    1e308,
    10**400,
    [10**400, 0],
    [1e300, 0],
    [1e12, -1e12],
    -1e308,
    [float("nan")] * 2,
    1e18,
    [0, 0],
)


def samples(rng: random.Random, here: Path) -> Kind:
    """`nsaid live` on lines that are no samples, or samples of odd numbers and times."""
    law, lines = rng.choice(_LAWS), []
    for k in range(rng.choice((3, 60, 150))):
        phase = np.array([0.06 * k, 0.06 * k + 1])
        parts: dict[str, object] = {"t": 0.01 * k, "q": (0.8 * np.sin(phase)).tolist()}
        parts |= {"v": (4.8 * np.cos(phase)).tolist(), "u": (5 * np.sin(phase)).tolist()}
        lines.append(parts)
    for _ in range(rng.choice((0, 1, 1, 3, 20))):
        odd = [drawn_number(rng), drawn_number(rng)]
        rng.choice(lines)[rng.choice("tqvu")] = rng.choice((*_PARTS, odd, odd, odd[0]))
    sent = [json.dumps(parts).encode() for parts in lines]
    for _ in range(rng.choice((0, 0, 1, 3, 12))):
        sent.insert(rng.randrange(len(sent) + 1), rng.choice(_LINES))

    def followed() -> str:
        session = _session(law)
        session.cleaner = type(session.cleaner)(session.robot.system, 100.0)
        shutil.rmtree(here / "out", ignore_errors=True)
        (here / "out").mkdir()
        run = session.run(io.BytesIO(b"\n".join(sent)), here / "out", lambda _: None)
        summary = finish(run).summary()
        json.dumps(summary, allow_nan=False)
        counted = sum(run.stream[key] for key in run.stream if key not in ("gaps", "missing"))
        lost = len([line for line in sent if line.strip()]) - counted
        ended = summary["status"] != "completed" or b'{"end": true}' in sent
        return f"{lost} lines were lost in silence" if lost and not ended else ""

    odd = [line[:60] for line in sent if not line.startswith(b'{"t": ') or b"e+" in line]
    return Kind(f"law {law}, {len(sent)} lines, {odd[:5]}", lambda: typed(followed))


FAMILIES: dict[str, Draw] = {
    "fields": of_fields,
    "commands": commands,
    "runs": runs,
    "options": options,
    "samples": samples,
}
