"""Estimates the part of the commands that is sensor noise fed back by a controller.

Smooth signals, sampled at a constant rate, have negligible fourth differences. Those of measurement
and command are then the noise's alone, and have C(8, 4) = 70 times its covariance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...log import Log
from ...numerics.kernels import i8, kernel, matrix, vector, void
from ...parameters import Array

_LONGEST = 2000.0  # samples over which the covariance is averaged
_FEWEST = 100  # fourth differences, at least, before it is used
_ORDER = 4  # of the differences


class FedBack(NamedTuple):
    """Running covariance of the noise of measurements and commands."""

    increments: Array  # (3, 2n + n_u) the last increments of position, velocity and command
    # (2n + n_u,) position and velocity increments into the last sample, and the command before it
    pending: Array
    together: Array  # (n_u, 2n) covariance of commands and measurements
    variance: Array  # (2n,) variance of the measurements
    seen: int  # number of samples so far

    @staticmethod
    def unknown(n: int, n_u: int) -> FedBack:
        """Before any sample of n velocities and n_u commands."""
        width = 2 * n + n_u
        return FedBack(
            np.zeros((3, width)), np.zeros(width), np.zeros((n_u, 2 * n)), np.zeros(2 * n), 0
        )

    def along(self, moves: Array, log: Log) -> FedBack:
        """The covariance at the end of a log, whose last command is not used.

        moves (N−1, n) are the tangent steps between its N positions.
        """
        steps = np.hstack([moves, np.diff(log.v, axis=0)])
        after = self._replace(
            increments=self.increments.copy(),
            pending=self.pending.copy(),
            together=self.together.copy(),
            variance=self.variance.copy(),
            seen=self.seen + len(steps),
        )
        _add(*after[:4], self.seen, steps, log.u[:-1], np.empty(len(self.pending)))
        return after

    def deviations(self) -> Array:
        """(2n, n_u) standard deviations of the commands due to each measurement's noise."""
        if self.seen < _FEWEST:
            return np.zeros(self.together.T.shape)
        safe = np.where(self.variance > 0, self.variance, np.inf)
        return (self.together / np.sqrt(safe)).T


@kernel(void(matrix, vector, matrix, vector, i8, matrix, matrix, vector))
def _add(increments, pending, together, variance, seen, steps, u, fourth):
    """Updates the covariance by the steps (k, 2n) that follow commands (k, n_u), in place.

    `fourth` (2n + n_u,) is workspace.
    """
    number = steps.shape[1]
    width = pending.shape[0]
    for k in range(steps.shape[0]):
        for i in range(width):
            new = pending[i] if i < number else u[k, i - number] - pending[i]
            fourth[i] = new - 3 * increments[2, i] + 3 * increments[1, i] - increments[0, i]
            increments[0, i], increments[1, i] = increments[1, i], increments[2, i]
            increments[2, i] = new
            pending[i] = steps[k, i] if i < number else u[k, i - number]
        known = seen + k + 1 - _ORDER
        if known > 0:
            share = 1.0 / min(known, _LONGEST)
            for j in range(number):
                variance[j] += share * (fourth[j] * fourth[j] / 70 - variance[j])
                for i in range(number, width):
                    product = fourth[i] * fourth[j] / 70
                    together[i - number, j] += share * (product - together[i - number, j])
