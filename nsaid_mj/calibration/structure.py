"""The interface between structure and fit: a problem, alternatives, and how they were chosen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

from ..parameters import Array
from ..robot.findings import Finding
from .payloads import Load
from .problem import Problem
from .residuals import Suspect


@dataclass(frozen=True)
class Options:
    """How the structure is chosen.

    Attributes:
        columns: friction columns of all joints, names of `joints.COLUMNS`; None to choose them by
            cross-validation inside the log.
        coupled: pairs (i, j, ±1) of joints, by number, whose motor turns by v_i ± v_j.
        delay: (k,) delays of the commands [s]; None to search for them.
        cutoff: cut-off frequency of the rows' filter [Hz]; None for the bandwidth of the motion.
        loads: payloads of known mass, carried in some of the logs.
        level: names of joints for which no constant offset is tried.
    """

    columns: frozenset[str] | None = None
    coupled: tuple[tuple[int, int, int], ...] = ()
    delay: Array | None = None
    cutoff: float | None = None
    loads: tuple[Load, ...] = ()
    level: frozenset[str] = frozenset()


class Velocity(NamedTuple):
    """The structure chosen for one velocity.

    Attributes:
        name: name of the joint, or of the component of a body's twist.
        columns: names of its friction columns.
        friction_speed: s of tanh(v/s) [rad/s or m/s]; NaN where there is no such column.
        delay: delay of its command [s].
    """

    name: str
    columns: tuple[str, ...]
    friction_speed: float
    delay: float


class Structured(NamedTuple):
    """A chosen structure.

    Attributes:
        problem: rows of the training logs.
        alternatives: problems of other plausible structures and filters, for the sensitivity of θ̂.
            An iterator, since those of a long log are large.
        checked: rows of the validation log; None without one.
        velocities: the choice for every velocity.
        findings: how the structure was chosen, and other findings.
        cutoff: cut-off frequency of the rows' filter [Hz].
        links: (10 k,) parameters of the links whose weight loads the friction of an arm's joints.
        delays: (k,) delays of the commands [s].
        suspects: maps θ̂ (p,) to unmodelled effects against which residuals are tested.
        noisier: the problem and the suspects with twice the variance of the sensors' noise, for a
            (p,) θ̂; None where suspects do not depend on the measured motion.
        acting: commands (N, k) as they act, apart from `delays`, from those at a rate [Hz].
    """

    problem: Problem
    alternatives: Iterator[Problem]
    checked: Problem | None
    velocities: tuple[Velocity, ...]
    findings: tuple[Finding, ...]
    cutoff: float
    links: Array
    delays: Array
    suspects: Callable[[Array], Iterable[Suspect]] = lambda _: ()
    noisier: Callable[[Array], tuple[Problem, Iterable[Suspect]]] | None = None
    acting: Callable[[Array, float], Array] = lambda u, _: u
