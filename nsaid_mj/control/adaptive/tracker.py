"""The control loop of all tracking laws: reference, balance of forces, command, adaptation.

At every sample the command solves W(t, x, w, a, u) θ̂ = pull, where the law chooses w, a and pull.
It is held until the next sample, so it is computed for the state expected half-way, which leaves an
error of second order in the sampling interval. The adaptation takes the state half-way between two
samples as measured, and the command that was really held.
"""

from __future__ import annotations

import numpy as np

from ...identifiers.metric import Metric
from ...log import Measurement
from ...parameters import Array
from ...system import SecondOrderSystem
from ..driver import InformedDriver
from .actuation import Actuation
from .laws import TrackingLaw
from .reference import Reference


class Tracker(InformedDriver):
    """Tracks a reference under one of the laws.

    Args:
        system: the structure.
        reference: the desired motion.
        actuation: the actuators.
        law: the law.
        period: interval at which an informed law wants the identifier's estimate [s].

    Attributes:
        reference: the desired motion.
    """

    def __init__(
        self,
        system: SecondOrderSystem,
        reference: Reference,
        actuation: Actuation,
        law: TrackingLaw,
        period: float,
    ):
        self._system, self._actuation, self._law = system, actuation, law
        self.reference = reference
        self.period = period if law.informed else np.inf
        self._idle = np.zeros(system.n_u)

    @property
    def theta_hat(self) -> Array:
        """(p,) θ̂ of the last command."""
        return self._law.estimate.theta

    @property
    def limits(self) -> tuple[Array, Array]:
        """(n_u,), (n_u,) smallest and largest commands."""
        return self._actuation.low, self._actuation.high

    @property
    def metric(self) -> Metric | None:
        """The metric in which θ̂ is adapted; None if it is not."""
        return self._law.estimate.metric

    def start(self) -> tuple[Array, Array]:
        """Returns to the prior, at the beginning of the reference."""
        self._law.estimate.reset()
        self._last: Measurement | None = None
        return self.reference.desired(0.0)

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the command for the state expected half-way to the next sample."""
        system, theta_hat, step = self._system, self._law.estimate.theta, 0.0
        if self._last is not None:
            step = t - self._last.t
            self._learn(t, q, v, self._last)
            theta_hat = self._law.estimate.theta
        _, a_r = self.reference(t, q, v)
        ahead = 0.5 * step
        t_m, q_m, v_m = t + ahead, system.integrate(q, ahead * v), v + ahead * a_r
        w, a, pull = self._law.demand(v_m, *self.reference(t_m, q_m, v_m))
        W = system._W(t_m, q_m, v_m, w, a, self._idle)
        u = self._actuation.command(theta_hat, W @ theta_hat - pull)
        self._last = Measurement(t, q, v, u)
        return u

    def _learn(self, t: float, q: Array, v: Array, last: Measurement) -> None:
        """Moves θ̂ by −Wᵀ s half-way between the last sample and this one."""
        system = self._system
        t_m, v_m = 0.5 * (last.t + t), 0.5 * (last.v + v)
        q_m = system.integrate(last.q, 0.5 * system.difference(last.q, q))
        v_r, a_r = self.reference(t_m, q_m, v_m)
        W = system._W(t_m, q_m, v_m, v_r, a_r, last.u)
        self._law.estimate.learn(W.T @ (v_r - v_m), t - last.t)

    def inform(self, theta_hat: Array) -> None:
        """Takes over an identifier's estimate, if the law uses one."""
        if self._law.informed:
            self._law.estimate.theta = np.array(theta_hat, dtype=np.float64)

    def compiled(self, t: Array) -> None:
        """None: only `command` evaluates the law."""
