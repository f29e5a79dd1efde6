"""How the law `memory` tracks an actuator fault during a run: gain errors over time.

`python scripts/fault.py [--scenario bluerov2] [--loss 0.4] [--actuator 3] [--time 60]
[--seconds 10] [--seeds 0,1,2]`; takes half a minute.

The common scale of θ is unobservable, so the error of a gain is relative: k̂/k over the mean of k̂/k
of the healthy gains, minus 1. The first table has the error of the faulty gain and the largest of
the healthy ones: medians of the seeds, the worst seed in brackets. The second table has, for every
seed, the largest error of the healthy gains after the fault.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import SimulatedRun, run
from nsaid_mj.experiment.scenario import Scenario
from nsaid_mj.identifiers import NullspaceAID
from nsaid_mj.parameters import Array
from nsaid_mj.plants import Loss
from nsaid_mj.plants.world.faults.kinds import gains_of

SENSORS = ("ideal", "noisy")
SINCE = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 10.0, 20.0, 30.0)
ENOUGH = 0.01


def failing(name: str, fault: Loss, seconds: float) -> Scenario:
    """A scenario with a fault that runs for another `seconds` [s] after it."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    return replace(
        scenario,
        plant=replace(scenario.plant, faults=(fault,)),
        identifier=replace(scenario.identifier, law="memory"),
        rivals={},
        duration=fault.time + seconds,
    )


def errors(done: SimulatedRun) -> tuple[Array, Array, Array]:
    """(N,) times since the fault [s], (N,) largest errors of the faulty and of the other gains."""
    plant, t = done.plant, done.record["t"]
    since, k = plant.epoch(t) > 0, plant.system.space.actuators
    weak = np.isin(k, gains_of(plant.system, plant.faults[0].actuator))
    ratio = done.record["theta_hat"][since][:, k] / plant.truth_at(t[since])[:, k]
    error = np.abs(ratio / ratio[:, ~weak].mean(axis=1, keepdims=True) - 1)
    return t[since] - t[since][0], error[:, weak].max(axis=1), error[:, ~weak].max(axis=1)


def median_and_worst(values: list[float]) -> str:
    """Median and largest value, in per cent."""
    return f"{100 * np.median(values):.2g} % ({100 * max(values):.2g} %)"


def main() -> None:
    """Runs all seeds and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="bluerov2")
    parser.add_argument("--loss", type=float, default=0.4)
    parser.add_argument("--actuator", type=int, default=3, help="1 is the first command's")
    parser.add_argument("--time", type=float, default=60.0, help="time of the fault [s]")
    parser.add_argument("--seconds", type=float, default=10.0, help="duration after the fault [s]")
    parser.add_argument("--seeds", default="0,1,2")
    chosen = parser.parse_args()
    fault = Loss(chosen.loss, actuator=chosen.actuator, time=chosen.time)
    scenario = failing(chosen.scenario, fault, chosen.seconds)
    seeds = [int(seed) for seed in chosen.seeds.split(",")]
    found: dict[str, list[tuple[Array, Array, Array]]] = {sensors: [] for sensors in SENSORS}
    for sensors in SENSORS:
        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                done = run(replace(scenario, sensors=sensors, seed=seed), Path(folder))
            print(f"{sensors}, seed {seed}: {done.ending.status.words}", flush=True)
            found[sensors].append(errors(done))
    heads = [f"{sensors}: {which}" for sensors in SENSORS for which in ("its gain", "others")]
    print("\n| since the fault | " + " | ".join(heads) + " |\n|" + "---|" * (1 + len(heads)))
    for since in (s for s in SINCE if s <= chosen.seconds):
        cells = []
        for runs in found.values():
            at = [int(np.argmin(np.abs(t - since))) for t, _, _ in runs]
            cells += [
                median_and_worst([float(part[which][k]) for part, k in zip(runs, at, strict=True)])
                for which in (1, 2)
            ]
        print(f"| {since:g} s | " + " | ".join(cells) + " |")
    print(f"\n| | others at most | all gains within {100 * ENOUGH:g} % from |\n|---|---|---|")
    for sensors, runs in found.items():
        for seed, (t, own, others) in zip(seeds, runs, strict=True):
            far = np.flatnonzero(np.maximum(own, others) > ENOUGH)
            known = t[far[-1] + 1] if far[-1] + 1 < len(t) else np.inf
            peak = int(np.argmax(others))
            print(
                f"| {sensors}, seed {seed} | {100 * others[peak]:.2g} % at {t[peak]:.1f} s "
                f"| {known:.1f} s |"
            )


if __name__ == "__main__":
    main()
