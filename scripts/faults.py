"""Faults found by the law `efficient`: how soon, how rightly, how often wrongly.

`python scripts/faults.py loss|slow|kinds|drift|matched|picture [--scenarios ur5,bluerov2,crazyflie]
[--seeds 10:30] [--seconds 180]`, under noisy sensors and with the scenario's own time step.

- `loss`: an actuator loses 40 % at 6 s; which one goes round with the seed. Delay of the isolated
  event, whether it names the actuator, its size, and afterwards the error of the lost gain and the
  largest of the others, all relative to the mean of the healthy ones, over the same before.
- `slow`: an actuator loses 1 %/s from 12 s on, up to 30 %; what it has lost when that is found.
- `kinds`: every kind of fault at 6 s; what it was taken for.
- `drift`: every second gain fades for `--seconds`; the largest error of any gain afterwards,
  and over its stated standard deviation, all gains relative to their mean.
- `picture`: docs/faults.png.
- `matched`: no fault, for `--seconds` on every seed; the events are false alarms.

The seeds 0 to 9 served for development. Printed figures are of all seeds given, none left out.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from nsaid_mj.core.laws.base import Estimates, State, Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.core.log import Log
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.lab.evaluation.confidence import known
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.faults.kinds import ActuatorFault, Bias, Friction, Payload
from nsaid_mj.lab.plants.world.faults.text import parse_faults
from nsaid_mj.lab.setup import Setup
from nsaid_mj.watch import drift_of

STRIKE, SLOWLY = 6.0, 12.0
_ACTUATORS = ("reversed {k}", "broken {k}", "stuck {k}")
_SENSORS = ("bias 0.05 of velocity {j}", "bias 0.01 of position {j}")
KINDS = {
    "ur5": (
        *_ACTUATORS,
        "friction 10 of viscous_{k}",
        "friction 1 of coulomb_{k}",
        "payload 2 kg place 0 0.1 0",
        "bias 0.05 of velocity {k}",
        "bias 0.01 of position {k}",
    ),
    "bluerov2": (
        *_ACTUATORS,
        "friction 20 of d_surge",
        "friction 20 of dq_heave",
        "payload 2 kg place 0.1 0 -0.1",
        *_SENSORS,
    ),
    "crazyflie": (
        *_ACTUATORS,
        "friction 0.01 of drag_x",
        "payload 4e-3 kg place 0 0 -0.01",
        *_SENSORS,
    ),
}


class Followed(NamedTuple):
    """A simulated run with its identification."""

    setup: Setup
    log: Log
    state: State
    estimates: Estimates

    @property
    def events(self) -> tuple[FaultEvent, ...]:
        """The faults found."""
        return self.state.faults

    @property
    def said(self) -> str:
        """The faults found, in words."""
        return "; ".join(event.in_words for event in self.events) or "nothing found"

    @property
    def hit(self) -> tuple[str, ...]:
        """Names of the gains of the first fault's actuator; none of another kind of fault."""
        fault, system = self.setup.plant.faults[0], self.setup.system
        if not isinstance(fault, ActuatorFault):
            return ()
        return tuple(system.space.names[i] for i in fault.affected(system))

    @property
    def gain_ratios(self) -> np.ndarray:
        """Estimated over true gains at the end, without those of the actuator that fails."""
        space = self.setup.system.space
        k = np.array([i for i in space.actuators if space.names[i] not in self.hit])
        return self.estimates.theta_hat[-1][k] / self.setup.plant.truth[k]


def followed(name: str, seed: int, faults: str, duration: float) -> Followed:
    """A scenario under noise with faults, identified by the law `efficient`."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    scenario = replace(
        scenario,
        plant=replace(scenario.plant, faults=parse_faults(faults)),
        identifier=replace(scenario.identifier, law="efficient", gamma="scale"),
        rivals={},
        duration=duration,
        seed=seed,
        sensors="noisy",
    )
    setup = Setup.of(scenario)
    identifier = setup.identifiers()[""]
    with setup.plant.running():
        log = setup.simulate()
    return Followed(setup, log, *identifier.follow(identifier.init(log.at(0)), log))


def actuator(name: str, seed: int) -> int:
    """The actuator that fails under a seed, counted from 1; all take their turns."""
    return 1 + seed % {"ur5": 6, "bluerov2": 8, "crazyflie": 4, "quadruped": 12}.get(name, 1)


def tabulated(heads: str, rows: Sequence[Sequence[object]]) -> None:
    """Prints a table in Markdown; heads are separated by `|`."""
    print(f"\n| {heads} |\n|" + "---|" * (heads.count("|") + 1))
    for row in rows:
        print(f"| {' | '.join(map(str, row))} |")


def median_and_worst(values: Sequence[float], unit: str = "%") -> str:
    """Such as `0.2 % (1.5 %)`, and `–` without values."""
    if not len(values):
        return "–"
    scale, words = (100, " %") if unit == "%" else (1, f" {unit}" if unit else "")
    return f"{scale * np.median(values):.2g}{words} ({scale * max(values):.2g}{words})"


def gain_errors(found: Followed, t: float) -> tuple[float, float]:
    """Errors of the hit gain, and the largest of the others, at time t [s]; see the module."""
    space = found.setup.system.space
    own = np.array([space.names[i] in found.hit for i in space.actuators])
    row = min(int(np.searchsorted(found.log.t, t - 1e-9)), len(found.estimates.theta_hat) - 1)
    truth = Truth(found.setup, found.log.t[-1]).theta_at(found.log.t[row])
    ratio = found.estimates.theta_hat[row][space.actuators] / truth[space.actuators]
    error = np.abs(ratio / ratio[~own].mean() - 1)
    return float(error[own].max()), float(error[~own].max())


# -- the studies: each tells the heads of its table, and the rows of a scenario --------------------

LOSS = (
    "| within 2 s | delay | isolated rightly | error of the size | within its interval "
    "| its gain 6 s later | the others, before → 6 s later | false before"
)


def loss(name: str, seeds: Sequence[int], share: float) -> list[list[object]]:
    """Sudden losses."""
    delays, sizes, errors, before = [], [], [], []
    right = covered = early = 0
    for seed in seeds:
        k = actuator(name, seed)
        found = followed(name, seed, f"loss {share} of {k} at {STRIKE} s", STRIKE + 6.0)
        events = [e for e in found.events if e.found > STRIKE]
        early += len(found.events) - len(events)
        state = "" if found.state.status is Status.completed else found.state.status.words
        print(f"{name}, seed {seed}, actuator {k}: {found.said} {state}", flush=True)
        if not events:
            continue
        delays.append(events[0].found - STRIKE)
        if events[0].kind == "loss" and events[0].names == found.hit:
            right += len(events) == 1
            sizes.append(abs(events[0].size - share))
            covered += events[0].low <= share <= events[0].high
            errors.append(gain_errors(found, found.log.t[-1]))
            before.append(gain_errors(found, STRIKE - 0.1)[1])
    n, in_time = len(seeds), sum(delay <= 2.0 for delay in delays)
    own, others = zip(*errors, strict=True) if errors else ((), ())
    later = f"{median_and_worst(before)} → {median_and_worst(others)}"
    return [
        [
            name,
            f"{in_time}/{n}",
            median_and_worst(delays, "s"),
            f"{right}/{n}",
            median_and_worst(sizes),
            f"{covered}/{len(sizes)}",
            median_and_worst(own),
            later,
            early,
        ]
    ]


SLOW = "| found before 10 % | lost when found | isolated rightly | false before"


def slow(name: str, seeds: Sequence[int]) -> list[list[object]]:
    """Slow losses."""
    lost, right, early = [], 0, 0
    for seed in seeds:
        k = actuator(name, seed)
        text = f"loss 0.3 of {k} rate 0.01 at {SLOWLY} s"
        found = followed(name, seed, text, SLOWLY + 14.0)
        events = [e for e in found.events if e.time > SLOWLY]
        early += len(found.events) - len(events)
        right += bool(events) and all((e.kind, e.names) == ("loss", found.hit) for e in events)
        print(f"{name}, seed {seed}, actuator {k}: {found.said}", flush=True)
        lost.append(0.01 * ((events[0].time if events else np.inf) - SLOWLY))
    n, below = len(seeds), sum(share < 0.1 for share in lost)
    return [[name, f"{below}/{n}", median_and_worst(lost), f"{right}/{n}", early]]


TAKEN = (
    "| fault | taken for | isolated rightly | delay | error of the size | healthy gains 4 s later"
)


def kinds(name: str, seeds: Sequence[int]) -> list[list[object]]:
    """What every kind of fault was taken for."""
    rows: list[list[object]] = []
    for text in KINDS[name]:
        taken, delays, sizes, others, right = Counter[str](), [], [], [], 0
        for seed in seeds:
            clause = text.format(k=actuator(name, seed), j=1 + seed % 6)
            found = followed(name, seed, f"{clause} at {STRIKE} s", STRIKE + 4.0)
            events = [e for e in found.events if e.found > STRIKE]
            restarts = "unexplained" if found.state.own.restarts else "nothing"
            taken[events[0].kind if events else restarts] += 1
            said = found.said if events else restarts
            print(f"{name}, seed {seed}, {clause}: {said}", flush=True)
            ratio = found.gain_ratios
            others.append(float(np.abs(ratio / np.median(ratio) - 1).max()))
            if events and isolated(found, events[0]):
                right += len(events) == 1
                delays.append(events[0].found - STRIKE)
                sizes += size_error(found, events[0])
        words = ", ".join(f"{kind} {count}" for kind, count in taken.most_common())
        cells = median_and_worst(delays, "s"), median_and_worst(sizes), median_and_worst(others)
        rows.append([name, f"`{text}`", words, f"{right}/{len(seeds)}", *cells])
    return rows


def isolated(found: Followed, event: FaultEvent) -> bool:
    """Whether an event names the kind and the part of the run's first fault."""
    fault, system = found.setup.plant.faults[0], found.setup.system
    if event.kind != type(fault).__name__.lower():
        return False
    if isinstance(fault, Bias):
        return event.names == (f"{fault.sensor} {fault.channel}",)
    hit = {system.space.names[i] for i in fault.affected(system)}
    return set(event.names) == hit if isinstance(fault, ActuatorFault) else hit <= set(event.names)


def size_error(found: Followed, event: FaultEvent) -> list[float]:
    """Relative error of the size of a load, an error of a sensor or a known coefficient.

    Masses and frictions are compared in units of the estimate, whose common factor with the healthy
    gains is unobservable.
    """
    fault, ratio = found.setup.plant.faults[0], float(np.median(found.gain_ratios))
    if isinstance(fault, Bias):
        return [abs(event.size / fault.by - 1)]
    if isinstance(fault, Payload):
        return [abs(event.size / (ratio * fault.mass) - 1)]
    if isinstance(fault, Friction) and event.names[0] == fault.parameter:
        return [abs(event.size / (ratio * fault.by) - 1)]
    return []


DRIFT = "| drift | error of a gain | over its deviation | followed | faults named"


def drift(name: str, seeds: Sequence[int], seconds: float) -> list[list[object]]:
    """How gains that drift are followed."""
    rows: list[list[object]] = []
    for rate in (1, 10):
        errors, deviations = [], []
        named, seen, commands = 0, 0, Setup.of(load(name)).system.n_u
        for seed in seeds:
            fading = range(1 + seed % 2, 1 + commands, 2)
            text = "; ".join(f"loss 0.9 of {k} rate {rate / 60} %/s at 0 s" for k in fading)
            found = followed(name, seed, text, seconds)
            system, theta, end = found.setup.system, found.state.theta_hat, found.log.t[-1]
            k = system.space.actuators
            ratio = theta[k] / Truth(found.setup, end).theta_at(end)[k]
            stated = found.setup.identifiers()[""].confidence(found.state)
            assert stated is not None
            nullspace = Nullspace.structural(system, theta, np.random.default_rng(0))
            sure = known(stated, theta, nullspace, system.space).actuators
            error = np.abs(ratio / ratio.mean() - 1)
            errors.append(float(error.max()))
            deviations.append(float((error / sure).max()))
            named, seen = named + len(found.events), seen + (drift_of(found.state)[0] > 0)
            print(f"{name}, {rate} %/min, seed {seed}: {errors[-1]:.2g}", flush=True)
        cells = median_and_worst(errors), median_and_worst(deviations, "")
        rows.append([name, f"{rate} %/min", *cells, f"{seen}/{len(seeds)}", named])
    return rows


MATCHED = "| noisy matched motion | false alarms"


def matched(name: str, seeds: Sequence[int], seconds: float) -> list[list[object]]:
    """False alarms."""
    alarms, total = 0, 0.0
    for seed in seeds:
        found = followed(name, seed, "", seconds)
        alarms += len(found.events)
        total += float(found.log.t[-1])
        own = found.state.own
        back = f"{own.supervision.returns} returns, {own.restarts} restarts"
        print(f"{name}, seed {seed}: {back}; {found.said}", flush=True)
    return [[name, f"{total / 60:.0f} min", alarms]]


def picture(path: Path) -> None:
    """Draws the gains of a run with a sudden and a slow loss and a load, and what was found."""
    weight = "payload 2 kg place 0.1 0 -0.1 at 20 s"
    text = f"loss 0.4 of 3 at 10 s; {weight}; loss 0.3 of 6 rate 1 %/s at 30 s"
    found = followed("bluerov2", 10, text, 60.0)
    space, t = found.setup.system.space, found.log.t
    k, truth = space.actuators, Truth(found.setup, float(t[-1]))
    figure, axes = plt.subplots(figsize=(9, 4.6), layout="constrained")
    colours = plt.get_cmap("tab10").colors  # type: ignore[attr-defined]  # a listed map has them
    healthy = np.delete(np.arange(len(k)), [2, 5])
    for values, style in ((found.estimates.theta_hat[:, k], "-"), (truth.theta_at(t)[:, k], ":")):
        share = values / truth.initial[k]
        share = 100 * share / share[:, healthy].mean(axis=1, keepdims=True)
        for i in range(len(k)):
            label = space.labels[k[i]] if style == "-" else None
            axes.plot(t, share[:, i], style, color=colours[i], label=label, linewidth=1.4)
    for row, event in enumerate(found.events):
        axes.axvline(event.found, color="#c92a2a", linewidth=0.8)
        words, place = f"{event.found:.2f} s: {event.in_words}", (event.found + 0.4, 47 + 4 * row)
        axes.annotate(words, place, color="#c92a2a", fontsize=8)
    axes.set(xlabel="time [s]", ylabel="gain, of that before [%]", ylim=(45, 118), xlim=(2, 60))
    axes.legend(ncols=4, fontsize=8, loc="upper left", frameon=False)
    figure.savefig(path, dpi=130)
    print(found.said)


def main() -> None:
    """Runs a study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("study", choices=["loss", "slow", "kinds", "drift", "matched", "picture"])
    parser.add_argument("--scenarios", default="ur5,bluerov2,crazyflie")
    parser.add_argument("--seeds", default="10:30")
    parser.add_argument(
        "--seconds", type=float, default=180.0, help="of each run that drifts or has no fault [s]"
    )
    parser.add_argument("--share", type=float, default=0.4, help="that is lost at once")
    chosen = parser.parse_args()
    if chosen.study == "picture":
        picture(Path("docs/faults.png"))
        return
    heads, study, *arguments = {
        "loss": (LOSS, loss, chosen.share),
        "slow": (SLOW, slow),
        "kinds": (TAKEN, kinds),
        "drift": (DRIFT, drift, chosen.seconds),
        "matched": (MATCHED, matched, chosen.seconds),
    }[chosen.study]
    first, _, last = chosen.seeds.partition(":")
    seeds = range(int(first), int(last)) if last else [int(seed) for seed in first.split(",")]
    rows = [row for name in chosen.scenarios.split(",") for row in study(name, seeds, *arguments)]
    tabulated(heads, rows)


if __name__ == "__main__":
    main()
