"""Progress of a command on the terminal: a spinner, or a progress bar during a run."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    ProgressColumn,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bar

from ..base import Stopwatch
from .observer import Observer, RobotDescription

if TYPE_CHECKING:
    from ..core import Log, Measurement, SecondOrderSystem, State
    from .scenario import Scenario

COMPILING = "compiling, once (half a minute)"
_STEP = 1e-4  # of plant, identifier and persistence levels, roughly [s]
_LARGE = 1e10  # size of a record that is announced beforehand [bytes]
_PATIENCE = 10.0  # time between two lines where there is no terminal [s]
_ALL = 1e6  # longer than any study [s]
_MINUTES = 120.0  # from which a time is told in minutes [s]
_PERIOD = 0.1  # smallest interval between two updates of the bar [s]


class Progress(Observer):
    """One transient line on the terminal for a whole command.

    During a run it is a bar with simulated time, time left, real-time factor and velocity error; at
    other times a spinner with the text set by `say`, or a bar with the time left, set by `stage`.
    It reports when kernels are being compiled. Without a terminal, a line now and then tells a
    run's and a stage's time left, and that kernels are being compiled.

    Args:
        name: name of the run.
        quiet: show nothing.
    """

    def __init__(self, name: str, quiet: bool = False):
        self._name, self._console = name, Console(stderr=True, quiet=quiet)
        self._bar = Bar(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=16),
            TextColumn("{task.fields[figures]}"),
            console=self._console,
            transient=True,
        )
        self._task = self._bar.add_task(name, total=None, figures="")
        self._stack = ExitStack()
        self._functions = 0
        self._told = -math.inf
        self._watch = Stopwatch()

    def __enter__(self) -> Progress:
        """Shows the line."""
        with self._stack as stack:
            stack.enter_context(Stopwatch.on_compiling(self._compiling))
            if self._console.is_terminal:
                stack.enter_context(self._bar)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        """Removes the line."""
        self._stack.close()

    def say(self, words: str) -> None:
        """Shows the spinner with a text."""
        self._bar.update(self._task, description=f"{self._name}: {words}")

    def stage(self, words: str, share: float | None) -> None:
        """Shows a text, and a bar with the time left if the completed share is known.

        The time left is extrapolated from the share of 0 on.
        """
        if not share:
            self._watch = Stopwatch()
        figures = f"{100 * share:.0f} %{self._left(share)}" if share else ""
        self._bar.update(
            self._task,
            description=f"{self._name}: {words}",
            total=None if share is None else 1.0,
            completed=share or 0.0,
            figures=figures,
        )
        if figures:
            self._tell(f"{words}, {figures}")

    def _left(self, share: float) -> str:
        """The time left when a share has been completed, in words."""
        return f", about {_in_words(self._watch.seconds * (1 / share - 1))} left"

    def _tell(self, words: str) -> None:
        """Without a terminal, prints a line, unless the last one was just printed."""
        now = time.monotonic()
        if not self._console.is_terminal and now - self._told > _PATIENCE:
            self._told = now
            self._console.print(f"{self._name}: {words}", highlight=False, markup=False)

    def _compiling(self) -> None:
        """Reports that kernels are being compiled."""
        self._functions += 1
        words = COMPILING if self._functions == 1 else f"{COMPILING}: {self._functions} functions"
        self.say(words)
        self._tell(words)

    def start(self, scenario: Scenario, robot: RobotDescription, first: Measurement) -> None:
        """Shows an empty bar, and announces the cost of a long run."""
        if words := cost_of(scenario, robot.system):
            self._console.print(f"{self._name}: {words}", highlight=False, markup=False)
        self._watch = Stopwatch()
        self._last = -_PERIOD
        self._end = scenario.duration
        self._bar.update(self._task, total=scenario.duration, description=self._name)

    def see(self, log: Log, states: dict[str, State], levels: tuple[float, float]) -> None:
        """Updates the bar, at most ten times a second."""
        now = self._watch.seconds
        t = float(log.t[-1])
        if t <= 0 or now - self._last < _PERIOD:
            return
        self._last = now
        speed = t / max(now, 1e-9)
        dv = states[""].v_hat - log.v[-1]
        figures = f"{t:.1f} of {self._end:g} s{self._left(t / self._end)}"
        self._bar.update(
            self._task,
            completed=t,
            description=self._name,
            figures=f"{figures}   {speed:.1f} × real time   "
            f"rms Δv {(dv @ dv / len(dv)) ** 0.5:.1e}",
        )
        if now > _PATIENCE:
            self._tell(figures)

    def stop(self) -> None:
        """Turns the bar back into a spinner, after a last update."""
        if self._console.is_terminal:
            self._bar.refresh()
        self._bar.reset(self._task, total=None, description=self._name, figures="")


def cost_of(scenario: Scenario, system: SecondOrderSystem) -> str:
    """The approximate cost of a run of an hour or more, or of a large record; "" for others."""
    from .loop import columns

    hours = scenario.steps * _STEP * (1 + len(scenario.rivals)) / 3600
    widths = columns(system, scenario).values()
    size = 8 * scenario.steps / scenario.record_every * sum(max(width, 1) for width in widths)
    if hours < 1 and size < _LARGE:
        return ""
    return (
        f"{scenario.steps:.1e} steps, which takes about {hours:.0f} h and {size / 1e9:.0f} GB of "
        "disk. --dt, --duration and --record-every make it less."
    )


class _Counted(Bar):
    """A bar that estimates the time left; where there is no terminal, by a line now and then."""

    def __init__(self, *columns: ProgressColumn, console: Console, quiet: bool):
        # the time left is estimated from all parts: one part may take longer than rich's 30 s
        super().__init__(
            *columns,
            console=console,
            transient=True,
            disable=quiet,
            speed_estimate_period=_ALL,
        )
        self._watch = Stopwatch()
        self._told = 0.0

    def advance(self, task_id: TaskID, advance: float = 1) -> None:
        """Counts a part."""
        super().advance(task_id, advance)
        now = self._watch.seconds
        if self.console.is_terminal or now - self._told < _PATIENCE:
            return
        self._told = now
        task = self._tasks[task_id]
        if task.total and task.completed:
            left = now * (task.total / task.completed - 1)
            said = f"{task.completed:g} of {task.total:g}, about {_in_words(left)} left"
            self.console.print(said, highlight=False, markup=False)


def _in_words(seconds: float) -> str:
    """A time in seconds or minutes, whichever is shorter to read."""
    return f"{seconds:.0f} s" if seconds < _MINUTES else f"{seconds / 60:.0f} min"


@contextmanager
def counted(quiet: bool, done: str = "{task.completed}/{task.total}") -> Iterator[Bar]:
    """Shows a transient bar of a study on the standard error; `done` is the format of its count.

    It estimates the time left. When the first kernel is compiled, a line above it says so.
    """
    bar = _Counted(
        TextColumn("{task.description:48}"),
        BarColumn(),
        TextColumn(done),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True, quiet=quiet),
        quiet=quiet,
    )
    announce = cache(lambda: bar.console.print(COMPILING, highlight=False))
    with Stopwatch.on_compiling(announce), bar:
        yield bar
