"""Progress of a study: the time left, on a terminal and without one."""

import io

import pytest
from rich.console import Console

from nsaid_mj.lab import progress


def test_without_a_terminal_a_line_says_how_long_a_study_still_takes(monkeypatch) -> None:
    now = iter([0.0, 60.0, 65.0, 300.0])
    monkeypatch.setattr(progress, "clock", lambda: next(now))
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
