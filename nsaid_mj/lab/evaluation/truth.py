"""The true parameters of a run's simulated plant, read only after the run.

Every function in this package that needs the truth takes a `Truth | None`: a robot's log has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core import Array, Log, Nullspace, Prior, SecondOrderSystem
from ..loop import Run, SimulatedRun
from ..setup import Seeds, Setup

CONVERGED = 0.01
"""Distance to the true set below which an estimate counts as converged, if it remains there."""


class Truth:
    """The true parameters of a simulated plant, and the true set.

    Faults change them during the run; members without a time argument refer to `end`.
    """

    def __init__(self, setup: Setup, end: float):
        self._setup = setup
        self._plant = setup.plant
        self._nullspaces: dict[int, Nullspace] = {}
        self.system: SecondOrderSystem = setup.system  # whose parameters these are
        self.end = end  # time at which estimates are judged [s]
        # effects in the plant that the structure does not model, and the faults, in words; empty if
        # there are none
        self.mismatches: Sequence[str] = setup.plant.mismatches
        self.fault: str = "; ".join(fault.in_words(setup.system) for fault in setup.plant.faults)

    @overload
    @staticmethod
    def of(run: SimulatedRun) -> Truth: ...
    @overload
    @staticmethod
    def of(run: Run) -> Truth | None: ...
    @staticmethod
    def of(run: Run) -> Truth | None:
        """The truth of a run's plant; None if the plant was not simulated."""
        return Truth(run.setup, run.ending.time) if isinstance(run, SimulatedRun) else None

    def theta_at(self, t: ArrayLike) -> Array:
        """(..., p) the true θ at times t (...) [s]."""
        return self._plant.truth_at(t)

    def epoch(self, t: ArrayLike) -> NDArray[np.intp]:
        """(...) number of earlier changes of the truth at times t (...) [s], 0 before a fault."""
        return self._plant.epoch(t)

    @property
    def initial(self) -> Array:
        """(p,) the true θ before any fault."""
        return self._plant.truth

    @cached_property
    def theta(self) -> Array:
        """(p,) the true θ at the end."""
        return self.theta_at(self.end)

    @property
    def nullspace(self) -> Nullspace:
        """Structural nullspace P_s(θ), over all motions, of the true θ at the end."""
        return self.nullspace_at(self.end)

    def nullspace_at(self, t: float) -> Nullspace:
        """Structural nullspace P_s(θ), over all motions, of the true θ at time t [s]."""
        epoch = int(self.epoch(t))
        if epoch not in self._nullspaces:
            rng = np.random.default_rng(self._setup.seeds.structure)
            self._nullspaces[epoch] = Nullspace.structural(self.system, self.theta_at(t), rng)
        return self._nullspaces[epoch]

    @property
    def prior_covariance(self) -> Array:
        """(p, p) covariance of θ/scale before any data, with which the prior or the truth is drawn.

        About the prior if the truth is drawn about it, else about the truth.
        """
        scenario = self._setup.scenario
        space = self.system.space
        about = self._setup.prior if scenario.prior == "nominal" else self.theta
        found = Prior(space, about, scenario.initial_error).covariance()
        if scenario.gain_error is not None:
            gains = space.actuators
            found[gains, gains] = (scenario.gain_error * about[gains] / space.scale[gains]) ** 2
        return found

    def distance(self, t: Array, theta_hat: Array) -> Array:
        """(N,) distance ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (N, p) to the true set at times t (N,)."""
        epochs = self.epoch(t)
        theta_s = theta_hat / self.system.space.scale
        ratio = np.empty(len(t))
        for epoch in np.unique(epochs):
            rows = epochs == epoch
            ratio[rows] = self.nullspace_at(float(t[rows][0])).ratio(theta_s[rows])
        return ratio

    def converged_at(self, t: Array, theta_hat: Array) -> float | None:
        """The first of the times t (N,) [s] from which on estimates (N, p) stay `CONVERGED`.

        It is None if the last one is not, or is NaN.
        """
        far = np.flatnonzero(~(self.distance(t, theta_hat) <= CONVERGED))
        first = far[-1] + 1 if len(far) else 0
        return float(t[first]) if first < len(t) else None

    def gain_ratio_error(self, theta_hat: Array) -> float:
        """The `actuator_ratio_error` of an estimate θ̂ (p,), of the true θ at the end."""
        return actuator_ratio_error(self.system, theta_hat, self.theta)

    @cached_property
    def held_out(self) -> Log | None:
        """A held-out trajectory of the plant in its final condition.

        None if the plant diverges, which is likely if it did so in the run.
        """
        return self._setup.held_out(self.end)

    @property
    def exact(self) -> Array | None:
        """(p,) the true θ if (29) gives the plant's exact acceleration with it, else None.

        It does not if unmeasured forces of contacts act.
        """
        touching = bool(self.system.structure.contacts)
        return None if self.mismatches or touching else self.theta


def actuator_ratio_error(system: SecondOrderSystem, theta_hat: Array, true: Array) -> float:
    """max |(k̂_i/k_i)/mean(k̂/k) − 1| over the actuator parameters of a true θ (p,) that are not 0.

    It is 0 where there is only one. A broken actuator's gain is 0.
    """
    k = system.space.actuators[true[system.space.actuators] != 0]
    ratio = theta_hat[k] / true[k]
    return float(np.max(np.abs(ratio / np.mean(ratio) - 1))) if len(ratio) > 1 else 0.0


def nullspace_of(run: Run, truth: Truth | None) -> Nullspace:
    """Structural nullspace P_s(θ), at the true θ or, if that is unknown, at the last estimate."""
    if truth is not None:
        return truth.nullspace
    theta = run.record.rows("theta_hat", -1) if len(run.record) else run.prior
    rng = np.random.default_rng(Seeds.of(run.scenario.seed).structure)
    return Nullspace.structural(run.system, theta, rng)
