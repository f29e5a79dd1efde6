"""Compiles the filter of the law `efficient` in a second process.

More than half of what a first run of this law compiles is the filter, and numba compiles in one
thread only. Meanwhile this process compiles the rest, by a run of the law without its filter. Both
share the cache of compiled kernels.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np

from ..bounds import config
from ..experiment.scenario import Scenario
from ..experiment.setup import Setup
from ..identifiers import Identifier, IdentifierConfig, NullspaceAID, State, Status
from ..identifiers.base import Confidence, Estimates, ExpectedGramian
from ..identifiers.efficient.law import EfficientIdentifier
from ..log import EXACT, Log, Measurement, SensorLevels
from ..parameters import Array
from ..system import SecondOrderSystem

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
    _ = Setup.of(scenario).system.forward  # compiles the structure's kernels, which both need
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _CALL],
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


def without_filter(scenario: Scenario) -> Scenario:
    """A scenario of the law `efficient`, to compile all but its filter."""
    assert isinstance(scenario.identifier, NullspaceAID)
    return replace(scenario, identifier=_WithoutFilter(base=scenario.identifier))


@config
class _WithoutFilter(IdentifierConfig):
    """The law `efficient` without its filter."""

    base: NullspaceAID = NullspaceAID(law="efficient")

    @property
    def in_cone(self) -> bool:
        return self.base.in_cone

    def build(
        self,
        system: SecondOrderSystem,
        prior: Array,
        dt: float,
        noise: SensorLevels = EXACT,
        gramian: ExpectedGramian | None = None,
    ) -> Identifier:
        whole = self.base.build(system, prior, dt, noise, gramian)
        assert isinstance(whole, EfficientIdentifier)
        return _MemoryAlone(whole)


class _MemoryAlone(Identifier):
    """The implicit steps of a law's memory, and nothing between them."""

    proven = False

    def __init__(self, whole: EfficientIdentifier):
        assert whole.guard.memory is not None
        self._whole, self._guard, self._memory = whole, whole.guard, whole.guard.memory
        self.system, self.conserves, self.cancelling = whole.system, False, whole.cancelling

    def init(self, first: Measurement) -> State:
        return self._guard.init(first)

    def resume(self, state: State, here: Measurement) -> State:
        return self._guard.resume(state, here)

    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        self.check(log)
        made, at = [Estimates.of(state)], 0
        while at < len(log.t) - 1 and state.status is Status.completed:
            assert state.memory is not None
            steps = self._memory.every - state.memory.step % self._memory.every
            piece = log.part(at, at + steps + 1)
            state = self._memory.absorb(state, piece)
            last = piece.at(-1)
            state = state._replace(t=last.t, v_hat=last.v)
            made += [Estimates.of(state)] * (len(piece.t) - 1)
            at += len(piece.t) - 1
        return state, Estimates(*(np.concatenate(part) for part in zip(*made, strict=True)))

    def conserved(self, theta_hat: Array) -> Array:
        return self._whole.conserved(theta_hat)

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        return self._whole.divergence(theta, theta_hat)

    def implicit(self, t: Array) -> np.ndarray:
        return self._whole.implicit(t)

    def slacks(self, log: Log, theta: Array) -> Array:
        return self._whole.slacks(log, theta)

    def confidence(self, state: State) -> Confidence | None:
        return self._guard.confidence(state)


def compile_filter() -> None:
    """What the second process does: reads a scenario from standard input and runs its filter."""
    from ..identifiers.efficient.law import Witness

    scenario = Scenario.from_json(sys.stdin.read())
    setup, identifier = Setup.of(scenario), scenario.identifier
    assert isinstance(identifier, NullspaceAID)
    q, v, u = setup.system.random_state(np.random.default_rng(0))
    rows = [Measurement(k * scenario.dt, q, v, u) for k in range(_SAMPLES)]  # any motion will do
    witness = Witness(setup.system, scenario.dt, identifier.efficient)
    witness.replay(setup.prior, witness.covariance(setup.prior), Log.unchecked_of(rows))
