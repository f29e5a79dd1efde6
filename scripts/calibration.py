"""Accuracy of `nsaid identify`, on a real arm's log and on simulated ones; of docs/results.md.

    python -m scripts.calibration [arms] [--robots ur5,panda,kinova] [--rate 500] [--duration 40]
    python -m scripts.calibration scale [--robots ur5,panda,kinova,z1,xarm7] [--seeds 100:110]
    python -m scripts.calibration payload [--seeds 0:5]
    python -m scripts.calibration tx40
    python -m scripts.calibration laws

- `arms`: logs `Simulated` of tests/support/simulated_logs.py, the scale fixed by one known gain.
  Errors of the gain ratios, and whether the stated intervals hold.
- `scale`: logs `HeavyWrist`, without a known number, so that the common scale rests on the file's
  masses. The scale of the gains whose ratios the log tells over the true one, whether the intervals
  of these gains hold it, the largest error of their ratios, and how many intervals of ratios hold.
- `payload`: how well a weighed load tells the scale of masses, gains and friction: 2 kg on the last
  link of a `HeavyWrist` UR5 in a second log; and 200 g in the gripper of an SO-101 in two of four
  logs, all of whose masses are the file's times a drawn factor. The load's place is not told.
- `tx40`: three fifths of the moving part of the Stäubli's log (last, first, middle) are held out in
  turn: NRMSE of every joint, and its ratio to weighted least squares on the same rows. Then the
  published essential parameters with the gears given, and the gains where they are free.
- `laws`: every law along the Stäubli's log, and along 20 s of a simulated UR5 at 500 Hz: the table
  of docs/results.md. Half-widths are of the logarithm.
"""

from __future__ import annotations

import argparse
import csv
import re
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from nsaid_mj.clinic.identify.choose.joint_search import structured_arm
from nsaid_mj.clinic.identify.fit import minimise, tempered, tempered_fit
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.loads import Load
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.identify.problem import least_squares
from nsaid_mj.clinic.identify.result import AlongLog, Options
from nsaid_mj.clinic.logs.mapping import read_map
from nsaid_mj.clinic.logs.preparation import prepare
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.lab import library
from nsaid_mj.lab.loop import run as simulate
from nsaid_mj.robots.assets import asset
from tests.support.simulated_logs import HeavyWrist, Simulated, nominal_model

TOLD = 0.2  # relative half-width up to which a ratio is told


def arms(robots: list[str], seeds: range, duration: float, rate: float) -> None:
    """Prints the accuracy of gains on logs that have what real ones have."""
    total = held = 0
    for name, seed in ((name, seed) for name in robots for seed in seeds):
        simulated = Simulated(name, seed, duration, rate=rate)
        with tempfile.TemporaryDirectory() as folder:
            path = simulated.write(Path(folder) / "log.csv")
            known = {"gain_1": float(simulated.gain[0])}
            found = identify_forces(nominal_model(simulated, seed), path, known=known)
        gains = found.of("motor gain")
        ratio = np.array([p.value for p in gains]) / simulated.gain
        inside = [p.low <= k <= p.high for p, k in zip(gains, simulated.gain, strict=True)]
        sure = [p.status == "identified" for p in gains]
        total += sum(sure)
        held += sum(a and b for a, b in zip(inside, sure, strict=True))
        delay = np.mean([j.delay for j in found.joints]) * 1e3
        print(f"{name} {seed}: {found.explains}, delay {delay:.1f} ms, {found.seconds:.1f} s")
        print("   gain/true", np.round(ratio, 3), "inside", np.array(inside, int))
        halves = np.round([p.high / p.value - 1 for p in gains], 3)
        print("   half-width", halves, "".join("i" if s else "-" for s in sure))
        rms = np.round([[j.held_out, j.least_squares] for j in found.joints], 3).T
        print("   NRMSE", *rms, flush=True)
    print(f"intervals of identified gains hold: {held} of {total}")


def scale(robots: list[str], seeds: range, duration: float) -> None:
    """Prints the common scale found on logs whose commands have unknown units."""
    held, ratios, scales = [], [], []
    for name, seed in ((name, seed) for name in robots for seed in seeds):
        log = HeavyWrist(name, seed, duration)
        with tempfile.TemporaryDirectory() as folder:
            found = identify_forces(log.robot, log.write(Path(folder) / "log.csv"))
        gains, true = found.of("motor gain"), log.gain
        off = np.log([p.value for p in gains] / true)
        half = np.array([np.inf if p.relative is None else p.relative for p in gains])
        told = half < TOLD if (half < TOLD).any() else half <= half.min()
        weight = told / np.maximum(half, 0.01) ** 2
        common = float(np.exp(weight @ off / weight.sum()))
        inside = np.array([p.low <= k <= p.high for p, k in zip(gains, true, strict=True)])
        apart = np.abs(np.exp(off) / common - 1)[told]
        held.append(bool(inside[told].mean() > 0.5))
        ratios += (apart <= half[told]).tolist()
        scales.append(common)
        print(
            f"{name} {seed}: {found.explains}, scale {common:.2f}, inside {inside.astype(int)}, "
            f"ratios of {told.sum()} gains off by at most {apart.max():.1%}; all "
            f"{np.round(np.exp(off), 2)}, {found.seconds:.1f} s",
            flush=True,
        )
    near = np.mean([1 / 1.3 <= common <= 1.3 for common in scales])
    print(
        f"common scale {min(scales):.2f} to {max(scales):.2f}, within 1.3 × in {near:.0%}, held by "
        f"the intervals in {np.mean(held):.0%} of {len(held)} logs; "
        f"{np.mean(ratios):.0%} of {len(ratios)} intervals of ratios hold"
    )


# -- weighed loads ---------------------------------------------------------------------------------


def payload(seeds: range) -> None:
    """Prints the two tables of docs/payload.md."""
    for name, trial in (("UR5, currents, 2 kg", loaded_arm), ("SO-101, targets, 200 g", servos)):
        print(f"\n| {name}: seed | found over true | 95 % interval | holds |\n|---|---|---|---|")
        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                value, low, high = trial(seed, Path(folder))
            held = "yes" if low <= 1 <= high else "no"
            print(f"| {seed} | {value:.3f} | {low:.3f} to {high:.3f} | {held} |", flush=True)


def loaded_arm(seed: int, folder: Path) -> np.ndarray:
    """The first three gains over the true ones, and the ends of their intervals, in the mean."""
    free = HeavyWrist("ur5", seed, 15.0)
    loaded = free.loaded(seed, 2.0, np.array([0.04, -0.02, 0.12]))
    logs = [free.write(folder / "free.csv"), loaded.write(folder / "loaded.csv")]
    gains = identify_forces(free.robot, logs, loads=["loaded.csv:2kg"]).of("motor gain")[:3]
    ratios = np.array([[g.value, g.low, g.high] for g in gains]) / free.gain[:3, None]
    return np.exp(np.log(ratios).mean(axis=0))


def servos(seed: int, folder: Path) -> np.ndarray:
    """The masses' scale over the true one, and the ends of its interval."""
    from tests.clinic.servos import simulated

    heavier = float(np.exp(np.random.default_rng([seed, 5]).uniform(-0.5, 0.5)))
    files, loads = [], []
    for k, load in enumerate((0.0, 0.0, 0.2, 0.2)):
        motion = simulated.log(100 * seed + k, heavier=heavier, load=load)
        files.append(simulated.write(folder / f"log_{k}.csv", *motion))
        loads += [Load(files[-1].name, load, "gripper")] if load else []
    given = servo_logs(simulated.MODEL, files, loads=loads)
    assert given is not None
    (found,) = identify_servos(given).scale
    return np.array([found.value, found.low, found.high]) / heavier


# -- the Stäubli TX40 ------------------------------------------------------------------------------

OURS = {
    "mx": "hx",
    "my": "hy",
    "mz": "hz",
    "Ia": "rotor",
    "fv": "viscous",
    "fs": "coulomb",
    "fvm": "coupling_viscous_5",
    "fsm": "coupling_coulomb_5",
}
"""Our names of the published parameters, where they differ."""


def essential() -> dict[str, tuple[float, float, bool]]:
    """Published essential parameters, ours, and whether they agree, with the gears given.

    Both are taken over viscous friction of joint 1 and shown at its published value. They agree
    within three published deviations or 10 %, whichever is larger.
    """
    known = {f"gain_{i}": 1.0 for i in range(1, 7)}
    found = identify_forces("tx40", known=known, columns=["viscous"], delay=0.0)
    values = {p.name: p.value for p in found.parameters}

    def combination(words: str) -> float:
        terms = re.findall(r"(-?)(?:([\d.]+)\*)?([A-Za-z]+)(\d)", words.replace("- ", "-"))
        return sum(
            (-1 if sign else 1) * float(weight or 1) * values[f"{OURS.get(kind, kind)}_{joint}"]
            for sign, weight, kind, joint in terms
        )

    with asset("tx40", "published_essential_parameters.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.reader(file) if row]
    viscous = next(float(row[3]) for row in rows if row[0] == "fv1")
    table = {}
    for words, _, _, weighted, percent in rows:
        published, own = float(weighted), combination(words) * viscous / values["viscous_1"]
        near = max(0.03 * float(percent), 0.1) * abs(published)
        table[words] = published, own, abs(own - published) <= near
    return table


def tx40() -> None:
    """Prints the tables of a real arm."""
    robot, mapping = load_robot_model("tx40"), read_map(asset("tx40", "map.toml"))
    recordings = prepare(read_tables([asset("tx40", "log.csv.gz")], mapping), mapping, robot)
    made = structured_arm(robot, recordings, None, Options(coupled=((4, 5, 1),)), lambda _: None)
    problem, at = made.problem, made.problem.space.actuators
    _, share = tempered_fit(problem)
    N, ratios = len(problem.t), []
    for name, begin in (("last", 4 * N // 5), ("first", 0), ("middle", 2 * N // 5)):
        part = np.arange(begin, {"last": N, "first": N // 5, "middle": 3 * N // 5}[name])
        rest, own = (problem.select(rows) for rows in (np.delete(np.arange(N), part), part))
        theta = minimise(rest, tempered(rest, share)).theta
        ours, plain = own.nrmse(theta), own.nrmse(least_squares(rest, theta[at]))
        ratios += (ours / plain).tolist()
        print(f"{name:6} NRMSE {np.round(ours, 3)}, over least squares {np.round(ours / plain, 2)}")
    below = np.sum(np.array(ratios) <= 1.05)
    print(f"{below} of {len(ratios)} at most 1.05, the worst {max(ratios):.2f}")
    table = essential()
    for words, (published, own, agrees) in table.items():
        mark = "" if agrees else "off"
        print(f"{words[:40]:40} published {published:8.4f} ours {own:8.4f} {mark}")
    print(f"{sum(agrees for *_, agrees in table.values())} of {len(table)} agree")
    for gain in identify_forces("tx40").of("motor gain"):
        print(f"{gain.label}: {gain.value:.3f} [{gain.low:.2f}, {gain.high:.2f}] {gain.status}")


def laws() -> None:
    """Prints the table of recursive laws beside the batch fit."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        simulate(replace(library.load("ur5"), sensors="noisy", duration=20.0), folder / "ur5")
        logs = {"TX40": ("tx40", ()), "`ur5`, simulated": ("ur5", folder / "ur5" / "record.arrow")}
        for name, (model, log) in logs.items():
            for law in ("efficient", "memory", "cone", "paper"):
                found = identify_forces(model, log, law=law).law
                assert found is not None
                print(f"| {name} | {law} | {' | '.join(_row(found))} |", flush=True)


def _row(found: AlongLog) -> list[str]:
    """The cells of a law's line: deviation, intervals, misfit, prediction, time."""
    apart = [abs(gain.law / gain.batch - 1) for gain in found.gains]
    held = sum(not gain.apart for gain in found.gains)
    half = np.median([gain.half for gain in found.gains]) if found.gains else np.inf
    told = f"{held} of {len(apart)}, ± {100 * half:.0f} %" if np.isfinite(half) else "states none"
    ended = "" if found.completed else f", ended at {found.run.ending.time:.1f} s"
    faults = ", ".join(fault.in_words for fault in found.run.faults)
    worst = f"{np.max(found.last):.3f} ({np.max(found.batch_last):.3f})"
    largest = f"{100 * max(apart):.0f} %" if apart else "–"
    last = f"{worst}, median {np.median(found.last):.3f} ({np.median(found.batch_last):.3f})"
    return [
        largest + ended,
        told,
        found.misfit or "–",
        faults or "–",
        last,
        f"{found.seconds:.1f} s",
    ]


def main() -> None:
    """Runs a study."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    studies = ("arms", "scale", "payload", "tx40", "laws")
    parser.add_argument("study", choices=studies, nargs="?", default="arms")
    parser.add_argument("--robots", help="of arms and scale")
    parser.add_argument("--seeds", help="as 0:5; of arms, scale and payload")
    parser.add_argument("--duration", type=float, help="of arms (40) and scale (30) [s]")
    parser.add_argument("--rate", type=float, default=500.0, help="of arms [Hz]")
    chosen = parser.parse_args()
    robots = {"arms": "ur5,panda,kinova", "scale": "ur5,panda,kinova,z1,xarm7"}
    names = (chosen.robots or robots.get(chosen.study, "")).split(",")
    first, last = (chosen.seeds or ("0:10" if chosen.study == "scale" else "0:5")).split(":")
    seeds = range(int(first), int(last))
    if chosen.study == "arms":
        arms(names, seeds, chosen.duration or 40.0, chosen.rate)
    elif chosen.study == "scale":
        scale(names, seeds, chosen.duration or 30.0)
    elif chosen.study == "payload":
        payload(seeds)
    elif chosen.study == "laws":
        laws()
    else:
        tx40()


if __name__ == "__main__":
    main()
