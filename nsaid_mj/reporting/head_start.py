"""Compiles the filter of the law `efficient` in a second process.

Almost half of what a first run of this law compiles is the filter, and numba compiles in one thread
only. The second process has a cache folder of its own, whose files are taken over where the first
process has none: two processes must not write to one cache at the same time.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ..experiment.scenario import Scenario
from ..experiment.setup import Setup
from ..identifiers import NullspaceAID
from ..log import Log, Measurement
from ..numerics.kernels import FOLDER

_CALL = "from nsaid_mj.reporting.head_start import compile_filter; compile_filter()"
_SAMPLES = 12  # of the log along which the filter is compiled
_LONGEST = 300.0  # time until the second process is given up [s]


def pays_off(scenario: Scenario) -> bool:
    """Whether a scenario has the filter, and this machine a second core."""
    law = scenario.identifier
    return isinstance(law, NullspaceAID) and law.law == "efficient" and (os.cpu_count() or 1) > 1


@contextmanager
def second_process(scenario: Scenario) -> Iterator[None]:
    """Compiles a scenario's filter while the body runs, and takes over the compiled files.

    If it fails, as for a plant that only the running script defines, nothing is taken over.

    Args:
        scenario: the scenario that is going to be run.
    """
    with TemporaryDirectory(prefix="nsaid-mj-") as folder:
        process = subprocess.Popen(
            [sys.executable, "-c", _CALL],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"NUMBA_CACHE_DIR": folder},
            text=True,
        )
        try:
            assert process.stdin is not None
            process.stdin.write(scenario.to_json())
            process.stdin.close()
            yield
            if process.wait(_LONGEST) == 0:
                take_over(Path(folder) / FOLDER.parent.name / FOLDER.name, FOLDER)
        except (BrokenPipeError, subprocess.TimeoutExpired):
            pass  # this process compiles the filter itself
        finally:
            process.kill()
            process.wait()


def take_over(source: Path, target: Path) -> None:
    """Moves the files of kernels of which the target has none, an index after its data."""
    for index in sorted(source.rglob("*.nbi")):
        home = target / index.relative_to(source).parent
        if (home / index.name).exists():
            continue
        home.mkdir(parents=True, exist_ok=True)
        for data in index.parent.glob(f"{index.stem}.*.nbc"):
            shutil.move(data, home / data.name)
        shutil.move(index, home / index.name)


def compile_filter() -> None:
    """What the second process does: reads a scenario from standard input and runs its filter."""
    from ..identifiers.efficient.law import Witness

    scenario = Scenario.from_json(sys.stdin.read())
    setup, identifier = Setup.of(scenario), scenario.identifier
    assert isinstance(identifier, NullspaceAID)
    q, v, u = setup.system.random_state(np.random.default_rng(0))
    rows = [Measurement(k * scenario.dt, q, v, u) for k in range(_SAMPLES)]  # any motion will do
    witness = Witness(setup.system, scenario.dt, identifier.efficient)
    witness.contradictions(setup.prior, Log.unchecked_of(rows))
