"""The interface between structure and fit: a problem, alternatives, and how they were chosen."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from ..parameters import Array
from ..robot.findings import Finding
from .payloads import Load
from .problem import Problem
from .residuals import Suspect


@dataclass(frozen=True)
class Options:
    """How the structure is chosen."""

    # friction columns of all joints, names of `joints.COLUMNS`; None to choose them by
    # cross-validation inside the log
    columns: frozenset[str] | None = None
    coupled: tuple[tuple[int, int, int], ...] = ()  # pairs (i, j, ±1): a motor turns by v_i ± v_j
    delay: Array | None = None  # (k,) delays of the commands [s]; None to search for them
    cutoff: float | None = None  # of the rows' filter [Hz]; None for the bandwidth of the motion
    loads: tuple[Load, ...] = ()  # payloads of known mass, carried in some of the logs
    level: frozenset[str] = frozenset()  # names of joints for which no constant offset is tried
    known: Mapping[str, float] = field(default_factory=dict)  # parameters by name or label [SI]


class Velocity(NamedTuple):
    """The structure chosen for one velocity."""

    name: str  # name of the joint, or of the component of a body's twist
    columns: tuple[str, ...]  # names of its friction columns
    friction_speed: float  # s of tanh(v/s) [rad/s or m/s]; NaN where there is no such column
    delay: float  # delay of its command [s]


class Structured(NamedTuple):
    """A chosen structure."""

    problem: Problem  # rows of the training logs
    # problems of other plausible structures and filters, for the sensitivity of θ̂. An iterator,
    # since those of a long log are large
    alternatives: Iterator[Problem]
    checked: Problem | None  # rows of the validation log; None without one
    velocities: tuple[Velocity, ...]  # the choice for every velocity
    findings: tuple[Finding, ...]  # how the structure was chosen, and other findings
    cutoff: float  # cut-off frequency of the rows' filter [Hz]
    links: Array  # (10 k,) parameters of the links whose weight loads an arm's friction
    delays: Array  # (k,) delays of the commands [s]
    # maps θ̂ (p,) to unmodelled effects against which residuals are tested
    suspects: Callable[[Array], Iterable[Suspect]] = lambda _: ()
    # the problem and the suspects with twice the variance of the sensors' noise, for a (p,) θ̂;
    # None where suspects do not depend on the measured motion
    noisier: Callable[[Array], tuple[Problem, Iterable[Suspect]]] | None = None
    # commands (N, k) as they act, apart from `delays`, from those at a rate [Hz]
    acting: Callable[[Array, float], Array] = lambda u, _: u
