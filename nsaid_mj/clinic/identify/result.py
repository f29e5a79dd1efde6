"""The result of a calibration: estimates, intervals and identifiability of every parameter."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array, Column, Indices, Rotor, Status
from ...lab import Run
from ...report import Result, Statistic
from ...robots import RobotModel
from ..logs.recordings import Recordings
from .fit import Fit, Precision
from .loads import Load
from .problem import FitProblem, Mask
from .residuals import Suspect


@dataclass(frozen=True)
class Options:
    """How the structure is chosen."""

    # friction columns of all joints, names of `choose.columns.COLUMNS`; None to choose them by
    # cross-validation inside the log
    columns: frozenset[str] | None = None
    coupled: tuple[tuple[int, int, int], ...] = ()  # pairs (i, j, ±1): a motor turns by v_i ± v_j
    delay: Array | None = None  # (k,) delays of the commands [s]; None to search for them
    cutoff: float | None = None  # of the rows' filter [Hz]; None for the bandwidth of the motion
    loads: tuple[Load, ...] = ()  # payloads of known mass, carried in some of the logs
    level: frozenset[str] = frozenset()  # names of joints for which no constant offset is tried
    known: Mapping[str, float] = field(default_factory=dict)  # parameters by name or label [SI]
    contradicted: tuple[Finding, ...] = ()  # of told values that logs or model file contradict
    # relative standard deviation by which the scale is uncertain since one was contradicted
    apart: float = 0.0


@dataclass(frozen=True)
class JointStructure:
    """Structure chosen for one joint or velocity, and prediction quality of its command.

    NRMSE is the rms error of the predicted command over the standard deviation of the measured one:
    predicting the mean gives 1.
    """

    name: str  # name of the joint, or of the component of a body's twist
    fit: float = np.nan  # NRMSE on the rows of the fit
    held_out: float = np.nan  # NRMSE on fifths of the log, each predicted from the others
    least_squares: float = np.nan  # that of weighted least squares on the same rows and columns
    validation: float | None = None  # NRMSE on the validation log; None without one
    # that of weighted least squares; None without a log
    validation_least_squares: float | None = None
    columns: tuple[str, ...] = ()  # friction columns in use
    # s of tanh(v/s) [rad/s or m/s]; NaN where there is no such column
    friction_speed: float = np.nan
    delay: float = 0.0  # delay of the command [s]
    delay_interval: tuple[float, float] | None = None  # its 95 % interval [s]; None if it was given
    force: float = np.nan  # the forces' standard deviation [`unit`], with which errors are compared
    unit: str = "N·m"  # or N
    # the held-out error over the forces of its own rows, where these are of a part in which its
    # motor does little, as of a leg in swing; NaN for others
    alone: float = np.nan
    limit: float = np.inf  # largest force of its motor in the model file [`unit`]
    noise: float = 0.0  # NRMSE that white noise of the command makes on its own; 0 if not known


class Structured(NamedTuple):
    """A chosen structure."""

    problem: FitProblem  # rows of the training logs
    # problems of other plausible structures and filters, for the sensitivity of θ̂. An iterator,
    # since those of a long log are large
    alternatives: Iterator[FitProblem]
    checked: FitProblem | None  # rows of the validation log; None without one
    velocities: tuple[JointStructure, ...]  # the choice for every velocity, before its prediction
    findings: tuple[Finding, ...]  # how the structure was chosen, and other findings
    cutoff: float  # cut-off frequency of the rows' filter [Hz]
    delays: Array  # (k,) delays of the commands [s]
    # maps θ̂ (p,) to unmodelled effects against which residuals are tested
    suspects: Callable[[Array], Iterable[Suspect]] = lambda _: ()
    # problems of structures and filters that predict the log as well as the chosen ones
    rivals: Iterable[FitProblem] = ()
    # the problem and the suspects with twice the variance of the sensors' noise, for a (p,) θ̂;
    # None where suspects do not depend on the measured motion
    noisier: Callable[[Array], tuple[FitProblem, Iterable[Suspect]]] | None = None
    # commands (N, k) as they act, apart from `delays`, from those at a rate [Hz]
    acting: Callable[[Array, float], Array] = lambda u, _: u
    coupled: tuple[tuple[int, int, int], ...] = ()  # pairs (i, j, ±1) of joints with a common motor
    loaded: frozenset[str] = frozenset()  # files in which the robot carries a load
    columns: Sequence[Column] = ()  # that the choice adds to the robot's own system
    rotors: Sequence[Rotor] = ()  # the same of rotors
    # (d, p) changes of θ̂ by errors that no log tells, such as of a foot's place, one standard
    # deviation each; None without any
    doubts: Array | None = None


_BETWEEN = 1.0  # time between two logs on the common axis [s]
_NEAR = 10.0  # a log that begins this soon after the one before it keeps its own times [s]


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that the log determines."""

    words: str  # such as "Izz of link_1 + rotor inertia of joint_1"
    unit: str  # SI unit
    value: float  # estimate
    low: float  # lower end of the 95 % interval
    high: float  # upper end of the 95 % interval


@dataclass(frozen=True)
class Curves:
    """Filtered commands, measured and predicted, for plots."""

    t: Array  # (N,) times [s], of the common axis of all logs
    segment: Indices  # (N,) number of the segment
    measured: Array  # (N, k) commands
    predicted: Array  # (N, k) commands that the estimate predicts
    usable: Mask  # (N, k) whether the row was used


def statistics_of(joints: Sequence[JointStructure]) -> tuple[Statistic, ...]:
    """The NRMSE of every joint, beside least squares and on the validation log if there is one."""
    kinds = {
        "held out": "held_out",
        "weighted least squares, held out": "least_squares",
        "validation log": "validation",
    }
    found = (
        Statistic(name, "%", {joint.name: getattr(joint, key) for joint in joints})
        for name, key in kinds.items()
    )
    return tuple(f for f in found if any(value is not None for value in f.values.values()))


class BatchFit(NamedTuple):
    """Intermediate results of a batch fit."""

    made: Structured  # the chosen structure
    problem: FitProblem  # rows and prior
    fit: Fit  # the minimum
    exact: Precision  # the estimate and its precision
    share: Array  # (n,) rows per effectively independent row


class GainRatio(NamedTuple):
    """A gain relative to the geometric mean of all gains, independent of the common scale of θ."""

    label: str  # label of the parameter
    law: float  # by the law
    half: float  # half-width of its 95 % interval, relative; infinite if the law states none
    batch: float  # by the batch fit
    batch_half: float  # half-width of its 95 % interval, relative

    @property
    def apart(self) -> bool:
        """Whether law and batch differ by more than both intervals together."""
        return bool(abs(np.log(self.law / self.batch)) > self.half + self.batch_half)


@dataclass(frozen=True, eq=False)
class AlongLog:
    """A law along a log."""

    name: str  # name of the law
    run: Run  # measurements and estimates
    actuators: Indices  # (a,) indices of the gains in θ
    t: Array  # (K,) times [s], of the common axis of all logs
    theta: Array  # (K, p) θ̂
    # (K, a) standard deviations of the gains over their mean, relative; infinite where the law
    # states none
    deviation: Array
    gains: tuple[GainRatio, ...]  # at the end, beside the batch fit's
    # (n,) NRMSE of the last fifth of the rows under the estimate before them; NaN where it is not
    # judged
    last: Array
    batch_last: Array  # (n,) that of a batch fit to the rows before
    # whether the motion contradicts the structure: `none`, `some` or `contradicts`; "" for a law
    # that does not test it
    misfit: str
    seconds: float  # duration of the run [s]

    @property
    def completed(self) -> bool:
        """Whether the law reached the end of the log."""
        return self.run.ending.status is Status.completed

    def summary(self) -> dict[str, Any]:
        """The figures, for JSON."""
        return {
            "name": self.name,
            "status": self.run.ending.status.words,
            "status_time": self.run.ending.time,
            "gains": [gain._asdict() for gain in self.gains],
            "last_fifth": self.last.tolist(),
            "last_fifth_batch": self.batch_last.tolist(),
            "misfit": self.misfit,
            "seconds": self.seconds,
        }


@dataclass(frozen=True, kw_only=True)
class Identification(Result):
    """Result of `identify`.

    Attributes:
        robot: the model.
        recordings: the segments of the training logs.
        joints: quality of the prediction, per joint.
        combinations: base parameters, which the log determines if the gains are known.
        anchor: what fixes the common scale of all parameters, in words.
        suggestion: the one further number or motion that would help most; "" if none.
        theta: (p,) θ̂.
        deviation: (p,) its stated standard deviations.
        covariance: (p, p) covariance of θ̂.
        friction: (k,) viscous and (k,) Coulomb friction nearest to the identified friction of each
            joint, for model files that hold no other; empty for a vehicle.
        predictions: measured and predicted commands of the training logs.
        validation: those of the validation log; None without one.
        law: the run of a law along the log; None for the batch fit alone.
        cutoff: cut-off frequency of the rows' filter [Hz].
        seconds: duration of the identification [s].
        fitted: parts of the fit, for laws that follow the log.
    """

    robot: RobotModel
    recordings: Recordings
    joints: tuple[JointStructure, ...]
    combinations: tuple[Combination, ...]
    anchor: str
    suggestion: str
    theta: Array
    deviation: Array
    covariance: Array
    friction: tuple[Array, Array]
    predictions: Curves
    validation: Curves | None
    law: AlongLog | None
    cutoff: float
    seconds: float
    fitted: BatchFit

    def write_models(self, folder: str | Path) -> list[Path]:
        """Writes the calibrated model, in all formats that can represent it; returns the files.

        Raises:
            NotWritten: a file of the user's is in the way, or the folder cannot be written.
        """
        from .export import write_models

        made = Path(folder)
        made.mkdir(parents=True, exist_ok=True)
        return write_models(self, made)[0]

    def summary(self) -> dict[str, Any]:
        """Everything but arrays, for JSON; numbers may be infinite."""
        return {
            "robot": self.robot.name,
            "explains": self.explains,
            "verdict": self.verdict,
            "joints": [asdict(j) for j in self.joints],
            "parameters": [p.document() for p in self.parameters],
            "combinations": [asdict(c) for c in self.combinations],
            "anchor": self.anchor,
            "suggestion": self.suggestion,
            "findings": [asdict(f) for f in self.findings],
            "cutoff": self.cutoff,
            "rate": self.recordings.rate,
            "seconds": self.seconds,
            **({"law": self.law.summary()} if self.law else {}),
        }


def shifts(spans: Sequence[tuple[str, float, float]]) -> Array:
    """(S,) times [s] to add to the segments' own, so that logs follow one another.

    Spans are the segments' files, and the times of their first and last samples [s]. Segments of
    one file keep their distances, so that the axis shows the file's times up to a constant, and
    exactly for the first file.
    """
    found = []
    shift = 0.0
    end = -np.inf
    for k, (source, start, last) in enumerate(spans):
        if k > 0 and (source != spans[k - 1][0] or start + shift < end):
            shift = 0.0 if end <= start <= end + _NEAR else end + _BETWEEN - start
        found.append(shift)
        end = last + shift
    return np.array(found)


def recording_shifts(recordings: Recordings) -> Array:
    """(S,) shifts of the segments of recordings."""
    return shifts([(s.source, s.log.t[0], s.log.t[-1]) for s in recordings.segments])
