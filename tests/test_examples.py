"""The examples run as scripts, and the notebooks are made from them."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.faulty import CHECKOUT

SCRIPTS = sorted((CHECKOUT / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_runs(
    script: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NSAID_EXAMPLE_SECONDS", "1")
    runpy.run_path(str(script), run_name="__main__")
    assert "distance to the true set" in capsys.readouterr().out
    assert (tmp_path / "runs" / f"example-{script.stem}" / "summary.json").is_file()


def test_the_notebooks_are_made_from_the_scripts() -> None:
    pytest.importorskip("jupytext")
    words = [sys.executable, "scripts/notebooks.py", "--check"]
    done = subprocess.run(words, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
