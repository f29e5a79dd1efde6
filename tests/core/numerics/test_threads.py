"""A call in a second thread: its result, its errors, its time; laws that use it; forks."""

import multiprocessing
import os
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.base import Stopwatch
from nsaid_mj.core.laws.base import Estimates
from nsaid_mj.core.numerics import threads
from nsaid_mj.core.numerics.threads import beside
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.faults.text import parse_faults
from nsaid_mj.lab.setup import Setup

LONG = threads._LONG


def test_only_a_long_log_takes_a_second_thread() -> None:
    own = threading.get_ident()
    assert beside(LONG - 1, threading.get_ident)() == own
    assert beside(LONG, threading.get_ident)() != own


def test_an_error_is_raised_where_the_result_is_used_and_no_thread_is_lost() -> None:
    waiting = [beside(LONG, int, "none") for _ in range(100)]
    for result in waiting[:50]:
        with pytest.raises(ValueError, match="none"):
            result()
    assert beside(LONG, int, "1")() == 1
    assert sum(thread.name.startswith("beside") for thread in threading.enumerate()) <= 40


def test_the_clock_stops_while_it_waits_for_a_thread_that_compiles() -> None:
    def compiles() -> None:
        time.sleep(0.2)
        Stopwatch.pause(0.15)

    watch = Stopwatch()
    beside(LONG, compiles)()
    assert 0.05 <= watch.seconds < 0.15


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_process_that_forks_later_has_threads_of_its_own() -> None:
    def waits() -> None:
        beside(LONG, int)()

    waits()
    child = multiprocessing.get_context("fork").Process(target=waits)
    child.start()
    child.join(30)
    assert child.exitcode == 0


@pytest.mark.parametrize(
    ("name", "law", "faults"),
    [
        ("ur5", "memory", ""),
        ("ur5", "efficient", ""),
        ("bluerov2", "efficient", "reversed 2 at 6 s"),
    ],
)
def test_a_second_thread_changes_no_bit_of_a_law(name, law, faults, monkeypatch) -> None:
    """Of the filter also where it starts again, finds a fault, and its memory pauses."""
    scenario = load(name)
    plant = replace(scenario.plant, faults=parse_faults(faults))
    own = replace(scenario.identifier, law=law)
    common = {"rivals": {}, "sensors": "noisy", "duration": 9.0, "seed": 36}
    setup = Setup.of(replace(scenario, plant=plant, identifier=own, **common))
    with setup.plant.running():
        log = setup.simulate()
    identifier = setup.identifiers()[""]

    def followed() -> Estimates:
        return identifier.follow(identifier.init(log.at(0)), log)[1]

    with monkeypatch.context() as patch:
        patch.setattr(threads, "_LONG", np.inf)
        expected = followed()
    for one, other in zip(followed(), expected, strict=True):
        np.testing.assert_array_equal(one, other)
