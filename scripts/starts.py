"""How the law `memory` fares from many starts, drawn at e^{±error} on every block of the cone.

`python scripts/starts.py [NAME …] [--starts 25] [--seeds 100,101] [--seconds 20] [--json FILE]`

For every scenario and seed the motion is simulated once, its driver built with the scenario's own
prior; every start then identifies the same measurements. Vehicles by default.
"""

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from nsaid_mj.cli import load
from nsaid_mj.cone import cone_of, drawn_inside, inside
from nsaid_mj.experiment import Cost, Seeds, prepare, trajectory
from nsaid_mj.identifiers import IdentifierConfig, NullspaceAID, Status
from nsaid_mj.nullspace import Nullspace, structural
from nsaid_mj.parameters import Array
from nsaid_mj.plants import Plant
from nsaid_mj.system import Measurement

VEHICLES = ("bluerov2", "remus100", "hummingbird", "crazyflie", "f1tenth", "bmw320i", "astrobee",
            "scalar_rov")  # fmt: skip
ENOUGH = 0.01  # theta_perp_ratio


@dataclass(frozen=True)
class Start:
    """How one start ended.

    Attributes:
        scenario: its name.
        seed: of the scenario.
        index: of the start: it is drawn by the seeds (seed, index).
        status: `completed`, or the law's own reason to end.
        time: when it ended [s].
        outside: whether an estimate was outside the cone at any step.
        not_finite: whether an estimate was not finite at any step.
        drift: of the conserved quantity, relative, the largest of all seconds.
        ratio_initial: theta_perp_ratio of the start.
        ratio: theta_perp_ratio at the end; None where it ended early.
    """

    scenario: str
    seed: int
    index: int
    status: str
    time: float
    outside: bool
    not_finite: bool
    drift: float
    ratio_initial: float
    ratio: float | None

    @property
    def near(self) -> bool:
        """Whether it came as near the true set as it should."""
        return self.ratio is not None and self.ratio <= ENOUGH


@dataclass(frozen=True)
class Log:
    """A motion that was simulated once.

    Attributes:
        scenario: its name.
        seed: its seed.
        law: who identifies.
        plant: with the truth, which is read to draw starts and to judge.
        measured: what all starts see.
        nullspace: P_s(θ).
    """

    scenario: str
    seed: int
    law: IdentifierConfig
    plant: Plant
    measured: list[Measurement]
    nullspace: Nullspace


def simulate(name: str, seed: int, seconds: float) -> Log:
    """Drives a scenario's plant, its driver built with the scenario's own prior."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    law = replace(scenario.identifier, law="memory")
    scenario = replace(scenario, identifier=law, rivals={}, seed=seed, duration=seconds)
    seeds, (plant, prior, _) = Seeds.of(seed), prepare(scenario)
    driver = scenario.excitation.build(plant.system, prior, np.random.default_rng(seeds.excitation))
    with plant.running():
        measured = list(trajectory(plant, driver, scenario.steps, None, Cost()))
    rng = np.random.default_rng(seeds.structure)
    return Log(name, seed, law, plant, measured, structural(plant.system, plant.truth, rng))


def drawn(log: Log, index: int, error: float) -> Array:
    """(p,) a start at e^{±error} of the truth."""
    rng = np.random.default_rng((log.seed, index))
    return drawn_inside(log.plant.system.space, log.plant.truth, error, rng)


def identify(log: Log, index: int, prior: Array) -> Start:
    """Runs the law from a start (p,) and looks at every estimate."""
    system, dt = log.plant.system, log.plant.dt
    cone, scale = cone_of(system.space), system.space.scale
    law = log.law.build(system, prior, dt)
    state = law.init(log.measured[0])
    conserved, drift, outside, not_finite = float(law.conserved(prior)), 0.0, False, False
    for k, (before, after) in enumerate(pairwise(log.measured), 1):
        state = law.step(state, before, after)
        outside |= not inside(cone, state.theta_hat)
        not_finite |= not (np.isfinite(state.theta_hat).all() and np.isfinite(state.v_hat).all())
        if k % round(1 / dt) == 0:
            now = float(law.conserved(state.theta_hat)) + state.spent
            drift = max(drift, abs(now / conserved - 1))
        if state.status is not Status.completed:
            break
    ended = state.status is not Status.completed or outside or not_finite
    ratio = None if ended else float(log.nullspace.ratio(state.theta_hat / scale))
    return Start(
        log.scenario, log.seed, index, state.status.words, state.t, outside, not_finite, drift,
        float(log.nullspace.ratio(prior / scale)), ratio,
    )  # fmt: skip


def study(name: str, seed: int, starts: int, seconds: float, error: float) -> list[Start]:
    """All starts of one scenario and seed."""
    log = simulate(name, seed, seconds)
    return [identify(log, index, drawn(log, index, error)) for index in range(starts)]


def row(name: str, results: list[Start]) -> str:
    """One row of the table."""
    first = [s.ratio_initial for s in results]
    last = [np.inf if s.ratio is None else s.ratio for s in results]
    lost = sum(s.outside or s.status == Status.estimate_not_positive_definite.words
               for s in results)  # fmt: skip
    far = sum(not s.near for s in results)
    cells = [f"`{name}`", len(results), lost, sum(s.not_finite for s in results), far,
             *(f"{v:.2g}" for v in (np.median(first), np.median(last), max(last),
                                    max(s.drift for s in results)))]  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |"


def failures(results: list[Start]) -> Iterator[str]:
    """What did not meet the bar, with the seeds to see it again."""
    for s in results:
        if not s.near:
            end = "" if s.ratio is None else f", ratio {s.ratio_initial:.2g} -> {s.ratio:.2g}"
            yield f"{s.scenario} seed {s.seed} start {s.index}: {s.status} at {s.time:.2f} s{end}"


def main() -> None:
    """Prints the table and the failures, and writes all results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--starts", type=int, default=25, help="for every seed")
    parser.add_argument("--seeds", default="100,101,102,103,104")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--error", type=float, default=1.0)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    names, results = chosen.names or VEHICLES, {}
    with ProcessPoolExecutor(2) as pool:
        waiting = {
            pool.submit(study, name, int(seed), chosen.starts, chosen.seconds, chosen.error): name
            for name in names for seed in chosen.seeds.split(",")
        }  # fmt: skip
        for done in as_completed(waiting):
            results.setdefault(waiting[done], []).extend(done.result())
    print("| scenario | starts | lost M̂ ≻ 0 | NaN | > 0.01 | ratio at first, median | "
          f"after {chosen.seconds:g} s, median | … worst | conserved drift, worst |")  # fmt: skip
    print("|" + "---|" * 9)
    for name in names:
        print(row(name, results[name]))
    for name in names:
        for line in failures(sorted(results[name], key=lambda s: (s.seed, s.index))):
            print(line)
    if chosen.json:
        chosen.json.write_text(json.dumps([asdict(s) for name in names for s in results[name]]))


if __name__ == "__main__":
    main()
