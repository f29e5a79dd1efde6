"""The README's table of results: every scenario, seeds 0 to 2, worst of them, as Markdown.

`python scripts/results.py [--gamma simulated] [--seeds 10,11] [NAME …]`; takes some minutes.
"""

import argparse
import dataclasses
import sys
import tempfile
from pathlib import Path

from nsaid_mj.cli import load
from nsaid_mj.experiment import run
from nsaid_mj.identifiers import NullspaceAID
from nsaid_mj.metrics import summarize
from nsaid_mj.resources import scenarios

WORST = ("theta_perp_ratio_initial", "theta_perp_ratio", "force_residual_ratio",
         "actuator_ratio_error", "conserved_drift", "lyapunov_violations")  # fmt: skip


def worst(name: str, gamma: str, seeds: tuple[int, ...]) -> str:
    """One row: the worst of the seeds, and the fastest run's real-time factor."""
    scenario = load(name)
    law = scenario.identifier
    if isinstance(law, NullspaceAID):
        law = dataclasses.replace(law, gamma=gamma)
    scenario = dataclasses.replace(scenario, identifier=law)
    summaries = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            result = run(dataclasses.replace(scenario, seed=seed), Path(folder))
            summaries.append(summarize(result))
        print(f"  {name} seed {seed}: {result.ending.status.words}", file=sys.stderr)
    figures = [f"{max(s[key] for s in summaries):.2g}" for key in WORST]
    first = summaries[0]
    speed = max(s["real_time_factor"] for s in summaries)
    cells = [f"`{name}`", f"{first['n']}, {first['p']}, {first['r']}", f"{scenario.duration:g} s"]
    return "| " + " | ".join([*cells, *figures, f"{speed:.0f} ×"]) + " |"


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--gamma", choices=("scale", "simulated"), default="scale")
    parser.add_argument("--seeds", default="0,1,2")
    chosen = parser.parse_args()
    seeds = tuple(int(seed) for seed in chosen.seeds.split(","))
    heads = ["scenario", "n, p, r", "run", "‖θ̄_P⊥‖/‖θ̂‖ at first", "at the end", "force residual",
             "gains' shares", "conserved drift", "V rises", "real time"]  # fmt: skip
    print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
    for name in chosen.names or scenarios():
        print(worst(name, chosen.gamma, seeds), flush=True)


if __name__ == "__main__":
    main()
