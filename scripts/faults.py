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
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

from nsaid_mj.evaluation import Truth
from nsaid_mj.evaluation.confidence import known
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.setup import Setup
from nsaid_mj.identifiers import NullspaceAID, Status
from nsaid_mj.identifiers.base import Estimates, State
from nsaid_mj.identifiers.faults import FaultEvent
from nsaid_mj.log import Log
from nsaid_mj.nullspace import structural
from nsaid_mj.plants import parse_faults
from nsaid_mj.plants.world.faults.kinds import ActuatorFault, Bias, Friction, Payload

STRIKE, SLOWLY = 6.0, 12.0
KINDS = {
    "ur5": [
        "reversed {k}",
        "broken {k}",
        "stuck {k}",
        "friction 10 of viscous_{k}",
        "friction 1 of coulomb_{k}",
        "payload 2 kg place 0 0.1 0",
        "bias 0.05 of velocity {k}",
        "bias 0.01 of position {k}",
    ],
    "bluerov2": [
        "reversed {k}",
        "broken {k}",
        "stuck {k}",
        "friction 20 of d_surge",
        "friction 20 of dq_heave",
        "payload 2 kg place 0.1 0 -0.1",
        "bias 0.05 of velocity {j}",
        "bias 0.01 of position {j}",
    ],
    "crazyflie": [
        "reversed {k}",
        "broken {k}",
        "stuck {k}",
        "friction 0.01 of drag_x",
        "payload 4e-3 kg place 0 0 -0.01",
        "bias 0.05 of velocity {j}",
        "bias 0.01 of position {j}",
    ],
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


def followed(name: str, seed: int, faults: str, duration: float) -> Followed:
    """A scenario under noise with faults, identified by the law `efficient`."""
    scenario = load(name)
    assert isinstance(scenario.identifier, NullspaceAID)
    setup = Setup.of(
        replace(
            scenario,
            plant=replace(scenario.plant, faults=parse_faults(faults)),
            identifier=replace(scenario.identifier, law="efficient", gamma="scale"),
            rivals={},
            duration=duration,
            seed=seed,
            sensors="noisy",
        )
    )
    identifier = setup.identifiers()[""]
    with setup.plant.running():
        log = setup.simulate()
    return Followed(setup, log, *identifier.follow(identifier.init(log.at(0)), log))


def actuator(name: str, seed: int) -> int:
    """The actuator that fails under a seed, counted from 1; all take their turns."""
    return 1 + seed % {"ur5": 6, "bluerov2": 8, "crazyflie": 4}.get(name, 1)


def hit(found: Followed) -> tuple[str, ...]:
    """Names of the gains of the first fault's actuator."""
    fault, system = found.setup.plant.faults[0], found.setup.system
    assert isinstance(fault, ActuatorFault)
    return tuple(system.space.names[i] for i in fault.affected(system))


def gain_errors(found: Followed, t: float) -> tuple[float, float]:
    """Errors of the hit gain, and the largest of the others, at time t [s]; see the module."""
    system, names = found.setup.system, hit(found)
    k = system.space.actuators
    own = np.array([system.space.names[i] in names for i in k])
    row = min(int(np.searchsorted(found.log.t, t - 1e-9)), len(found.estimates.theta_hat) - 1)
    truth = Truth(found.setup, found.log.t[-1]).theta_at(found.log.t[row])
    ratio = found.estimates.theta_hat[row][k] / truth[k]
    error = np.abs(ratio / ratio[~own].mean() - 1)
    return float(error[own].max()), float(error[~own].max())


def median_and_worst(values: list[float], unit: str = "%") -> str:
    """Median and largest value."""
    shown = 100 * np.array(values) if unit == "%" else np.array(values)
    return f"{np.median(shown):.2g} {unit} ({shown.max():.2g} {unit})" if len(values) else "–"


def loss(names: list[str], seeds: list[int], share: float) -> None:
    """Prints the table of sudden losses."""
    rows = []
    for name in names:
        delays: list[float] = []
        sizes: list[float] = []
        own: list[float] = []
        others: list[float] = []
        before: list[float] = []
        right = covered = early = 0
        for seed in seeds:
            k = actuator(name, seed)
            found = followed(name, seed, f"loss {share} of {k} at {STRIKE} s", STRIKE + 6.0)
            events = [e for e in found.events if e.found > STRIKE]
            early += len(found.events) - len(events)
            good = bool(events) and events[0].kind == "loss" and events[0].names == hit(found)
            right += good and len(events) == 1
            said = "; ".join(e.in_words for e in events) or "nothing found"
            state = "" if found.state.status is Status.completed else found.state.status.words
            print(f"{name}, seed {seed}, actuator {k}: {said} {state}", flush=True)
            if events:
                delays.append(events[0].found - STRIKE)
            if good:
                sizes.append(abs(events[0].size - share))
                covered += events[0].low <= share <= events[0].high
                at = gain_errors(found, found.log.t[-1])
                own.append(at[0])
                others.append(at[1])
                before.append(gain_errors(found, STRIKE - 0.1)[1])
        n = len(seeds)
        in_time = sum(delay <= 2.0 for delay in delays)
        rows.append(
            f"| {name} | {in_time}/{n} | {median_and_worst(delays, 's')} | {right}/{n} "
            f"| {median_and_worst(sizes)} | {covered}/{len(sizes)} | {median_and_worst(own)} "
            f"| {median_and_worst(before)} → {median_and_worst(others)} | {early} |"
        )
    print(
        "\n| | within 2 s | delay | isolated rightly | error of the size | within its interval "
        "| its gain 6 s later | the others, before → 6 s later | false before |\n|" + "---|" * 9
    )
    print("\n".join(rows))


def slow(names: list[str], seeds: list[int]) -> None:
    """Prints the table of slow losses."""
    rows = []
    for name in names:
        lost: list[float] = []
        right = early = 0
        for seed in seeds:
            k = actuator(name, seed)
            text = f"loss 0.3 of {k} rate 0.01 at {SLOWLY} s"
            found = followed(name, seed, text, SLOWLY + 14.0)
            events = [e for e in found.events if e.time > SLOWLY]
            early += len(found.events) - len(events)
            right += bool(events) and all((e.kind, e.names) == ("loss", hit(found)) for e in events)
            said = "; ".join(e.in_words for e in events) or "nothing found"
            print(f"{name}, seed {seed}, actuator {k}: {said}", flush=True)
            first = events[0].time if events else np.inf
            lost.append(0.01 * (first - SLOWLY))
        below = sum(share < 0.1 for share in lost)
        n = len(seeds)
        rows.append(f"| {name} | {below}/{n} | {median_and_worst(lost)} | {right}/{n} | {early} |")
    print("\n| | found before 10 % | lost when found | isolated rightly | false before |")
    print("|---|---|---|---|---|\n" + "\n".join(rows))


def kinds(names: list[str], seeds: list[int]) -> None:
    """Prints what every kind of fault was taken for."""
    rows = []
    for name in names:
        for text in KINDS[name]:
            taken: Counter[str] = Counter()
            delays: list[float] = []
            sizes: list[float] = []
            others: list[float] = []
            right = 0
            for seed in seeds:
                k = actuator(name, seed)
                clause = text.format(k=k, j=1 + seed % 6)
                found = followed(name, seed, f"{clause} at {STRIKE} s", STRIKE + 4.0)
                events = [e for e in found.events if e.found > STRIKE]
                restarts = "unexplained" if found.state.filter.restarts else "nothing"
                taken[events[0].kind if events else restarts] += 1
                said = "; ".join(e.in_words for e in events) or restarts
                print(f"{name}, seed {seed}, {clause}: {said}", flush=True)
                others.append(healthy_error(found))
                if events and isolated(found, events[0]):
                    right += len(events) == 1
                    delays.append(events[0].found - STRIKE)
                    sizes += size_error(found, events[0])
            words = ", ".join(f"{kind} {count}" for kind, count in taken.most_common())
            delay, size = median_and_worst(delays, "s"), median_and_worst(sizes)
            rows.append(
                f"| {name} | `{text}` | {words} | {right}/{len(seeds)} | {delay} | {size} "
                f"| {median_and_worst(others)} |"
            )
    print(
        "\n| | fault | taken for | isolated rightly | delay | error of the size "
        "| healthy gains 4 s later |\n|" + "---|" * 7 + "\n" + "\n".join(rows)
    )


def drift(names: list[str], seeds: list[int], seconds: float) -> None:
    """Prints how gains that drift are followed."""
    rows = []
    for name, rate in ((name, rate) for name in names for rate in (1, 10)):
        errors: list[float] = []
        deviations: list[float] = []
        named, seen, commands = 0, 0, Setup.of(load(name)).system.n_u
        for seed in seeds:
            fading = range(1 + seed % 2, 1 + commands, 2)
            text = "; ".join(f"loss 0.9 of {k} rate {rate / 60} %/s at 0 s" for k in fading)
            found = followed(name, seed, text, seconds)
            inside, system = found.state.filter, found.setup.system
            k, truth = system.space.actuators, Truth(found.setup, found.log.t[-1])
            ratio = found.state.theta_hat[k] / truth.theta_at(found.log.t[-1])[k]
            stated = found.setup.identifiers()[""].confidence(found.state)
            assert stated is not None
            nullspace = structural(system, found.state.theta_hat, np.random.default_rng(0))
            sure = known(stated, found.state.theta_hat, nullspace, system.space).actuators
            error = np.abs(ratio / ratio.mean() - 1)
            errors.append(float(error.max()))
            deviations.append(float((error / sure).max()))
            named, seen = named + len(found.events), seen + (inside.drift > 0)
            print(f"{name}, {rate} %/min, seed {seed}: {errors[-1]:.2g}", flush=True)
        rows.append(
            f"| {name} | {rate} %/min | {median_and_worst(errors)} | "
            f"{median_and_worst(deviations, '')} | {seen}/{len(seeds)} | {named} |"
        )
    print("\n| | drift | error of a gain | over its deviation | followed | faults named |")
    print("|---|---|---|---|---|---|\n" + "\n".join(rows))


def isolated(found: Followed, event: FaultEvent) -> bool:
    """Whether an event names the kind and the part of the run's first fault."""
    fault, system = found.setup.plant.faults[0], found.setup.system
    if event.kind != type(fault).__name__.lower():
        return False
    if isinstance(fault, Bias):
        return event.names == (f"{fault.sensor} {fault.channel}",)
    hit_names = {system.space.names[i] for i in fault.affected(system)}
    if isinstance(fault, ActuatorFault):
        return set(event.names) == hit_names
    return hit_names <= set(event.names)


def size_error(found: Followed, event: FaultEvent) -> list[float]:
    """Relative error of the size of a load, an error of a sensor or a known coefficient.

    Masses and frictions are compared in units of the estimate, whose common factor with the healthy
    gains is unobservable.
    """
    fault = found.setup.plant.faults[0]
    if isinstance(fault, Bias):
        return [abs(event.size / fault.by - 1)]
    ratio = float(np.median(gain_ratios(found)))
    if isinstance(fault, Payload):
        return [abs(event.size / (ratio * fault.mass) - 1)]
    if isinstance(fault, Friction) and event.names[0] == fault.parameter:
        return [abs(event.size / (ratio * fault.by) - 1)]
    return []


def gain_ratios(found: Followed) -> np.ndarray:
    """Estimated over true gains at the end, of those that a fault has not set to 0."""
    system = found.setup.system
    k = system.space.actuators
    if isinstance(found.setup.plant.faults[0], ActuatorFault):
        k = np.array([i for i in k if system.space.names[i] not in hit(found)])
    return found.estimates.theta_hat[-1][k] / found.setup.plant.truth[k]


def healthy_error(found: Followed) -> float:
    """Largest error of a healthy gain at the end, relative to their median."""
    ratio = gain_ratios(found)
    return float(np.abs(ratio / np.median(ratio) - 1).max())


def matched(names: list[str], seeds: list[int], seconds: float) -> None:
    """Prints the false alarms."""
    rows = []
    for name in names:
        alarms, total = 0, 0.0
        for seed in seeds:
            found = followed(name, seed, "", seconds)
            alarms += len(found.events)
            total += float(found.log.t[-1])
            said = "; ".join(f"{e.found:.1f} s: {e.in_words}" for e in found.events)
            inside = found.state.filter
            back = f"{inside.returns} returns, {inside.restarts} restarts"
            print(f"{name}, seed {seed}: {back} {said}", flush=True)
        rows.append(f"| {name} | {total / 60:.0f} min | {alarms} |")
    print("\n| | noisy matched motion | false alarms |\n|---|---|---|\n" + "\n".join(rows))


def picture(path: Path) -> None:
    """Draws the gains of a run with a sudden and a slow loss and a load, and what was found."""
    weight = "payload 2 kg place 0.1 0 -0.1 at 20 s"
    text = f"loss 0.4 of 3 at 10 s; {weight}; loss 0.3 of 6 rate 1 %/s at 30 s"
    found = followed("bluerov2", 10, text, 60.0)
    system, t = found.setup.system, found.log.t
    k, truth = system.space.actuators, Truth(found.setup, float(t[-1]))
    scale = truth.initial[k]
    figure, axes = plt.subplots(figsize=(9, 4.6), layout="constrained")
    colours = plt.get_cmap("tab10").colors  # type: ignore[attr-defined]  # a listed map has them
    healthy = np.delete(np.arange(len(k)), [2, 5])
    for values, style in ((found.estimates.theta_hat[:, k], "-"), (truth.theta_at(t)[:, k], ":")):
        share = values / scale
        share = 100 * share / share[:, healthy].mean(axis=1, keepdims=True)
        for i in range(len(k)):
            label = system.space.labels[k[i]] if style == "-" else None
            axes.plot(t, share[:, i], style, color=colours[i], label=label, linewidth=1.4)
    for row, event in enumerate(found.events):
        axes.axvline(event.found, color="#c92a2a", linewidth=0.8)
        words = f"{event.found:.2f} s: {event.in_words}"
        place = (event.found + 0.4, 47 + 4 * row)
        axes.annotate(words, place, color="#c92a2a", fontsize=8)
    axes.set(xlabel="time [s]", ylabel="gain, of that before [%]", ylim=(45, 118), xlim=(2, 60))
    axes.legend(ncols=4, fontsize=8, loc="upper left", frameon=False)
    figure.savefig(path, dpi=130)
    print("\n".join(event.in_words for event in found.events))


def main() -> None:
    """Runs a study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", choices=["loss", "slow", "kinds", "drift", "matched", "picture"])
    parser.add_argument("--scenarios", default="ur5,bluerov2,crazyflie")
    parser.add_argument("--seeds", default="10:30")
    parser.add_argument(
        "--seconds", type=float, default=180.0, help="of each run that drifts or has no fault [s]"
    )
    parser.add_argument("--share", type=float, default=0.4, help="that is lost at once")
    chosen = parser.parse_args()
    names = chosen.scenarios.split(",")
    first, _, last = chosen.seeds.partition(":")
    seeds = list(range(int(first), int(last))) if last else [int(s) for s in first.split(",")]
    if chosen.study == "loss":
        loss(names, seeds, chosen.share)
    elif chosen.study == "slow":
        slow(names, seeds)
    elif chosen.study == "kinds":
        kinds(names, seeds)
    elif chosen.study == "drift":
        drift(names, seeds, chosen.seconds)
    elif chosen.study == "picture":
        picture(Path("docs/faults.png"))
    else:
        matched(names, seeds, chosen.seconds)


if __name__ == "__main__":
    main()
