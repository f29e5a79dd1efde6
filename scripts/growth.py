"""Measures how computing time grows with the system's size, and memory with a run's duration.

    python scripts/growth.py [FOLDER]             time per step against size: growth.png, .json
    python scripts/growth.py --hour [FOLDER]      memory over an hour of a run: memory.png, .json
    python scripts/growth.py --log [SECONDS]      time and memory of `nsaid identify` on a long log

Time: serial chains of 1 to 38 joints (xarm7s end to end), fixed-base and floating robots, and
vehicles, along a smooth motion. `compiled` is the identifier alone, along a log in one call; it is
compared with calls from Python at every time step, Pinocchio's backend, the law `memory`, and
MuJoCo's own step. No θ explains this motion, so the memory's solver takes several times longer than
in a run.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import matplotlib
import mujoco
import numpy as np
import pinocchio as pin
from calibration import Simulated
from machine import machine

from nsaid_mj import ArmPlant, Measurement, NullspaceAID, Scenario
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import Observer, run
from nsaid_mj.identifiers import State
from nsaid_mj.log import Log
from nsaid_mj.plants import Plant
from nsaid_mj.plants.arm import nominal_scales
from nsaid_mj.robot.loading import Base, load_robot
from nsaid_mj.robot.tree import tree_spec
from nsaid_mj.structure.multibody import CompiledMultibody, Multibody
from nsaid_mj.system import SecondOrderSystem

matplotlib.use("Agg")

import matplotlib.pyplot as plt

DT = 1e-3
JOINTS = (1, 2, 3, 4, 5, 6, 7, 10, 14, 19, 26, 38)
ROBOTS: tuple[tuple[str, Base], ...] = (
    ("ur5", "held"),
    ("solo12", "held"),
    ("solo12", "free"),
    ("solo8", "held"),
    ("panda", "held"),
    ("g1", "held"),
    ("talos", "held"),
    ("talos", "free"),
)
VEHICLES = ("scalar_rov", "f1tenth", "astrobee", "hummingbird", "bluerov2", "remus100")
LEAST = 7  # smallest chain in the fit of exponents: below, the overhead of a call dominates
ROUNDS = 7  # passes through all sizes, so that load on the machine affects all of them
BLOCK_SECONDS = 0.03
PAGE = os.sysconf("SC_PAGE_SIZE") / 1e6  # of memory [MB]
STYLES = {
    "compiled": ("#0b6e99", "o", "identifier, compiled"),
    "python": ("#5f3dc4", "s", "… called from Python at every step"),
    "memory": ("#c2255c", "D", "… with the memory, solved every 500 steps"),
    "pinocchio": ("#e8590c", "^", "identifier on Pinocchio"),
    "mujoco": ("#868e96", "v", "MuJoCo's RK4 step"),
}


def chain(joints: int) -> pin.Model:
    """A serial chain of the joints and links of xarm7s, mounted end to end."""
    arm, model = load_robot("xarm7").model, pin.Model()
    for k in range(joints):
        i = 1 + k % arm.nq
        limits = (
            [getattr(arm, name)[i - 1]]
            for name in (
                "upperEffortLimit",
                "upperVelocityLimit",
                "lowerPositionLimit",
                "upperPositionLimit",
            )
        )
        model.addJoint(
            k, arm.joints[i], arm.jointPlacements[i], f"joint{k + 1}", *map(np.array, limits)
        )
        model.appendBodyToJoint(k + 1, arm.inertias[i], pin.SE3.Identity())
    return model


def motion(system: SecondOrderSystem, steps: int) -> Log:
    """A smooth motion whose velocities match its positions to order dt²."""
    rng, samples = np.random.default_rng(0), []
    q, v, _ = system.random_state(rng)
    w, phase = rng.uniform(1, 5, system.n), rng.uniform(0, 6, system.n)
    for k in range(steps + 1):
        samples.append(Measurement(k * DT, q, v * np.cos(w * k * DT + phase), np.ones(system.n_u)))
        q = system.integrate(q, DT * v * np.cos(w * (k + 0.5) * DT + phase))
    return Log.of(samples)


def truth(model: pin.Model, system: SecondOrderSystem) -> np.ndarray:
    """(p,) θ with the description's inertias and the nominal joint parameters."""
    theta = system.space.scale.copy()
    links = [inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]]
    theta[: 10 * len(links)] = np.concatenate(links)
    return theta


class Timed:
    """Times an action block by block.

    Args:
        action: what is timed; it is called twice for warming up.
        steps: time steps in one call of the action.

    Attributes:
        times: time per step in every block [µs].
    """

    def __init__(self, action: Callable[[], object], steps: int):
        self._action, self._steps, self.times = action, steps, []
        action()
        begin = time.perf_counter()
        action()
        self._repeats = max(1, int(BLOCK_SECONDS / (time.perf_counter() - begin)))

    def block(self) -> None:
        """Times another block."""
        begin = time.perf_counter()
        for _ in range(self._repeats):
            self._action()
        self.times.append(1e6 * (time.perf_counter() - begin) / self._repeats / self._steps)


def identifying(
    system: SecondOrderSystem, law: Literal["paper", "memory"], prior: np.ndarray, at_once: bool
) -> Timed:
    """An identifier's time steps along a log, in one call (`at_once`) or one call per step."""
    log = motion(system, 500 if at_once else 20)
    identifier = NullspaceAID(law=law, gain=1e-6).build(system, prior, DT)
    start, samples = identifier.init(log.at(0)), log.rows

    def by_step() -> State:
        state = start
        for one, other in pairwise(samples):
            state = identifier.step(state, one, other)
        return state

    def by_log() -> State:
        return identifier.follow(start, log)[0]

    action = by_log if at_once else by_step
    assert (end := action()).t == log.t[-1], end.status
    return Timed(action, len(log.t) - 1)


def ours(system: SecondOrderSystem, prior: np.ndarray) -> dict[str, Timed]:
    """The identifier of a system, timed in three ways."""
    return {
        "compiled": identifying(system, "paper", prior, True),
        "python": identifying(system, "paper", prior, False),
        "memory": identifying(system, "memory", prior, True),
    }


def tree(model: pin.Model) -> tuple[SecondOrderSystem, dict[str, Timed]]:
    """The system of a tree of joints, and timers for all of STYLES."""
    scales = nominal_scales(model, ArmPlant(armature=0.0))
    speed = np.full(len(scales.gain), 0.05)
    system, slow = (kind(model, scales, speed) for kind in (CompiledMultibody, Multibody))
    prior, world = truth(model, system), tree_spec(model, DT).compile()
    data = mujoco.MjData(world)
    return system, ours(system, prior) | {
        "pinocchio": identifying(slow, "paper", prior, False),
        "mujoco": Timed(lambda: mujoco.mj_step(world, data, 20), 20),
    }


def vehicle(name: str) -> tuple[SecondOrderSystem, dict[str, Timed]]:
    """The system of an included vehicle, and timers for the identifier's part of STYLES."""
    plant = load(name).plant.build(DT, 0)
    return plant.system, ours(plant.system, plant.truth)


def everything() -> list[tuple[dict[str, Any], dict[str, Timed]]]:
    """All systems: the first columns of their rows, and their timers."""
    made = [("chain", f"chain of {k}", tree(chain(k))) for k in JOINTS]
    made += [
        ("robot", f"{name}, {base}", tree(load_robot(name, base).model)) for name, base in ROBOTS
    ]
    made += [("vehicle", name, vehicle(name)) for name in VEHICLES]
    return [
        ({"kind": kind, "name": name, "n": system.n, "p": system.p}, actions)
        for kind, name, (system, actions) in made
    ]


def exponent(rows: list[dict[str, Any]], of: str, against: str, least: int) -> float:
    """Exponent of a power law fitted to the medians of chains with n ≥ `least`."""
    some = [row for row in rows if row["kind"] == "chain" and row["n"] >= least]
    x, y = (
        np.log([row[key] if key in "np" else row[key][1] for row in some]) for key in (against, of)
    )
    return float(np.polyfit(x, y, 1)[0])


def draw_growth(rows: list[dict[str, Any]], path: Path) -> None:
    """Plots the time per step against degrees of freedom and against parameters."""
    figure, axes = plt.subplots(1, 2, figsize=(12.5, 7.4), sharey=True, layout="constrained")
    for axis, against, label in zip(
        axes, "np", ("degrees of freedom n", "parameters p"), strict=True
    ):
        for name, (colour, mark, what) in STYLES.items():
            power = exponent(rows, name, against, LEAST)
            for kind, look in (
                (
                    "chain",
                    {"marker": mark, "lw": 1.4, "label": f"{what}: ∝ {against}$^{{{power:.2f}}}$"},
                ),
                ("robot", {"marker": mark, "ls": "", "mfc": "white"}),
                ("vehicle", {"marker": "x", "ls": ""}),
            ):
                some = [row for row in rows if row["kind"] == kind and name in row]
                if some:
                    low, median, high = np.array([row[name] for row in some]).T
                    axis.errorbar(
                        [row[against] for row in some],
                        median,
                        yerr=[median - low, high - median],
                        color=colour,
                        ms=5.5,
                        elinewidth=0.8,
                        capsize=2,
                        **look,
                    )
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_xlabel(label, fontsize=11)
        axis.grid(alpha=0.3, which="both")
        axis.legend(
            frameon=False,
            fontsize=11,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.1),
            title=f"exponents of the chains with n ≥ {LEAST}",
        )
    axes[0].set_xticks(ticks := [1, 2, 3, 5, 7, 10, 14, 20, 30, 38], map(str, ticks))
    axes[1].set_xticks(ticks := [5, 10, 20, 50, 100, 200, 500], map(str, ticks))
    for axis in axes:
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
    axes[0].set_ylabel("time per step [µs]", fontsize=11)
    figure.suptitle(
        "Serial chains, p = 13 n (lines), robots held or floating (open marks), vehicles (crosses)",
        fontsize=13,
    )
    save(figure, path)


def save(figure: Any, path: Path) -> None:
    """Writes a figure and closes it."""
    figure.savefig(path, dpi=110)
    plt.close(figure)


def growth(folder: Path) -> None:
    """Measures and plots the time per step."""
    here, found, rows = machine(), everything(), []
    for _ in range(ROUNDS):
        for _, actions in found:
            for action in actions.values():
                action.block()
    for row, actions in found:
        for name, action in actions.items():
            row[name] = np.percentile(action.times, [25, 50, 75]).tolist()
        rows.append(row)
        medians = ", ".join(f"{name} {row[name][1]:.1f}" for name in actions)
        print(f"{row['name']}: n {row['n']}, p {row['p']}; µs per step: {medians}")
    powers = {
        f"{name} against {x}": exponent(rows, name, x, LEAST) for name in STYLES for x in "np"
    }
    document = {
        "machine": here,
        "unit": "µs per step: quartile, median, quartile",
        "exponents": powers,
        "exponents_from_n": LEAST,
        "rows": rows,
    }
    (folder / "growth.json").write_text(json.dumps(document, indent=1) + "\n")
    draw_growth(rows, folder / "growth.png")


# -- memory ----------------------------------------------------------------------------------------


class Watch(Observer):
    """Records the process's resident memory once a minute of simulated time.

    Attributes:
        rows: simulated time [s] and resident memory [MB] of every sample.
    """

    def __init__(self) -> None:
        self.rows: list[tuple[float, float]] = []

    def start(self, scenario: Scenario, plant: Plant) -> None:
        """Does nothing: the first sample is that of the first stretch."""

    def see(
        self, measurement: Measurement, states: dict[str, State], levels: tuple[float, float]
    ) -> None:
        """Records the memory if a minute has passed since the last sample."""
        if measurement.t >= 60 * len(self.rows) - DT:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            self.rows.append((measurement.t, pages * PAGE))

    def stop(self) -> None:
        """Does nothing."""


def an_hour(name: str, law: str) -> None:
    """Runs a scenario for an hour of simulated time; prints its memory over time as JSON."""
    scenario = load(name)
    identifier = replace(scenario.identifier, law=law)
    scenario = replace(scenario, identifier=identifier, duration=3600.0, record_every=100)
    watch = Watch()
    with tempfile.TemporaryDirectory() as folder:
        ended = run(scenario, Path(folder), watch)
        size = (Path(folder) / "record.arrow").stat().st_size
    print(
        json.dumps(
            {
                "scenario": name,
                "law": law,
                "status": ended.ending.status.words,
                "wall_s": ended.cost.wall,
                "steps": ended.cost.steps,
                "record_bytes": size,
                "rows": watch.rows,
            }
        )
    )


def memory(folder: Path, names: list[str]) -> None:
    """Runs scenarios for an hour each, in separate processes, and plots their memory."""
    here, found = machine(), []
    for name in names:
        words = [sys.executable, __file__, "--one", name]
        done = subprocess.run(words, check=True, capture_output=True, text=True)
        found.append(json.loads(done.stdout.splitlines()[-1]))
        t, size = np.array(found[-1]["rows"]).T
        later = t >= 600
        slope = float(np.polyfit(t[later] / 3600, size[later], 1)[0])
        found[-1]["slope_MB_per_hour"] = slope
        print(
            f"{name}: {found[-1]['status']}, {slope:+.2f} MB/h after the first ten minutes, "
            f"{size[later].min():.1f} to {size[later].max():.1f} MB",
            flush=True,
        )
    document = {"machine": here, "unit": "s, MB resident", "runs": found}
    (folder / "memory.json").write_text(json.dumps(document, indent=1) + "\n")
    draw_memory(found, folder / "memory.png")


def draw_memory(found: list[dict[str, Any]], path: Path) -> None:
    """Plots the resident memory against simulated time."""
    figure, axis = plt.subplots(figsize=(9, 4.4), layout="constrained")
    for run_, (colour, mark, _) in zip(found, STYLES.values(), strict=False):
        t, size = np.array(run_["rows"]).T
        axis.plot(
            t / 60,
            size,
            color=colour,
            marker=mark,
            ms=4,
            lw=1.2,
            label=f"{run_['scenario']}, law {run_['law']}: "
            f"{run_['slope_MB_per_hour']:+.2f} MB/h after 10 min",
        )
    axis.set_ylim(0, 1.25 * max(size for run_ in found for _, size in run_["rows"]))
    axis.set_xlim(0, 60)
    axis.set_xlabel("simulated time [min]")
    axis.set_ylabel("resident memory of the process [MB]")
    axis.set_title("A run of an hour, 360 000 steps")
    axis.grid(alpha=0.3)
    axis.legend(loc="lower right")
    save(figure, path)


def long_log(seconds: float) -> None:
    """Prints what `nsaid identify` takes for a CSV log of six joints at 1 kHz."""
    with tempfile.TemporaryDirectory() as folder:
        path = Simulated("ur5", 0, seconds, plain=True, rate=1000.0).write(Path(folder) / "log.csv")
        nsaid = [Path(sys.executable).with_name("nsaid"), "identify", "--model", "ur5"]
        subprocess.run([*nsaid, "--log", path, "--out", f"{folder}/out"], check=False)
        size = path.stat().st_size / 1e6
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent, most = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
    print(f"{seconds:.0f} s, CSV of {size:.0f} MB: {spent:.0f} CPU s, {most:.0f} MB; {machine()}")


def main() -> None:
    """Measures time or, with --hour and --log, memory."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs"))
    parser.add_argument("--hour", action="store_true", help="measure memory instead of time")
    parser.add_argument("--scenarios", nargs="+", default=["bluerov2", "scalar_rov"])
    parser.add_argument("--log", type=float, nargs="?", const=3600.0, metavar="SECONDS")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.one:
        an_hour(chosen.one, "memory")
    elif chosen.log:
        long_log(chosen.log)
    elif chosen.hour:
        memory(chosen.folder, chosen.scenarios)
    else:
        growth(chosen.folder)


if __name__ == "__main__":
    main()
