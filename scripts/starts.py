"""How a law converges from many priors, drawn within e^{±error} on every block of θ.

`python scripts/starts.py [NAME …] [--law efficient] [--sensors noisy] [--starts 25]
[--seeds 100,101] [--seconds 20] [--json FILE]`

For every scenario and seed the motion is simulated once, with a driver based on the scenario's own
prior; identification from every start then uses these measurements. The default is all vehicles.
"""

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path

import numpy as np

from nsaid_mj import NullspaceAID, Scenario, Status
from nsaid_mj.experiment.library import load
from nsaid_mj.studies.montecarlo import Course, identify, simulate
from nsaid_mj.studies.sweep import seed_of
from nsaid_mj.studies.sweep_results import Row

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
ENOUGH = 0.01  # theta_perp_ratio


def motion(
    name: str, seed: int, seconds: float, law: str = "memory", sensors: str = "ideal"
) -> Course:
    """Simulates a scenario's plant with a driver based on the scenario's own prior."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    scenario = replace(
        scenario,
        identifier=replace(scenario.identifier, law=law, gamma="scale"),
        rivals={},
        seed=seed,
        duration=seconds,
        sensors=sensors,
    )
    with ThreadPoolExecutor(1) as pool:
        (course,) = simulate([scenario], pool)
    return course


def start(scenario: Scenario, index: int, error: float) -> Scenario:
    """The scenario with its prior drawn within e^{±error} of the truth, by start index."""
    seed = seed_of(scenario.seed, index)
    return replace(scenario, seed=seed, initial_error=error, gain_error=None)


def study(
    name: str,
    seed: int,
    starts: int,
    seconds: float,
    error: float,
    law: str = "memory",
    sensors: str = "ideal",
) -> list[Row]:
    """All starts of one scenario and seed."""
    course = motion(name, seed, seconds, law, sensors)
    draws = [(index, start(course.setup.scenario, index, error)) for index in range(starts)]
    return [{"scenario": name, "motion": seed} | found for found in identify(course, draws)]


def near(found: Row) -> bool:
    """Whether identification from a start converged to within ENOUGH of the true set."""
    return found["status"] == Status.completed.words and found["theta_perp_ratio"] <= ENOUGH


def line(name: str, results: list[Row]) -> str:
    """One row of the table."""
    first, last = (
        np.array([found[key] for found in results])
        for key in ("theta_perp_ratio_initial", "theta_perp_ratio")
    )
    lost = [found["status"] != Status.completed.words for found in results]
    far = sum(not near(found) for found in results)
    last[lost] = np.inf
    figures = [f"{v:.2g}" for v in (np.median(first), np.median(last), max(last))]
    drifts = [found["conserved_drift"] for found in results if found["conserved_drift"] is not None]
    figures.append(f"{max(drifts):.2g}" if drifts else "–")
    return f"| {' | '.join(map(str, (f'`{name}`', len(results), sum(lost), far, *figures)))} |"


def failures(results: list[Row]) -> Iterator[str]:
    """Starts that did not converge, with the seeds that reproduce them."""
    for found in sorted(results, key=lambda found: (found["motion"], found["run"])):
        if not near(found):
            what = "{scenario} seed {motion} start {run}: {status} at {status_time:.2f} s, "
            ratios = "ratio {theta_perp_ratio_initial:.2g} -> {theta_perp_ratio:.2g}"
            yield (what + ratios).format(**found)


def main() -> None:
    """Prints the table and the failures, and writes all results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--law", choices=("memory", "efficient"), default="memory")
    parser.add_argument("--sensors", choices=("ideal", "noisy"), default="ideal")
    parser.add_argument("--starts", type=int, default=25, help="number for every seed")
    parser.add_argument("--seeds", default="100,101,102,103,104")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--error", type=float, default=1.0)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    names, results = chosen.names or VEHICLES, {}
    with ProcessPoolExecutor(2) as pool:  # the memory's steps hold the GIL
        waiting = {
            pool.submit(
                study,
                name,
                int(seed),
                chosen.starts,
                chosen.seconds,
                chosen.error,
                chosen.law,
                chosen.sensors,
            ): name
            for name in names
            for seed in chosen.seeds.split(",")
        }
        for done in as_completed(waiting):
            results.setdefault(waiting[done], []).extend(done.result())
    print(
        "| scenario | starts | lost | > 0.01 | ratio at first, median | "
        f"after {chosen.seconds:g} s, median | … worst | conserved drift, worst |"
    )
    print("|" + "---|" * 8)
    for name in names:
        print(line(name, results[name]))
    for name in names:
        for failure in failures(results[name]):
            print(failure)
    if chosen.json:
        chosen.json.write_text(json.dumps([found for name in names for found in results[name]]))


if __name__ == "__main__":
    main()
