"""The only loop: runs the identifiers on the measurements of a source, and writes the record.

No true value reaches an identifier: it gets the plant's structure, a prior, and measurements.
`setup` draws the prior before the first time step; the truth is not read again until the end of the
run.
"""

import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from ..base import (
    BadRun,
    FolderInUse,
    NotWritten,
    OutputFile,
    OutputFolder,
    Stopwatch,
    json_of,
    single_threaded,
)
from ..core import (
    Array,
    FaultEvent,
    Identifier,
    Nullspace,
    PersistenceMonitor,
    SecondOrderSystem,
    State,
    Status,
)
from ..robots import Looks
from .folders import holds_run
from .following import FAULTS, Ending, Loop, RunTimes, segment_steps
from .observer import Observer, RobotDescription
from .plants.world.plant import Plant
from .record import PROFILED, RECORD_FILE, TARGET_DELAYS, Record, RecordWriter
from .scenario import Scenario
from .setup import Seeds, Setup, identifier_of
from .source import Simulation, Source

DERIVED = ("summary.json", "scenario.json", "run.rrd", "report.html", "verify.json", FAULTS)
"""Files of an earlier run that `run` deletes from its folder, if they are ours."""


@dataclass(eq=False, kw_only=True)
class Run:
    """A finished run: measurements and estimates, without any true value.

    Attributes:
        scenario: the scenario that was run.
        folder: folder of the run's files.
        record: the recorded measurements and estimates, read from the folder as they are used.
        system: the structure that was identified.
        prior: (p,) θ̂(0).
        identifiers: by name; "" is the scenario's own.
        statuses: the status of each identifier at the end, by name.
        ending: how the run ended.
        cost: computing times.
        states: the identifiers' last states, by name; empty if the run was read from its record.
        looks: visual meshes of the robot; None if there are none.
        stream: faults of a live robot's samples, in words and numbers; empty for a run without
            measurements from outside.
    """

    scenario: Scenario
    folder: Path
    record: Record
    system: SecondOrderSystem
    prior: Array
    identifiers: dict[str, Identifier]
    statuses: dict[str, Status]
    ending: Ending
    cost: RunTimes
    states: dict[str, State] = field(default_factory=dict)
    looks: Looks | None = None
    stream: dict[str, int] = field(default_factory=dict)

    @property
    def faults(self) -> tuple[FaultEvent, ...]:
        """The faults that the main identifier found; raises `BadRun` if their file is damaged."""
        file = self.folder / FAULTS
        if not file.is_file():
            return ()
        try:
            return tuple(FaultEvent.of(keys) for keys in json_of(OutputFile(file).read()))
        except (KeyError, TypeError, ValueError, OSError) as error:
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


@single_threaded
def run(
    scenario: Scenario, folder: Path, *observers: Observer, force: bool = False
) -> SimulatedRun:
    """Runs a scenario: simulates the plant, runs the identifiers, writes the record.

    If plant or identifier fails, the run ends early; its ending gives status, time and signal, and
    the record up to there is kept.

    Args:
        scenario: the scenario to run.
        folder: folder of the run's files, created if missing; other files in it are kept.
        observers: called during the run.
        force: whether a run that the folder holds is replaced.

    Raises:
        FolderInUse: another run is writing into the folder, or it holds a run and `force` is not
            set.
        NotWritten: the disk is full; the record up to there is kept.
        BadRun: the record was removed or replaced during the run.
        NsaidError: the scenario cannot be started; no record has been written.
    """
    with OutputFolder(folder).locked():
        if not force and holds_run(folder):
            remedy = "Give force=True to replace it, or another folder"
            raise FolderInUse(folder, "it holds a run", remedy)
        watch = Stopwatch()
        setup = Setup.of(scenario)
        moved = setup.plant, setup.driver(), setup.sensors()
        source = Simulation(*moved, scenario.dt, scenario.steps)
        robot = RobotDescription(setup.system, setup.prior, setup.plant)
        metadata: dict[str, Any] = {}
        if setup.plant.targets:
            late = setup.plant.late
            steps = np.zeros(setup.system.n_u) if late is None else late
            metadata = {TARGET_DELAYS: (steps * setup.plant.dt).tolist()}
            metadata |= {PROFILED: setup.plant.profile is not None}
        done = followed(scenario, robot, source, setup.identifiers(), folder, observers, metadata)
        done.cost.compile = watch.compiling
        return SimulatedRun(**vars(done), setup=setup)


def followed(
    scenario: Scenario,
    robot: RobotDescription,
    source: Source,
    identifiers: dict[str, Identifier],
    folder: Path,
    observers: Sequence[Observer] = (),
    metadata: dict[str, Any] | None = None,
) -> Run:
    """Runs identifiers on the measurements of a source until it ends, and writes the record.

    The identifier "" is the scenario's own. The scenario's plant is not simulated here; no other
    run may write into the folder, which is created if missing. `metadata` are further entries of
    the record's.

    Raises:
        NotWritten: the disk is full; the record up to there is kept.
        BadRun: the record was removed or replaced during the run.
    """
    system = robot.system
    rng = np.random.default_rng(Seeds.of(scenario.seed).structure)
    r = Nullspace.structural(system, robot.prior, rng).r
    with NotWritten.on_failure(folder):  # files of an earlier run could be mistaken for this one's
        folder.mkdir(parents=True, exist_ok=True)
        OutputFolder(folder).check((RECORD_FILE, *DERIVED), None)
        for name in DERIVED:
            OutputFile(folder / name).discard()
    space = system.space
    widths = columns(system, scenario)
    known = {"names": space.names, "units": space.units, "scale": space.scale.tolist(), "r": r}
    known = {"scenario": scenario.to_json()} | known | (metadata or {})
    batch = max(1, segment_steps(scenario) // scenario.record_every)
    writer = RecordWriter(folder / RECORD_FILE, widths, known, batch)
    monitor = PersistenceMonitor(system.p, r, scenario.pe_window)
    loop = Loop(scenario, robot, source, identifiers, monitor, writer, observers, folder)
    watch = Stopwatch()
    try:
        with _ctrl_c(loop.stop):
            loop()
    except KeyboardInterrupt:
        loop.ending.status = source.stopped
    finally:
        loop.cost.wall = watch.seconds
        for observer in observers:
            observer.stop()
        writer.close()
    writer.check()
    return Run(
        scenario=scenario,
        folder=folder,
        record=Record.opened(folder),
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

    It also handles the signals that the command line treats like Ctrl-C. An exception could be
    raised anywhere, and within compiled code it would be lost or become a SystemError; this way,
    the loop stops between two segments.
    """
    # other signals have another handler, or are ignored
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


@runtime_checkable
class Measured(Protocol):
    """A plant of a scenario that is not simulated: a real robot, whose log the record holds."""

    def known(self) -> RobotDescription:
        """Structure, prior and looks."""
        ...


def reopen(folder: Path, record: Record) -> Run:
    """Rebuilds a run from its record; a truncated record counts as an interrupted run.

    Raises:
        BadRun: the record has no scenario, or not that scenario's columns.
    """
    scenario = Scenario.from_json(record.scenario(folder))
    if isinstance(scenario.plant, Measured):
        return _reopened_log(scenario, scenario.plant.known(), folder, record)
    setup = Setup.of(scenario)
    identifiers = setup.identifiers()
    system = setup.system
    record.check(folder, columns(system, scenario))
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
        cost=RunTimes(),
        looks=setup.plant,
        setup=setup,
    )


def _reopened_log(scenario: Scenario, robot: RobotDescription, folder: Path, record: Record) -> Run:
    """The run of a robot that is not simulated, rebuilt from its record."""
    record.check(folder, columns(robot.system, scenario))
    return Run(
        scenario=scenario,
        folder=folder,
        record=record,
        system=robot.system,
        prior=robot.prior,
        identifiers=measured_identifiers(scenario, robot),
        statuses={"": Status.completed},
        ending=Ending(Status.completed, float(record["t"][-1])),
        cost=RunTimes(steps=len(record)),
        looks=robot.looks,
    )


def measured_identifiers(scenario: Scenario, robot: RobotDescription) -> dict[str, Identifier]:
    """The scenario's own identifier, for a robot that is not simulated."""
    config = scenario.identifier
    levels = scenario.noise.levels
    return {"": identifier_of(config, scenario, robot.system, robot.prior, levels)}


def columns(system: SecondOrderSystem, scenario: Scenario) -> dict[str, int]:
    """Entries per row of every column of a run's record, by name; 0 for a scalar column."""
    found = {"t": 0, "q": system.m, "v": system.n, "u": system.n_u}
    found |= dict.fromkeys(("pivot", "spent", "pe", "pe_perp"), 0)
    for end in ("", *(f"_{name}" for name in scenario.rivals)):
        found |= {f"v_hat{end}": system.n, f"theta_hat{end}": system.p}
    return found
