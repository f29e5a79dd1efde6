"""The result of a calibration: what the log reveals of every parameter, and what it does not."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..evaluation.result import Result
from ..parameters import Array, Indices
from .data import Recordings, RobotModel
from .law_result import AlongLog, Fitted
from .problem import Mask


@dataclass(frozen=True)
class Combination:
    """A combination of parameters that the log determines.

    Attributes:
        words: such as "Izz of link_1 + rotor inertia of joint_1".
        unit: SI unit.
        value: estimate.
        low: lower end of the 95 % interval.
        high: upper end of the 95 % interval.
    """

    words: str
    unit: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class JointFit:
    """How well the structure explains one joint's (or velocity's) command.

    NRMSE is the rms error of the predicted command over the standard deviation of the measured one:
    predicting the mean gives 1.

    Attributes:
        name: of the joint.
        fit: NRMSE on the rows of the fit.
        held_out: NRMSE on fifths of the log, each predicted from the others.
        least_squares: that of weighted least squares on the same rows and columns.
        validation: NRMSE on the validation log; None without one.
        validation_least_squares: that of weighted least squares; None without a log.
        columns: friction columns in use.
        friction_speed: s of tanh(v/s) [rad/s or m/s].
        delay: of the command [s].
    """

    name: str
    fit: float
    held_out: float
    least_squares: float
    validation: float | None
    validation_least_squares: float | None
    columns: tuple[str, ...]
    friction_speed: float
    delay: float


@dataclass(frozen=True)
class Curves:
    """Filtered commands, measured and predicted, for plots.

    Attributes:
        t: (N,) times [s].
        segment: (N,) number of the segment.
        measured: (N, k) commands.
        predicted: (N, k) commands that the estimate predicts.
        usable: (N, k) whether the row was used.
    """

    t: Array
    segment: Indices
    measured: Array
    predicted: Array
    usable: Mask


@dataclass(frozen=True, kw_only=True)
class Identification(Result):
    """Result of `identify`.

    Attributes:
        robot: the model.
        recordings: the segments of the training logs.
        joints: quality of the prediction, per joint.
        combinations: base parameters: what the log determines, gains given.
        anchor: what fixes the common scale of all parameters.
        suggestion: the one further number or motion that would help most; "" if none.
        theta: (p,) θ̂.
        deviation: (p,) its stated standard deviations.
        covariance: (p, p) of θ̂.
        friction: (k,) viscous and (k,) Coulomb friction nearest to the identified friction of each
            joint, for model files that hold no other; empty for a vehicle.
        curves: of the training logs.
        validation: of the validation log; None without one.
        law: the run of a law along the log; None for the batch fit alone.
        cutoff: of the rows' filter [Hz].
        seconds: duration of the identification [s].
        fitted: parts of the fit, for laws that follow the log.
    """

    robot: RobotModel
    recordings: Recordings
    joints: tuple[JointFit, ...]
    combinations: tuple[Combination, ...]
    anchor: str
    suggestion: str
    theta: Array
    deviation: Array
    covariance: Array
    friction: tuple[Array, Array]
    curves: Curves
    validation: Curves | None
    law: AlongLog | None
    cutoff: float
    seconds: float
    fitted: Fitted

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
