"""An identifier on its way along a log, stretch by stretch, and the check that RK4 still follows.

A run and a Monte Carlo study both feed an identifier a stretch of measurements at a time; what
they make of its estimates, and when they stop it, is decided here.
"""

from __future__ import annotations

import numpy as np

from ..identifiers import Identifier, State, Status
from ..identifiers.base import Estimates
from ..log import Log

DRIFT = 1e-3
"""Relative drift of the conserved quantity beyond which RK4 no longer follows the law."""

CHECK = 0.5
"""Time between two checks of the conserved quantity [s]."""


class Following:
    """An identifier's state along a log.

    Args:
        identifier: follows the log.
        log: begins with the measurement to start from.

    Attributes:
        identifier: as given.
        state: at the last measurement absorbed, or where the identifier could not go on.
        ended: when it could not go on [s]; None as long as it can.
        drift: largest relative drift of the conserved quantity at any check.
    """

    def __init__(self, identifier: Identifier, log: Log):
        self.identifier, self.state = identifier, identifier.init(log.at(0))
        self.ended: float | None = None
        self.drift = 0.0
        self._start = float(identifier.conserved(self.state.theta_hat))

    @property
    def signal(self) -> str:
        """What showed that the identifier could not go on."""
        too_fast = self.state.status is Status.adaptation_too_fast
        return "theta_hat" if too_fast else f"pivot {self.state.pivot:.3g}"

    def follow(self, log: Log, due: np.ndarray) -> Estimates:
        """Follows a stretch that begins at the last measurement absorbed.

        Args:
            log: the stretch.
            due: rows of it after which the conserved quantity is checked.

        Returns:
            The estimates up to the end of the stretch, or to where the identifier could not go on.
        """
        return self.absorb(log, *self.identifier.follow(self.state, log), due)

    def absorb(self, log: Log, state: State, estimates: Estimates, due: np.ndarray) -> Estimates:
        """Takes over what following a stretch has given, up to a drift beyond `DRIFT`.

        Args:
            log: the stretch.
            state: at its end.
            estimates: along it.
            due: rows of it after which the conserved quantity is checked.

        Returns:
            The estimates up to the end of the stretch, or to where the identifier could not go on.
        """
        rows = len(estimates.pivot)
        if self.ended is None and rows < len(log.t):
            self.ended = float(log.t[rows])
        due = due[due < rows]
        if self.identifier.conserves and len(due):
            conserved = self.identifier.conserved(estimates.theta_hat[due]) + estimates.spent[due]
            drift = np.abs(conserved / self._start - 1)
            beyond = np.flatnonzero(~(drift <= DRIFT))  # NaN is beyond, too
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
    """The rows of a stretch after which the conserved quantity is checked.

    Args:
        first: step of the run with which the stretch begins.
        rows: measurements in the stretch; its first one belongs to the stretch before.
        dt: step [s].
        last: last step of the run, after which there is always a check.
    """
    row = np.arange(1, rows)
    steps = first + row
    return row[(steps % max(1, round(CHECK / dt)) == 0) | (steps == last)]
