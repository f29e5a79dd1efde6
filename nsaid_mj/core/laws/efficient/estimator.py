"""The filter of the law `efficient` as one object: its constants, its prior, and its steps."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ....base import InvalidInput
from ...log import Log, Measurement
from ...nullspace.subspace import parts_of
from ...parameters import Array
from ...quotient.cone import Cone
from ...structure.contacts import displaced_jacobians
from ...structure.system import SecondOrderSystem
from ..cone.prior import Prior, spread_of_numbers
from ..settings import EfficientConfig
from .covariance import SMALL, keep_above_rounding
from .filter import (
    COMPLETED,
    CONTRADICTED,
    NEAR,
    ROUNDED,
    Along,
    FilterConstants,
    FilterState,
    filter_at,
)
from .kalman import acceptable, follow_filter, restart_state
from .steps import margin_of

USUAL = 0.3
"""Default of the largest relative error of a prior."""
_STAYS = 2.0  # time constant of the error of a contact's place, as a foot stands for seconds [s]
_UNTESTED = 10**9  # samples: a window that never ends
_LEAST_WINDOW = 10  # samples over which innovations are tested, at least
_PIECE = 25  # rows between two rests of a replay
_INDEFINITE = 1e-13  # least eigenvalue over the largest, of a P_θθ that rounding made indefinite


class Stretch(NamedTuple):
    """How the filter followed a log."""

    last: int  # index of the last sample processed
    completed: bool  # whether that is the log's last
    contradicted: bool  # whether the innovations there are larger than chance allows
    rounded: bool  # whether rounding errors made the covariance indefinite there


class Replay(NamedTuple):
    """A log followed by the filter alone."""

    contradictions: tuple[float, ...]  # times of significantly large innovations [s]
    along: Along  # the filter's outputs
    filter: FilterState  # at the end


class KalmanFilter:
    """An extended Kalman filter of (q, v, θ), for measurements dt [s] apart; see `kalman`.

    The filter's state is a `Filter`, which the methods overwrite. γ is that near θ, `NEAR`; see
    `cautious`.

    Attributes:
        system: the structure, with compiled forward dynamics.
        dt: time between measurements [s].
        constants: what the compiled loops know.

    Raises:
        InvalidInput: the system has no compiled forward dynamics, or `unexplained` has not its
            size.
    """

    def __init__(self, system: SecondOrderSystem, dt: float, config: EfficientConfig):
        if system.forward is None:
            raise InvalidInput(
                "law",
                "a system with compiled forward dynamics",
                type(system).__name__,
                "Use --law memory; for an arm, --plant.backend compiled.",
            )
        self.system = system
        self.dt = dt
        contacts = system.structure.contacts
        self._size = 2 * system.n - sum(contact.rows for contact in contacts)
        self._prior_error = config.prior or USUAL
        self._far_gamma = config.linearisation
        cone = Cone.of(system.space)
        scale = np.array(system.space.scale)
        window = max(_LEAST_WINDOW, round(config.innovation_window / dt))
        unexplained = np.array(config.unexplained, dtype=np.float64)
        motor = system.p - 1 in system.space.actuators
        if len(unexplained) and (len(unexplained) != system.n or not motor):
            raise InvalidInput(
                "identifier.efficient.unexplained",
                f"{system.n} numbers, for a robot with motors",
                len(unexplained),
                "Give one for every velocity, or none.",
            )
        self.constants = FilterConstants(
            structure=system.forward,
            cone=cone,
            scale=scale,
            margin=margin_of(cone, scale),
            gamma=NEAR,
            window=window,
            walk=np.zeros(system.p),
            unexplained=unexplained,
            parts=parts_of(system),
        )

    def cautious(self) -> KalmanFilter:
        """A copy of this filter with the γ of a run's beginning: θ̂ may be as far off as a prior."""
        return self._with(gamma=self._far_gamma)

    def walking(self, walk: Array) -> KalmanFilter:
        """A copy of this filter in which θ is a random walk.

        walk (p,) is the variance that θ, relative to itself, gains per second [1/s].
        """
        return self._with(walk=walk)

    def _with(self, **constants: float | Array) -> KalmanFilter:
        other = copy.copy(self)
        other.constants = self.constants._replace(**constants)  # type: ignore[arg-type]
        return other

    def covariance(self, theta: Array) -> Array:
        """(p, p) P_θθ of θ̂/scale before any data: that of the draw of a prior about θ (p,).

        Limbs that only the base connects also differ in their scale, by as much as one number.
        """
        spread = Prior(self.system.space, theta, self._prior_error).covariance()
        parts = self.constants.parts
        if len(parts) > 1:
            own = parts * theta / self.constants.scale
            one = np.ones(1)
            spread += spread_of_numbers(one, one, self._prior_error) * own.T @ own
        return spread

    def at(self, q: Array, v: Array, theta: Array, P: Array) -> FilterState:
        """The state at the first measurement q (m,), v (n,), with P_θθ (p, p) of θ̂/scale."""
        return filter_at(q, v, theta, P)

    def follow(self, state: FilterState, log: Log, along: Along | None = None) -> Stretch:
        """Follows a log from a state at its first sample, up to a contradiction at most.

        Rows of `along`, one for every sample of the log, are written if it is given.
        """
        if along is None:
            along = Along.empty(len(log.t), self.system.n, self.system.p)
        structure = self.system.structure
        J = np.zeros((len(log.t) - 1, 0, self.system.n))
        shifts = J
        if structure.contacts:
            middle = self.system.midpoints(log, hermite=False).q
            J, shifts = displaced_jacobians(structure, structure.contacts, middle)
            shifts *= np.sqrt(2 * _STAYS)
        last, end = follow_filter(self.constants, state, *log, J, shifts, along)
        return Stretch(last, end == COMPLETED, end == CONTRADICTED, end == ROUNDED)

    def replay(
        self, theta: Array, P: Array, log: Log, rest: Callable[[], None] | None = None
    ) -> Replay:
        """Follows a log of N measurements from θ̂ (p,) with P_θθ (p, p) of θ̂/scale.

        Where the innovations are significantly large, the filter restarts from both. `rest`, if
        any, is called after every 25 rows: a thread of a live program must not hold up its loop.
        """
        count = len(log.t)
        piece = _PIECE if rest else count
        kalman = self.at(log.q[0], log.v[0], theta, P)
        along = Along.empty(count, log.v.shape[1], len(theta))
        times = list[float]()
        at = 0
        while at < count - 1:
            stretch = self.follow(kalman, log.part(at, at + piece + 1), along.part(at))
            at += stretch.last
            if stretch.rounded:
                self.repair(kalman, log.at(at))
            elif stretch.contradicted:
                times.append(float(log.t[at]))
                kalman.theta[:] = theta
                kalman.Ptt[:] = P
                self.restart(kalman, log.at(at))
            if rest:
                rest()
        return Replay(tuple(times), along, kalman)

    @staticmethod
    def sizes(theta: Array, scale: Array) -> Array:
        """(p,) sizes of θ (p,) over the scale (p,), to which relative changes refer."""
        return np.maximum(np.abs(theta / scale), SMALL)

    def innovations(self, state: FilterState, log: Log) -> Array:
        """(N, 2n) normalised innovations along a log of N samples, without a test of them.

        They are infinite from the sample at which the filter fails.
        """
        along = Along.empty(len(log.t), self.system.n, self.system.p)
        stretch = self._with(window=_UNTESTED).follow(state, log, along)
        along.innovation[stretch.last + stretch.completed :] = np.inf
        return along.innovation

    def carry(self, state: FilterState, log: Log) -> None:
        """Carries one of several competing filters along a log, without a test of its innovations.

        The sum of squared innovations in its tally is infinite where it has failed.
        """
        stretch = self._with(window=_UNTESTED).follow(state, log)
        keep_above_rounding(state.Ptt, np.empty_like(state.Ptt))
        state.tally[2] += 0.0 if stretch.completed else np.inf

    def restart(self, state: FilterState, here: Measurement) -> None:
        """Restarts position and velocity at a measurement, uncorrelated with θ̂."""
        restart_state(state, here.q, here.v, state.R)

    def repair(self, state: FilterState, here: Measurement) -> None:
        """Makes P_θθ positive definite after rounding errors, and restarts the state."""
        values, vectors = scipy.linalg.eigh(state.Ptt)
        state.Ptt[:] = (vectors * np.maximum(values, _INDEFINITE * values[-1])) @ vectors.T
        self.restart(state, here)

    def acceptable(self, state: FilterState) -> float:
        """Largest sum of squared innovations in the current window that may be due to chance."""
        samples = int(state.tally[1])
        return float(acceptable(samples, self._size, state.noise.seen[0]))
