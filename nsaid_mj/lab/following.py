"""Runs identifiers on measurements from a source, segment by segment.

A run and a Monte Carlo study both feed an identifier one segment of measurements at a time;
`Following` decides when an identifier must be stopped, and `Loop` advances a run's source, its
identifiers, the record and the observers.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..base import OutputFile, Stopwatch
from ..core import (
    Estimates,
    FaultEvent,
    Identifier,
    Log,
    Measurement,
    PersistenceMonitor,
    State,
    Status,
)
from .contacts import rows_along
from .observer import Observer, RobotDescription
from .record import BATCH_SECONDS, RecordWriter
from .scenario import Scenario
from .source import Source, SourceSegment

FAULTS = "faults.json"
"""The faults found so far, rewritten whenever there is a new one."""

_PE_SAMPLES = 50  # regressors in a window of the online persistence levels

DRIFT = 1e-3
"""Relative drift of the conserved quantity beyond which RK4 has lost the law's solution."""

CHECK = 0.5
"""Interval between two checks of the conserved quantity [s]."""


class Following:
    """An identifier and its state along a log, whose first measurement initializes it.

    Attributes:
        state: after the last measurement absorbed, or at the one where the identifier failed.
        ended: time at which the identifier failed [s]; None while it has not.
        drift: largest relative drift of the conserved quantity at any check.
    """

    def __init__(self, identifier: Identifier, log: Log):
        self.identifier, self.state = identifier, identifier.init(log.at(0))
        self.ended: float | None = None
        self.drift = 0.0
        conserved = identifier.conserves
        self._start = float(identifier.conserved(self.state.theta_hat)) if conserved else np.nan

    @property
    def signal(self) -> str:
        """The signal that showed the failure: `theta_hat`, or M̂'s smallest pivot."""
        too_fast = self.state.status is Status.adaptation_too_fast
        return "theta_hat" if too_fast else f"pivot {self.state.pivot:.3g}"

    def follow(self, log: Log, due: np.ndarray) -> Estimates:
        """Follows a segment that begins at the last measurement absorbed.

        The conserved quantity is checked after the rows that are due. Returns the estimates up to
        the end of the segment, or up to the failure.
        """
        return self.absorb(log, *self.identifier.follow(self.state, log), due)

    def resume(self, here: Measurement) -> None:
        """Continues at a measurement after a gap; see `Identifier.resume`."""
        self.state = self.identifier.resume(self.state, here)

    @staticmethod
    def due(first: int, rows: int, dt: float, last: int) -> np.ndarray:
        """The rows of a segment after which the conserved quantity is checked.

        `first` is the run's time step at the segment's first row, which also ends the previous
        segment; `last` is the run's last time step, which is always checked.
        """
        row = np.arange(1, rows)
        steps = first + row
        return row[(steps % Following.every(dt) == 0) | (steps == last)]

    @staticmethod
    def every(dt: float) -> int:
        """Time steps of dt [s] between two checks of the conserved quantity."""
        return max(1, round(CHECK / dt))

    def absorb(self, log: Log, state: State, estimates: Estimates, due: np.ndarray) -> Estimates:
        """Absorbs estimates and last state of a segment, up to a drift beyond `DRIFT`.

        Returns the estimates up to the end of the segment, or up to the failure.
        """
        rows = len(estimates.pivot)
        if self.ended is None and rows < len(log.t):
            self.ended = float(log.t[rows])
        due = due[due < rows]
        if self.identifier.conserves and len(due):
            conserved = self.identifier.conserved(estimates.theta_hat[due]) + estimates.spent[due]
            drift = np.abs(conserved / self._start - 1)
            beyond = np.flatnonzero(~(drift <= DRIFT))  # includes NaN
            if len(beyond):
                row = int(due[beyond[0]])
                drift = drift[: beyond[0] + 1]
                estimates = estimates.first(row + 1)
                self.ended = float(log.t[row])
                state = state._replace(
                    t=self.ended,
                    v_hat=estimates.v_hat[row].copy(),
                    theta_hat=estimates.theta_hat[row].copy(),
                    status=Status.adaptation_too_fast,
                )
            self.drift = max(self.drift, float(drift.max()))
        self.state = state
        return estimates


@dataclass
class Ending:
    """How a run ended, or its state so far, at a simulated time [s].

    The signal is the one that showed the failure; empty if the run completed.
    """

    status: Status = Status.completed
    time: float = 0.0
    signal: str = ""


@dataclass
class RunTimes:
    """Computing times of a run. Only `compile` includes the compilation of kernels."""

    wall: float = 0.0  # wall time of the whole loop [s], in which plant and identifiers may overlap
    plant: float = 0.0  # time in MuJoCo [s]
    identifier: float = 0.0  # time in the identifiers [s]
    steps: int = 0  # number of time steps
    compile: float = 0.0  # time spent compiling kernels [s]; 0 if all were cached on disk


def segment_steps(scenario: Scenario) -> int:
    """Time steps in a segment: simulated first, then followed by the identifiers and recorded."""
    return max(1, round(BATCH_SECONDS / scenario.dt))


@dataclass
class Loop:
    """The loop of a run: for each segment, the robot moves and the identifiers follow."""

    scenario: Scenario
    robot: RobotDescription
    source: Source
    identifiers: dict[str, Identifier]
    monitor: PersistenceMonitor
    writer: RecordWriter
    observers: Sequence[Observer]
    folder: Path
    following: dict[str, Following] = field(default_factory=dict)
    ending: Ending = field(default_factory=Ending)
    cost: RunTimes = field(default_factory=RunTimes)
    stopped: bool = False
    faults: tuple[FaultEvent, ...] = ()

    @property
    def states(self) -> dict[str, State]:
        """The state of every identifier, by name."""
        return {name: following.state for name, following in self.following.items()}

    def stop(self) -> None:
        """Ends the loop after the current segment."""
        self.stopped = True
        self.source.stop()

    def __call__(self) -> None:
        """Runs the loop: for each segment, first the robot moves, then the identifiers follow."""
        scenario = self.scenario
        source = self.source
        period = min((observer.period for observer in self.observers), default=np.inf)
        most = max(1, round(min(period / scenario.dt, segment_steps(scenario))))
        with source.running():
            first = source.begin()
            if first.end:
                self._end(*first.end, float(first.log.t[0]))
                return
            log = first.log
            for observer in self.observers:
                observer.start(scenario, self.robot, log.at(0))
            self.following |= {name: Following(i, log) for name, i in self.identifiers.items()}
            self._keep(0, 0, log, {name: Estimates.of(s) for name, s in self.states.items()})
            k = 0
            while k < scenario.steps and self.ending.status is Status.completed:
                own = self.following[""].state.theta_hat
                steps = min(most, scenario.steps - k)
                segment = source.segment(log.at(-1), k, steps, own)
                self.cost.plant += segment.seconds
                k, log = self._absorb(k, segment)
                if self.stopped or (segment.end and segment.end[0] is Status.completed):
                    break
            if self.stopped and self.ending.status is Status.completed:
                self._end(source.stopped, "", self.ending.time)

    def _absorb(self, k: int, segment: SourceSegment) -> tuple[int, Log]:
        """Follows and records a segment after measurement k; returns the last one's number."""
        log = segment.log
        if segment.end and segment.end[0] is not Status.completed:
            self._end(*segment.end, float(log.t[-1]))
            log = log.first(len(log.t) - 1)
        if segment.resumed:
            for following in self.following.values():
                following.resume(log.at(0))
            k += 1
            self._keep(k, 0, log.first(1), {n: Estimates.of(s) for n, s in self.states.items()})
        if len(log.t) > 1:
            log, estimates = self._follow(k, log)
            self._keep(k, 1, log, estimates)
            k += len(log.t) - 1
        self.cost.steps = k
        return k, log

    def _end(self, status: Status, signal: str, t: float) -> None:
        self.ending.status = status
        self.ending.signal = signal
        self.ending.time = t

    def _follow(self, k: int, log: Log) -> tuple[Log, dict[str, Estimates]]:
        """Runs the identifiers along a segment from time step k; cut where the main one fails."""
        watch = Stopwatch()
        estimates = {}
        for name, following in self.following.items():  # the scenario's own comes first
            due = Following.due(k, len(log.t), self.scenario.dt, self.scenario.steps)
            found = following.follow(log, due)
            if not name and following.ended is not None:
                self._end(following.state.status, following.signal, following.ended)
                log = log.first(len(found.pivot))
            estimates[name] = found.padded(len(log.t))
        self.cost.identifier += watch.seconds
        return log, estimates

    def _keep(self, k: int, fresh: int, log: Log, estimates: dict[str, Estimates]) -> None:
        """Records a segment from time step k, beginning with row `fresh`; calls the observers."""
        scenario = self.scenario
        system = self.robot.system
        own = estimates[""]
        rows = np.arange(fresh, len(log.t))
        every = max(1, round(scenario.pe_window / scenario.dt / _PE_SAMPLES))
        levels = np.empty((len(log.t), 2))
        levels[:] = self.monitor.level, self.monitor.level_perp
        due = rows[(k + rows) % every == 0]
        W = rows_along(system, log, due, own.v_hat[due], own.theta_hat[due])
        for j, sample in zip(due, W * system.space.scale, strict=True):
            self.monitor.add(sample, every * scenario.dt)
            levels[j:] = self.monitor.level, self.monitor.level_perp
        first = fresh + -(k + fresh) % scenario.record_every
        pivot = np.where(np.isfinite(own.pivot), own.pivot, 0.0)
        columns = [log.t, log.q, log.v, log.u, pivot, own.spent, *levels.T]
        columns += [part for made in estimates.values() for part in (made.v_hat, made.theta_hat)]
        self.writer.extend(*(column[first :: scenario.record_every] for column in columns))
        if self.ending.status is Status.completed:
            self.ending.time = float(log.t[-1])
        if self.states[""].faults != self.faults:
            self.faults = self.states[""].faults
            OutputFile(self.folder / FAULTS).write_json([fault.keys() for fault in self.faults])
        for observer in self.observers if len(rows) else ():
            now = self.monitor.level, self.monitor.level_perp
            observer.see(log.part(fresh, len(log.t)), self.states, now)
