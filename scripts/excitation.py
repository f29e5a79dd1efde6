"""Designed against random excitation: the tables and the picture of docs/excitation.md.

    python scripts/excitation.py measure FILE.json [SYSTEM …] [--effort 1] [--baselines]
    python scripts/excitation.py table FILE.json
    python scripts/excitation.py picture FILE.json PICTURE.png

`measure` designs an excitation for every system from its published values alone and then runs the
law `efficient` for 20 s with noisy sensors, with the scenario's own random excitation and with the
designed ones. Every seed is another plant, another prior and other noise.
"""

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg

from nsaid_mj.base.errors import NsaidError
from nsaid_mj.base.stopwatch import Stopwatch
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.lab.evaluation.truth import Truth, actuator_ratio_error
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.scenario import Scenario
from nsaid_mj.plans.excite.designing import Design, design
from nsaid_mj.plans.excite.experiment import Experiment
from nsaid_mj.plans.excite.information import ranks

ARMS, VEHICLES = ("ur5", "panda", "kinova"), ("bluerov2", "crazyflie", "remus100")
SEEDS = range(200, 210)  # none was used while the design was developed
DURATION = 20.0
SAMPLED = 1000  # errors drawn from each predicted covariance
LOOKS = {
    "random": ("random", "#8a97a5", "o"),
    "condition": ("condition number", "#d98b2b", "v"),
    "d-optimal": ("D-optimal", "#7b5ea7", "s"),
    "bound": ("designed (bound)", "#0b6e99", "o"),
}


def experiment_of(name: str) -> Scenario:
    """A scenario for 20 s with noisy sensors and the law `efficient`."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    return replace(
        scenario,
        identifier=replace(scenario.identifier, law="efficient"),
        sensors="noisy",
        duration=DURATION,
        pe_window=min(scenario.pe_window, DURATION),
        record_every=1,
    )


def error_of(scenario: Scenario, folder: Path) -> float:
    """The largest error of the ratios of gains at the end of a run; inf if it fails."""
    try:
        found = run(scenario, folder, force=True)
    except NsaidError:
        return float("inf")
    theta, truth = found.record["theta_hat"][-1], Truth.of(found).theta
    if found.ending.time < 0.99 * scenario.duration or not np.isfinite(theta).all():
        return float("inf")
    return actuator_ratio_error(found.system, theta, truth)


def measured(scenario: Scenario) -> list[float]:
    """Errors of all seeds."""
    errors = []
    for seed in SEEDS:
        with tempfile.TemporaryDirectory() as folder:
            errors.append(error_of(replace(scenario, seed=seed), Path(folder) / "run"))
    return errors


def largest(found: Design) -> float:
    """Predicted median of the largest error of all requested numbers."""
    rng, errors = np.random.default_rng(0), []
    for P, theta in zip(found.covariances, found.experiment.draws, strict=True):
        rows = found.asked.rows(theta)
        values, vectors = scipy.linalg.eigh(rows @ P @ rows.T)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn = rng.standard_normal((SAMPLED, len(values))) @ root.T
        errors.append(np.abs(drawn).max(axis=1))
    return float(np.median(errors))


def designed(scenario: Scenario, criterion: str, effort: float) -> dict[str, Any]:
    """A design, the wall and processor time it took [s] without compilation, and its errors."""
    experiment = Experiment.of(scenario)
    watch = Stopwatch()
    wall, work = time.perf_counter(), time.process_time()
    found = design(experiment, criterion=criterion, effort=effort)
    wall, work = time.perf_counter() - wall, time.process_time() - work
    compiled = watch.compiling
    row: dict[str, Any] = {"predicted": largest(found), "wall_s": wall - compiled}
    row |= {"work_s": max(0.0, work - compiled), "candidates": found.evaluations}
    if criterion == "bound":
        counted = ranks(experiment, found.limits)
        row["ranks"] = [counted.needed, [list(pair) for pair in counted.measured]]
    errors = measured(replace(scenario, excitation=found.driver))
    return row | {"uses": found.uses, "errors": errors}


def measure(path: Path, names: list[str], effort: float, baselines: bool) -> None:
    """Designs for systems and measures, adding each result to a file as soon as it is there."""
    rows: dict[str, Any] = json.loads(path.read_text()) if path.is_file() else {}
    for name in names:
        scenario, row = experiment_of(name), rows.setdefault(name, {})
        if "random" not in row:
            row["random"] = {"errors": measured(scenario)}
        print(name, "random", np.median(row["random"]["errors"]), flush=True)
        for criterion in ("bound", *(("condition", "d-optimal") if baselines else ())):
            if criterion in row:
                continue
            try:
                row[criterion] = designed(scenario, criterion, effort)
            except NsaidError as error:
                print(f"{name}, {criterion}: {error}", flush=True)
                continue
            path.write_text(json.dumps(rows, indent=1))
            print(name, criterion, json.dumps(row[criterion]), flush=True)


def table(path: Path) -> None:
    """Prints the tables of docs/excitation.md."""
    rows = json.loads(path.read_text())
    print("| system | random | designed | ratio | predicted | measured / predicted | design |")
    print("|---|---|---|---|---|---|---|")
    for name, row in rows.items():
        own, random = (np.median(row[kind]["errors"]) for kind in ("bound", "random"))
        print(
            f"| `{name}` | {random:.2g} | {own:.2g} | {own / random:.2f} "
            f"| {row['bound']['predicted']:.2g} | {own / row['bound']['predicted']:.2f} "
            f"| {row['bound']['work_s']:.0f} s |"
        )
    print("\n| system | random | condition | d-optimal | bound |\n|---|---|---|---|---|")
    for name, row in rows.items():
        if "condition" in row or "d-optimal" in row:
            cells = [f"{np.median(row[k]['errors']):.2g}" if k in row else "–" for k in LOOKS]
            print(f"| `{name}` | {' | '.join(cells)} |")
    print("\n| system | p − r | rank by number of harmonics or tones |\n|---|---|---|")
    for name, row in rows.items():
        needed, found = row["bound"]["ranks"]
        print(f"| `{name}` | {needed} | {', '.join(f'{h}: {rank}' for h, rank in found)} |")


def picture(path: Path, target: Path) -> None:
    """Draws the errors of all seeds, and the predicted ones."""
    import matplotlib.pyplot as plt

    rows = json.loads(path.read_text())
    figure, axes = plt.subplots(figsize=(8, 4.2), layout="constrained")
    kinds = {kind: look for kind, look in LOOKS.items() if any(kind in r for r in rows.values())}
    for place, row in enumerate(rows.values()):
        for k, (kind, (_, colour, mark)) in enumerate(LOOKS.items()):
            if kind in row:
                x = place + 0.18 * (k - 1.5)
                errors = np.array(row[kind]["errors"])
                axes.plot([x] * len(errors), errors, mark, ms=3.5, color=colour, alpha=0.5, mew=0)
                axes.plot([x - 0.07, x + 0.07], [np.median(errors)] * 2, color=colour, lw=2.5)
        x = place + 0.27
        axes.plot([x - 0.1, x + 0.1], [row["bound"]["predicted"]] * 2, "k", lw=1.2, ls="--")
    for label, colour, mark in kinds.values():
        axes.plot([], [], mark, color=colour, label=label)
    axes.plot([], [], "k--", lw=1.2, label="predicted before the run")
    axes.set_yscale("log")
    axes.set_xticks(range(len(rows)), list(rows))
    axes.set_ylabel("largest relative error\nof the ratios of gains")
    axes.grid(axis="y", alpha=0.3)
    axes.set_title("After 20 s with noisy sensors; each mark is another robot", fontsize=10)
    axes.legend(fontsize=8, frameon=False, ncols=2)
    figure.savefig(target, dpi=130)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("word", choices=("measure", "table", "picture"))
    parser.add_argument("file", type=Path)
    parser.add_argument("rest", nargs="*", help="systems, or the picture's path")
    parser.add_argument("--effort", type=float, default=1.0)
    parser.add_argument("--baselines", action="store_true")
    given = parser.parse_args()
    if given.word == "measure":
        names = given.rest or [*ARMS, *VEHICLES]
        measure(given.file, names, given.effort, given.baselines)
    elif given.word == "table":
        table(given.file)
    else:
        picture(given.file, Path(given.rest[0]))
