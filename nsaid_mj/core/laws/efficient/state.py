"""The state of the efficient law."""

from __future__ import annotations

from typing import NamedTuple

from ...log import Log, Measurement
from ...parameters import Array
from ...structure.system import SecondOrderSystem
from ..base import State
from .estimator import KalmanFilter
from .filter import FilterState
from .supervision import Supervision


class EfficientState(NamedTuple):
    """State of the efficient law: the filter, the memory that guards it, and their supervision."""

    filter: FilterState
    guard: State  # the memory and its estimate
    supervision: Supervision
    step: int = 0  # index of the sample
    pause: int = 0  # intervals for which the memory still pauses
    calm: float = 0.0  # time since the filter began, or was last contradicted [s]
    handed: bool = False  # whether the law returns the filter's θ̂
    restarts: int = 0  # how often the filter restarted at the memory's estimate
    waiting: Log | None = None  # samples not yet in the memory, with the acting signals; or None

    @property
    def theta(self) -> Array:
        """(p,) the filter's θ̂ in terms of the commands given."""
        return self.filter.theta * self.supervision.factors

    def here(self, system: SecondOrderSystem, log: Log) -> Measurement:
        """The last measurement of a log without the known errors of its signals."""
        last = log.part(len(log.t) - 1, len(log.t))
        return self.supervision.signals.acting(system, last).at(0)

    def restarted(self, estimator: KalmanFilter, here: Measurement) -> EfficientState:
        """The filter at the memory's estimate, with the uncertainty of a prior."""
        theta = self.guard.theta_hat
        self.filter.theta[:] = theta
        self.filter.Ptt[:] = estimator.covariance(theta)
        estimator.restart(self.filter, here)
        return self._replace(calm=0.0, handed=False, restarts=self.restarts + 1)
