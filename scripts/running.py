"""Whether intervals hold while a motion goes on: those of the law alone, and those stated live.

    python -m scripts.running --seed S [--runs 60]

Robots, motions, sensors, priors and unmodelled effects are those of `scripts/court.py`, drawn from
the seed; runs with faults are left out. Every half second the gains, relative to the mean of all,
are compared with the truth: by the covariance of `efficient` alone, where it does not call the
motion contradicted, and by `RunningMisfit`. The figures of docs/live.md are from here.
"""

import argparse
from collections import defaultdict

import numpy as np

from nsaid_mj.core.laws.base import Confidence
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.evaluation.confidence import INTERVAL
from nsaid_mj.lab.evaluation.running import RunningMisfit
from nsaid_mj.watch import Misfit
from scripts.machine import machine
from tests.court.cases import drawn
from tests.court.simulation import NotRun, Simulated, simulated

_EVERY = 0.5  # time between two statements [s]


def misses(found: Simulated) -> tuple[Array, Array, str]:
    """(k,) largest errors of a gain over its half-width, by the law alone and judged.

    They are NaN where no interval is stated. Also the last level of the misfit.
    """
    setup, log = found.setup, found.log
    identifier, space = setup.identifiers()[""], setup.system.space
    misfit = RunningMisfit(setup.scenario, identifier, setup.prior)
    state, alone, judged = identifier.init(log.at(0)), [], []
    truth, step = setup.plant.truth[space.actuators], max(1, round(_EVERY / setup.scenario.dt))
    misfit.see(log.first(1), state)
    for k in range(0, len(log.t) - 1, step):
        state, made = identifier.follow(state, log.part(k, k + step + 1))
        misfit.see(log.part(k + 1, k + len(made.pivot)), state)
        ratio = state.theta_hat[space.actuators] / truth
        error = np.abs(ratio / ratio.mean() - 1)
        own = None
        if Misfit.during(state) != "contradicts":
            own = identifier.confidence(state)
        own = Confidence.of_gains(own, state.theta_hat, space)
        for rows, deviation in ((alone, own), (judged, misfit.deviations(state))):
            known = np.isfinite(deviation).all()
            rows.append(np.max(error / (INTERVAL * deviation)) if known else np.nan)
    misfit.stop()
    return np.array(alone), np.array(judged), misfit.level(state)


def main() -> None:
    """Prints a line for each run, and the shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--runs", type=int, default=60)
    given, rows = parser.parse_args(), defaultdict(list)
    print(", ".join(f"{key} {value}" for key, value in machine().items()), flush=True)
    for number in range(given.runs):
        case = drawn(given.seed, number, ["efficient"])
        try:
            found = simulated(case)
        except NotRun:
            continue
        if found.setup.plant.faults or len(found.setup.system.space.actuators) < 2:
            continue
        *both, level = misses(found)
        rows["exact" if case.effect == "none" else "with an effect"].append(both)
        worst = [f"{np.nanmax(one, initial=0):.1f}" for one in both]
        print(f"{case.words}: {level}, worst {worst[0]} alone, {worst[1]} judged", flush=True)
    for name, runs in rows.items():
        for words, part in zip(("alone", "judged"), zip(*runs, strict=True), strict=True):
            every = np.concatenate(part)
            stated = every[np.isfinite(every)]
            print(
                f"{name}, {words}: {len(runs)} runs, intervals at {len(stated)} of {len(every)} "
                f"times; a gain is outside at {np.mean(stated > 1):.1%} of these, by up to "
                f"{stated.max():.1f} half-widths, by more than 2 at {np.mean(stated > 2):.1%}"
            )


if __name__ == "__main__":
    main()
