"""Code in the folder of a user's logs never runs unless it is named on the command line."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import nsaid_mj

PACKAGE = Path(nsaid_mj.__file__).parent
NAMES = ("json", "numpy", "pydantic", "matplotlib", "rerun", "nsaid_mj", "typing", "numba", "rich")


@pytest.fixture
def poisoned(tmp_path: Path) -> Path:
    """A folder with modules by the names of others, which leave a trace if they are imported."""
    for name in NAMES:
        text = f"open({str(tmp_path / 'trace')!r}, 'a').write({name!r})\nraise SystemExit(7)\n"
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        ("run", "scalar_rov", "--duration", "0.2", "--held-out", "0.5", "--pe-window", "0.1"),
        pytest.param(
            ("sweep", "scalar_rov", "--duration", "0.2", "--seeds", "2", "--jobs", "2"),
            marks=pytest.mark.slow,
        ),
        ("list",),
    ],
    ids=lambda words: words[0],
)
def test_a_command_imports_nothing_from_the_current_folder(
    words: tuple[str, ...], poisoned: Path
) -> None:
    program = Path(sys.executable).with_name("nsaid")
    ran = subprocess.run(
        [program, *words], cwd=poisoned, capture_output=True, text=True, check=False, timeout=300
    )
    assert not (poisoned / "trace").exists(), (poisoned / "trace").read_text(encoding="utf-8")
    assert ran.returncode == 0, ran.stderr


def test_every_python_that_we_start_ignores_the_current_folder() -> None:
    started = 0
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.List) and len(node.elts) > 1:
                words = [ast.unparse(word) for word in node.elts[:2]]
                if words[0] == "sys.executable":
                    started += 1
                    assert words[1] == "'-P'", f"{path}:{node.lineno}"
    assert started >= 2
