"""Bad input by the thousand: every try must succeed or end in a typed error.

    python -m scripts.campaign_inputs [FAMILY …] [--tries 500] [--seed 0]

A family draws tries of one kind: values of fields, whole runs with odd values, command lines,
URDF files, scripts, logs and maps. Everything runs in this process. A try ends in

- `ok`: it did what was asked;
- `typed`: refused with a message, or a run that says in its summary how it ended;
- `untyped`: any other exception, or no message;
- `hang`: it took longer than `LIMIT`;
- `wrong`: it claims success, but a file is not strict JSON or a figure is missing.

Prints the tries that failed, and a table; the exit code is 1 if there is any.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import itertools
import json
import os
import random
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from nsaid_mj import cli
from nsaid_mj.errors import NsaidError
from nsaid_mj.resources import scenarios
from scripts import campaign_files, field_values

LIMIT = 300
"""Wall time after which a try counts as hanging [s]; compiling kernels may take minutes."""
TYPED = ("ok", "typed")
_NUMBERS = ("0", "-1", "nan", "inf", "1e300", "5e-324", "1e12", "2**31", "1.5", "9" * 400, "-0.0")
_WORDS = ("", "x", "[/x]", "[red]", "\udcff", "ünicode", "a" * 3000, "--", "-", "None", "{}", "*")


class Try(NamedTuple):
    """A try.

    Attributes:
        name: what to give to repeat it.
        outcome: as above.
        words: what it said, where it failed.
    """

    name: str
    outcome: str
    words: str = ""


class Hang(BaseException):
    """A try took too long; no `except Exception` can swallow it."""


class Reached(Exception):
    """A command line got as far as the work itself."""


def judged(action: Callable[[], str]) -> tuple[str, str]:
    """The outcome of an action that returns one, and what went wrong."""
    said = io.StringIO()
    kept = signal.signal(signal.SIGALRM, _hang)
    signal.alarm(LIMIT)
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(said),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            return action(), said.getvalue()[-300:]
    except NsaidError as error:
        return ("typed" if str(error) else "untyped"), ""
    except Hang:
        return "hang", f"longer than {LIMIT} s"
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return "untyped", f"{type(error).__name__}: {str(error)[:200]} ({last.name})"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, kept)


def _hang(*_: object) -> None:
    raise Hang


def shell(*words: str) -> str:
    """The outcome of `nsaid …`; `inspect` tells its refusals on standard output."""
    said = io.StringIO()
    try:
        with (
            mock.patch.object(sys, "argv", ["nsaid", *words]),
            contextlib.redirect_stderr(said),
            contextlib.redirect_stdout(said),
        ):
            cli.run_from_shell()
    except SystemExit as exited:
        text = said.getvalue()
        if "Traceback" in text:
            raise RuntimeError(text[-300:]) from None
        if exited.code in (0, None):
            return "ok"
        return "typed" if exited.code == 1 or text.strip() else "untyped"
    return "untyped"


# -- families --------------------------------------------------------------------------------------


def fields(rng: random.Random) -> Iterator[Try]:
    """Values of fields, replaced in Python, in JSON, or by flags."""
    while True:
        way, name, values = field_values.drawn(rng)

        def action(way: str = way, name: str = name, values: dict[str, Any] = values) -> str:
            end = field_values.outcome(way, name, values)
            if end not in ("valid", "refused"):
                raise RuntimeError(end)
            return "ok" if end == "valid" else "typed"

        shown = ", ".join(f"{path}={field_values.shown(value)}" for path, value in values.items())
        yield Try(f"{way}, {name}, {shown}", *judged(action))


_SHORT = ("--duration", "0.06", "--held-out", "0.05", "--pe-window", "0.02", "--quiet", "--force")
_RUNS = ("scalar_rov", "double_pendulum")
_LAWS = ("paper", "cone", "memory", "efficient")


def runs(rng: random.Random) -> Iterator[Try]:
    """Whole runs of a few steps, with one or two fields set to odd numbers."""
    from nsaid_mj.experiment.scenario import field_at

    while True:
        name = rng.choice(_RUNS)
        scenario = field_values.packed(name)
        paths = [
            path
            for path in field_values.field_paths(scenario)
            if isinstance(field_at(scenario, path), int | float | None)
            and path not in ("duration", "seed")
        ]
        words = ["run", name, *_SHORT, "--law", rng.choice(_LAWS), "--out", "run"]
        for path in rng.sample(paths, rng.choice((1, 1, 2))):
            value = rng.choice(_NUMBERS)
            if rng.random() < 0.5:
                value = repr(10 ** rng.uniform(-16, 16))
            words += [f"--{path}={value}"]
        if rng.random() < 0.3:
            words += ["--sensors", "noisy"]
        yield Try(" ".join(words), *judged(lambda words=words: ended(words)))


def ended(words: list[str]) -> str:
    """The outcome of a run, with its summary checked."""
    folder = Path("run")
    for file in folder.glob("*"):
        file.unlink()
    outcome = shell(*words)
    if outcome == "ok":
        summary = json.loads((folder / "summary.json").read_text(), parse_constant=_refuse)
        if summary["status"] != "completed" or summary["theta_perp_ratio"] is None:
            return "wrong"
    return outcome


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no JSON")


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
_VARIED = ("identifier.gain=nan", "identifier.gain=", "=", "a=b", "dt=1,2,x", "identifier.gain=1,1")
_SEEDS = ("0:", ":", "3:1", "0,0", "x", "1e3", "-5:0", "0:1000000000000", "1,", "")
_PLACES = ("[/x]", "file", "file/below", "/proc/x", "\0", "a" * 300, ".", "")


def commands(rng: random.Random) -> Iterator[Try]:
    """Command lines with odd flags and values, up to where the work would begin."""
    Path("file").write_text("")
    scenario_names = [*scenarios(), "no_such", "", "file", "x.py"]
    while True:
        word = rng.choice(list(_FLAGS))
        line = [word]
        if word in ("run", "verify", "compare", "sweep", "montecarlo"):
            line.append(rng.choice(scenario_names))
        for flag in rng.choices(_FLAGS[word] or ("--x",), k=rng.choice((0, 1, 1, 2, 3))):
            line.append(flag)
            line += _values(flag, rng)
        if word in ("run", "sweep") and line[1] in scenarios() and rng.random() < 0.5:
            path = rng.choice(field_values.places(line[1]))
            line += [f"--{path}", rng.choice(_NUMBERS + _WORDS)]
        if rng.random() < 0.1:
            rng.shuffle(line)
        yield Try(repr(line), *judged(lambda line=line: _reaching(line)))


def _values(flag: str, rng: random.Random) -> list[str]:
    """None or one value of a flag."""
    own = {"--vary": _VARIED, "--seeds": _SEEDS, "--out": _PLACES, "--run": _PLACES}
    return rng.choice(([], [rng.choice(own.get(flag, ()) + _NUMBERS + _WORDS)]))


def _reaching(line: list[str]) -> str:
    """The outcome of a command line, whose work is replaced by an exception."""
    work = (
        "nsaid_mj.experiment.loop.run",
        "nsaid_mj.studies.compare.run",
        "nsaid_mj.studies.sweep.run",
        "nsaid_mj.studies.montecarlo_results.rows_of",
        "nsaid_mj.calibration.identify.identify",
    )
    with contextlib.ExitStack() as stack:
        for name in work:
            with contextlib.suppress(AttributeError):
                stack.enter_context(mock.patch(name, side_effect=Reached))
        try:
            return shell(*line)
        except Reached:
            return "ok"


def urdfs(rng: random.Random) -> Iterator[Try]:
    """URDF files with damaged text, numbers, names and structure."""
    from nsaid_mj.calibration.models import load_robot_model
    from nsaid_mj.plants import ArmPlant

    for number in itertools.count():
        content = campaign_files.urdf(rng)
        path = Path("robot.urdf")
        path.write_bytes(content)

        def simulated() -> str:
            plant = ArmPlant("./robot.urdf").build(1e-3, 0)
            return "ok" if np.isfinite(plant.truth).all() else "wrong"

        def modelled() -> str:
            model = load_robot_model("robot.urdf").model
            numbers = [i.toDynamicParameters() for i in list(model.inertias)[1:]]
            return "ok" if np.isfinite(numbers).all() else "wrong"

        kind, action = rng.choice((("run", simulated), ("identify", modelled)))
        outcome, words = judged(action)
        yield Try(f"{kind}, URDF {number}: {content[:4000]!r}", outcome, words)


def scripts(rng: random.Random) -> Iterator[Try]:
    """Scripts with errors in them, and drivers that return something else."""
    for number in itertools.count():
        text = campaign_files.script(rng)
        name = f"mine{number % 7}.py"
        Path(name).write_bytes(text.encode("utf-8", "replace"))
        line = ["run", name, "--quiet", "--force", "--out", "run"]
        yield Try(f"script: {text[-900:]!r}", *judged(lambda line=line: shell(*line)))


def logs(rng: random.Random) -> Iterator[Try]:
    """Logs and maps with damaged text, columns and times, for `nsaid inspect`."""
    Path("robot.urdf").write_bytes(campaign_files.GOOD)
    while True:
        log, table = campaign_files.log(rng), campaign_files.table(rng)
        Path("log.csv").write_bytes(log)
        Path("table.toml").write_bytes(table)
        line = ["inspect", "log.csv", "--json", "--out", "inspected"]
        line += rng.choice(([], ["--model", "robot.urdf"]))
        line += rng.choice(([], [], ["--map", "table.toml"]))
        outcome, words = judged(lambda line=line: shell(*line))
        yield Try(f"{' '.join(line)}, log {log[:300]!r}, map {table!r}", outcome, words)


def identifications(rng: random.Random) -> Iterator[Try]:
    """`nsaid identify` on damaged logs and maps."""
    Path("robot.urdf").write_bytes(campaign_files.GOOD)
    while True:
        log, table = campaign_files.log(rng), campaign_files.table(rng)
        Path("log.csv").write_bytes(log)
        Path("table.toml").write_bytes(table)
        line = ["identify", "--model", "robot.urdf", "--log", "log.csv", "--json", "--force"]
        line += ["--out", "identified", *rng.choice(([], [], ["--map", "table.toml"]))]
        outcome, words = judged(lambda line=line: shell(*line))
        yield Try(f"{' '.join(line)}, log {log[:300]!r}, map {table!r}", outcome, words)


FAMILIES: dict[str, Callable[[random.Random], Iterator[Try]]] = {
    "fields": fields,
    "commands": commands,
    "urdfs": urdfs,
    "scripts": scripts,
    "logs": logs,
    "identifications": identifications,
    "runs": runs,
}


def carry_out(family: str, tries: int, seed: int) -> Iterator[Try]:
    """The first tries of a family, in a folder of their own."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            yield from itertools.islice(FAMILIES[family](random.Random(seed)), tries)
        finally:
            os.chdir(here)


def main() -> int:
    """Prints failures and the table; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("families", nargs="*")
    parser.add_argument("--tries", type=int, default=500, help="of each family")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    table = []
    for family in chosen.families or FAMILIES:
        begin, ends = time.time(), Counter[str]()
        for found in carry_out(family, chosen.tries, chosen.seed):
            ends[found.outcome] += 1
            if found.outcome not in TYPED:
                name = found.name.encode("utf-8", "replace").decode()
                words = found.words.encode("utf-8", "replace").decode()
                print(f"{family}: {found.outcome}: {name}\n    {words}", flush=True)
        failed = sum(count for end, count in ends.items() if end not in TYPED)
        table.append((family, sum(ends.values()), failed, dict(ends), time.time() - begin))
        print(f"-- {family}: {dict(ends)}, {time.time() - begin:.0f} s", flush=True)
    print("| family | tries | failed |\n|---|---|---|")
    for family, tries, failed, *_ in table:
        print(f"| {family} | {tries} | {failed} |")
    return int(any(failed for _, _, failed, *_ in table))


if __name__ == "__main__":
    sys.exit(main())
