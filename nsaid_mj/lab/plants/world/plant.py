"""A plant: a MuJoCo model, the structure for identifiers, and the hidden true parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ....base import InvalidInput
from ....core import Array, Indices, Log, Measurement, SecondOrderSystem, Status
from ....robots import Looks, VisualMesh, quiet
from ...control.computed_torque import Tracking
from ...control.driver import CompiledDriver, Driver
from ...target_profile import advance, at_rest
from .callbacks import installed
from .coordinates import Reading
from .faults.kinds import Fault
from .faults.schedule import Schedule, Variant
from .mismatch import Mismatch
from .sensors import EXACT_SENSORS, Sensors
from .stepping import SimulatedWorld, drive, sound, warnings_of

_PIECE = 5000  # time steps after which a long simulation can be stopped


class Plant(ABC):
    """A simulated plant. Step it inside `with plant.running():`.

    Attributes:
        system: the structure that an identifier may know.
        model: MuJoCo's model. It holds the truth and must not reach an identifier.
        data: MuJoCo's data.
        dt: time step of the measurements and the commands [s].
        substeps: steps of MuJoCo in a time step.
        delay: time steps from a command to the actuators.
        targets: whether commands are positions; until one arrives, servos hold the first.
        late: (n_u,) known time steps from a target to its servo: u is the acting target. None
            without.
        profile: (n_u, 3) of the targets, likewise; see `robot.target_profile`. None without.
        mismatches: effects that the structure does not model, in words.
        faults: faults of actuators, sensors or the plant during a run.
        gain_places: for each command, the indices of its actuator's gains in MuJoCo's userdata;
            empty if MuJoCo's actuators hold the gains.
        reading: index map of the system's coordinates for compiled code; None if compiled code
            cannot read them.
    """

    system: SecondOrderSystem
    model: Any
    data: Any
    dt: float
    substeps: int = 1
    passive: Any | None = None  # a compiled callback, kept alive here
    delay: int = 0
    targets: bool = False
    late: Indices | None = None
    profile: Array | None = None
    mismatches: tuple[str, ...] = ()
    faults: tuple[Fault, ...] = ()
    gain_places: Sequence[Sequence[int]] = ()
    reading: Reading | None = None
    _looks: Looks
    _schedule: Schedule
    _variants: dict[tuple[int, ...], Variant]  # by the faults of the plant itself that are active
    _next_edge: float = np.inf  # when a fault next begins or ends [s]; -inf while a gain falls
    _held: dict[int, float] = {}  # noqa: RUF012 (replaced, never changed): commands of stuck ones
    _biases: Array | None = None  # (2, n) of positions and velocities

    def _compile(self, spec: Any, mismatch: Mismatch) -> None:
        """Compiles MuJoCo's model and data, with the mismatch's lag and delay."""
        mismatch.apply(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.dt = self.model.opt.timestep
        self.delay = mismatch.steps(self.dt)
        self.mismatches = (*self.mismatches, *mismatch.in_words(self.dt))
        self._variants = {(): Variant.of(self.model, self.data, self.gain_places)}
        self.failing(())

    @property
    @abstractmethod
    def truth(self) -> Array:
        """(p,) the true θ before any fault; only evaluation and recording may read it."""

    def truth_at(self, t: ArrayLike) -> Array:
        """(..., p) the true θ at times t (...) [s]; only evaluation and recording may read it."""
        return self._schedule.theta(self.truth, t)

    def epoch(self, t: ArrayLike) -> NDArray[np.intp]:
        """(...) number of earlier changes of the truth at times t (...) [s], 0 before a fault."""
        return self._schedule.epoch(t)

    def failing(self, faults: Sequence[Fault], config: Any = None) -> Self:
        """Schedules faults, at the time steps nearest to their times; returns the plant itself.

        A payload and friction need the plant's configuration, a `ParametricPlantConfig`.

        Raises:
            InvalidInput: a fault names a part that the plant does not have.
        """
        schedule = Schedule(faults, self.system, self.dt)
        self.faults = tuple(faults)
        self._schedule = schedule
        self._variants = {(): self._variants[()]}
        for which in sorted(schedule.all_carried() - {()}):
            if not hasattr(config, "simulating"):
                expected = "faults of actuators and sensors, for this plant"
                remedy = "It cannot be made with a given θ; see ParametricPlantConfig."
                raise InvalidInput("faults", expected, "a change of its body", remedy)
            theta = self.truth + schedule.added(which)
            changed = replace(config, faults=()).simulating(self.dt, theta)
            self._variants[which] = Variant.of(changed.model, changed.data, changed.gain_places)
        return self

    def refined(self, substeps: int) -> Self:
        """Divides every time step into equal steps of MuJoCo's; returns the plant itself.

        Commands, measurements, delays and faults stay at the time steps.
        """
        self.substeps = substeps
        self.model.opt.timestep = self.dt / substeps
        return self

    def reset(self, position: Array, velocity: Array, as_at: float | None = None) -> None:
        """Sets position numbers (n,) and velocities (n,) at t = 0, with actuators at rest.

        `as_at` [s] freezes the plant in its condition at that time of a run, with sound sensors,
        and a stuck actuator at rest unless it holds a stated command; None lets faults occur.
        """
        sound = self._variants[()]
        self.model = sound.model
        self.data = sound.data
        mujoco.mj_resetData(self.model, self.data)
        self._delayed_commands = deque([np.zeros(self.system.n_u)] * self.delay)
        kept = 0 if self.late is None else int(self.late.max())
        self._issued: deque[Array] = deque(maxlen=kept + 1)
        self._profiled: Array | None = None
        self._place(position, velocity)
        self.model.actuator_gainprm[:] = sound.gainprm
        self._variants[()] = Variant.of(self.model, self.data, self.gain_places)
        self._held, self._biases, self._next_edge = {}, None, self._schedule.next_edge(-np.inf)
        if as_at is not None:
            self._fail(as_at)
            self._biases = None
            self._next_edge = np.inf

    def _fail(self, t: float) -> None:
        """Puts plant and sensors into their condition at time t of a run [s]."""
        schedule = self._schedule
        variant = self._variants[schedule.carried(t)]
        if variant.data is not self.data:
            variant.enter(Variant.of(self.model, self.data, self.gain_places))
            self.model = variant.model
            self.data = variant.data
        variant.scale_gains(schedule.factors(t))
        held = {k: float(self.data.ctrl[k]) if x is None else x for k, x in schedule.stuck(t)}
        self._held = held | {k: x for k, x in self._held.items() if k in held}
        self._biases = schedule.biases(t)
        self._next_edge = -np.inf if schedule.fades(t) else schedule.next_edge(t)

    @abstractmethod
    def _place(self, position: Array, velocity: Array) -> None:
        """Writes state (n,), (n,) and the callback's parameters into freshly reset data."""

    @abstractmethod
    def coordinates(self) -> tuple[Array, Array]:
        """(n,) exact position numbers and (n,) exact velocities."""

    def position(self, coordinates: Array) -> Array:
        """(..., m) the system's position q from position numbers (..., n)."""
        return self.system.position(coordinates)

    def visuals(self) -> list[VisualMesh]:
        """The meshes that show the plant; there may be none."""
        return self._looks.visuals()

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m); see `Looks.poses`."""
        return self._looks.poses(q)

    @property
    def t(self) -> float:
        """Simulation time [s]."""
        return self.data.time

    @property
    def diverged(self) -> str:
        """Name of the signal that made MuJoCo diverge; "" if none."""
        found = (signal for kind, signal in _DIVERGENCES if self.data.warning[kind].number)
        return next(found, "")

    @contextmanager
    def running(self) -> Iterator[None]:
        """Context in which the plant can be stepped: its callback is installed in MuJoCo.

        MuJoCo's own warnings are silenced.

        Raises:
            RuntimeError: another plant is running in this process.
        """
        with quiet(), installed(self.passive):  # `diverged` reports it once
            yield

    def begin(
        self, driver: Driver, sensors: Sensors = EXACT_SENSORS, as_at: float | None = None
    ) -> Measurement:
        """Resets plant and driver and takes the first measurement; for `as_at` see `reset`."""
        self.reset(*driver.start(), as_at)
        first = self._measure(0.0, driver, sensors)
        if self.targets:
            self._delayed_commands = deque([first.u] * self.delay)
        return first

    def drive(
        self, driver: Driver, last: Measurement, steps: int, sensors: Sensors = EXACT_SENSORS
    ) -> Log:
        """Continues the simulation in closed loop with the driver.

        Returns `steps` + 1 measurements, beginning with `last`, that of the plant's current state.
        If the plant diverges or a measurement is not finite, the log ends there.
        """
        t = self.times(last.t, steps)
        reading = self.reading
        law = self.law(driver, t)
        if law is None or reading is None:
            return self._drive_stepwise(driver, last, t, sensors)
        log = Log.unchecked(t, *(np.empty((len(t), len(part))) for part in last[1:]))
        for column, first in zip(log, last, strict=True):
            column[0] = first
        errors = sensors.errors(steps, self.system.n)
        world = SimulatedWorld.of(self.model, self.data, self.substeps)
        return log.first(drive(law, world, reading, errors, log))

    def trajectory(
        self,
        driver: Driver,
        steps: int,
        sensors: Sensors | None = None,
        as_at: float | None = None,
        check: Callable[[], object] = lambda: None,
    ) -> Log:
        """Drives the running plant for a number of time steps.

        Sensors are exact if none are given. `as_at` freezes the actuators in their state at this
        time of a run [s]. `check` is called at intervals; it may raise an exception to stop.
        Returns steps + 1 measurements; fewer if the plant diverges, or after one that is not
        finite.
        """
        sensors = sensors or EXACT_SENSORS
        last = self.begin(driver, sensors, as_at)
        parts = []
        while True:
            check()
            log = self.drive(driver, last, min(steps, _PIECE), sensors)
            parts.append(log.part(1 if parts else 0, len(log.t)))
            steps = steps - _PIECE
            last = log.at(-1)
            if steps <= 0 or not self.is_sound(log):
                return Log.unchecked(*map(np.concatenate, zip(*parts, strict=True)))

    def is_sound(self, log: Log) -> bool:
        """Whether it did not diverge along its last log, and all of the log is finite."""
        return not self.diverged and all(np.isfinite(part).all() for part in log)

    def ended(self, last: Measurement) -> tuple[Status, str] | None:
        """Status and signal if the plant diverged or its measurement is not finite, else None."""
        if self.diverged:
            return Status.plant_diverged, self.diverged
        for name, part in (("q", last.q), ("v", last.v)):  # before u, which follows from them
            if not np.isfinite(part).all():
                return Status.measurement_not_finite, name
        return None if np.isfinite(last.u).all() else (Status.command_not_finite, "u")

    def times(self, start: float, steps: int) -> Array:
        """(steps + 1,) times from the sample at `start` [s] on."""
        first = round(start / self.dt)
        return self.dt * np.arange(first, first + steps + 1, dtype=np.float64)

    def law(self, driver: Driver, t: Array) -> Array | Tracking | None:
        """The driver's law, if compiled code can continue the simulation at times t (k,) with it.

        Then it uses no memory of the robot's structure, which other threads may use.
        """
        faulty = self._held or self._biases is not None
        delayed = self.delay or self.late is not None or self.profile is not None
        steady = not delayed and not faulty and self.t + (len(t) - 1) * self.dt < self._next_edge
        if not steady or self.reading is None or not isinstance(driver, CompiledDriver):
            return None
        return driver.compiled(t)

    def _drive_stepwise(self, driver: Driver, last: Measurement, t: Array, sensors: Sensors) -> Log:
        """Drives at times t (k,) [s], calling `command` at each; t[0] is that of `last`."""
        rows = [last]
        for now in t[1:]:
            self.step(rows[-1].u)
            rows.append(self._measure(float(now), driver, sensors))
            if not sound(warnings_of(self.data), *rows[-1][1:]):
                break
        return Log.unchecked_of(rows)

    def _measure(self, t: float, driver: Driver, sensors: Sensors) -> Measurement:
        """The measurement at the current state and the driver's command for it."""
        coordinates, v = sensors(*self.coordinates())
        q = self.position(coordinates)
        if self._biases is not None:
            q = self.system.displaced(q, self._biases[0])
            v = v + self._biases[1]
        u = driver.command(t, q, v)
        if self.profile is not None:
            if self._profiled is None:
                self._profiled = at_rest(u)
            advance(self.profile, u, self.dt, self._profiled)
            u = self._profiled[:, 2].copy()
        if self.late is not None:
            self._issued.append(u)
            ago = np.minimum(self.late, len(self._issued) - 1)
            u = np.array([self._issued[-1 - k][j] for j, k in enumerate(ago)])
        return Measurement(t, q, v, u)

    def step(self, u: Array) -> None:
        """Advances by one time step, in substeps of RK4, with the command u (n_u,) held."""
        if self.delay:
            self._delayed_commands.append(np.array(u, dtype=np.float64))
            u = self._delayed_commands.popleft()
        if self.t > self._next_edge:
            self._fail(self.t)
        self.data.ctrl[:] = u
        for k, held in self._held.items():
            self.data.ctrl[k] = held
        mujoco.mj_step(self.model, self.data, self.substeps)


_DIVERGENCES = (
    (mujoco.mjtWarning.mjWARN_BADQPOS, "qpos"),
    (mujoco.mjtWarning.mjWARN_BADQVEL, "qvel"),
    (mujoco.mjtWarning.mjWARN_BADQACC, "qacc"),
    (mujoco.mjtWarning.mjWARN_BADCTRL, "ctrl"),  # above 1e10 MuJoCo applies no control
)
