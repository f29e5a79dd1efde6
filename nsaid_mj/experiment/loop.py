"""The only loop: runs the identifiers on the measurements of a source, and writes the record.

The wall: an identifier gets the plant's structure, a prior, and measurements. `setup` draws the
prior before the first time step; the truth is not read again until the end of the run.
"""

from __future__ import annotations

import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..errors import BadRun
from ..identifiers import Identifier, State, Status
from ..identifiers.base import Estimates
from ..identifiers.faults import FaultEvent
from ..log import Log, Measurement
from ..nullspace import PersistenceMonitor, structural
from ..numerics.stopwatch import clock, compile_seconds
from ..numerics.threads import single_threaded
from ..parameters import Array
from ..plants import Looks, Plant
from ..resources import json_of, locked, told, write_json
from ..system import SecondOrderSystem
from .following import Following, due_rows
from .record import BATCH_SECONDS, FILE, Record, RecordWriter
from .scenario import Scenario
from .setup import Seeds, Setup
from .source import Segment, Simulation, Source

FAULTS = "faults.json"
"""The faults found so far, rewritten whenever there is a new one."""

DERIVED = ("summary.json", "scenario.json", "run.rrd", "report.html", "verify.json", FAULTS)
"""Files of an earlier run that `run` deletes from its folder."""
_PE_SAMPLES = 50  # regressors in a window of the online persistence levels


@dataclass
class Ending:
    """How a run ended, or its state so far.

    Attributes:
        status: the status.
        time: simulated time of the end [s].
        signal: the signal that showed the failure; empty if the run completed.
    """

    status: Status = Status.completed
    time: float = 0.0
    signal: str = ""


@dataclass
class Cost:
    """Computing times of a run. Only `compile` includes the compilation of kernels.

    Attributes:
        wall: wall time of the whole loop [s].
        plant: time in MuJoCo [s].
        identifier: time in the identifiers [s].
        steps: number of time steps.
        compile: time spent compiling kernels [s]; 0 if all were cached on disk.
    """

    wall: float = 0.0
    plant: float = 0.0
    identifier: float = 0.0
    steps: int = 0
    compile: float = 0.0


class Robot(NamedTuple):
    """What is known of the robot that moves: no true value.

    Attributes:
        system: the structure.
        prior: (p,) θ̂(0).
        looks: its visual meshes; None if there are none.
    """

    system: SecondOrderSystem
    prior: Array
    looks: Looks | None


@dataclass(eq=False, kw_only=True)
class Run:
    """A finished run: measurements and estimates, without any true value.

    Attributes:
        scenario: the scenario that was run.
        folder: of the run's files.
        record: the recorded measurements and estimates.
        system: the structure that was identified.
        prior: (p,) θ̂(0).
        identifiers: by name; "" is the scenario's own.
        statuses: the status of each identifier at the end, by name.
        ending: how the run ended.
        cost: computing times.
        states: the identifiers' last states, by name; empty if the run was read from its record.
        confidence: from an earlier summary of the run, if it was read from its record.
        looks: visual meshes of the robot; None if there are none.
        stream: what was wrong with the samples of a live robot, in words and numbers; empty of a
            run whose measurements did not arrive from outside.
    """

    scenario: Scenario
    folder: Path
    record: Record
    system: SecondOrderSystem
    prior: Array
    identifiers: dict[str, Identifier]
    statuses: dict[str, Status]
    ending: Ending
    cost: Cost
    states: dict[str, State] = field(default_factory=dict)
    confidence: dict[str, Any] | None = None
    looks: Looks | None = None
    stream: dict[str, int] = field(default_factory=dict)

    @property
    def faults(self) -> tuple[FaultEvent, ...]:
        """The faults that the scenario's own identifier found.

        Raises:
            BadRun: their file is damaged.
        """
        file = self.folder / FAULTS
        if not file.is_file():
            return ()
        try:
            return tuple(FaultEvent.of(keys) for keys in json_of(file.read_bytes()))
        except (KeyError, TypeError, ValueError) as error:
            raise BadRun(file, "not a list of faults", "Run the scenario again") from error


@dataclass(eq=False, kw_only=True)
class SimulatedRun(Run):
    """A finished run of a simulated plant, whose truth can be read.

    Attributes:
        setup: the simulated scenario with its plant.
    """

    setup: Setup

    @property
    def plant(self) -> Plant:
        """The simulated plant, which holds the truth."""
        return self.setup.plant


class Observer(ABC):
    """Callbacks during a run, for a progress bar or a live viewer.

    Attributes:
        period: largest interval between two calls of `see`, in simulated time [s].
    """

    period: float = np.inf

    @abstractmethod
    def start(self, scenario: Scenario, robot: Robot, first: Measurement) -> None:
        """Called at the first measurement."""

    @abstractmethod
    def see(
        self, measurement: Measurement, states: dict[str, State], levels: tuple[float, float]
    ) -> None:
        """Called after every segment of the run.

        Args:
            measurement: the last sample of the segment.
            states: every identifier's state at that sample, by name; "" is the first identifier's.
            levels: ε₀ of (2) and of (75) over the current window.
        """

    @abstractmethod
    def stop(self) -> None:
        """Called at the end of the run, also after an error."""


@single_threaded
def run(scenario: Scenario, folder: Path, *observers: Observer) -> SimulatedRun:
    """Runs a scenario: simulates the plant, runs the identifiers, writes the record.

    If plant or identifier fails, the run ends early; its ending gives status, time and signal, and
    the record up to there is kept.

    Args:
        scenario: the scenario to run.
        folder: of the run's files; created if missing, files of an earlier run are replaced.
        observers: called during the run.

    Raises:
        FolderInUse: another run is writing into the folder.
        NotWritten: the disk is full; the record up to there is kept.
        BadRun: the record was removed or replaced during the run.
        NsaidError: the scenario cannot be started; no record has been written.
    """
    with locked(folder):
        compiled, setup = compile_seconds(), Setup.of(scenario)
        source = Simulation(setup.plant, setup.driver(), setup.sensors(), scenario.dt)
        robot = Robot(setup.system, setup.prior, setup.plant)
        done = followed(scenario, robot, source, setup.identifiers(), folder, observers)
        done.cost.compile = compile_seconds() - compiled
        return SimulatedRun(**vars(done), setup=setup)


def followed(
    scenario: Scenario,
    robot: Robot,
    source: Source,
    identifiers: dict[str, Identifier],
    folder: Path,
    observers: Sequence[Observer] = (),
    metadata: dict[str, Any] | None = None,
) -> Run:
    """Runs identifiers on the measurements of a source until it ends, and writes the record.

    Args:
        scenario: of the run; its plant is not simulated here.
        robot: what is known of it.
        source: of the measurements.
        identifiers: by name; "" is the scenario's own.
        folder: of the run's files, which no other run may write; created if missing.
        observers: called during the run.
        metadata: further entries of the record's.

    Raises:
        NotWritten: the disk is full; the record up to there is kept.
        BadRun: the record was removed or replaced during the run.
    """
    system = robot.system
    rng = np.random.default_rng(Seeds.of(scenario.seed).structure)
    r = structural(system, robot.prior, rng).r
    with told(folder):  # files of an earlier run could be mistaken for this one's
        folder.mkdir(parents=True, exist_ok=True)
        for name in DERIVED:
            (folder / name).unlink(missing_ok=True)
    writer = RecordWriter(
        folder / FILE,
        columns(system.n, system.m, system.n_u, system.p, list(scenario.rivals)),
        {
            "scenario": scenario.to_json(),
            "names": system.space.names,
            "units": system.space.units,
            "scale": system.space.scale.tolist(),
            "r": r,
        }
        | (metadata or {}),
        batch=max(1, segment_steps(scenario) // scenario.record_every),
    )
    monitor = PersistenceMonitor(system.p, r, scenario.pe_window)
    loop = _Loop(scenario, robot, source, identifiers, monitor, writer, observers, folder)
    begin = clock()
    try:
        with _ctrl_c(loop.stop):
            loop()
    except KeyboardInterrupt:
        loop.ending.status = source.stopped
    finally:
        loop.cost.wall = clock() - begin
        for observer in observers:
            observer.stop()
        writer.close()
    writer.check()
    return Run(
        scenario=scenario,
        folder=folder,
        record=Record.read(folder),
        system=system,
        prior=robot.prior,
        identifiers=identifiers,
        statuses={name: state.status for name, state in loop.states.items()},
        ending=loop.ending,
        cost=loop.cost,
        states=loop.states,
        looks=robot.looks,
    )


@contextmanager
def _ctrl_c(ask: Callable[[], None]) -> Iterator[None]:
    """Turns the first Ctrl-C into a call of `ask`; the second one raises KeyboardInterrupt.

    The same goes for the signals that the command line treats as Ctrl-C.

    An exception could be raised anywhere, and within compiled code it would be lost or become a
    SystemError. The loop stops between two segments instead.
    """
    # on others another handler is installed, or they are ignored
    ours = [s for s in signal.valid_signals() if signal.getsignal(s) is signal.default_int_handler]
    if threading.current_thread() is not threading.main_thread():
        ours = []

    def set_all(handler: Any) -> None:
        for number in ours:
            signal.signal(number, handler)

    def asked(*_: object) -> None:
        set_all(signal.default_int_handler)
        ask()

    set_all(asked)
    try:
        yield
    finally:
        set_all(signal.default_int_handler)


def reopen(folder: Path, record: Record) -> SimulatedRun:
    """Rebuilds a run from its record; a truncated record counts as an interrupted run.

    Raises:
        BadRun: the record has no scenario, or not that scenario's columns.
    """
    scenario = Scenario.from_json(record.scenario(folder))
    setup = Setup.of(scenario)
    identifiers, system = setup.identifiers(), setup.system
    widths = columns(system.n, system.m, system.n_u, system.p, list(scenario.rivals))
    record.check(folder, widths)
    end = float(record["t"][-1])
    whole = record.complete and end >= (scenario.steps - scenario.record_every) * scenario.dt
    return SimulatedRun(
        scenario=scenario,
        folder=folder,
        record=record,
        system=system,
        prior=setup.prior,
        identifiers=identifiers,
        statuses=dict.fromkeys(identifiers, Status.completed),
        ending=Ending(Status.completed if whole else Status.interrupted, end),
        cost=Cost(),
        looks=setup.plant,
        setup=setup,
    )


def columns(n: int, m: int, n_u: int, p: int, rivals: list[str]) -> dict[str, int]:
    """Entries per row of every column of a record, by name; 0 for a scalar column."""
    own = {"t": 0, "q": m, "v": n, "u": n_u, "pivot": 0, "spent": 0, "pe": 0, "pe_perp": 0}
    estimates = {"v_hat": n, "theta_hat": p}
    for name in rivals:
        estimates |= {f"v_hat_{name}": n, f"theta_hat_{name}": p}
    return own | estimates


def segment_steps(scenario: Scenario) -> int:
    """Time steps in a segment: simulated first, then followed by the identifiers and recorded."""
    return max(1, round(BATCH_SECONDS / scenario.dt))


@dataclass
class _Loop:
    scenario: Scenario
    robot: Robot
    source: Source
    identifiers: dict[str, Identifier]
    monitor: PersistenceMonitor
    writer: RecordWriter
    observers: Sequence[Observer]
    folder: Path
    following: dict[str, Following] = field(default_factory=dict)
    ending: Ending = field(default_factory=Ending)
    cost: Cost = field(default_factory=Cost)
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
        scenario, source = self.scenario, self.source
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
                begin = clock()
                segment = source.segment(log.at(-1), k, min(most, scenario.steps - k))
                self.cost.plant += clock() - begin
                k, log = self._absorb(k, segment)
                if self.stopped or (segment.end and segment.end[0] is Status.completed):
                    break
            if self.stopped and self.ending.status is Status.completed:
                self._end(source.stopped, "", self.ending.time)

    def _absorb(self, k: int, segment: Segment) -> tuple[int, Log]:
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
        self.source.inform(k, self.following[""].state.theta_hat)
        return k, log

    def _end(self, status: Status, signal: str, t: float) -> None:
        self.ending.status, self.ending.signal, self.ending.time = status, signal, t

    def _follow(self, k: int, log: Log) -> tuple[Log, dict[str, Estimates]]:
        """Runs the identifiers along a segment from time step k; cut where the own one fails."""
        begin, estimates = clock(), {}
        for name, following in self.following.items():  # the scenario's own comes first
            due = due_rows(k, len(log.t), self.scenario.dt, self.scenario.steps)
            found = following.follow(log, due)
            if not name and following.ended is not None:
                self._end(following.state.status, following.signal, following.ended)
                log = log.first(len(found.pivot))
            estimates[name] = found.padded(len(log.t))
        self.cost.identifier += clock() - begin
        return log, estimates

    def _keep(self, k: int, fresh: int, log: Log, estimates: dict[str, Estimates]) -> None:
        """Records a segment from time step k, beginning with row `fresh`; calls the observers."""
        scenario, system = self.scenario, self.robot.system
        own, rows = estimates[""], np.arange(fresh, len(log.t))
        every = max(1, round(scenario.pe_window / scenario.dt / _PE_SAMPLES))
        levels = np.empty((len(log.t), 2))
        levels[:] = self.monitor.level, self.monitor.level_perp
        for j in rows[(k + rows) % every == 0]:
            stage = system.evaluate_at(*log.at(j), own.v_hat[j], own.theta_hat[j])
            self.monitor.add(stage.W * system.space.scale, every * scenario.dt)
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
            write_json(self.folder / FAULTS, [fault.keys() for fault in self.faults])
        for observer in self.observers:
            observer.see(log.at(-1), self.states, (self.monitor.level, self.monitor.level_perp))
