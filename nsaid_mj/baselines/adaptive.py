"""Our identifiers and the conventional one, run over a log as they would run beside the robot."""

from __future__ import annotations

from collections.abc import Iterator

from ..errors import NoEstimate
from ..identifiers import Identifier, Status
from ..system import Measurement
from .base import Estimate, Log, Problem


def follow(identifier: Identifier, problem: Problem) -> Estimate:
    """The identifier's last estimate; it has its own prior.

    Raises:
        NoEstimate: it ended early.
    """
    samples = _samples(problem.log)
    previous = next(samples)
    state = identifier.init(previous)
    for now in samples:
        state = identifier.step(state, previous, now)
        if state.status is not Status.completed:
            raise NoEstimate(f"{state.status.words} at t = {now.t:.4g} s", state.status.remedy)
        previous = now
    return Estimate(state.theta_hat)


def _samples(log: Log) -> Iterator[Measurement]:
    for t, q, v, u in zip(*log, strict=True):
        yield Measurement(float(t), q, v, u)
