"""run(scenario) -> Run: the only time loop, and the only place where a plant meets an identifier.

The wall: an identifier gets the plant's structure, a prior, and measurements. The prior is drawn
here, once, as the truth plus a seeded error, before the first step; nothing of the truth is read
again until the run has ended.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .cone import drawn_inside
from .control import Driver
from .errors import BadRun
from .identifiers import Identifier, State, Status
from .nullspace import structural
from .parameters import Array, ParameterSpace
from .persistence import PersistenceMonitor
from .plants import Plant
from .record import BATCH_SECONDS, FILE, Record, RecordWriter
from .rehearsal import expected_gramian
from .scenario import Scenario
from .system import EXACT, Measurement

DERIVED = ("summary.json", "scenario.json", "run.rrd", "report.html", "verify.json")
_PE_SAMPLES = 100  # regressors in a window of the online persistence levels
_REHEARSAL = 60.0  # how long the motion is simulated that designs a gain, at most [s]
_DRIFT = 1e-3  # of the conserved quantity: beyond it RK4 no longer follows the law


class Seeds(NamedTuple):
    """Independent streams from one seed; adding one at the end changes none before it."""

    truth: np.random.SeedSequence
    prior: np.random.SeedSequence
    excitation: np.random.SeedSequence
    sensors: np.random.SeedSequence
    held_out: np.random.SeedSequence
    structure: np.random.SeedSequence
    rehearsal: np.random.SeedSequence

    @staticmethod
    def of(seed: int) -> Seeds:
        """The streams of a scenario's seed."""
        return Seeds(*np.random.SeedSequence(seed).spawn(len(Seeds._fields)))


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
    """Where the time went.

    Attributes:
        wall: of the whole loop [s].
        plant: inside MuJoCo [s].
        identifier: inside the identifier [s].
        steps: how many were made.
    """

    wall: float = 0.0
    plant: float = 0.0
    identifier: float = 0.0
    steps: int = 0


@dataclass(eq=False)
class Run:
    """A run that has ended, with what its metrics need.

    Attributes:
        scenario: what was run.
        folder: where its files are.
        record: what was recorded.
        plant: the plant, holding the truth.
        prior: (p,) θ̂(0).
        identifiers: by name; "" is the scenario's own.
        statuses: how each identifier ended, by name.
        ending: how the run ended.
        cost: where the time went.
        states: the identifiers' last states, by name; none where the run was read back.
        confidence: as an earlier summary of the run told it, where it was read back.
    """

    scenario: Scenario
    folder: Path
    record: Record
    plant: Plant
    prior: Array
    identifiers: dict[str, Identifier]
    statuses: dict[str, Status]
    ending: Ending
    cost: Cost
    states: dict[str, State] = field(default_factory=dict)
    confidence: dict[str, Any] | None = None


class Observer:
    """Watches a run: a progress bar, a live viewer. Does nothing by itself."""

    def start(self, scenario: Scenario, plant: Plant) -> None:
        """Called before the first step."""

    def see(self, measurement: Measurement, states: dict[str, State], levels: tuple[float, float]):
        """Called about twenty times a second of the run."""

    def stop(self) -> None:
        """Called when the run has ended, however it did."""


def draw_prior(
    truth: Array,
    space: ParameterSpace,
    error: float,
    gain_error: float | None,
    rng: np.random.Generator,
    in_cone: bool = False,
) -> Array:
    """θ̂(0): every parameter off by up to ±error of its size.

    The size of a parameter near 0 (a product of inertia) is a tenth of its scale, so that no
    estimate starts out exact.

    Args:
        truth: (p,) the true θ.
        space: its names and scales.
        error: largest relative error.
        gain_error: if given, actuator parameters are off by just this share, up and down in turn.
        rng: source of the errors.
        in_cone: whether it must be physical: see `cone.drawn_inside`.
    """
    if in_cone:
        prior = drawn_inside(space, truth, error, rng)
        if gain_error is not None:
            prior[space.actuators] = _assumed(truth[space.actuators], gain_error)
        return prior
    size = np.maximum(np.abs(truth), 0.1 * space.scale)
    prior = truth + error * size * rng.uniform(-1, 1, len(truth))
    if gain_error is not None:
        prior[space.actuators] = _assumed(truth[space.actuators], gain_error)
    return prior


def _assumed(gains: Array, error: float) -> Array:
    """Gains off by a share, up and down in turn."""
    return gains * (1 + error * np.where(np.arange(len(gains)) % 2, -1, 1))


def trajectory(
    plant: Plant,
    driver: Driver,
    steps: int,
    corrupt: Callable[[Array, Array], tuple[Array, Array]] | None,
    cost: Cost,
    as_at: float | None = None,
) -> Iterator[Measurement]:
    """Yields steps + 1 measurements of a driven plant; the driver sees what the sensors say.

    With `as_at` [s] the plant's actuators stay as they are at that time of a run.
    """
    plant.reset(*driver.start(), as_at)
    for k in range(steps + 1):
        coordinates, v = plant.coordinates()
        if corrupt is not None:
            coordinates, v = corrupt(coordinates, v)
        q, t = plant.position(coordinates), k * plant.dt
        u = driver.command(t, q, v)
        yield Measurement(t, q, v, u)
        if k < steps:
            begin = time.perf_counter()
            plant.step(u)
            cost.plant += time.perf_counter() - begin


def run(scenario: Scenario, folder: Path, *observers: Observer) -> Run:
    """Simulates, identifies and records.

    A run that cannot go on ends early, with its status, time and signal, and all it has recorded.

    Args:
        scenario: what to run.
        folder: where to write; it is made, and a record in it is replaced.
        observers: who watches.

    Raises:
        NsaidError: the scenario cannot be started; nothing has been written then.
    """
    seeds = Seeds.of(scenario.seed)
    plant, prior, identifiers = prepare(scenario)
    system = plant.system
    driver = scenario.excitation.build(system, prior, np.random.default_rng(seeds.excitation))
    r = structural(system, prior, np.random.default_rng(seeds.structure)).r
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
        batch=max(1, round(BATCH_SECONDS / (scenario.dt * scenario.record_every))),
    )
    monitor = PersistenceMonitor(system.p, r, scenario.pe_window)
    loop = _Loop(scenario, plant, driver, identifiers, monitor, writer, observers)
    begin = time.perf_counter()
    try:
        for observer in observers:
            observer.start(scenario, plant)
        with _ctrl_c(loop.stop):
            loop(seeds.sensors)
    except KeyboardInterrupt:
        loop.ending.status = Status.interrupted
    finally:
        loop.cost.wall = time.perf_counter() - begin
        writer.close()
        for observer in observers:
            observer.stop()
    statuses = {name: state.status for name, state in loop.states.items()}
    return Run(scenario, folder, Record.read(folder), plant, prior, identifiers, statuses,
               loop.ending, loop.cost, loop.states)  # fmt: skip


@contextmanager
def _ctrl_c(ask: Callable[[], None]) -> Iterator[None]:
    """Makes the first Ctrl-C a request that the loop answers between two steps.

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


def prepare(scenario: Scenario) -> tuple[Plant, Array, dict[str, Identifier]]:
    """The plant with its hidden truth, the prior (p,), and the identifiers by name."""
    seeds = Seeds.of(scenario.seed)
    plant = scenario.plant.build(scenario.dt, int(seeds.truth.generate_state(1)[0]))
    system = plant.system
    prior = draw_prior(
        plant.truth,
        system.space,
        scenario.initial_error,
        scenario.gain_error,
        np.random.default_rng(seeds.prior),
        any(law.in_cone for law in (scenario.identifier, *scenario.rivals.values())),
    )
    noise = scenario.noise.levels if scenario.sensors == "noisy" else EXACT

    @cache
    def gramian() -> Array:
        driver = scenario.excitation.build(system, prior, np.random.default_rng(seeds.rehearsal))
        return expected_gramian(
            system, driver, prior, scenario.dt, min(scenario.duration, _REHEARSAL)
        )

    identifiers = {
        name: config.build(system, prior, scenario.dt, noise, gramian)
        for name, config in {"": scenario.identifier, **scenario.rivals}.items()
    }
    return plant, prior, identifiers


def reopen(folder: Path, record: Record) -> Run:
    """A run as its record has it; one that was cut off counts as interrupted where it stops."""
    scenario = Scenario.from_json(record.metadata["scenario"])
    plant, prior, identifiers = prepare(scenario)
    end = float(record["t"][-1])
    whole = record.complete and end >= (scenario.steps - scenario.record_every) * scenario.dt
    status = Status.completed if whole else Status.interrupted
    return Run(
        scenario, folder, record, plant, prior, identifiers,
        dict.fromkeys(identifiers, Status.completed), Ending(status, end), Cost(),
    )  # fmt: skip


def columns(n: int, m: int, n_u: int, p: int, rivals: list[str]) -> dict[str, int]:
    """The record's columns and their widths."""
    own = {"t": 0, "q": m, "v": n, "u": n_u, "pivot": 0, "spent": 0, "pe": 0,
           "pe_perp": 0}  # fmt: skip
    estimates = {"v_hat": n, "theta_hat": p}
    for name in rivals:
        estimates |= {f"v_hat_{name}": n, f"theta_hat_{name}": p}
    return own | estimates


@dataclass
class _Loop:
    scenario: Scenario
    plant: Plant
    driver: Driver
    identifiers: dict[str, Identifier]
    monitor: PersistenceMonitor
    writer: RecordWriter
    observers: tuple[Observer, ...]
    states: dict[str, State] = field(default_factory=dict)
    ending: Ending = field(default_factory=Ending)
    cost: Cost = field(default_factory=Cost)
    stopped: bool = False

    def stop(self) -> None:
        """Asks the loop to end after the step it is in."""
        self.stopped = True

    def __call__(self, sensor_seed: np.random.SeedSequence) -> None:
        scenario, plant, cost = self.scenario, self.plant, self.cost
        rng = np.random.default_rng(sensor_seed)
        corrupt = None
        if scenario.sensors == "noisy":
            corrupt = partial(scenario.noise.corrupt, rng=rng)
        states = self.states
        conserved: dict[str, float] = {}
        watch = max(1, round(0.05 / scenario.dt))
        check = max(1, round(BATCH_SECONDS / scenario.dt))
        excite = max(1, round(scenario.pe_window / scenario.dt / _PE_SAMPLES))
        previous: Measurement | None = None
        with plant.running():
            for k, now in enumerate(trajectory(plant, self.driver, scenario.steps, corrupt, cost)):
                self.ending.time = now.t
                if self._bad(now):
                    return
                begin = time.perf_counter()
                if previous is None:
                    states |= {name: law.init(now) for name, law in self.identifiers.items()}
                    conserved = {name: float(law.conserved(states[name].theta_hat))
                                 for name, law in self.identifiers.items()}  # fmt: skip
                else:
                    for name, law in self.identifiers.items():
                        if states[name].status is Status.completed:
                            states[name] = law.step(states[name], previous, now)
                    if states[""].status is not Status.completed:
                        self._end(states[""].status, f"pivot {states[''].pivot:.3g}")
                        return
                cost.identifier += time.perf_counter() - begin
                cost.steps = k
                if k % excite == 0:
                    self._excite(states[""], excite)
                if k % scenario.record_every == 0:
                    self._record(now, states)
                if (
                    k
                    and (k % check == 0 or k == scenario.steps)
                    and self._drifted(states, conserved)
                ):
                    return
                if k % watch == 0:
                    levels = self.monitor.level, self.monitor.level_perp
                    for observer in self.observers:
                        observer.see(now, states, levels)
                if self.stopped:
                    self._end(Status.interrupted, "")
                    return
                previous = now

    def _bad(self, now: Measurement) -> bool:
        """Ends the run where the plant has diverged or a measurement is not finite."""
        signal = self.plant.diverged
        if signal:
            self._end(Status.plant_diverged, signal)
            return True
        if math.isfinite(now.q.sum() + now.v.sum() + now.u.sum()):
            return False
        parts = {"q": now.q, "v": now.v, "u": now.u}  # u comes last: it follows from q and v
        bad = next((name for name, part in parts.items() if not np.isfinite(part).all()), "u")
        self._end(Status.measurement_not_finite, bad)
        return True

    def _end(self, status: Status, signal: str) -> None:
        self.ending.status, self.ending.signal = status, signal

    def _excite(self, state: State, stride: int) -> None:
        _, W, _ = state.instant.evaluate(state.v_hat, state.theta_hat)
        self.monitor.add(W * self.plant.system.space.scale, stride * self.scenario.dt)

    def _record(self, now: Measurement, states: dict[str, State]) -> None:
        estimates = [part for s in states.values() for part in (s.v_hat, s.theta_hat)]
        own = states[""]
        pivot = own.pivot if np.isfinite(own.pivot) else 0.0
        self.writer.append(
            now.t, now.q, now.v, now.u, pivot, own.spent, self.monitor.level,
            self.monitor.level_perp, *estimates,
        )  # fmt: skip

    def _drifted(self, states: dict[str, State], conserved: dict[str, float]) -> bool:
        for name, law in self.identifiers.items():
            now = float(law.conserved(states[name].theta_hat)) + states[name].spent
            lost = states[name].status is not Status.completed  # it keeps its own reason
            if law.conserves and not lost and not abs(now / conserved[name] - 1) <= _DRIFT:
                states[name] = states[name]._replace(status=Status.adaptation_too_fast)
        if states[""].status is Status.adaptation_too_fast:
            self._end(Status.adaptation_too_fast, "theta_hat")
            return True
        return False


def held_out(run: Run) -> Record | None:
    """Drives a run's plant, as it is at the run's end, along another trajectory; no identifying.

    Returns:
        What was measured; None where the plant diverges, as it may where the run did.
    """
    scenario, plant = run.scenario, run.plant
    seed = Seeds.of(scenario.seed).held_out
    driver = scenario.excitation.build(plant.system, run.prior, np.random.default_rng(seed))
    steps = max(2, round(scenario.held_out / scenario.dt))
    with plant.running():
        rows = list(trajectory(plant, driver, steps, None, Cost(), run.ending.time))
    finite = all(np.isfinite(part).all() for row in rows for part in row[1:])
    if plant.diverged or not finite:
        return None
    t, q, v, u = (np.array(part) for part in zip(*rows, strict=True))
    return Record({"t": t, "q": q, "v": v, "u": u}, {}, True)
