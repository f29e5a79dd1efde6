"""Runs an identifier along a log in segments and checks the drift of its conserved quantity.

A run and a Monte Carlo study both feed an identifier one segment of measurements at a time; this
module decides when an identifier has to be stopped.
"""

from __future__ import annotations

import numpy as np

from ..identifiers import Identifier, State, Status
from ..identifiers.base import Estimates
from ..log import Log, Measurement

DRIFT = 1e-3
"""Relative drift of the conserved quantity beyond which RK4 has lost the law's solution."""

CHECK = 0.5
"""Interval between two checks of the conserved quantity [s]."""


class Following:
    """An identifier and its state along a log, whose first measurement initializes it.

    Attributes:
        state: after the last measurement absorbed, or at the one where the identifier failed.
        ended: time at which the identifier failed [s]; None while it has not.
        drift: largest relative drift of the conserved quantity at any check.
    """

    def __init__(self, identifier: Identifier, log: Log):
        self.identifier, self.state = identifier, identifier.init(log.at(0))
        self.ended: float | None = None
        self.drift = 0.0
        self._start = float(identifier.conserved(self.state.theta_hat))

    @property
    def signal(self) -> str:
        """The signal that showed the failure: `theta_hat`, or M̂'s smallest pivot."""
        too_fast = self.state.status is Status.adaptation_too_fast
        return "theta_hat" if too_fast else f"pivot {self.state.pivot:.3g}"

    def follow(self, log: Log, due: np.ndarray) -> Estimates:
        """Follows a segment that begins at the last measurement absorbed.

        The conserved quantity is checked after the rows that are due. Returns the estimates up to
        the end of the segment, or up to the failure.
        """
        return self.absorb(log, *self.identifier.follow(self.state, log), due)

    def resume(self, here: Measurement) -> None:
        """Goes on at a measurement after a gap; see `Identifier.resume`."""
        self.state = self.identifier.resume(self.state, here)

    def absorb(self, log: Log, state: State, estimates: Estimates, due: np.ndarray) -> Estimates:
        """Absorbs estimates and last state of a segment, up to a drift beyond `DRIFT`.

        Returns the estimates up to the end of the segment, or up to the failure.
        """
        rows = len(estimates.pivot)
        if self.ended is None and rows < len(log.t):
            self.ended = float(log.t[rows])
        due = due[due < rows]
        if self.identifier.conserves and len(due):
            conserved = self.identifier.conserved(estimates.theta_hat[due]) + estimates.spent[due]
            drift = np.abs(conserved / self._start - 1)
            beyond = np.flatnonzero(~(drift <= DRIFT))  # includes NaN
            if len(beyond):
                row, drift = int(due[beyond[0]]), drift[: beyond[0] + 1]
                estimates, self.ended = estimates.first(row + 1), float(log.t[row])
                state = state._replace(
                    t=self.ended,
                    v_hat=estimates.v_hat[row].copy(),
                    theta_hat=estimates.theta_hat[row].copy(),
                    status=Status.adaptation_too_fast,
                )
            self.drift = max(self.drift, float(drift.max()))
        self.state = state
        return estimates


def due_rows(first: int, rows: int, dt: float, last: int) -> np.ndarray:
    """The rows of a segment after which the conserved quantity is checked.

    `first` is the run's time step at the segment's first row, which also ends the segment before;
    `last` is the run's last time step, which is always checked.
    """
    row = np.arange(1, rows)
    steps = first + row
    return row[(steps % max(1, round(CHECK / dt)) == 0) | (steps == last)]
