"""A user's own files, odd names of files, odd options, and streams of odd samples."""

from __future__ import annotations

import contextlib
import io
import json
import os
import random
import shutil
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np

from nsaid_mj.calibration.live_robot import LiveRobot
from nsaid_mj.calibration.measured import measured_scenario
from nsaid_mj.recording.postprocessing import finish
from nsaid_mj.streaming.session import Session
from scripts.campaign_files import GOOD, sound_log
from scripts.campaign_tries import Draw, Kind, Try, carried_out, typed
from tests.support.faulty import shell

_SHORT = ("--duration", "0.1", "--held-out", "0.05", "--pe-window", "0.05")
_OWN = ("report.html", "map.toml", "map-new.toml", "inspection.png", "run.rrd", "two.xml")
_OWN += ("two-calibrated.urdf", "calibrated.yaml", "summary.txt", "rows.txt")
_OWN += ("motion.csv", "compare.csv", "scenario.py", "montecarlo.parquet", "sysid.yaml")
_COMMANDS = (
    ("inspect", "log.csv"),
    ("inspect", "log.csv", "--model", "two.urdf"),
    ("run", "scalar_rov", *_SHORT),
    ("verify", "scalar_rov", *_SHORT),
    ("identify", "--model", "two.urdf", "--log", "log.csv"),
    ("sweep", "scalar_rov", *_SHORT, "--seeds", "1", "--jobs", "1"),
    ("montecarlo", "scalar_rov", *_SHORT, "--runs", "1", "--jobs", "1"),
    ("compare", "scalar_rov", "--durations", "0.2", "--seeds", "0:1", "--methods", "paper"),
    ("excite", "--model", "two.urdf", "--duration", "x"),
)


def _desk(folder: Path, log: str = "log.csv", model: str = "two.urdf") -> None:
    """A log and a model in a folder."""
    (folder / log).write_bytes(sound_log())
    (folder / model).write_bytes(GOOD)


def _said(words: tuple[str, ...] | list[str], folder: Path) -> tuple[str, str, str]:
    """What is wrong with how `nsaid …` ends in a folder, and what it has said."""
    with contextlib.chdir(folder):
        code, said = shell(*words)
    wrong = "" if code in (0, 1, 2) else f"exit code {code}: {said.err[-300:]}"
    if "Traceback" in said.err:
        wrong = f"a traceback: {said.err[-300:]}"
    if code == 2 and not (said.err + said.out).strip():
        wrong = "refused without a word"
    return wrong, said.out, said.err


def files(rng: random.Random, folder: Path) -> Kind:
    """No command overwrites what it did not make; inputs stay even with --force."""
    _desk(folder)
    mine = folder / rng.choice((".", "mine"))
    mine.mkdir(exist_ok=True)
    for name in rng.sample(_OWN, rng.choice((1, 1, 3))):
        (mine / name).write_text(f"dear: {name}", encoding="utf-8")
    (folder / "link").symlink_to(mine)
    places = (".", "link", str(mine), "two.urdf", "log.csv/x", "link/..", "./mine/../link")
    words = [*rng.choice(_COMMANDS), "--out", rng.choice(places)]
    if forced := rng.random() < 0.2 and words[0] in ("run", "identify"):
        words.append("--force")
    kept = [folder / "log.csv", folder / "two.urdf"]
    kept += [] if forced else [path for path in mine.iterdir() if path.name in _OWN]
    before = {path: path.read_bytes() for path in kept}

    def check() -> str:
        wrong, *_ = _said(words, folder)
        lost = [p.name for p, b in before.items() if not p.is_file() or p.read_bytes() != b]
        return wrong or (f"overwritten: {', '.join(lost)}" if lost else "")

    return Kind(f"{' '.join(words)} beside {', '.join(sorted(p.name for p in kept))}", check)


_ODD = ("-x", "[red]", "a\nb", "\udcff", " ", "~", "*", "{}", "a" * 240, "é", "$(touch pwned)")
_ODD += ("<img src=x onerror=alert(1)>", "{{ 7 }}", "%s%n", "\x1b[31m", "; touch pwned", "'", '"')
_ODD += ("a:b", "a b", "..", "#", "&amp;", "\u202egnp", "run", "ur5", "--", "`touch pwned`", "\\")


def names(rng: random.Random, folder: Path) -> Kind:
    """Odd names of files and folders are names: on the terminal, in pages, and on command lines."""
    log, model, out = (f"{rng.choice(_ODD)}{end}" for end in (".csv", ".urdf", ""))
    here = folder / "here"
    here.mkdir()
    _desk(here, log, model)
    command = rng.choice(("inspect", "identify", "run"))
    words = [command, "--model", f"./{model}"]
    if command == "run":
        words = ["run", "arm", "--robot", f"./{model}", *_SHORT]
    else:
        words += ["--log", f"./{log}"] if command == "identify" else [f"./{log}"]
    words += ["--out", f"./{out}" if out != ".." else "./x"]

    def check() -> str:
        wrong, out, err = _said(words, here)
        if wrong:
            return wrong
        if any(control in out + err for control in ("\x1b[31m", "\u202e")):
            return "a control character of a name reaches the terminal"
        if (here / "pwned").exists():
            return "a name was executed"
        pages = [page for page in here.rglob("*.html") if "<img src=x" in page.read_text("utf-8")]
        return "markup of a name is in the page" if pages else ""

    return Kind(" ".join(words), check)


_OPTIONS = {
    "--known": ("gain_1=nan", "gain_1=-1", "gain_1=0", "gain_1=1e300", "x=1", "=", "mass of l1=2",
                "mass of l1=-2", "gain_1=1", "gain_1=1e-300", "gain_j1=inf"),
    "--load": ("log.csv:1kg@tool", "log.csv:-1kg@tool", "x:1kg@tool", "log.csv:nankg@l2", "",
               "log.csv:1e300kg@l2", "log.csv:1kg@", "1kg", "log.csv:1 kg@l2@l1"),
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
}  # fmt: skip


def options(rng: random.Random, folder: Path) -> Kind:
    """`nsaid identify` on a good log with odd options ends well or typed, with strict JSON."""
    _desk(folder)
    (folder / "empty.csv").write_bytes(b"")
    words = ["identify", "--model", "two.urdf", "--log", "log.csv", "--json", "--out", "out"]
    for option in rng.sample(list(_OPTIONS), rng.choice((1, 1, 2))):
        words.append(f"{option}={rng.choice(_OPTIONS[option])}")

    def check() -> str:
        wrong, out, _ = _said(words, folder)
        if not wrong and out.strip():
            json.loads(out, parse_constant=_refuse)
        return wrong

    return Kind(" ".join(words[7:]), check)


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


@cache
def _session(law: str) -> Session:
    """A live identification of the planar arm, of which each try takes a new cleaner."""
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"campaign-{os.getpid()}.urdf"
    folder.write_bytes(GOOD)
    robot = LiveRobot(robot=str(folder))
    return Session(measured_scenario(robot, law, 100.0, (1e-4, 5e-3), 0.5))


_LINES = (b"", b"{}", b"[]", b"null", b"[" * 50_000, b'{"t":' * 20_000, b"\xff\xfe", b"\0", b"NaN")
_LINES += (
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
)
_PARTS += (
    10**400,
    [10**400, 0],
    [1e300, 0],
    [1e12, -1e12],
    -1e308,
    [float("nan")] * 2,
    1e18,
    [0, 0],
)


def samples(rng: random.Random, folder: Path) -> Kind:
    """`nsaid live` on lines that are no samples, or samples of odd numbers and times."""
    law = rng.choice(("efficient", "memory", "cone", "paper"))
    lines = []
    for k in range(rng.choice((3, 60, 150))):
        phase = np.array([0.06 * k, 0.06 * k + 1])
        parts: dict[str, object] = {"t": 0.01 * k, "q": (0.8 * np.sin(phase)).tolist()}
        parts |= {"v": (4.8 * np.cos(phase)).tolist(), "u": (5 * np.sin(phase)).tolist()}
        lines.append(parts)
    for _ in range(rng.choice((0, 1, 1, 3, 20))):
        rng.choice(lines)[rng.choice("tqvu")] = rng.choice(_PARTS)
    sent = [json.dumps(parts).encode() for parts in lines]
    for _ in range(rng.choice((0, 0, 1, 3, 12))):
        sent.insert(rng.randrange(len(sent) + 1), rng.choice(_LINES))

    def check() -> str:
        session = _session(law)
        session.cleaner = type(session.cleaner)(session.robot.system, 100.0)

        def followed() -> str:
            run = session.run(io.BytesIO(b"\n".join(sent)), folder / "out", lambda _: None)
            summary = finish(run)
            json.dumps(summary, allow_nan=False)
            counted = sum(run.stream[key] for key in run.stream if key not in ("gaps", "missing"))
            lost = len([line for line in sent if line.strip()]) - counted
            ended = summary["status"] != "completed" or b'{"end": true}' in sent
            return f"{lost} lines were lost in silence" if lost and not ended else ""

        shutil.rmtree(folder / "out", ignore_errors=True)
        (folder / "out").mkdir()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return typed(followed)

    odd = [line[:60] for line in sent if not line.startswith(b'{"t": ') or b"e+" in line]
    return Kind(f"law {law}, {len(sent)} lines, {odd[:5]}", check)


FAMILIES: dict[str, Draw] = {
    "user's files": files,
    "file names": names,
    "options": options,
    "samples": samples,
}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family."""
    return carried_out(family, FAMILIES[family], tries, seed)
