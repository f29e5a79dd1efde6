"""Compiles the kernels that a scenario needs before its run is timed."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from .. import evaluation
from ..experiment.loop import Run, run
from ..experiment.scenario import Scenario
from ..identifiers import Status
from ..numerics.kernels import FOLDER, compile_seconds
from . import head_start

_SECONDS, _STEPS = 1.5, 50  # length of the short run, the longer of the two; a memory is in use


def warm_up(scenario: Scenario) -> float:
    """Compiles every kernel that a run of a scenario and its evaluation call, if any is missing.

    It makes a short run in a temporary folder, with random streams of its own. If a scenario of the
    same kind was warmed up before, it does nothing.

    Args:
        scenario: the scenario that is going to be run.

    Returns:
        Time spent compiling [s].

    Raises:
        NsaidError: the scenario cannot be started.
        KeyboardInterrupt: Ctrl-C ended the short run.
    """
    if is_warm(scenario):
        return 0.0
    before = compile_seconds()
    duration = min(scenario.duration, max(_SECONDS, _STEPS * scenario.dt))
    short = replace(scenario, duration=duration, held_out=min(scenario.held_out, duration))
    if head_start.pays_off(scenario):
        with head_start.second_process(short):
            _run_and_judge(head_start.without_filter(short))
    mark_warm(_run_and_judge(short))
    return compile_seconds() - before


def _run_and_judge(scenario: Scenario) -> Run:
    """Runs and evaluates a scenario in a temporary folder.

    Raises:
        KeyboardInterrupt: Ctrl-C ended the run.
    """
    with TemporaryDirectory(prefix="nsaid-mj-") as folder:
        result = run(scenario, Path(folder))
        if result.ending.status is Status.interrupted:
            raise KeyboardInterrupt
        evaluation.summarize(result, evaluation.truth_of(result))
    return result


def is_warm(scenario: Scenario) -> bool:
    """Whether the kernels for scenarios of this kind are known to be cached on disk."""
    return _mark(scenario).exists()


def mark_warm(result: Run) -> None:
    """Notes that the kernels of a run, which has been evaluated, are cached on disk."""
    if result.ending.status is Status.completed:  # else some kernels may not have been called
        with suppress(OSError):  # without the mark the next run warms up again
            _mark(result.scenario).touch()


def _mark(scenario: Scenario) -> Path:
    return FOLDER / f"warm-{kind_of(scenario)}"


def kind_of(scenario: Scenario) -> str:
    """Twelve hexadecimal digits, equal for scenarios that differ in numbers only.

    Kernels are compiled for types, so the numbers of a scenario do not affect which are needed.
    """
    found = json.dumps(_without_numbers(json.loads(scenario.to_json())), sort_keys=True)
    return hashlib.sha256(found.encode()).hexdigest()[:12]


def _without_numbers(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_numbers(item) for item in value]
    return None if isinstance(value, int | float) and not isinstance(value, bool) else value
