"""Generates the tables of docs/results.md: the worst of seeds 0 to 2 of every scenario.

`python scripts/results.py [--law efficient --duration 30] [--sensors noisy] [--gamma simulated]
[--seeds 10,11] [NAME …]`; takes some minutes.
"""

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from nsaid_mj.evaluation import summarize, truth_of
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import run
from nsaid_mj.identifiers import NullspaceAID
from nsaid_mj.resources import scenarios

WORST = (
    "theta_perp_ratio_initial",
    "theta_perp_ratio",
    "force_residual_ratio",
    "actuator_ratio_error",
    "conserved_drift",
    "lyapunov_violations",
)


def worst(name: str, changes: dict[str, Any], seeds: tuple[int, ...], typical: bool) -> str:
    """One row: worst or median figures of the seeds, and the fastest run's real-time factor."""
    scenario = load(name)
    law = scenario.identifier
    if isinstance(law, NullspaceAID):
        own = {key: changes[key] for key in ("gamma", "law")}
        law = dataclasses.replace(law, **own)
    duration = changes["duration"] or scenario.duration
    scenario = dataclasses.replace(
        scenario, identifier=law, duration=duration, sensors=changes["sensors"]
    )
    summaries = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            result = run(dataclasses.replace(scenario, seed=seed), Path(folder))
            summaries.append(summarize(result, truth_of(result)))
        print(f"  {name} seed {seed}: {result.ending.status.words}", file=sys.stderr)
    of = np.median if typical else np.max
    figures = []
    for key in WORST:
        values = [s[key] for s in summaries if s[key] is not None]
        figures.append(f"{of(values):.2g}" if values else "–")
    covered = [s["confidence"]["covered"] for s in summaries if s["confidence"]]
    first = summaries[0]
    speed = max(s["real_time_factor"] for s in summaries)
    cells = [f"`{name}`", f"{first['n']}, {first['p']}, {first['r']}", f"{scenario.duration:g} s"]
    coverage = [f"{np.mean(covered):.2f}"] if covered else ["–"]
    return "| " + " | ".join([*cells, *figures, *coverage, f"{speed:.0f} ×"]) + " |"


def main() -> None:
    """Runs all scenarios and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--gamma", choices=("scale", "simulated"), default="scale")
    parser.add_argument("--law", choices=("paper", "cone", "memory", "efficient"), default="paper")
    parser.add_argument("--sensors", choices=("ideal", "noisy"), default="ideal")
    parser.add_argument(
        "--duration", type=float, help="of every run [s] (default: the scenario's own)"
    )
    parser.add_argument(
        "--median", action="store_true", help="print medians of the seeds instead of the worst"
    )
    parser.add_argument("--seeds", default="0,1,2", help="as 0,1,2 or 0:10")
    chosen = parser.parse_args()
    first, _, end = chosen.seeds.partition(":")
    seeds = (
        tuple(range(int(first), int(end)))
        if end
        else tuple(int(seed) for seed in chosen.seeds.split(","))
    )
    heads = [
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
    ]
    print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
    for name in chosen.names or scenarios():
        print(worst(name, vars(chosen), seeds, chosen.median), flush=True)


if __name__ == "__main__":
    main()
