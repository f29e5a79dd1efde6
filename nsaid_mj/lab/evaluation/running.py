"""The misfit of a motion that still goes on."""

import time
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor

import numpy as np

from ...core import Array, Confidence, Identifier, Log, State
from ...watch import (
    Misfit,
    drift_of,
    signals_after,
    widened,
)
from ..scenario import Scenario
from ..source import Source
from .run_misfit import filter_of

_FIRST = 0.5  # duration that is judged first [s], and the next one's ratio to it
_NEXT = 1.5
_LATER = 1.4  # durations judged, after which the misfit is stated; enough time for 1 kHz
_REST = 5e-4  # of the thread between two pieces, so that on two cores the user's loop can run [s]


class RunningMisfit:
    """Judges the motion so far each time it has grown by half, as `misfit_of` does at its end.

    A law's own covariance is not enough while it learns: it counts errors of linearisation as
    information, and small effects that W lacks accumulate without a single significant innovation.
    So the filter runs along the log again, from the estimate and its covariance. A fault or a gap
    begins another log.

    A background thread judges. Its result is used from the moment at which the motion has grown by
    two fifths since, so that results do not depend on the speed of the machine.

    Laws other than `memory` and `efficient` are not judged; prior (p,) is θ̂(0).
    """

    def __init__(self, scenario: Scenario, identifier: Identifier, prior: Array):
        self._identifier = identifier
        self._system = identifier.system
        self._prior = prior
        self._dt = scenario.dt
        self._filter = filter_of(scenario, self._system)
        self._pool = ThreadPoolExecutor(1, "misfit")
        self._stated: tuple[Misfit, Array] | None = None  # with the gains' deviations at its end
        self._log = 0  # number of the log that goes on
        self._begin(0)

    def _begin(self, faults: int) -> None:
        """Begins another log, after so many faults."""
        self._log += 1
        self._faults, self._parts = faults, tuple[Log, ...]()
        self._start, self._judged = np.nan, max(_FIRST, Misfit.FEWEST * self._dt)
        self._found: tuple[Future[Misfit], Array] | None = None

    def see(self, log: Log, state: State) -> None:
        """Adds samples, at the last of which the law has a state."""
        if self._filter is None or not len(log.t):
            return
        known = tuple(event for event in state.faults if event.kind != "unknown")
        gap = self._parts and log.t[0] - self._parts[-1].t[-1] > Source.LONGEST_STEP * self._dt
        if gap or len(known) > self._faults:
            self._begin(len(known))
        self._start = float(log.t[0]) if not self._parts else self._start
        self._parts = Log.extended(self._parts, log)
        while len(self._parts) > 1 and self._parts[1].t[0] < log.t[-1] - Misfit.longest(
            self._system
        ):
            self._parts = self._parts[1:]
        duration = float(log.t[-1]) - self._start
        if self._found is not None and duration >= _LATER * self._judged:
            misfit, deviations = self._found
            self._stated = (misfit.result(), deviations)
            self._found = None
            self._judged *= _NEXT
        drift, _ = drift_of(state)
        if self._found is None and duration >= self._judged and not drift:
            whole = Log.joined(*self._parts)
            start = int(np.searchsorted(whole.t, whole.t[-1] - Misfit.longest(self._system)))
            whole = whole.part(start, len(whole.t))
            stated = self._identifier.confidence(state)
            deviations = Confidence.of_gains(stated, state.theta_hat, self._system.space)
            acting = signals_after(self._system, known).acting(self._system, whole)
            given = state.theta_hat, stated, self._prior, acting
            self._found = self._pool.submit(self._judgement, self._log, *given), deviations

    def _judgement(
        self, number: int, theta: Array, stated: Confidence | None, prior: Array, log: Log
    ) -> Misfit:
        """The misfit of a log, in the thread, until another log begins."""

        def rest() -> None:
            if number != self._log:
                raise CancelledError
            time.sleep(_REST)

        assert self._filter is not None
        return Misfit.of_estimate(self._filter, theta, stated, prior, log, rest)

    def level(self, state: State) -> str:
        """The level of `Misfit` so far; "" of a law that is not judged."""
        found = Misfit.during(state), self._stated[0].level if self._stated else ""
        return max(found, key=("", *Misfit.LEVELS).index)

    def deviations(self, state: State) -> Array:
        """(a,) relative standard deviations of the gains, of `gain_deviations`; inf if unknown.

        They are the law's own, widened by the last misfit, and never less than they were when that
        was judged. They are unknown before the first one, and while the misfit contradicts.
        """
        stated = self._identifier.confidence(state)
        space = self._system.space
        if self._filter is None or stated is None:
            return Confidence.of_gains(stated, state.theta_hat, space)
        if self._stated is None or self.level(state) == Misfit.LEVELS[-1]:
            return Confidence.of_gains(None, state.theta_hat, space)
        misfit, least = self._stated
        own = Confidence.of_gains(widened(stated, misfit.widening), state.theta_hat, space)
        return np.maximum(own, misfit.widening * least)

    def stop(self) -> None:
        """Ends the thread and waits for it, as kernels it compiles would delay the next run."""
        self._log += 1
        self._pool.shutdown(wait=True, cancel_futures=True)
