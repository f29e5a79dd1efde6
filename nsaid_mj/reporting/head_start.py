"""Compiles the filter of the law `efficient` in a second process.

Almost half of what a first run of this law compiles is the filter, and numba compiles in one thread
only. Both processes share the cache of compiled kernels.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np

from ..experiment.scenario import Scenario
from ..experiment.setup import Setup
from ..identifiers import NullspaceAID
from ..log import Log, Measurement

_CALL = "from nsaid_mj.reporting.head_start import compile_filter; compile_filter()"
_SAMPLES = 12  # of the log along which the filter is compiled
_LONGEST = 300.0  # time until the second process is given up [s]


def pays_off(scenario: Scenario) -> bool:
    """Whether a scenario has the filter, and this machine a second core."""
    law = scenario.identifier
    return isinstance(law, NullspaceAID) and law.law == "efficient" and (os.cpu_count() or 1) > 1


@contextmanager
def second_process(scenario: Scenario) -> Iterator[None]:
    """Compiles a scenario's filter while the body runs, and waits for the rest of it.

    If it fails, as for a plant that only the running script defines, nothing is lost but time.

    Args:
        scenario: the scenario that is going to be run.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", _CALL],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        assert process.stdin is not None
        with suppress(BrokenPipeError), process.stdin:  # it may have failed already
            process.stdin.write(scenario.to_json())
        yield
        with suppress(subprocess.TimeoutExpired):
            process.wait(_LONGEST)
    finally:
        process.kill()
        process.wait()


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
