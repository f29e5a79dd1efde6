"""Motions of vehicles: their own controllers, with given frequencies and phases.

A candidate has one number for every uniform draw of the scenario's driver: frequencies and phases
of set-points and of the dither on commands. tanh maps it to a share of the draw's range. The motion
is that of a simulation in closed loop under a draw of the prior, so that box, speed and attitude
are judged as they will be. Amplitudes are those of the driver, or what the limit of commands leaves
of them: a multisine's reach that limit anyway, and larger dither was seen to spoil what a search of
a minute finds.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ..control import DesignedSignals, DriverConfig
from ..control.designed import Given
from ..errors import InvalidInput
from ..log import Log
from ..parameters import Array
from .experiment import Experiment
from .limits import COMMAND, Limits, extents_of

_PENALTY = 3.0  # cost per unit of use beyond a limit
_STEP = 0.02  # longest step at which information is computed [s]
_AMPLITUDES = ("amplitude", "dither", "swing")  # fields of drivers: shares of a command's range


class DrivenMotions:
    """Candidates of a vehicle's motion.

    Args:
        experiment: of a vehicle.
        limits: of the motion.
        base: the excitation whose frequencies and phases are designed.

    Attributes:
        size: length of a candidate.
        stride: time steps between samples at which information is computed.

    Raises:
        InvalidInput: the driver has no uniform draws.
    """

    parallel = False
    """MuJoCo's callbacks, which the simulation needs, are global in a process."""

    def __init__(self, experiment: Experiment, limits: Limits, base: DriverConfig):
        largest = limits.limits[COMMAND].high.min() if COMMAND in limits.limits else np.inf
        base = amplified(base, 1.0, float(largest))
        self.experiment, self.limits, self.base = experiment, limits, base
        given = Given(np.empty(0))
        base.build(experiment.system, experiment.prior, given)
        if not given.used:
            raise InvalidInput(
                "design", "a driver with random frequencies or phases", type(base).__name__, ""
            )
        self.size = given.used
        self.stride = max(1, round(_STEP / experiment.scenario.dt))

    def random(self, rng: np.random.Generator) -> Array:
        """A random candidate; its shares are uniform."""
        return np.arctanh(rng.uniform(-1, 1, self.size) * (1 - 1e-9))

    def candidate(self, candidate: Array, draw: int) -> tuple[Log, float]:
        """The motion of a candidate under a draw, and its penalty, 0 inside the limits."""
        experiment = self.experiment
        duration = experiment.scenario.duration
        log = experiment.simulate(self.driver(candidate), draw, duration)
        if log is None:
            return Log.unchecked(*(np.zeros((2, 1)),) * 4), np.inf
        uses = self.limits.uses(extents_of(experiment.system, log, experiment.draws[draw]))
        excess = sum(max(0.0, use - 1 + self.limits.margin_of(name)) for name, use in uses.items())
        return Log.unchecked(*(np.ascontiguousarray(x[:: self.stride]) for x in log)), (
            _PENALTY * excess
        )

    def period(self, log: Log) -> Log:
        """The motion itself; it has no period."""
        return log

    def driver(self, candidate: Array, share: float = 1.0) -> DesignedSignals:
        """The driver of a candidate, its amplitudes multiplied by `share`."""
        shares = np.clip(0.5 + 0.5 * np.tanh(candidate), 1e-12, 1.0)
        return DesignedSignals(amplified(self.base, share), tuple(shares.tolist()))


def amplitudes_of(config: DriverConfig) -> list[str]:
    """Names of a driver's amplitudes of commands."""
    return [field.name for field in fields(config) if field.name in _AMPLITUDES]


def amplified(config: DriverConfig, factor: float, largest: float = np.inf) -> DriverConfig:
    """A driver with the amplitudes of its commands times a factor.

    Args:
        config: of the driver.
        factor: > 0.
        largest: no amplitude exceeds it.
    """
    values = {name: getattr(config, name) for name in amplitudes_of(config)}
    return replace(config, **{name: min(factor * x, largest) for name, x in values.items()})
