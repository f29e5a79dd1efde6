"""The examples run as scripts, and the notebooks are made from them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.faulty import CHECKOUT

SCRIPTS = sorted((CHECKOUT / "examples").glob("*.py"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_an_example_runs(script: Path, tmp_path: Path) -> None:
    more = {"NSAID_EXAMPLE_SECONDS": "1", "MPLBACKEND": "Agg", "PYTHONPATH": str(CHECKOUT)}
    done = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env={**os.environ, **more},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "distance to the true set" in done.stdout
    assert (tmp_path / "runs" / f"example-{script.stem}" / "summary.json").is_file()


def test_the_notebooks_are_made_from_the_scripts() -> None:
    pytest.importorskip("jupytext")
    words = [sys.executable, "scripts/notebooks.py", "--check"]
    done = subprocess.run(words, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
