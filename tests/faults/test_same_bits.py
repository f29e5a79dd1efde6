"""A run's record is the same to the bit, wherever and however its process was started."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.faulty import CHECKOUT

RUN = """
import hashlib, sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from nsaid_mj import run
from nsaid_mj.lab.library import load
scenario = load(sys.argv[1])
scenario = replace(scenario, duration=float(sys.argv[2]), held_out=0.5)
with TemporaryDirectory() as folder:
    run(scenario, Path(folder))
    print(hashlib.sha256((Path(folder) / "record.arrow").read_bytes()).hexdigest())
"""
PRODUCT = """
import hashlib
import numpy as np
from nsaid_mj.base.threads import single_threaded
@single_threaded
def product():
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(2000, 700)), rng.normal(size=2000)
    return np.linalg.lstsq(A, b, rcond=None)[0].tobytes() + (A.T @ A).tobytes()
print(hashlib.sha256(product()).hexdigest())
"""


def said(code: str, *words: str, cwd: Path, more: dict[str, str], one_core: bool = False) -> str:
    """What a process prints whose environment has some more variables."""
    if one_core:
        code = f"import os; os.sched_setaffinity(0, [min(os.sched_getaffinity(0))]); {code}"
    own = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=cwd,
        env=own | {"PYTHONPATH": str(CHECKOUT)} | more,
        capture_output=True,
        text=True,
        timeout=900,
        check=True,
    ).stdout.strip()


def threads(count: int) -> dict[str, str]:
    return dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), str(count))


def test_products_do_not_depend_on_the_number_of_threads(tmp_path: Path) -> None:
    assert len({said(PRODUCT, cwd=tmp_path, more=threads(count)) for count in (1, 2, 4)}) == 1


def test_a_run_does_not_depend_on_its_surroundings(tmp_path: Path) -> None:
    words = ("scalar_rov", "2")
    expected = said(RUN, *words, cwd=CHECKOUT, more=threads(1))
    surroundings = [
        {"PYTHONHASHSEED": "1", "LC_ALL": "de_DE.UTF-8", "TZ": "Asia/Tokyo", **threads(4)},
        {"PYTHONHASHSEED": "2", "LC_ALL": "C", "PYTHONUTF8": "0", "COLUMNS": "20"},
    ]
    one_core = (False, hasattr(os, "sched_setaffinity"))
    for more, one in zip(surroundings, one_core, strict=True):
        assert said(RUN, *words, cwd=tmp_path, more=more, one_core=one) == expected


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "uvms", "ur5", "bluerov2"])
def test_a_run_does_not_depend_on_the_number_of_threads(name: str, tmp_path: Path) -> None:
    found = {said(RUN, name, "2", cwd=tmp_path, more=threads(count)) for count in (1, 2, 4)}
    nsaid = "from nsaid_mj.cli import run_from_shell; run_from_shell()"
    flags = ("--duration", "2", "--held-out", "0.5", "--out", "out", "--quiet")
    said(nsaid, "run", name, *flags, cwd=tmp_path, more={})
    record = (tmp_path / "out" / "record.arrow").read_bytes()
    assert found == {hashlib.sha256(record).hexdigest()}
