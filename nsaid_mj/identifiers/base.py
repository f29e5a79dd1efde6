"""What an identifier is: two pure functions over a state, and the ways a run can end."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from typing import NamedTuple

import numpy as np

from ..bounds import Config, config
from ..log import EXACT, Log, Measurement, SensorLevels
from ..parameters import Array
from ..system import SecondOrderSystem
from .memory.statistics import Memory


class Status(Enum):
    """How a run stands or ended, in words, with what to do about it."""

    completed = "completed", ""
    plant_diverged = (
        "plant diverged",
        "The simulation left the physical world: take a smaller dt, or a gentler excitation.",
    )
    estimate_not_positive_definite = (
        "estimated mass matrix not positive definite",
        "The estimate moved too far: take a smaller identifier gain (or rate, or a larger floor), "
        "a better initial estimate, a gentler excitation, or --law cone.",
    )
    adaptation_too_fast = (
        "conserved quantity drifted by more than 1e-3",
        "The adaptation is too fast for RK4 at this dt: take a smaller identifier gain or dt.",
    )
    measurement_not_finite = (
        "measurement not finite",
        "A sensor gave NaN or infinity: see the named signal at the named time.",
    )
    interrupted = "interrupted", "Stopped by the user; what was recorded until then is complete."

    def __init__(self, words: str, remedy: str):
        self.words, self.remedy = words, remedy


class State(NamedTuple):
    """An identifier's whole memory.

    Attributes:
        t: time [s].
        v_hat: (n,) velocity of the identification plant.
        theta_hat: (p,) estimate.
        pivot: smallest pivot of M̂'s Cholesky factorisation in the last step; > 0 where M̂ is
            positive definite.
        status: `completed` as long as the estimate may go on.
        memory: of past data, for laws that have one.
        spent: what the memory's implicit steps have taken from the conserved quantity.
    """

    t: float
    v_hat: Array
    theta_hat: Array
    pivot: float
    status: Status
    memory: Memory | None = None
    spent: float = 0.0


class Estimates(NamedTuple):
    """What an identifier has thought along a trajectory, one row for each measurement.

    Attributes:
        v_hat: (N, n) velocity of the identification plant.
        theta_hat: (N, p) estimate.
        pivot: (N,) smallest pivot of M̂ in the step up to there.
        spent: (N,) as in `State`.
    """

    v_hat: Array
    theta_hat: Array
    pivot: Array
    spent: Array

    @staticmethod
    def of(*states: State) -> Estimates:
        """The states' own."""
        rows = [(s.v_hat, s.theta_hat, s.pivot, s.spent) for s in states]
        return Estimates(*(np.array(column) for column in zip(*rows, strict=True)))

    def first(self, count: int) -> Estimates:
        """Its first rows."""
        return Estimates(*(part[:count] for part in self))

    def after(self, count: int) -> Estimates:
        """All but its first rows."""
        return Estimates(*(part[count:] for part in self))

    def padded(self, count: int) -> Estimates:
        """As many rows: the last is repeated where there are fewer."""
        if len(self.pivot) == count:
            return self
        rows = np.minimum(np.arange(count), len(self.pivot) - 1)
        return Estimates(*(part[rows] for part in self))


class Confidence(NamedTuple):
    """What is known of how far off an estimate may be.

    Attributes:
        covariance: (p, p) of θ̂, the scale held.
        prior: (p, p) the same before any data.
        blocks: (n,) independent samples in each row of the momentum balance.
    """

    covariance: Array
    prior: Array
    blocks: Array


class Identifier(ABC):
    """An adaptive identifier of a system's θ: pure functions of a state. Same input, same bits.

    Attributes:
        system: the structure it knows.
        conserves: whether its conserved quantity exists.
        cancelling: size of the terms that cancel in V's second term, beside V itself [J]; their
            rounding bounds how exactly V is known.
    """

    system: SecondOrderSystem
    conserves: bool
    cancelling: float

    @abstractmethod
    def init(self, first: Measurement) -> State:
        """The state at the first measurement, with Δv = 0."""

    @abstractmethod
    def step(self, state: State, previous: Measurement, following: Measurement) -> State:
        """The state at the following measurement; the command is held in between."""

    @abstractmethod
    def follow(self, state: State, log: Log) -> tuple[State, Estimates]:
        """Steps along a log that begins where the state stands.

        Args:
            state: at the first measurement; one that may not go on stays as it is.
            log: N measurements.

        Returns:
            The state at the last measurement, or where it may not go on; and the estimates from the
            first measurement up to there, but not at a step that failed.
        """

    @abstractmethod
    def conserved(self, theta_hat: Array) -> Array:
        """(...,) the law's conserved quantity for estimates (..., p); constant along a run."""

    @abstractmethod
    def divergence(self, theta: Array, theta_hat: Array) -> Array:
        """(...,) the second term of V (66) at θ (p,) and estimates (..., p)."""

    @abstractmethod
    def implicit(self, t: Array) -> np.ndarray:
        """(N−1,) between which of the times (N,) of a run lies an implicit step of a memory."""

    @abstractmethod
    def slack(self, state: State, theta: Array) -> float:
        """By how much V may rise in a step up to `state` because θ (p,) is not quite what data say.

        0 for a law without a memory; sensors' noise and the quadrature's error make it more.
        """

    @abstractmethod
    def confidence(self, state: State) -> Confidence | None:
        """What is known of the estimate's error; None for a law that does not say."""


class DataMemory(ABC):
    """What an identifier remembers of past data, and how that moves θ̂ every now and then.

    Attributes:
        every: steps between two of its updates of θ̂.
    """

    every: int

    @abstractmethod
    def begin(self, first: Measurement) -> Memory:
        """The memory at a first measurement: of nothing."""

    @abstractmethod
    def absorb(self, state: State, log: Log) -> State:
        """The state with a log of at most `every` steps in its memory, and θ̂ updated if due."""

    @abstractmethod
    def slack(self, state: State, theta: Array) -> float:
        """By how much an update up to `state` can raise V under the true θ (p,)."""

    @abstractmethod
    def updates(self, t: Array) -> np.ndarray:
        """(N−1,) between which of the times (N,) of a run an update lies."""

    @abstractmethod
    def confidence(self, state: State) -> Confidence | None:
        """What is known of the estimate's error; None as long as the memory says nothing."""


Expected = Callable[[], Array]


@config
class IdentifierConfig(Config, ABC):
    """An identifier as data; `build` makes the thing itself."""

    _path = "identifier"

    @property
    @abstractmethod
    def in_cone(self) -> bool:
        """Whether θ̂ must start inside the cone of physical parameters."""

    @abstractmethod
    def build(
        self,
        system: SecondOrderSystem,
        prior: Array,
        dt: float,
        noise: SensorLevels = EXACT,
        gramian: Expected | None = None,
    ) -> Identifier:
        """Makes the identifier.

        Args:
            system: the structure it knows.
            prior: (p,) θ̂(0).
            dt: time between measurements [s].
            noise: what the sensors are said to be off by.
            gramian: gives (p, p) the expected mean of S Wᵀ M⁻¹ W S under the prior, for laws whose
                gain is designed by it. It is costly, so it is asked for only where needed.
        """
