"""The interface of a method: a function of log, structure, prior and noise levels."""

from collections.abc import Callable
from typing import NamedTuple

from ...base import NoEstimate
from ...core import Array, Identifier, Log, SecondOrderSystem, SensorLevels, Status


class Problem(NamedTuple):
    """The information that a method gets."""

    system: SecondOrderSystem
    log: Log  # measurements and commands
    prior: Array  # (p,) θ̂(0)
    noise: SensorLevels = (
        SensorLevels()
    )  # standard deviations of the sensors, as stated by their data sheet


class MethodEstimate(NamedTuple):
    """The result of a method."""

    theta: Array  # (p,) the estimate θ̂
    note: str = ""  # settings that the method chose from the data, in words


Method = Callable[[Problem], MethodEstimate]
"""A method raises an `NsaidError` if it finds no estimate."""


def follow(identifier: Identifier, problem: Problem) -> MethodEstimate:
    """An identifier's final estimate, from its own prior and the log alone.

    Raises:
        NoEstimate: the identifier ended early.
    """
    log = problem.log
    state, made = identifier.follow(identifier.init(log.at(0)), log)
    if state.status is not Status.completed:
        failed = log.t[len(made.pivot)]
        raise NoEstimate(f"{state.status.words} at t = {failed:.4g} s", state.status.remedy)
    return MethodEstimate(state.theta_hat)
