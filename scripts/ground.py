"""A quadruped on a stand and on the ground: how many scales its gains have, and how they are found.

    python -m scripts.ground [--seeds 10:13] [--seconds 60]

The scenarios `quadruped_stand` and `quadruped`, law `memory`, noisy sensors. Prints the table of
docs/ground.md, each figure the worst of the seeds, and draws docs/ground.png for the first seed.
Then the law `efficient` on the ground, from priors that are drawn: what its 95 % intervals cover,
and its CPU time over that of MuJoCo's steps along the same motion, in alternating blocks.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from nsaid_mj.core import Identifier, Log, State
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab.evaluation.confidence import known
from nsaid_mj.lab.evaluation.curves import gains_of_limbs
from nsaid_mj.lab.evaluation.truth import actuator_ratio_error
from nsaid_mj.lab.library import load
from nsaid_mj.lab.setup import Setup
from scripts.machine import machine

_BLOCK = 250  # steps of either side between two measurements of the other
PLACES = {"quadruped_stand": "on a stand", "quadruped": "on the ground"}


class Followed(NamedTuple):
    """A run of one scenario."""

    setup: Setup
    t: np.ndarray  # (N,) times [s]
    theta_hat: np.ndarray  # (N, p) estimates
    falls: bool

    @property
    def limbs(self) -> dict[str, np.ndarray]:
        """(N,) scale of each limb: mean of its gains' ratios to the truth, over that of all."""
        system = self.setup.system
        k = system.space.actuators
        ratio = self.theta_hat[:, k] / self.setup.plant.truth[k]
        mean = ratio.mean(axis=1)
        return {name: ratio[:, k].mean(axis=1) / mean for name, k in gains_of_limbs(system).items()}

    @property
    def apart(self) -> float:
        """Largest deviation of a limb's scale from the mean of all, at the end."""
        return max(abs(float(scale[-1]) - 1) for scale in self.limbs.values())

    @property
    def within(self) -> float:
        """Largest error of a gain's ratio to the others of its limb, at the end."""
        system = self.setup.system
        k = system.space.actuators
        ratio = self.theta_hat[-1, k] / self.setup.plant.truth[k]
        limbs = gains_of_limbs(system).values()
        return max(float(np.abs(ratio[own] / ratio[own].mean() - 1).max()) for own in limbs)


def followed(name: str, seed: int, seconds: float) -> Followed:
    """Simulates a scenario and identifies it."""
    scenario = replace(load(name), seed=seed, duration=seconds, sensors="noisy")
    setup = Setup.of(scenario)
    identifier = setup.identifiers()[""]
    with setup.plant.running():
        log = setup.simulate()
    estimates = identifier.follow(identifier.init(log.at(0)), log)[1]
    falls = bool(setup.system.group) and log.q[:, 2].min() < 0.5 * log.q[0, 2]
    rows = np.linspace(0, len(log.t) - 1, 600).astype(int)
    return Followed(setup, log.t[rows], np.array(estimates.theta_hat[rows]), falls)


def row_of(name: str, runs: Sequence[Followed]) -> list[str]:
    """A row of the table."""
    setup = runs[0].setup
    system = setup.system
    found = Nullspace.structural(system, setup.plant.truth, np.random.default_rng(0))
    words = [each.words for each in found.directions(system.space)]
    scales = sum(each.startswith("common scale") for each in words)
    error = max(
        actuator_ratio_error(system, run.theta_hat[-1], run.setup.plant.truth) for run in runs
    )
    return [
        PLACES[name],
        f"{system.p - found.r} of {system.p}",
        f"**{scales}**",
        f"{100 * max(run.within for run in runs):.2g} %",
        f"{100 * max(run.apart for run in runs):.2g} %",
        f"{100 * error:.2g} %",
    ]


def seconds_of(action: Callable[[], object]) -> float:
    """CPU time of an action, of all threads [s]."""
    begin = time.process_time()
    action()
    return time.process_time() - begin


def cost(setup: Setup, log: Log, state: State, identifier: Identifier) -> float:
    """Median CPU time of the identifier's steps over that of MuJoCo's, in blocks of a log."""
    plant = setup.plant
    ratios = []
    with plant.running():
        plant.begin(setup.driver())
        for first in range(0, len(log.t) - _BLOCK, _BLOCK):
            block = log.part(first, first + _BLOCK + 1)
            theirs = seconds_of(lambda block=block: [plant.step(u) for u in block.u[:-1]])
            begin = time.process_time()
            state, _ = identifier.follow(state, block)
            ratios.append((time.process_time() - begin) / theirs)
    return float(np.median(ratios))


def filtered(seed: int, seconds: float) -> list[str]:
    """A row of the table of the law `efficient`."""
    scenario = load("quadruped")
    law = replace(scenario.identifier, law="efficient")
    scenario = replace(scenario, identifier=law, seed=seed, prior="drawn", sensors="noisy")
    setup = Setup.of(replace(scenario, duration=seconds))
    with setup.plant.running():
        log = setup.simulate()
    identifier = setup.identifiers()[""]
    begin = identifier.init(log.at(0))
    state, _ = identifier.follow(begin, log)
    system = setup.system
    scale = system.space.scale
    theta = state.theta_hat
    truth = setup.plant.truth
    nullspace = Nullspace.structural(system, theta, np.random.default_rng(0))
    found = known(identifier.confidence(state), theta, nullspace, system.space)
    unit = truth / scale / np.linalg.norm(truth / scale)
    off = found.directions @ (theta / scale / np.linalg.norm(theta / scale) - unit)
    return [
        str(seed),
        f"{100 * actuator_ratio_error(system, theta, truth):.2g} %",
        f"{100 * np.linalg.norm(off):.2g} %",
        f"{100 * found.covered(theta / scale, truth / scale):.0f} %",
        f"{cost(setup, log.first(10 * _BLOCK + 1), begin, identifier):.1f}",
    ]


def draw(runs: dict[str, Followed], path: Path) -> None:
    """Draws every limb's scale over time, on the stand and on the ground."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.6), sharey=True, layout="constrained")
    for axis, (name, run) in zip(axes, runs.items(), strict=True):
        for limb, scale in run.limbs.items():
            axis.plot(run.t, scale, label=limb.removesuffix("_hip"))
        axis.set_title(PLACES[name])
        axis.set_xlabel("time [s]")
        axis.axhline(1.0, color="0.6", linewidth=0.8, zorder=0)
    axes[0].set_ylabel("scale of each leg's gains, over the mean")
    axes[1].legend(title="leg")
    figure.savefig(path, dpi=110)


def main() -> None:
    """Prints the table and draws the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="10:13")
    parser.add_argument("--seconds", type=float, default=60.0)
    arguments = parser.parse_args()
    first, last = map(int, arguments.seeds.split(":"))
    print(machine())
    heads = "| observable directions | scales | gains within a leg | between legs | all gains"
    print(f"\n| {heads} |\n|" + "---|" * 6)
    drawn = {}
    for name in PLACES:
        runs = [followed(name, seed, arguments.seconds) for seed in range(first, last)]
        assert not any(run.falls for run in runs), "the robot fell"
        drawn[name] = runs[0]
        print(f"| {' | '.join(row_of(name, runs))} |", flush=True)
    print(
        "\n| seed | gains | distance from the true set | covered | cost / MuJoCo |\n|" + "---|" * 5
    )
    for seed in range(first, last):
        print(f"| {' | '.join(filtered(seed, arguments.seconds))} |", flush=True)
    draw(drawn, Path(__file__).parents[1] / "docs" / "ground.png")


if __name__ == "__main__":
    main()
