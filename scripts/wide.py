"""Cost of many identifiers along one motion: rows for `make bench`.

`python scripts/wide.py [xarm7 ur5 bluerov2] [--runs 256] [--jobs 2] [--steps 1000]`
"""

import argparse
import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, Literal, get_args

import numpy as np

from nsaid_mj import ArmPlant, NullspaceAID, Scenario
from nsaid_mj.experiment.library import load
from nsaid_mj.studies.montecarlo import follow, grouped, simulate
from nsaid_mj.studies.sweep import seed_of

Law = Literal["paper", "cone"]
REPEATS = 5


def scenario_of(name: str, law: Law) -> Scenario:
    """An included scenario with the compiled backend and priors within 10 % of the truth."""
    scenario = load(name)
    plant = scenario.plant
    if name == "xarm7":  # without rotors: 91 parameters
        plant = ArmPlant("xarm7", armature=0.0, damping=0.003, friction=0.003, friction_speed=0.3)
    if isinstance(plant, ArmPlant):
        plant = replace(plant, backend="compiled")
    assert isinstance(scenario.identifier, NullspaceAID)
    identifier = replace(scenario.identifier, law=law)
    return replace(scenario, plant=plant, identifier=identifier, initial_error=0.1, rivals={})


def cost(name: str, law: Law, runs: int = 256, jobs: int = 2, steps: int = 1000) -> dict[str, Any]:
    """A row with medians of wall time and processor time [µs] per run and time step.

    Simulation is not timed; drawing priors and building identifiers is. Nothing is evaluated.
    """
    scenario = scenario_of(name, law)
    scenario = replace(scenario, duration=steps * scenario.dt)
    draws = [replace(scenario, seed=seed_of(scenario.seed, k)) for k in range(runs)]
    times = []
    with ThreadPoolExecutor(jobs) as pool:
        (course,) = simulate([scenario], pool)
        follow(course, grouped(draws, jobs)[0])  # compiles
        for _ in range(REPEATS):
            begin = time.perf_counter(), time.process_time()
            waiting = [pool.submit(follow, course, group) for group in grouped(draws, jobs)]
            ends = [run.following.ended for done in waiting for run in done.result()]
            assert not any(ends), "a run ended early, which would cost less"
            times.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    wall, processor = (1e6 * np.array(times) / (runs * steps)).T
    low, median, high = np.percentile(wall, [25, 50, 75])
    return {
        "what": f"{runs} runs on {jobs} threads: {name}, {course.setup.system.p} parameters, {law}",
        "us_per_run_and_step": float(median),
        "quartiles": [float(low), float(high)],
        "processor_us": float(np.median(processor)),
    }


def main() -> None:
    """Prints a row for every scenario and law, as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    for flag, default in (("--runs", 256), ("--jobs", 2), ("--steps", 1000)):
        parser.add_argument(flag, type=int, default=default)
    chosen = parser.parse_args()
    for name in chosen.names or ("xarm7", "ur5", "bluerov2"):
        for law in get_args(Law):
            print(json.dumps(cost(name, law, chosen.runs, chosen.jobs, chosen.steps)), flush=True)


if __name__ == "__main__":
    main()
