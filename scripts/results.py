"""The README's table of results: every scenario, seeds 0 to 2, worst of them, as Markdown.

`python scripts/results.py [NAME …]`; takes a few minutes.
"""

import dataclasses
import sys
import tempfile
from pathlib import Path

from nsaid_mj.cli import load
from nsaid_mj.experiment import run
from nsaid_mj.metrics import summarize
from nsaid_mj.resources import scenarios

SEEDS = (0, 1, 2)
WORST = ("theta_perp_ratio_initial", "theta_perp_ratio", "force_residual_ratio",
         "actuator_ratio_error", "conserved_drift", "lyapunov_violations")  # fmt: skip


def worst(name: str) -> str:
    """One row: the worst of the seeds, and the fastest run's real-time factor."""
    scenario = load(name)
    summaries = []
    for seed in SEEDS:
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
    heads = ["scenario", "n, p, r", "run", "‖θ̄_P⊥‖/‖θ̂‖ at first", "at the end", "force residual",
             "gains' shares", "conserved drift", "V rises", "real time"]  # fmt: skip
    print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads))
    for name in sys.argv[1:] or scenarios():
        print(worst(name), flush=True)


if __name__ == "__main__":
    main()
