"""A progress bar on the terminal, with the real-time factor."""

from __future__ import annotations

import sys
import time

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from ..experiment.loop import Observer
from ..experiment.scenario import Scenario
from ..identifiers import State
from ..log import Measurement
from ..plants import Plant


class Progress(Observer):
    """Shows simulated time, the real-time factor and the velocity error.

    Args:
        name: of the run.
    """

    def __init__(self, name: str):
        self._bar = Bar(
            TextColumn(name),
            BarColumn(),
            TextColumn("{task.completed:6.1f}/{task.total:.0f} s"),
            TextColumn("{task.fields[speed]:5.1f} × real time"),
            TextColumn("rms Δv {task.fields[error]:.1e}"),
            TimeRemainingColumn(),
            console=Console(file=sys.stderr),
            transient=True,
        )

    def start(self, scenario: Scenario, plant: Plant) -> None:
        """Shows an empty bar."""
        self._begin, self._last = time.perf_counter(), 0.0
        self._task = self._bar.add_task("", total=scenario.duration, speed=0.0, error=0.0)
        self._bar.start()

    def see(
        self, measurement: Measurement, states: dict[str, State], levels: tuple[float, float]
    ) -> None:
        """Moves the bar, ten times a second at most."""
        now = time.perf_counter()
        if now - self._last < 0.1:
            return
        self._last = now
        dv = states[""].v_hat - measurement.v
        self._bar.update(
            self._task,
            completed=measurement.t,
            speed=measurement.t / max(now - self._begin, 1e-9),
            error=float((dv @ dv / len(dv)) ** 0.5),
        )

    def stop(self) -> None:
        """Takes the bar away."""
        self._bar.stop()
