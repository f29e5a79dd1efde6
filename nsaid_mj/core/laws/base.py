"""The interface of identifiers, an identifier's state, and the ways a run ends."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...base import InvalidInput
from ..log import Log, Measurement
from ..parameters import Array, ParameterSpace
from ..structure.system import SecondOrderSystem, checked

if TYPE_CHECKING:
    from .faults import FaultEvent
    from .memory.statistics import Memory
    from .metric import Metric


class Status(Enum):
    """How a run ended, in words, with the remedy."""

    completed = "completed", ""
    plant_diverged = (
        "plant diverged",
        "The simulation became unstable: use a smaller dt or a gentler excitation.",
    )
    estimate_not_positive_definite = (
        "estimated mass matrix not positive definite",
        "The estimate moved too far: use a smaller identifier gain (or rate, or a larger floor), "
        "a better initial estimate, a gentler excitation, or --law cone.",
    )
    adaptation_too_fast = (
        "conserved quantity drifted by more than 1e-3",
        "The adaptation is too fast for RK4 at this dt: use a smaller identifier gain or dt.",
    )
    measurement_not_finite = (
        "measurement not finite",
        "A sensor returned NaN or infinity: check the named signal at the named time.",
    )
    command_not_finite = (
        "command not finite",
        "The controller returned NaN or infinity: check the driver, and the prior that it uses.",
    )
    interrupted = "interrupted", "Stopped by the user; what was recorded until then is complete."

    def __init__(self, words: str, remedy: str):
        self.words = words
        self.remedy = remedy


class State(NamedTuple):
    """The complete state of an identifier."""

    t: float  # time [s]
    v_hat: Array  # (n,) velocity of the identification plant
    theta_hat: Array  # (p,) estimate
    # smallest pivot of M̂'s Cholesky factorisation in the last step; > 0 if M̂ is positive definite
    pivot: float
    status: Status  # `completed` as long as identification may continue
    memory: Memory | None = None  # statistics of past data; None for laws without a memory
    spent: float = 0.0  # total decrease of the conserved quantity in the memory's implicit steps
    own: Any = None  # what a law keeps besides; None for a law that keeps nothing
    faults: tuple[FaultEvent, ...] = ()  # those found so far; empty for a law that seeks none


class Estimates(NamedTuple):
    """An identifier's outputs along a log, one row for each of N measurements."""

    v_hat: Array  # (N, n) velocity of the identification plant
    theta_hat: Array  # (N, p) estimate
    pivot: Array  # (N,) smallest pivot of M̂ in the step that ends at the measurement
    spent: Array  # (N,) total decrease of the conserved quantity in the memory's implicit steps

    @staticmethod
    def of(state: State, count: int = 1) -> Estimates:
        """`count` rows for the estimates from a state on, which is the first; the rest is unset."""
        v_hat = np.empty((count, len(state.v_hat)))
        theta_hat = np.empty((count, len(state.theta_hat)))
        pivot = np.empty(count)
        v_hat[0] = state.v_hat
        theta_hat[0] = state.theta_hat
        pivot[0] = state.pivot
        return Estimates(v_hat, theta_hat, pivot, np.full(count, state.spent))

    def first(self, count: int) -> Estimates:
        """The first `count` rows."""
        return Estimates(*(part[:count] for part in self))

    def after(self, count: int) -> Estimates:
        """All but the first `count` rows."""
        return Estimates(*(part[count:] for part in self))

    def padded(self, count: int) -> Estimates:
        """`count` rows, the last one repeated if there are fewer."""
        if len(self.pivot) == count:
            return self
        rows = np.minimum(np.arange(count), len(self.pivot) - 1)
        return Estimates(*(part[rows] for part in self))


class Confidence(NamedTuple):
    """Uncertainty of an estimate."""

    covariance: Array  # (p, p) covariance of θ̂ at a fixed common scale
    prior: Array  # (p, p) covariance before any data
    blocks: Array  # (n,) effective number of independent samples per row of the momentum balance

    @staticmethod
    def of_gains(stated: Confidence | None, theta_hat: Array, space: ParameterSpace) -> Array:
        """(a,) relative standard deviations of k_i over the mean of all actuators.

        inf where nothing is stated.
        """
        k = space.actuators
        if stated is None:
            return np.full(len(k), np.inf)
        share = np.eye(len(k)) - 1 / len(k)
        gains = np.where(theta_hat[k] == 0, space.scale[k], theta_hat[k])  # 0: a failed actuator's
        relative = stated.covariance[np.ix_(k, k)] / np.outer(gains, gains)
        return np.sqrt(np.maximum(np.diag(share @ relative @ share), 0.0))


class Identifier(ABC):
    """An adaptive identifier of a system's θ: pure, bitwise reproducible functions of a state."""

    system: SecondOrderSystem  # the structure it knows
    metric: Metric | None = None  # maps Wᵀ Δv to θ̂̇ (45); None for a law without one
    conserves: bool = False  # whether the law has a conserved quantity; that of its metric

    @abstractmethod
    def init(self, first: Measurement) -> State:
        """The state at the first measurement, with Δv = 0."""

    def step(self, state: State, previous: Measurement, following: Measurement) -> State:
        """The state at the following measurement, with `previous.u` held in between.

        Raises:
            InvalidInput: time does not increase, or a shape is wrong.
        """
        for sample in (previous, following):
            shapes = [getattr(part, "shape", ()) for part in sample]
            if shapes != self._shapes:
                checked(self.system, sample)  # raises, and names the wrong part
        if not (following.t > previous.t and math.isfinite(following.t)):
            raise InvalidInput(
                "t",
                f"a time after {previous.t!r} s",
                repr(following.t),
                "Sort the samples by time.",
            )
        pairs = zip(previous, following, strict=True)
        return self.follow(state, Log.unchecked(*(np.array(pair, np.float64) for pair in pairs)))[0]

    def check(self, log: Log) -> None:
        """Raises `InvalidInput` unless the log has the system's numbers of columns."""
        if not isinstance(log, Log):
            raise InvalidInput("log", "a Log", type(log).__name__, "Make one: Log(t, q, v, u).")
        for name, part, shape in zip("tqvu", log, self._shapes, strict=True):
            if part.shape[1:] != shape:
                raise InvalidInput(
                    name,
                    f"{sum(shape)} columns",
                    f"{part.shape[1]}",
                    "A log holds the system's own coordinates: m positions, n velocities and "
                    "n_u commands.",
                )

    @cached_property
    def _shapes(self) -> list[tuple[int, ...]]:
        """Those of the parts of a measurement."""
        return [(), (self.system.m,), (self.system.n,), (self.system.n_u,)]

    @abstractmethod
    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Steps along a log of N measurements.

        Returns the state at the last measurement, or before the first step that failed, and the
        estimates from the first measurement up to there. A state whose status is not `completed` is
        returned unchanged.
        """

    @abstractmethod
    def resume(self, state: State, here: Measurement) -> State:
        """The state at a measurement after a gap in which the motion is unknown.

        θ̂ and its statistics are kept; v̂ and all other states of the motion are reinitialised.
        """

    def conserved(self, theta_hat: Array) -> Array:
        """(...,) the metric's conserved quantity for estimates (..., p); constant along a run.

        Only a law with a metric has it.
        """
        assert self.metric is not None
        return self.metric.conserved(theta_hat)

    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) the second term of V (66) at θ (p,) and estimates (..., p)."""
        assert self.metric is not None
        return self.metric.divergence(theta, theta_hat)

    @abstractmethod
    def confidence(self, state: State) -> Confidence | None:
        """The estimate's uncertainty; None for a law that does not provide it."""
