"""run(scenario) -> Run: the only time loop, and the only place where a plant meets an identifier.

The wall: an identifier gets the plant's structure, a prior, and measurements. The prior is drawn
before the first step, by `setup`; nothing of the truth is read again until the run has ended.
"""

from __future__ import annotations

import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from ..control import Driver
from ..errors import BadRun
from ..identifiers import Identifier, State, Status
from ..identifiers.base import Estimates
from ..log import Log, Measurement
from ..nullspace import structural
from ..numerics.kernels import clock, compile_seconds
from ..parameters import Array
from ..persistence import PersistenceMonitor
from ..plants import Plant, VisualMesh
from ..system import SecondOrderSystem
from .following import Following, due_rows
from .record import BATCH_SECONDS, FILE, Record, RecordWriter
from .scenario import Scenario
from .setup import Setup

DERIVED = ("summary.json", "scenario.json", "run.rrd", "report.html", "verify.json")
_PE_SAMPLES = 50  # regressors in a window of the online persistence levels


@dataclass
class Ending:
    """How a run stands or ended.

    Attributes:
        status: in one word.
        time: when [s of the run].
        signal: what showed it, "" where it completed.
    """

    status: Status = Status.completed
    time: float = 0.0
    signal: str = ""


@dataclass
class Cost:
    """Where the time went; what compiling took is in none of it but its own.

    Attributes:
        wall: of the whole loop [s].
        plant: inside MuJoCo [s].
        identifier: inside the identifier [s].
        steps: how many were made.
        compile: compiling kernels, before the loop and in it [s]; 0 where they were on disk.
    """

    wall: float = 0.0
    plant: float = 0.0
    identifier: float = 0.0
    steps: int = 0
    compile: float = 0.0


class Looks(Protocol):
    """What a robot looks like, and where its parts are."""

    def visuals(self) -> list[VisualMesh]:
        """The meshes."""
        ...

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        ...


@dataclass(eq=False, kw_only=True)
class Run:
    """A run that has ended: what was measured and estimated. It holds no true value.

    Attributes:
        scenario: what was run.
        folder: where its files are.
        record: what was recorded.
        system: the structure that was identified.
        prior: (p,) θ̂(0).
        identifiers: by name; "" is the scenario's own.
        statuses: how each identifier ended, by name.
        ending: how the run ended.
        cost: where the time went.
        states: the identifiers' last states, by name; empty where the run was read back.
        confidence: as an earlier summary of the run states it, where it was read back.
        looks: draws the robot; None where nobody knows what it looks like.
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


@dataclass(eq=False, kw_only=True)
class SimulatedRun(Run):
    """A run of a simulated plant: its truth can be read, after the fact.

    Attributes:
        setup: what was simulated.
    """

    setup: Setup

    @property
    def plant(self) -> Plant:
        """The plant that moved, which holds the truth."""
        return self.setup.plant


class Observer(ABC):
    """Watches a run: a progress bar, a live viewer.

    Attributes:
        period: largest interval between two calls of `see` [s of simulated time].
    """

    period: float = np.inf

    @abstractmethod
    def start(self, scenario: Scenario, plant: Plant) -> None:
        """Called before the first time step."""

    @abstractmethod
    def see(
        self, measurement: Measurement, states: dict[str, State], levels: tuple[float, float]
    ) -> None:
        """Called at the end of every stretch of the run.

        Args:
            measurement: the last sample of the stretch.
            states: every identifier's state at that sample, by name; "" is the first identifier's.
            levels: ε₀ of (2) and of (75) over the current window.
        """

    @abstractmethod
    def stop(self) -> None:
        """Called when the run ends, also when an error ends it."""


def run(scenario: Scenario, folder: Path, *observers: Observer) -> SimulatedRun:
    """Simulates, identifies and records.

    A run that cannot go on ends early, with its status, time and signal, and all it has recorded.

    Args:
        scenario: what to run.
        folder: where to write; it is made, and a record in it is replaced.
        observers: who watches.

    Raises:
        NsaidError: the scenario cannot be started; nothing has been written then.
    """
    compiled, setup = compile_seconds(), Setup.of(scenario)
    system, driver, identifiers = setup.system, setup.driver(), setup.identifiers()
    r = structural(system, setup.prior, np.random.default_rng(setup.seeds.structure)).r
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for stale in folder.glob("*"):  # of a run that was here: it would pass for this one's
            if stale.name in DERIVED:
                stale.unlink()
        (folder / FILE).open("wb").close()
    except OSError as error:
        raise BadRun(
            folder, f"it cannot be written: {error.strerror}", "Give another folder, with --out"
        ) from error
    writer = RecordWriter(
        folder / FILE,
        columns(system.n, system.m, system.n_u, system.p, list(scenario.rivals)),
        {
            "scenario": scenario.to_json(),
            "names": system.space.names,
            "units": system.space.units,
            "scale": system.space.scale.tolist(),
            "r": r,
        },
        batch=max(1, stretch_of(scenario) // scenario.record_every),
    )
    monitor = PersistenceMonitor(system.p, r, scenario.pe_window)
    loop = _Loop(setup, driver, identifiers, monitor, writer, observers)
    begin = clock()
    try:
        for observer in observers:
            observer.start(scenario, setup.plant)
        with _ctrl_c(loop.stop):
            loop()
    except KeyboardInterrupt:
        loop.ending.status = Status.interrupted
    finally:
        loop.cost.wall, loop.cost.compile = clock() - begin, compile_seconds() - compiled
        writer.close()
        for observer in observers:
            observer.stop()
    return SimulatedRun(
        scenario=scenario,
        folder=folder,
        record=Record.read(folder),
        system=system,
        prior=setup.prior,
        identifiers=identifiers,
        statuses={name: state.status for name, state in loop.states.items()},
        ending=loop.ending,
        cost=loop.cost,
        states=loop.states,
        looks=setup.plant,
        setup=setup,
    )


@contextmanager
def _ctrl_c(ask: Callable[[], None]) -> Iterator[None]:
    """Makes the first Ctrl-C a request that the loop answers between two stretches.

    As an exception it would strike anywhere, and in compiled code be lost or become a SystemError.
    The second one is an exception again.
    """

    def asked(*_: object) -> None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        ask()

    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield  # somebody else handles it, or it is ignored
        return
    signal.signal(signal.SIGINT, asked)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ended(plant: Plant, last: Measurement) -> tuple[Status, str] | None:
    """How a run ends, and the signal that shows it: divergence, or no number; None if sound."""
    if plant.diverged:
        return Status.plant_diverged, plant.diverged
    parts = {"q": last.q, "v": last.v, "u": last.u}  # u comes last: it follows from q and v
    bad = [name for name, part in parts.items() if not np.isfinite(part).all()]
    return (Status.measurement_not_finite, bad[0]) if bad else None


def reopen(folder: Path, record: Record) -> SimulatedRun:
    """A run as its record has it; one that was cut off counts as interrupted where it stops."""
    scenario = Scenario.from_json(record.metadata["scenario"])
    setup = Setup.of(scenario)
    identifiers = setup.identifiers()
    end = float(record["t"][-1])
    whole = record.complete and end >= (scenario.steps - scenario.record_every) * scenario.dt
    return SimulatedRun(
        scenario=scenario,
        folder=folder,
        record=record,
        system=setup.system,
        prior=setup.prior,
        identifiers=identifiers,
        statuses=dict.fromkeys(identifiers, Status.completed),
        ending=Ending(Status.completed if whole else Status.interrupted, end),
        cost=Cost(),
        looks=setup.plant,
        setup=setup,
    )


def columns(n: int, m: int, n_u: int, p: int, rivals: list[str]) -> dict[str, int]:
    """The record's columns and their widths."""
    own = {"t": 0, "q": m, "v": n, "u": n_u, "pivot": 0, "spent": 0, "pe": 0,
           "pe_perp": 0}  # fmt: skip
    estimates = {"v_hat": n, "theta_hat": p}
    for name in rivals:
        estimates |= {f"v_hat_{name}": n, f"theta_hat_{name}": p}
    return own | estimates


def stretch_of(scenario: Scenario) -> int:
    """How many steps a plant makes before its identifiers follow and all is recorded."""
    return max(1, round(BATCH_SECONDS / scenario.dt))


@dataclass
class _Loop:
    setup: Setup
    driver: Driver
    identifiers: dict[str, Identifier]
    monitor: PersistenceMonitor
    writer: RecordWriter
    observers: tuple[Observer, ...]
    following: dict[str, Following] = field(default_factory=dict)
    ending: Ending = field(default_factory=Ending)
    cost: Cost = field(default_factory=Cost)
    stopped: bool = False

    @property
    def states(self) -> dict[str, State]:
        """Where every identifier is, by name."""
        return {name: following.state for name, following in self.following.items()}

    def stop(self) -> None:
        """Asks the loop to end after the stretch it is in."""
        self.stopped = True

    def __call__(self) -> None:
        """Stretch by stretch: the plant moves, then the identifiers follow."""
        scenario, plant = self.setup.scenario, self.setup.plant
        driver, sensors = self.driver, self.setup.sensors()
        period = min((observer.period for observer in self.observers), default=np.inf)
        stretch = max(1, round(min(period / scenario.dt, stretch_of(scenario))))
        with plant.running():
            log = Log.unchecked_of([plant.begin(driver, sensors)])
            if self._unsound(log):
                return
            self.following |= {name: Following(i, log) for name, i in self.identifiers.items()}
            self._keep(0, 0, log, {name: Estimates.of(s) for name, s in self.states.items()})
            k = 0
            while k < scenario.steps and self.ending.status is Status.completed:
                begin, steps = clock(), min(stretch, scenario.steps - k)
                log = plant.drive(driver, log.at(-1), steps, sensors)
                self.cost.plant += clock() - begin
                log, estimates = self._follow(k, log.first(len(log.t) - self._unsound(log)))
                self._keep(k, 1, log, estimates)
                k += len(log.t) - 1
                self.cost.steps = k
                if self.stopped and self.ending.status is Status.completed:
                    self._end(Status.interrupted, "", self.ending.time)

    def _unsound(self, log: Log) -> bool:
        """Ends the run where the plant has diverged or the last measurement is not finite."""
        last = log.at(-1)
        end = ended(self.setup.plant, last)
        if end:
            self._end(*end, last.t)
        return end is not None

    def _end(self, status: Status, signal: str, t: float) -> None:
        self.ending.status, self.ending.signal, self.ending.time = status, signal, t

    def _follow(self, k: int, log: Log) -> tuple[Log, dict[str, Estimates]]:
        """Lets the identifiers follow a stretch from step k, as far as the scenario's own comes."""
        begin, estimates = clock(), {}
        for name, following in self.following.items():  # the scenario's own is the first
            due = due_rows(k, len(log.t), self.setup.scenario.dt, self.setup.scenario.steps)
            found = following.follow(log, due)
            if not name and following.ended is not None:
                self._end(following.state.status, following.signal, following.ended)
                log = log.first(len(found.pivot))
            estimates[name] = found.padded(len(log.t))
        self.cost.identifier += clock() - begin
        return log, estimates

    def _keep(self, k: int, fresh: int, log: Log, estimates: dict[str, Estimates]) -> None:
        """Records a stretch that begins with step k, from its row `fresh` on; shows its end."""
        scenario, system = self.setup.scenario, self.setup.system
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
        for observer in self.observers:
            observer.see(log.at(-1), self.states, (self.monitor.level, self.monitor.level_perp))
