"""Predicted against measured generalised forces, along a motion that the estimate has not seen."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..experiment.loop import Run
from ..parameters import Array
from .confidence import INTERVAL, known
from .figures import timed_rows
from .summary import nullspace_of
from .truth import Truth


class Forces(NamedTuple):
    """The two sides of W θ̂ = 0 along k samples of a trajectory.

    Attributes:
        t: (k,) times [s].
        measured: (k, n) forces of the actuators under their estimated gains, in the units of
            `evaluation.force_units`.
        predicted: (k, n) forces that the motion requires under the estimated plant.
        half: (k, n) half width of the prediction's 95 % interval; None if the law states none, or
            if the run was read from its record.
    """

    t: Array
    measured: Array
    predicted: Array
    half: Array | None

    @property
    def nrmse(self) -> Array:
        """(n,) rms error over rms of the measured force; NaN where that is zero."""
        rms = np.sqrt(np.mean(self.measured**2, axis=0))
        error = np.sqrt(np.mean((self.predicted - self.measured) ** 2, axis=0))
        return error / np.where(rms > 0, rms, np.nan)


def forces_of(run: Run, truth: Truth | None) -> Forces | None:
    """The forces on the held-out trajectory or, without a truth, over the run's last tenth.

    With a truth, θ̂ is multiplied by the factor that brings it closest to it in θ/scale: the
    common scale of θ is unobservable.

    Returns:
        None if there is no such trajectory, or if commands are missing in the record.
    """
    system, theta = run.system, np.array(run.record.rows("theta_hat", -1))
    later = None if truth is None else truth.held_out
    exact = None if truth is None else truth.exact
    if later is None and (run.scenario.record_every != 1 or len(run.record) < 20):
        return None
    if later is None:
        log = run.record.log
        later, exact = log.last(max(2, len(log.t) // 10)), None
    t, W = timed_rows(system, later, exact)
    scale, k = system.space.scale, system.space.actuators
    factor = 1.0
    if truth is not None:
        theta_s = theta / scale
        factor = float(theta_s @ (truth.theta / scale) / (theta_s @ theta_s))
    given = W[..., k] @ theta[k]
    half = None
    stated = run.identifiers[""].confidence(run.states[""]) if "" in run.states else None
    if stated is not None:
        found = known(stated, theta, nullspace_of(run, None), system.space)
        spread = (W * scale) @ (found.directions.T * found.deviation)
        half = INTERVAL * np.linalg.norm(spread, axis=-1) * float(np.linalg.norm(theta / scale))
        half *= abs(factor)
    return Forces(t, -factor * given, factor * (W @ theta - given), half)
