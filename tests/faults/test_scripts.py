"""An error in a user's script is told in three lines, with file and line, and never a traceback."""

from pathlib import Path

import pytest

from tests.support.faulty import shell

_SCRIPT = """
import numpy as np
from nsaid_mj import MultisineCommand, ScalarRovPlant, Scenario
from nsaid_mj.base.bounds import config
from nsaid_mj.lab.control.driver import CompiledDriver, DriverConfig


class Mine(CompiledDriver):
    def start(self):
        return {start}

    def command(self, t, q, v):
        {command}

    def compiled(self, t):
        return {compiled}


@config
class MyDriver(DriverConfig):
    def build(self, system, prior, rng):
        {build}


scenario = Scenario(
    ScalarRovPlant(), MyDriver(), duration=0.05, dt=0.01, held_out=0.05, pe_window=0.02
)
"""


def scripted(
    command: str = "return np.zeros(1)",
    start: str = "np.zeros(1), np.zeros(1)",
    compiled: str = "None",
    build: str = "return Mine()",
) -> str:
    return _SCRIPT.format(command=command, start=start, compiled=compiled, build=build)


BAD = {  # script: line at fault, reason, line of code
    "x = (\n": (1, "SyntaxError: '(' was never closed", "x = ("),
    "import no_such_module\n": (1, "ModuleNotFoundError", "import no_such_module"),
    "def f():\n    return 1 / 0\n\n\nf()\n": (2, "ZeroDivisionError", "return 1 / 0"),
    "import sys\nsys.exit(3)\n": (2, "it exits while it is loaded", "sys.exit(3)"),
    scripted("raise RuntimeError('tired')"): (13, "RuntimeError: tired", "raise RuntimeError"),
    scripted("return q[5]"): (13, "IndexError: index 5 is out of bounds", "return q[5]"),
    scripted("return 1 / 0 if t > 0.02 else np.zeros(1)"): (13, "ZeroDivisionError", "return 1"),
    scripted("raise SystemExit(7)"): (13, "SystemExit: 7", "raise SystemExit(7)"),
    scripted("return np.zeros(3)"): (12, "shape (1,), got shape (3,)", "def command"),
    scripted("return 0.0"): (12, "shape (1,), got shape ()", "def command"),
    scripted("return None"): (12, "shape (1,), got shape ()", "def command"),
    scripted("return 'full'"): (12, "shape (1,), got str", "def command"),
    scripted("return np.array([1j])"): (12, "complex numbers", "def command"),
    scripted(start="3"): (9, "to start from, got int", "def start"),
    scripted(start="(np.zeros(2), np.zeros(1))"): (9, "shape (1,), got shape (2,)", "def start"),
    scripted(compiled="np.zeros((3, 3))"): (15, "got shape (3, 3)", "def compiled"),
    scripted(build="pass"): (21, "expected a Driver, got NoneType", "def build"),
    scripted(build="raise ValueError('two\\nlines')"): (22, "two lines", "raise ValueError"),
}


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("number", range(len(BAD)))
def test_an_error_in_a_script_is_told_in_three_lines_with_file_and_line(number, desk):
    script, (line, reason, code) = list(BAD.items())[number]
    (desk / "mine.py").write_text(script)
    exit_code, said = shell("run", "mine.py", "--quiet", "--out", "out")
    first, second, third = said.err.rstrip("\n").splitlines()
    assert exit_code == 2 and said.out == ""
    assert first.startswith("nsaid: ") and f"mine.py, line {line}: " in first and reason in first
    assert second.startswith(f"  {code}") and third


@pytest.mark.parametrize("script", ["", "scenario = 3\n"])
def test_a_script_without_a_scenario_says_what_one_is(script, desk):
    (desk / "mine.py").write_text(script)
    code, said = shell("run", "mine.py", "--quiet", "--out", "out")
    assert code == 2 and "defines `scenario = Scenario(…)`" in said.err


def test_a_field_that_json_cannot_hold_is_refused(desk):
    fields = "class MyDriver(DriverConfig):\n    strength: float = object()\n"
    (desk / "mine.py").write_text(scripted().replace("class MyDriver(DriverConfig):\n", fields))
    code, said = shell("run", "mine.py", "--quiet", "--out", "out")
    assert code == 2 and "expected what JSON can hold" in said.err


def test_bytes_that_are_no_python_are_refused(desk):
    (desk / "mine.py").write_text("\0")
    code, said = shell("run", "mine.py", "--quiet", "--out", "out")
    assert code == 2 and said.err.startswith("nsaid: mine.py: SyntaxError: ")


def test_the_script_behind_the_broken_ones_runs(desk):
    (desk / "mine.py").write_text(scripted())
    assert shell("run", "mine.py", "--quiet", "--out", "out")[0] == 0


def test_a_controllers_nan_is_not_called_a_sensors(desk):
    (desk / "mine.py").write_text(scripted("return np.array([np.nan if t > 0.02 else 0.0])"))
    code, said = shell("run", "mine.py", "--json", "--out", "out")
    assert code == 1 and '"status": "command not finite"' in said.out
