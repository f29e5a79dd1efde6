"""A live identification from its first sample to its page, and its estimates; for `nsaid live`."""

from __future__ import annotations

import io
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import orjson

from ..base import single_threaded
from ..core import Array, Identifier, Log, Measurement, State, Status
from ..lab import (
    INTERVAL,
    Observer,
    RobotDescription,
    Run,
    RunningMisfit,
    Scenario,
    followed,
    measured_identifiers,
)
from .identify.measured import MeasuredRobot
from .logs.stream import Cleaner, Counts, Stream


class LiveGain(NamedTuple):
    """An actuator's parameter, with the 95 % interval of its ratio to the mean of all.

    No motion reveals the common scale of θ, so the interval takes the mean as exact.

    Attributes:
        name: name of the parameter.
        unit: SI unit.
        value: estimate.
        low: lower end of the interval; −inf before the law states one, and while the motion
            contradicts the structure.
        high: upper end; inf then.
    """

    name: str
    unit: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class LiveEstimate:
    """The estimate at a sample.

    Attributes:
        t: time of the sample, since the first [s].
        samples: number used so far.
        names: (p,) names of the parameters.
        units: (p,) their SI units.
        theta_hat: (p,) θ̂.
        gains: gains of the actuators.
        misfit: whether the motion contradicts the structure: `none`, `some` or `contradicts`; ""
            from a law that does not test it.
        faults: found so far, in words.
    """

    t: float
    samples: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    theta_hat: Array
    gains: tuple[LiveGain, ...]
    misfit: str
    faults: tuple[str, ...]

    def line(self, head: bool = False) -> bytes:
        """The estimate as a line of JSON; null for what is not finite.

        With `head` it also holds names and units, which otherwise a line before states once.
        """
        found: dict[str, Any] = {"t": self.t, "samples": self.samples}
        found |= {"theta": self.theta_hat, "gains": [[g.value, g.low, g.high] for g in self.gains]}
        found |= {"misfit": self.misfit, "faults": self.faults}
        if head:
            found |= {"names": self.names, "units": self.units}
            found["actuators"] = [self.names.index(gain.name) for gain in self.gains]
        return orjson.dumps(found, option=orjson.OPT_SERIALIZE_NUMPY | orjson.OPT_APPEND_NEWLINE)

    @staticmethod
    def of_line(found: dict[str, Any]) -> LiveEstimate:
        """The estimate of such a line with its names and units."""
        names = tuple(found["names"])
        units = tuple(found["units"])
        gains = (
            LiveGain(
                names[k],
                units[k],
                value,
                -np.inf if low is None else low,
                np.inf if high is None else high,
            )
            for k, (value, low, high) in zip(found["actuators"], found["gains"], strict=True)
        )
        return LiveEstimate(
            found["t"],
            found["samples"],
            names,
            units,
            np.array(found["theta"]),
            tuple(gains),
            found["misfit"],
            tuple(found["faults"]),
        )


_INTERVALS = 0.05  # time between two computations of the gains' intervals [s]
_WARM = 2.0  # duration of the warm-up motion [s], and its least number of samples
_LEAST = 60


class EstimateStream(Observer):
    """Passes on the estimate while a stream is followed.

    `show` receives it at intervals of `every` [s], 0 for one after all new samples; `misfit` judges
    it, and `counts` are those of the samples.
    """

    def __init__(
        self,
        identifier: Identifier,
        misfit: RunningMisfit,
        counts: Counts,
        show: Callable[[LiveEstimate], None],
        every: float,
    ):
        self._misfit = misfit
        self._counts = counts
        self._show = show
        self._every = every
        self.period = every or np.inf
        self._space = identifier.system.space
        self._next = self._stated = -np.inf
        self._deviation = np.full(len(self._space.actuators), np.inf)

    def start(self, scenario: Scenario, robot: RobotDescription, first: Measurement) -> None:
        """Does nothing: there is no estimate yet."""

    def see(self, log: Log, states: dict[str, State], levels: tuple[float, float]) -> None:
        """Passes on the estimate if it is due."""
        state = states[""]
        t = float(log.t[-1])
        self._misfit.see(log, state)
        if t < self._next:
            return
        self._next = t + self._every * (1 - 1e-9)
        if t >= self._stated + _INTERVALS:
            self._deviation = self._misfit.deviations(state)
            self._stated = t
        space = self._space
        theta = state.theta_hat
        gains = []
        for k, spread in zip(space.actuators, self._deviation, strict=True):
            value = float(theta[k])
            half = INTERVAL * abs(value) * float(spread) if np.isfinite(spread) else np.inf
            gains.append(
                LiveGain(space.names[k], space.units[k], value, value - half, value + half)
            )
        self._show(
            LiveEstimate(
                state.t,
                self._counts.used,
                tuple(space.names),
                tuple(space.units),
                theta,
                tuple(gains),
                self._misfit.level(state),
                tuple(fault.in_words for fault in state.faults),
            )
        )

    def stop(self) -> None:
        """Stops judging."""
        self._misfit.stop()


class Session:
    """A live identification before its first sample.

    Args:
        scenario: made by `measured_scenario`.
        frame: axes of the samples.

    Attributes:
        robot: its structure, prior and meshes.
        cleaner: checks the samples.

    Raises:
        NsaidError: the model cannot be read, or a value is wrong.
    """

    def __init__(self, scenario: Scenario, frame: str = "ENU/FLU"):
        assert isinstance(scenario.plant, MeasuredRobot)
        self.scenario, self.robot = scenario, scenario.plant.known()
        self.identifiers = measured_identifiers(scenario, self.robot)
        self._frame, self.cleaner = frame, Cleaner(self.robot.system, 1 / scenario.dt, frame)

    def warm_up(self) -> None:
        """Loads everything a run needs, above all kernels, by a short run on an invented motion.

        Raises:
            KeyboardInterrupt: by Ctrl-C meanwhile, which the short run takes as its own end.
        """
        system = self.robot.system
        dt = self.scenario.dt
        rng = np.random.default_rng(0)
        q, v, u = system.random_state(rng)
        lines = []
        for k in range(max(_LEAST, round(_WARM / dt))):
            moved = v + self.scenario.noise.velocity * rng.standard_normal(system.n)
            q = system.integrate(q, dt * moved)
            parts = {"t": k * dt, "q": q, "v": moved, "u": u}
            lines.append(orjson.dumps(parts, option=orjson.OPT_SERIALIZE_NUMPY) + b"\n")
        with TemporaryDirectory(prefix="nsaid-mj-") as folder:
            invented = io.BytesIO(b"".join(lines))
            run = self.run(invented, Path(folder), lambda _: None, stopped=Status.interrupted)
        if run.ending.status is Status.interrupted:
            raise KeyboardInterrupt
        self.cleaner = Cleaner(system, 1 / dt, self._frame)

    @single_threaded
    def run(
        self,
        lines: Iterable[bytes] | socket.socket,
        folder: Path,
        show: Callable[[LiveEstimate], None],
        every: float = 0.0,
        observers: Sequence[Observer] = (),
        stopped: Status = Status.completed,
    ) -> Run:
        """Follows the samples until they end; the folder is locked by the caller.

        `lines` are their source, see `Stream`; `show` receives estimates, at intervals of `every`
        [s], 0 for one after all new samples; `stopped` is the status of a run that Ctrl-C ends.

        Raises:
            InvalidInput: there are no samples, or ones of another robot or rate.
            NotWritten: the disk is full; the record up to there is kept.
        """
        own = self.identifiers[""]
        counts = self.cleaner.counts
        source = Stream(self.robot.system, self.cleaner, lines)
        source.stopped = stopped
        misfit = RunningMisfit(self.scenario, own, self.robot.prior)
        watchers = (EstimateStream(own, misfit, counts, show, every), *observers)
        run = followed(self.scenario, self.robot, source, self.identifiers, folder, watchers)
        run.stream = asdict(counts)
        return run
