"""Where the law `memory` ends under sensors that are many times noisier than the default.

`python scripts/heavy_noise.py [NAME …] [--factors 3,10,36] [--seeds 400,401] [--seconds 20]`
prints the distance to the true set at the end over that at the start: above 1 the law has made the
prior worse. About 3 s for each run.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from nsaid_mj import NullspaceAID, evaluation
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import run

VEHICLES = ("bluerov2", "remus100", "crazyflie", "f1tenth", "astrobee", "hummingbird")


def ratio(name: str, factor: float, seed: int, seconds: float) -> float:
    """Distance at the end over that at the start, with noise of `factor` times the default."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    noise = replace(
        scenario.noise,
        position=factor * scenario.noise.position,
        velocity=factor * scenario.noise.velocity,
    )
    scenario = replace(
        scenario,
        identifier=replace(scenario.identifier, law="memory", gamma="scale"),
        rivals={},
        sensors="noisy",
        noise=noise,
        seed=seed,
        duration=seconds,
        held_out=0.5,
    )
    with tempfile.TemporaryDirectory() as folder:
        done = run(scenario, Path(folder))
        record = done.record
        distance = evaluation.truth_of(done).distance(record["t"], record["theta_hat"])
    return float(distance[-1] / distance[0])


def main() -> None:
    """Prints a table in Markdown, a row for every scenario and factor."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=VEHICLES)
    parser.add_argument("--factors", default="3,10,36")
    parser.add_argument("--seeds", default="400,401")
    parser.add_argument("--seconds", type=float, default=20.0)
    chosen = parser.parse_args()
    seeds = [int(seed) for seed in chosen.seeds.split(",")]
    print("| scenario | noise × |", *(f"seed {seed} |" for seed in seeds))
    print("|---" * (2 + len(seeds)) + "|")
    for name in chosen.names:
        for factor in map(float, chosen.factors.split(",")):
            found = [ratio(name, factor, seed, chosen.seconds) for seed in seeds]
            print(f"| {name} | {factor:g} |", *(f"{x:.2g} |" for x in found), flush=True)


if __name__ == "__main__":
    main()
