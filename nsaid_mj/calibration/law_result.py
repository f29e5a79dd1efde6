"""The result of a law along a log: estimates with intervals, and gains beside the batch fit's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..experiment.loop import Run
from ..identifiers import Status
from ..parameters import Array, Indices
from .fit import Fit
from .precision import Precision
from .problem import Problem
from .structure import Structured


class Fitted(NamedTuple):
    """The parts of a batch fit.

    Attributes:
        made: what was chosen.
        problem: rows and prior.
        fit: the minimum.
        exact: the estimate and its precision.
        share: (n,) rows per effectively independent row.
        coupled: pairs (i, j, ±1) of joints with a common motor.
    """

    made: Structured
    problem: Problem
    fit: Fit
    exact: Precision
    share: Array
    coupled: tuple[tuple[int, int, int], ...]


class Gain(NamedTuple):
    """A gain over the geometric mean of all, which does not depend on the common scale of θ.

    Attributes:
        label: of the parameter.
        law: by the law.
        half: half-width of its 95 % interval, relative; infinite if the law states none.
        batch: by the batch fit.
        batch_half: half-width of its 95 % interval, relative.
    """

    label: str
    law: float
    half: float
    batch: float
    batch_half: float

    @property
    def apart(self) -> bool:
        """Whether law and batch differ by more than both intervals together."""
        return bool(abs(np.log(self.law / self.batch)) > self.half + self.batch_half)

    @property
    def covers(self) -> bool:
        """Whether the law's interval contains the batch fit's value."""
        return bool(abs(np.log(self.law / self.batch)) <= self.half)


@dataclass(frozen=True, eq=False)
class AlongLog:
    """A law along a log.

    Attributes:
        name: of the law.
        run: measurements and estimates.
        actuators: (a,) of the gains in θ.
        t: (K,) times [s], of the common axis of all logs.
        theta: (K, p) θ̂.
        deviation: (K, a) standard deviations of the gains over their mean, relative; infinite where
            the law states none.
        gains: at the end, beside the batch fit's.
        last: (n,) NRMSE of the last fifth of the rows under the estimate before them; NaN where it
            is not judged.
        batch_last: (n,) that of a batch fit to the rows before.
        misfit: whether the motion contradicts the structure: `none`, `some` or `contradicts`; ""
            for a law that does not test it.
        seconds: duration of the run [s].
    """

    name: str
    run: Run
    actuators: Indices
    t: Array
    theta: Array
    deviation: Array
    gains: tuple[Gain, ...]
    last: Array
    batch_last: Array
    misfit: str
    seconds: float

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
