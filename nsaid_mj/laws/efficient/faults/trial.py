"""A filter under one fault hypothesis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....log import Log
from ....parameters import Array, ParameterSpace
from ....structure.system import SecondOrderSystem
from ..covariance import keep_above_rounding
from ..filter import COMPLETED, Along, Filter, Law
from ..kalman import follow_filter
from .evidence import jumped
from .hypotheses import Hypothesis, command_of, loaded, most_changed
from .signals import Signals

_LEAST = 0.2  # command at which a stuck actuator is tried, over a typical one
_WALK = 0.012  # of δ per second, as a fault may still grow [1/√s]


class Trial(NamedTuple):
    """A filter under one hypothesis; its tally counts from the start of the trial.

    Attributes:
        hypothesis: under trial.
        filter: at the last sample.
        signals: that act under the hypothesis.
        theta: (p,) θ̂ at the start.
        P: (p, p) P_θθ at the start, with the hypothesis's D Dᵀ.
        earlier: sum of the squared normalised innovations that no longer count as evidence.
    """

    hypothesis: Hypothesis
    filter: Filter
    signals: Signals
    theta: Array
    P: Array
    earlier: float = 0.0

    @staticmethod
    def begin(start: Filter, signals: Signals, hypothesis: Hypothesis, scale: Array) -> Trial:
        """A trial from a filter just before the fault."""
        own = start.copied()
        own.theta[:] += scale * hypothesis.mean
        own.Ptt[:] += hypothesis.D @ hypothesis.D.T
        return Trial(hypothesis, own, signals, own.theta.copy(), own.Ptt.copy())

    @property
    def squares(self) -> float:
        """Sum of the squared normalised innovations."""
        return float(self.filter.tally[2])

    @property
    def evidence(self) -> float:
        """Logarithm of the likelihood of the innovations."""
        return float(-0.5 * (self.filter.tally[2] + self.filter.tally[3]))

    def followed(
        self, law: Law, system: SecondOrderSystem, log: Log, before: Signals | None = None
    ) -> Trial:
        """The trial after a log; `before` are the signals at its first sample, if different."""
        own, count = self.filter.copied(), len(log.t)
        t, q, v, u = self.signals.acting(system, log)
        if before is not None:
            sound = before.acting(system, log.first(1))
            q, v = np.concatenate([sound.q, q[1:]]), np.concatenate([sound.v, v[1:]])
        out = Along.empty(count, system.n, system.p)
        _, end = follow_filter(law._replace(window=10**9), own, t, q, v, u, out)
        keep_above_rounding(own.Ptt, np.empty_like(own.Ptt))
        own.tally[1] = self.filter.tally[1] + count - 1
        own.tally[2] += 0.0 if end == COMPLETED else np.inf
        return self._replace(filter=own)

    def freed(self, seconds: float) -> None:
        """The trial with variance added for a change that continues for the given time [s]."""
        D = self.hypothesis.D
        self.filter.Ptt[:] += _WALK**2 * seconds * (D @ D.T)

    def forgetting(self) -> Trial:
        """The trial, its evidence counted from here."""
        earlier = self.earlier + self.squares
        self.filter.tally[1:] = 0.0
        return self._replace(earlier=earlier)

    def again(self, start: Filter, law: Law) -> Trial:
        """A trial of a load or a seizure from the same start, linearised at this one's estimate.

        Raises:
            LinAlgError: θ with the load is not inside the cone, or too close to its boundary.
        """
        hit = self.hypothesis.D.any(axis=1)
        if self.hypothesis.kind == "stuck":
            k = int(np.argmax(hit))
            held, ratio = self.signals.held.copy(), self.filter.theta[k] / start.theta[k]
            command, typical = self.hypothesis.command, self.hypothesis.held
            better = command_of(self.hypothesis, held[command], ratio)
            held[command] = np.copysign(max(abs(better), _LEAST * abs(typical)), typical)
            signals = self.signals._replace(held=held)
            return Trial.begin(start, signals, self.hypothesis, law.scale)
        mean = np.where(hit, (self.filter.theta - start.theta) / law.scale, 0.0)
        hypothesis = loaded(self.hypothesis, law.cone, law.scale, start.theta, mean)
        return Trial.begin(start, self.signals, hypothesis, law.scale)

    def reported(self, space: ParameterSpace) -> tuple[Hypothesis, tuple[float, float, float]]:
        """The changed part, and the size of the change with its 95 % interval."""
        hypothesis, kalman = self.hypothesis, self.filter
        if hypothesis.kind == "broken":
            return hypothesis, (1.0, 1.0, 1.0)
        if not hypothesis.size.any():
            return hypothesis, (0.0, 0.0, 0.0)
        shift = (kalman.theta - self.theta) / space.scale
        jump = jumped(self.P, kalman.Ptt, shift, hypothesis.D)
        if hypothesis.kind == "friction" and not jump.evident:
            hypothesis = hypothesis._replace(kind="none")
        elif hypothesis.kind == "friction":
            hypothesis = most_changed(space, hypothesis, jump)
        change = jump.interval(hypothesis.size)
        if hypothesis.kind != "stuck":
            size, low, high = (hypothesis.offset + x for x in change)
            return hypothesis, (size, low, high)
        held = float(self.signals.held[hypothesis.command])  # command of the same effort when sound
        size, *ends = (command_of(hypothesis, held, 1 + x) for x in change)
        return hypothesis, (size, min(ends), max(ends))

    def settled(
        self,
        system: SecondOrderSystem,
        scale: Array,
        log: Log,
    ) -> tuple[Filter, Signals]:
        """The filter that continues after the log that ended the trials, and its signals."""
        return self.filter, self.signals
