"""The package's own identifiers as methods: run once along a log, as they would run online."""

from __future__ import annotations

from ..errors import NoEstimate
from ..identifiers import Identifier, Status
from .base import Estimate, Problem


def follow(identifier: Identifier, problem: Problem) -> Estimate:
    """The identifier's final estimate.

    Args:
        identifier: starts from its own prior.
        problem: only its log is used.

    Raises:
        NoEstimate: the identifier ended early.
    """
    log = problem.log
    state, made = identifier.follow(identifier.init(log.at(0)), log)
    if state.status is not Status.completed:
        failed = log.t[len(made.pivot)]
        raise NoEstimate(f"{state.status.words} at t = {failed:.4g} s", state.status.remedy)
    return Estimate(state.theta_hat)
