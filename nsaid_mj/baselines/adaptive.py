"""Our identifiers and the conventional one, run over a log as they would run beside the robot."""

from __future__ import annotations

from ..errors import NoEstimate
from ..identifiers import Identifier, Status
from .base import Estimate, Problem


def follow(identifier: Identifier, problem: Problem) -> Estimate:
    """The identifier's last estimate; it has its own prior.

    Raises:
        NoEstimate: it ended early.
    """
    log = problem.log
    state, made = identifier.follow(identifier.init(log.at(0)), log)
    if state.status is not Status.completed:
        failed = log.t[len(made.pivot)]
        raise NoEstimate(f"{state.status.words} at t = {failed:.4g} s", state.status.remedy)
    return Estimate(state.theta_hat)
