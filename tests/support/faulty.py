"""Small scenarios to break, and ways to run `nsaid` on them."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from nsaid_mj import (
    ArmPlant,
    ConventionalAID,
    FourierTracking,
    MultisineCommand,
    NullspaceAID,
    ScalarRovPlant,
    Scenario,
)
from nsaid_mj.cli import commands as cli

CHECKOUT = Path(__file__).parents[2]
NSAID = Path(sys.executable).with_name("nsaid")
FILES = (
    *(".nsaid-mj.json", "report.html", "record.arrow", "run.rrd", "scenario.json"),
    "summary.json",
)
"""Files of a run; the first has the signatures of the others."""

ROV = Scenario(
    plant=ScalarRovPlant(),
    excitation=MultisineCommand(low=0.1, high=1.0, tones=8, amplitude=0.4),
    identifier=NullspaceAID(K=10.0, gain=0.3),
    initial_error=0.5,
    duration=2.0,
    dt=0.01,
    pe_window=0.5,
    held_out=1.0,
)
WITH_RIVAL = replace(ROV, rivals={"conventional": ConventionalAID(K=10.0, gain=0.3)})
PENDULUM = Scenario(
    plant=ArmPlant(robot="double_pendulum", damping=0.1, friction=0.2, armature=0.01),
    excitation=FourierTracking(fundamental=0.3, harmonics=5, speed=6.0),
    identifier=NullspaceAID(K=20.0, gain=8.0),
    duration=0.5,
    pe_window=0.1,
    held_out=0.2,
)


@dataclass
class Heard:
    """What a piece of code has said, by Python or by C."""

    out: str = ""
    err: str = ""
    warned: list[str] = field(default_factory=list)


@contextlib.contextmanager
def heard() -> Iterator[Heard]:
    """Catches both streams, as Python and as C know them, and Python's warnings."""
    said = Heard()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        kept = os.dup(1), os.dup(2)
        os.dup2(out.fileno(), 1)
        os.dup2(err.fileno(), 2)
        try:
            with (
                open(os.dup(1), "w", encoding="utf-8") as python_out,
                open(os.dup(2), "w", encoding="utf-8") as python_err,
                contextlib.redirect_stdout(python_out),
                contextlib.redirect_stderr(python_err),
                warnings.catch_warnings(record=True) as warned,
            ):
                warnings.simplefilter("default")
                yield said
        finally:
            for number, file in zip((1, 2), kept, strict=True):
                os.dup2(file, number)
                os.close(file)
            out.seek(0)
            err.seek(0)
            said.out, said.err = out.read().decode(), err.read().decode()
            said.warned = [str(w.message) for w in warned]


def shell(*arguments: object) -> tuple[int, Heard]:
    """What `nsaid …` exits with and says, in this process."""
    with mock.patch.object(sys, "argv", ["nsaid", *map(str, arguments)]):
        return code_of(cli.run_from_shell)


def script(scenario: Scenario, *arguments: object) -> tuple[int, Heard]:
    """What a scenario's own script exits with and says, in this process."""
    return code_of(lambda: cli.main(scenario, [str(a) for a in arguments]))


def code_of(action: Any) -> tuple[int, Heard]:
    """What a program that ends by `sys.exit` exits with and says."""
    with heard() as said, pytest.raises(SystemExit) as exited:
        action()
    code = exited.value.code
    return (code if isinstance(code, int) else 0 if code is None else 1), said


def call(*arguments: object, cwd: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """`nsaid …` in its own process, to its end; `more` is set in its environment."""
    code = "from nsaid_mj.cli import run_from_shell; run_from_shell()"
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(CHECKOUT), "PYTHONUTF8": "1", **more},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def start(
    *arguments: object, cwd: Path, before: str = "", redirect: str = "", **more: str
) -> subprocess.Popen[str]:
    """A real `nsaid …` in its own process, which signals reach even where tests run behind.

    A shell carries out `before`, `ulimit -f 9; ` say, and redirects streams, as in `>/dev/full`.
    """
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # never inherit SIG_IGN
    hangup = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # as under nohup
    try:
        line = f'{before}exec "$0" "$@" {redirect}'
        return subprocess.Popen(
            ["sh", "-c", line, str(NSAID), *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "OMP_NUM_THREADS": "1", "PYTHONUTF8": "1", **more},
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
    finally:
        signal.signal(signal.SIGINT, handler)
        signal.signal(signal.SIGHUP, hangup)


def flat(text: str) -> str:
    """Text without the frames and line breaks that a terminal's width has put in."""
    return " ".join(re.sub("[│─╭╮╰╯]", " ", text).split())


def strict(text: str) -> Any:
    """JSON as the standard has it: NaN and Infinity are errors."""

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)
