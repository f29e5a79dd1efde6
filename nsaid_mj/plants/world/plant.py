"""A plant: a MuJoCo model, the structure an identifier may know of it, and the hidden truth."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...bounds import Config, config
from ...errors import InvalidInput
from ...log import Log, Measurement
from ...parameters import Array
from ...system import SecondOrderSystem
from .callbacks import installed
from .coordinates import Reading
from .faults import Fault
from .mismatch import Mismatch
from .sensors import EXACT_SENSORS, Sensors
from .shapes import VisualMesh
from .stepping import World, drive, sound, warnings_of

if TYPE_CHECKING:
    from ...control import Driver


@config
class PlantConfig(Config, ABC):
    """A plant as data; `build` makes the thing itself.

    Attributes:
        mismatch: what the plant does and the identifier's structure does not know.
        fault: an actuator that weakens.
    """

    _path = "plant"

    mismatch: Mismatch = field(default_factory=Mismatch, kw_only=True)
    fault: Fault = field(default_factory=Fault, kw_only=True)

    @abstractmethod
    def build(self, dt: float, seed: int) -> Plant:
        """Makes the plant.

        Args:
            dt: step of the simulation and of the measurements [s].
            seed: of the hidden truth.
        """


class Plant(ABC):
    """A simulated plant. Step it inside `with plant.running():`.

    Attributes:
        system: the structure an identifier may know.
        model: MuJoCo's model. It holds the truth: never hand it out.
        data: MuJoCo's data.
        dt: step [s].
        delay: steps from a command to the actuators.
        mismatches: what it does and its structure does not know, in words.
        fault: the actuator that weakens.
        gain_places: for every command the places in MuJoCo's userdata of its actuator's gains;
            empty where MuJoCo's actuators have the gains.
        reading: where the system's coordinates are in MuJoCo's, None where compiled code has no
            way to read them.
    """

    system: SecondOrderSystem
    model: Any
    data: Any
    passive: Any | None = None  # a compiled callback, kept alive here
    delay: int = 0
    mismatches: tuple[str, ...] = ()
    fault: Fault = Fault()
    gain_places: Sequence[Sequence[int]] = ()
    reading: Reading | None = None
    _strikes: float = np.inf  # after which time of a run the actuator is weak
    _next_strike: float = np.inf  # the same on the plant's clock; none once it is weak, or held

    def _compile(self, spec: Any, mismatch: Mismatch) -> None:
        """Makes MuJoCo's model and data, with lagging and late actuators where wanted."""
        mismatch.apply(spec)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._initial_gainprm = self.model.actuator_gainprm.copy()
        self.delay = mismatch.steps(self.dt)
        self.mismatches = (*self.mismatches, *mismatch.in_words(self.dt))

    @property
    def dt(self) -> float:
        """Step of the simulation [s]."""
        return self.model.opt.timestep

    @property
    @abstractmethod
    def truth(self) -> Array:
        """(p,) the true θ, before any fault; read by evaluation and recording only."""

    def truth_at(self, t: ArrayLike) -> Array:
        """(..., p) the true θ at times t (...) of a run [s]; for evaluation and recording only."""
        weak = self.truth.copy()
        if self.fault.loss:
            weak[self.fault.gains(self.system)] *= 1 - self.fault.loss
        return np.where(self.struck(t)[..., None], weak, self.truth)

    def struck(self, t: ArrayLike) -> NDArray[np.bool_]:
        """(...) whether the actuator has weakened by times t (...) of a run [s]."""
        return np.asarray(t) > self._strikes

    def failing(self, fault: Fault) -> Self:
        """The plant itself, whose actuator will weaken, at the step nearest to the fault's time.

        Raises:
            InvalidInput: it has no such actuator.
        """
        strikes = np.inf
        if fault.loss:
            fault.gains(self.system)
            strikes = (round(fault.time / self.dt) - 0.5) * self.dt
        self.fault, self._strikes, self._next_strike = fault, strikes, strikes
        return self

    def reset(self, position: Array, velocity: Array, as_at: float | None = None) -> None:
        """Puts the plant at coordinates (n,) and velocities (n,), at t = 0.

        Args:
            position: coordinates.
            velocity: velocities.
            as_at: keep the actuators as they are at this time of a run [s]; None lets them weaken.
        """
        mujoco.mj_resetData(self.model, self.data)
        self._delayed_commands = deque([np.zeros(self.system.n_u)] * self.delay)
        self._place(position, velocity)
        self.model.actuator_gainprm[:] = self._initial_gainprm
        self._next_strike = self._strikes if as_at is None else np.inf
        if as_at is not None and self.struck(as_at):
            self._weaken()

    def _weaken(self) -> None:
        """Takes the fault's share from the actuator's gains, wherever they are."""
        k, left = self.fault.actuator - 1, 1 - self.fault.loss
        self.model.actuator_gainprm[k] *= left
        if self.gain_places:
            self.data.userdata[list(self.gain_places[k])] *= left
        self._next_strike = np.inf

    @abstractmethod
    def _place(self, position: Array, velocity: Array) -> None:
        """Writes coordinates and velocities, and the callback's numbers, into fresh data."""

    @abstractmethod
    def coordinates(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities, exact, as the encoders would see them."""

    def position(self, coordinates: Array) -> Array:
        """(..., m) the system's position q for position numbers (..., n)."""
        return self.system.position(coordinates)

    @abstractmethod
    def visuals(self) -> list[VisualMesh]:
        """What the plant looks like."""

    @abstractmethod
    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """

    @property
    def t(self) -> float:
        """Time of the simulation [s]."""
        return self.data.time

    @property
    def diverged(self) -> str:
        """Which signal MuJoCo found bad, "" while all is well."""
        for counter, signal in self._counters:
            if counter.number:
                return signal
        return ""

    @cached_property
    def _counters(self) -> list[tuple[Any, str]]:
        """MuJoCo's own counters of what diverged, looked up once."""
        return [(self.data.warning[warning], signal) for warning, signal in _DIVERGENCES]

    @contextmanager
    def running(self) -> Iterator[None]:
        """Installs what the plant needs in MuJoCo, and silences MuJoCo's repeated warnings."""
        handler = mujoco.get_mju_user_warning()
        mujoco.set_mju_user_warning(lambda _: None)  # `diverged` tells it, once
        try:
            with installed(self.passive):
                yield
        finally:
            mujoco.set_mju_user_warning(handler)

    def begin(
        self, driver: Driver, sensors: Sensors = EXACT_SENSORS, as_at: float | None = None
    ) -> Measurement:
        """Puts the plant where the driver starts, and measures; `as_at` is that of `reset`."""
        self.reset(*driver.start(), as_at)
        return self._measure(0.0, driver, sensors)

    def drive(
        self, driver: Driver, last: Measurement, steps: int, sensors: Sensors = EXACT_SENSORS
    ) -> Log:
        """Goes on from the last measurement; the driver sees what the sensors say.

        Args:
            driver: chooses the commands.
            last: what was measured last, of where the plant is.
            steps: how many to make.
            sensors: what measures.

        Returns:
            `steps` + 1 measurements, the first of them the last one; fewer where the plant diverges
            or a measurement is not finite, which is then the last.
        """
        start = round(last.t / self.dt)
        t = self.dt * np.arange(start, start + steps + 1, dtype=np.float64)
        steady = not self.delay and self.t + steps * self.dt < self._next_strike
        law = driver.compiled(t) if steady else None
        if law is None or self.reading is None:
            return self._drive_stepwise(driver, last, t, sensors)
        log = Log.unchecked(t, *(np.empty((len(t), len(part))) for part in last[1:]))
        for column, first in zip(log, last, strict=True):
            column[0] = first
        errors = sensors.errors(steps, self.system.n)
        return log.first(drive(law, World.of(self.model, self.data), self.reading, errors, log))

    def _drive_stepwise(self, driver: Driver, last: Measurement, t: Array, sensors: Sensors) -> Log:
        """Drives step by step, asking the driver at every time t (k,); t[0] is that of `last`."""
        rows, warnings = [last], warnings_of(self.data)
        for now in t[1:]:
            self.step(rows[-1].u)
            rows.append(self._measure(float(now), driver, sensors))
            if not sound(warnings, *rows[-1][1:]):
                break
        return Log.unchecked_of(rows)

    def _measure(self, t: float, driver: Driver, sensors: Sensors) -> Measurement:
        """What is measured now, and the driver's answer."""
        coordinates, v = sensors(*self.coordinates())
        q = self.position(coordinates)
        return Measurement(t, q, v, driver.command(t, q, v))

    def step(self, u: Array) -> None:
        """Holds the command u (n_u,) for one step of RK4."""
        if self.delay:
            self._delayed_commands.append(np.array(u, dtype=np.float64))
            u = self._delayed_commands.popleft()
        if self.t > self._next_strike:
            self._weaken()
        self.data.ctrl[:] = u
        mujoco.mj_step(self.model, self.data)


_DIVERGENCES = (
    (mujoco.mjtWarning.mjWARN_BADQPOS, "qpos"),
    (mujoco.mjtWarning.mjWARN_BADQVEL, "qvel"),
    (mujoco.mjtWarning.mjWARN_BADQACC, "qacc"),
    (mujoco.mjtWarning.mjWARN_BADCTRL, "ctrl"),  # beyond 1e10, and then MuJoCo applies none
)


def set_options(spec: Any, dt: float) -> None:
    """Sets what every plant needs: RK4, no silent reset, no contacts or limits.

    Raises:
        InvalidInput: dt is not a positive number.
    """
    if not (np.isfinite(dt) and dt > 0):
        raise InvalidInput("dt", "a step > 0 s", dt, "1e-3 suits arms.")
    spec.option.timestep = dt
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_AUTORESET
        | mujoco.mjtDisableBit.mjDSBL_CONTACT
        | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )
