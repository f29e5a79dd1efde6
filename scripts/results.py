"""Generates the tables of docs/results.md: the worst of seeds 0 to 2 of every scenario.

    python scripts/results.py [NAME …] [--law efficient --duration 30] [--sensors noisy]
                              [--gamma simulated] [--seeds 10,11] [--median]
    python scripts/results.py [NAME …] --law memory --starts 25 --seeds 100:105 --duration 20

With `--starts`, the motion of every seed is simulated once, with a driver based on the scenario's
own prior; then identification starts from that many priors, drawn within e^{±1} on every block.
"""

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj import NullspaceAID, Scenario, Status
from nsaid_mj.lab.evaluation.run_evaluation import evaluate
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.plans.studies.montecarlo import DrawnMotion, identify, simulate
from nsaid_mj.plans.studies.study import seed_of
from nsaid_mj.robots.assets import scenarios

VEHICLES = (
    "bluerov2",
    "remus100",
    "hummingbird",
    "crazyflie",
    "f1tenth",
    "bmw320i",
    "astrobee",
    "scalar_rov",
)
WORST = (
    "theta_perp_ratio_initial",
    "theta_perp_ratio",
    "force_residual_ratio",
    "actuator_ratio_error",
    "conserved_drift",
    "lyapunov_violations",
)
HEADS = (
    "scenario",
    "n, p, r",
    "run",
    "‖θ̄_P⊥‖/‖θ̂‖ at first",
    "at the end",
    "force residual",
    "gains' shares",
    "conserved drift",
    "V rises",
    "95 % covers",
    "real time",
)
ENOUGH = 0.01  # theta_perp_ratio
STARTS = (
    "scenario",
    "starts",
    "lost",
    f"> {ENOUGH}",
    "ratio at first, median",
    "at the end, median",
    "… worst",
    "conserved drift, worst",
)
Cells = list[str | int]


def changed(name: str, chosen: argparse.Namespace) -> Scenario:
    """A scenario as the flags say."""
    scenario = load(name)
    law = scenario.identifier
    if isinstance(law, NullspaceAID):
        law = replace(law, law=chosen.law, gamma=chosen.gamma)
    duration = chosen.duration or scenario.duration
    return replace(scenario, identifier=law, duration=duration, sensors=chosen.sensors)


def worst(name: str, scenario: Scenario, seeds: range | list[int], typical: bool) -> Cells:
    """Worst or median figures of the seeds, and the fastest run's real-time factor."""
    summaries = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            result = run(replace(scenario, seed=seed), Path(folder))
            summaries.append(evaluate(result, Truth.of(result))).summary()
        print(f"  {name} seed {seed}: {result.ending.status.words}", file=sys.stderr)
    of, figures = np.median if typical else np.max, []
    for key in WORST:
        values = [s[key] for s in summaries if s[key] is not None]
        figures.append(f"{of(values):.2g}" if values else "–")
    covered = [s["confidence"]["covered"] for s in summaries if s["confidence"]]
    sizes = ", ".join(str(summaries[0][key]) for key in "npr")
    speed = max(s["real_time_factor"] for s in summaries)
    coverage = f"{np.mean(covered):.2f}" if covered else "–"
    return [f"`{name}`", sizes, f"{scenario.duration:g} s", *figures, coverage, f"{speed:.0f} ×"]


def course(scenario: Scenario) -> DrawnMotion:
    """A scenario's motion, with a driver based on its own prior."""
    with ThreadPoolExecutor(1) as pool:
        (found,) = simulate([scenario], pool)
    return found


def start(scenario: Scenario, index: int) -> Scenario:
    """The scenario with its prior drawn within e^{±1} of the truth, by start index."""
    seed = seed_of(scenario.seed, index)
    return replace(scenario, seed=seed, initial_error=1.0, gain_error=None)


def from_starts(name: str, scenario: Scenario, seeds: range | list[int], starts: int) -> Cells:
    """Figures of identification from many priors; prints the starts that end far off."""
    found: list[dict[str, Any]] = []
    for seed in seeds:
        known = course(replace(scenario, seed=seed, rivals={}))
        draws = [(k, start(known.setup.scenario, k)) for k in range(starts)]
        rows = identify(known, draws)
        found += rows
        for row in rows:
            if row["status"] != Status.completed.words or row["theta_perp_ratio"] > ENOUGH:
                print(
                    f"  {name} seed {seed} start {row['run']}: {row['status']} at "
                    f"{row['status_time']:.2f} s, ratio {row['theta_perp_ratio_initial']:.2g} -> "
                    f"{row['theta_perp_ratio']:.2g}",
                    file=sys.stderr,
                )
    first, last = (
        np.array([row[key] for row in found])
        for key in ("theta_perp_ratio_initial", "theta_perp_ratio")
    )
    lost = np.array([row["status"] != Status.completed.words for row in found])
    last[lost] = np.inf
    drifts = [row["conserved_drift"] for row in found if row["conserved_drift"] is not None]
    figures = [np.median(first), np.median(last), last.max(), *([max(drifts)] if drifts else [])]
    words = [f"{value:.2g}" for value in figures] + ([] if drifts else ["–"])
    return [f"`{name}`", len(found), int(lost.sum()), int((last > ENOUGH).sum()), *words]


def main() -> None:
    """Runs all scenarios and prints the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*")
    parser.add_argument("--gamma", choices=("scale", "simulated"), default="scale")
    parser.add_argument("--law", choices=("paper", "cone", "memory", "efficient"), default="paper")
    parser.add_argument("--sensors", choices=("ideal", "noisy"), default="ideal")
    parser.add_argument("--duration", type=float, help="of every run [s]; the scenario's own")
    parser.add_argument("--median", action="store_true", help="medians of the seeds, not the worst")
    parser.add_argument("--seeds", default="0,1,2", help="as 0,1,2 or 0:10")
    parser.add_argument("--starts", type=int, help="number for every seed")
    chosen = parser.parse_args()
    first, _, end = chosen.seeds.partition(":")
    seeds = range(int(first), int(end)) if end else [int(s) for s in chosen.seeds.split(",")]
    heads = STARTS if chosen.starts else HEADS
    print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
    for name in chosen.names or (VEHICLES if chosen.starts else scenarios()):
        scenario = changed(name, chosen)
        if chosen.starts:
            cells = from_starts(name, scenario, seeds, chosen.starts)
        else:
            cells = worst(name, scenario, seeds, chosen.median)
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)


if __name__ == "__main__":
    main()
