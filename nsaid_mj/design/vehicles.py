"""Motions of vehicles: their own controllers, with given frequencies and phases.

A candidate has one number for every uniform draw of the scenario's driver: frequencies and phases
of set-points and of the dither on commands. tanh maps it to a share of the draw's range. The motion
is that of a simulation in closed loop under a draw of the prior, so that box, speed and attitude
are judged as they will be.
"""

from __future__ import annotations

import numpy as np

from ..control import DesignedSignals, DriverConfig
from ..control.designed import Given
from ..errors import InvalidInput
from ..log import Log
from ..parameters import Array
from .experiment import Experiment
from .limits import Limits, extents_of

_PENALTY = 3.0  # cost per unit of use beyond a limit
_STEP = 0.02  # longest step at which information is computed [s]


class DrivenMotions:
    """Candidates of a vehicle's motion.

    Args:
        experiment: of a vehicle.
        limits: of the motion.
        base: the excitation whose frequencies and phases are designed.

    Raises:
        InvalidInput: the driver has no uniform draws.
    """

    parallel = False
    """MuJoCo's callbacks, which the simulation needs, are global in a process."""

    def __init__(self, experiment: Experiment, limits: Limits, base: DriverConfig):
        self.experiment, self.limits, self.base = experiment, limits, base
        given = Given(np.empty(0))
        base.build(experiment.system, experiment.prior, given)
        self.size = given.used
        if not self.size:
            raise InvalidInput(
                "design", "a driver with random frequencies or phases", type(base).__name__, ""
            )
        self.stride = max(1, round(_STEP / experiment.scenario.dt))

    def random(self, rng: np.random.Generator) -> Array:
        """A random candidate; its shares are uniform."""
        return np.arctanh(rng.uniform(-1, 1, self.size) * (1 - 1e-9))

    def candidate(self, candidate: Array, draw: int) -> tuple[Log, float]:
        """The motion of a candidate under a draw, and its penalty, 0 inside the limits."""
        experiment = self.experiment
        driver, duration = self.driver(candidate), experiment.scenario.duration
        log = experiment.simulate(driver, draw, duration)
        if log is None:
            return Log.unchecked(*(np.zeros((2, 1)),) * 4), np.inf
        uses = self.limits.uses(extents_of(experiment.system, log, experiment.draws[draw]))
        excess = sum(max(0.0, use - 1 + self.limits.margin) for use in uses.values())
        return Log.unchecked(*(np.ascontiguousarray(x[:: self.stride]) for x in log)), (
            _PENALTY * excess
        )

    def period(self, log: Log) -> Log:
        """The motion itself; it has no period."""
        return log

    def driver(self, candidate: Array) -> DesignedSignals:
        """The driver of a candidate."""
        shares = np.clip(0.5 + 0.5 * np.tanh(candidate), 1e-12, 1.0)
        return DesignedSignals(self.base, tuple(shares.tolist()))
