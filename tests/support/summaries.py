"""Results of runs by hand, and what summary.json says of a run."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

from nsaid_mj.lab.evaluation.curves import with_curves
from nsaid_mj.lab.evaluation.run_evaluation import evaluate
from nsaid_mj.lab.evaluation.run_result import RunResult, judged
from nsaid_mj.lab.evaluation.statistics import (
    Conditions,
    Dimensions,
    LawUsed,
    Origin,
    RunCost,
    RunEnding,
    Unobservable,
)
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.loop import Run, SimulatedRun


def summarize(run: Run, truth: Truth | None) -> dict[str, Any]:
    """The content of a run's summary.json."""
    return evaluate(run, truth).summary()


def evaluated(run: Run, truth: Truth | None) -> RunResult:
    """The result of a run with its curves."""
    return with_curves(evaluate(run, truth), run, truth)


def unknown(done: SimulatedRun) -> Run:
    """A run as a robot's log would give it: nothing of the plant is left."""
    parts: dict[str, Any] = {field.name: getattr(done, field.name) for field in fields(Run)}
    parts["looks"] = None
    return Run(**parts)


SCALE = Unobservable(
    direction="common scale of mass and drag",
    fix="one known number fixes it, and with it these 2: mass, drag",
    parameters=("mass", "drag"),
    labels=("mass", "drag"),
)


def run_result(**changes: Any) -> RunResult:
    """The result of a completed run of a vehicle with four parameters, made by hand."""
    plain = RunResult(
        truth_known=True,
        ending=RunEnding(status="completed", status_time=10.0),
        dimensions=Dimensions(
            n=1, velocity_units=("m/s",), p=4, r=1, rank_tolerance=1e-9, rank_gap=(1e-3, 1e-15)
        ),
        law=LawUsed(law="paper"),
        conditions=Conditions(sensors="ideal", mismatch=(), fault=""),
        unobservable=(SCALE,),
        cost=RunCost(
            wall_s=1.0,
            compile_s=0.0,
            sim_s=10.0,
            real_time_factor=10.0,
            identifier_us_per_step=1.0,
            plant_us_per_step=1.0,
        ),
        origin=Origin(seed=0, versions={"nsaid-mj": "0"}, scenario_hash="0"),
    )
    return judged(replace(plain, **changes))
