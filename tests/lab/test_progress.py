"""Progress of a study: the time left, on a terminal and without one."""

import io
import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from nsaid_mj.lab import progress
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run


class Watch:
    """A stopwatch whose clock shows the next of given times at every look."""

    def __init__(self, times: Iterator[float]):
        self._times = times
        self._begin = next(times)

    @property
    def seconds(self) -> float:
        return next(self._times) - self._begin


def test_without_a_terminal_a_line_says_how_long_a_study_still_takes(monkeypatch) -> None:
    now = iter([0.0, 60.0, 65.0, 300.0])
    monkeypatch.setattr(progress, "Stopwatch", lambda: Watch(now))
    stream = io.StringIO()
    bar = progress._Counted(console=Console(file=stream), quiet=False)
    task = bar.add_task("", total=10)
    for _ in range(3):
        bar.advance(task)
    assert stream.getvalue().splitlines() == [
        "1 of 10, about 9 min left",
        "3 of 10, about 12 min left",
    ]


@pytest.mark.parametrize("seconds", [5.0, 400.0])
def test_parts_of_minutes_have_an_estimate_too(seconds: float) -> None:
    """Rich forgets what is older than half a minute."""
    time = [0.0]
    console = Console(file=io.StringIO(), force_terminal=True, get_time=lambda: time[0])
    bar = progress._Counted(console=console, quiet=False)
    task = bar.add_task("", total=4)
    for _ in range(3):
        time[0] += seconds
        bar.advance(task)
    left = bar.tasks[0].time_remaining
    assert left is not None and left == pytest.approx(seconds, rel=0.01)


def test_a_stage_tells_the_time_left_without_a_terminal_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = io.StringIO()
    now = iter([0.0, 100.0, 150.0])  # made; a share of 0 begins anew; a quarter later
    monkeypatch.setattr(progress, "Console", lambda **_: Console(file=stream))
    monkeypatch.setattr(progress, "Stopwatch", lambda: Watch(now))
    told = progress.Progress("ur5")
    told.stage("searching", 0.0)
    told.stage("searching", 0.25)
    assert stream.getvalue() == "ur5: searching, 25 %, about 2 min left\n"


def test_a_run_tells_the_time_left_without_a_terminal_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line every ten seconds, here of a clock that goes by four seconds a look."""
    stream = io.StringIO()
    now = itertools.count(0.0, 4.0)
    monkeypatch.setattr(progress, "Console", lambda **_: Console(file=stream))
    monkeypatch.setattr(progress, "Stopwatch", lambda: Watch(now))
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    run(replace(load("scalar_rov"), duration=20.0), tmp_path, progress.Progress("rov"))
    lines = stream.getvalue().splitlines()
    assert lines
    for line in lines:
        assert re.fullmatch(r"rov: [\d.]+ of 20 s, about \d+ (s|min) left", line)
