"""Sources of a run's measurements: a simulated plant, logs, or anything else."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from typing import ClassVar, NamedTuple

import numpy as np

from ..base import Stopwatch
from ..core import Array, Log, Measurement, Status
from .control.driver import Driver, InformedDriver
from .plants.world.plant import Plant
from .plants.world.sensors import Sensors


class SourceSegment(NamedTuple):
    """Consecutive measurements from a source.

    Attributes:
        log: begins at the last measurement of the previous segment or, if `resumed`, at the first
            one after a gap.
        resumed: whether measurements are missing between this segment and the previous one.
        end: how the source ended with this segment, with the signal that shows it; else None.
        seconds: computing time of a simulated plant [s].
    """

    log: Log
    resumed: bool = False
    end: tuple[Status, str] | None = None
    seconds: float = 0.0


class Source(ABC):
    """Provides the measurements of a run, segment by segment.

    Attributes:
        stopped: status of a run that the user stops.
        LONGEST_STEP: interval between two samples, over the period, beyond which it is a gap.
    """

    LONGEST_STEP: ClassVar = 1.5
    stopped: Status = Status.interrupted

    @abstractmethod
    def running(self) -> AbstractContextManager[None]:
        """The context within which `begin` and `segment` may be called."""

    @abstractmethod
    def begin(self) -> SourceSegment:
        """The first measurement, as a log of one row."""

    @abstractmethod
    def segment(self, last: Measurement, k: int, steps: int, theta_hat: Array) -> SourceSegment:
        """The measurements after the last one, which has number k: at most `steps`, or none yet.

        theta_hat (p,) is the main identifier's estimate at that measurement.
        """

    @abstractmethod
    def stop(self) -> None:
        """Ends a wait for measurements."""


class Simulation(Source):
    """A simulated plant with sensors, moved by a driver, which receives estimates on request.

    While the identifiers follow a segment, a second thread simulates the next one, if it is
    compiled code that does so and the driver waits for no estimate. `steps` is the number of time
    steps of the run, dt [s] their length.
    """

    def __init__(self, plant: Plant, driver: Driver, sensors: Sensors, dt: float, steps: int):
        self.plant = plant
        self._driver = driver
        self._sensors = sensors
        self._inform = driver.steps(dt) if isinstance(driver, InformedDriver) else np.inf
        self._steps = steps
        self._next: Future[SourceSegment] | None = None

    @contextmanager
    def running(self) -> Iterator[None]:
        """The plant's own context, and the second thread's."""
        with self.plant.running(), ThreadPoolExecutor(1) as self._thread:
            yield

    def begin(self) -> SourceSegment:
        """The plant's first measurement."""
        self._next = None
        return self._sound(Log.unchecked_of([self.plant.begin(self._driver, self._sensors)]))

    def segment(self, last: Measurement, k: int, steps: int, theta_hat: Array) -> SourceSegment:
        """Informs the driver if due; moves the plant, at most to its next request for that."""
        if k and self._informs(k) and isinstance(self._driver, InformedDriver):
            self._driver.inform(theta_hat)
        found = self._next.result() if self._next else self._simulate(last, k, steps)
        self._next, k = None, k + len(found.log.t) - 1
        steps = min(steps, self._steps - k)
        if not (found.end or self._informs(k)) and steps:
            last = found.log.at(-1)
            if self.plant.law(self._driver, self.plant.times(last.t, steps)) is not None:
                self._next = self._thread.submit(self._simulate, last, k, steps)
        return found

    def stop(self) -> None:
        """Does nothing: a simulation does not wait."""

    def _informs(self, k: int) -> bool:
        return k % self._inform == 0

    def _simulate(self, last: Measurement, k: int, steps: int) -> SourceSegment:
        watch = Stopwatch()
        steps = int(min(steps, self._inform - k % self._inform))
        found = self._sound(self.plant.drive(self._driver, last, steps, self._sensors))
        return found._replace(seconds=watch.seconds)

    def _sound(self, log: Log) -> SourceSegment:
        return SourceSegment(log, end=self.plant.ended(log.at(-1)))
