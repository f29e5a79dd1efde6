"""Measures how computing time grows with the system's size.

    python -m scripts.growth [FOLDER]             time per step against size: growth.png, .json
    python -m scripts.growth --log [SECONDS]      time and memory of `nsaid identify` on a long log

Time: serial chains of 1 to 38 joints (xarm7s end to end), fixed-base and floating robots, and
vehicles, along a smooth motion. `compiled` is the identifier alone, along a log in one call; it is
compared with calls from Python at every time step, Pinocchio's backend, the law `memory`, and
MuJoCo's own step. No θ explains this motion, so the memory's solver takes several times longer than
in a run.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import matplotlib
import mujoco
import numpy as np
import pinocchio as pin

from nsaid_mj import ArmPlant, Measurement, NullspaceAID
from nsaid_mj.core.laws.base import State
from nsaid_mj.core.log import Log
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.core.structure.system import SecondOrderSystem
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.arm import nominal_scales
from nsaid_mj.robots.loading import Base, load_robot
from nsaid_mj.robots.tree import tree_spec
from tests.support.simulated_logs import Simulated

from .machine import machine

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
STYLES = {
    "compiled": ("#0b6e99", "o", "identifier, compiled"),
    "python": ("#5f3dc4", "s", "… called from Python at every step"),
    "memory": ("#c2255c", "D", "… with the memory, solved every 500 steps"),
    "pinocchio": ("#e8590c", "^", "identifier on Pinocchio"),
    "mujoco": ("#868e96", "v", "MuJoCo's RK4 step"),
}
Row = dict[str, Any]


def chain(joints: int) -> pin.Model:
    """A serial chain of the joints and links of xarm7s, mounted end to end."""
    arm, model = load_robot("xarm7").model, pin.Model()
    limits = (
        arm.upperEffortLimit,
        arm.upperVelocityLimit,
        arm.lowerPositionLimit,
        arm.upperPositionLimit,
    )
    for k in range(joints):
        i = 1 + k % arm.nq
        own = [limit[i - 1 : i] for limit in limits]
        model.addJoint(k, arm.joints[i], arm.jointPlacements[i], f"joint{k + 1}", *own)
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
    system, slow = (
        kind(model, scales, speed) for kind in (JointTree.checked, JointTree.by_pinocchio)
    )
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


def everything() -> Iterator[tuple[Row, dict[str, Timed]]]:
    """All systems: the first columns of their rows, and their timers."""
    made = [("chain", f"chain of {k}", tree(chain(k))) for k in JOINTS]
    made += [("robot", f"{n}, {base}", tree(load_robot(n, base).model)) for n, base in ROBOTS]
    made += [("vehicle", name, vehicle(name)) for name in VEHICLES]
    for kind, name, (system, timers) in made:
        yield {"kind": kind, "name": name, "n": system.n, "p": system.p}, timers


def exponent(rows: list[Row], of: str, against: str) -> float:
    """Exponent of a power law fitted to the medians of chains with n ≥ `LEAST`."""
    some = [row for row in rows if row["kind"] == "chain" and row["n"] >= LEAST]
    x, y = ([row[key] if key in "np" else row[key][1] for row in some] for key in (against, of))
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def growth(folder: Path) -> None:
    """Measures and plots the time per step."""
    here, found, rows = machine(), list(everything()), []
    for _ in range(ROUNDS):
        for _, timers in found:
            for timer in timers.values():
                timer.block()
    for row, timers in found:
        row |= {name: np.percentile(t.times, [25, 50, 75]).tolist() for name, t in timers.items()}
        rows.append(row)
        medians = ", ".join(f"{name} {row[name][1]:.1f}" for name in timers)
        print(f"{row['name']}: n {row['n']}, p {row['p']}; µs per step: {medians}")
    powers = {f"{name} against {x}": exponent(rows, name, x) for name in STYLES for x in "np"}
    document = {
        "machine": here,
        "unit": "µs per step: quartile, median, quartile",
        "exponents": powers,
        "exponents_from_n": LEAST,
        "rows": rows,
    }
    (folder / "growth.json").write_text(json.dumps(document, indent=1) + "\n")
    draw_growth(rows, folder / "growth.png")


def draw_growth(rows: list[Row], path: Path) -> None:
    """Plots the time per step against degrees of freedom and against parameters."""
    figure, axes = plt.subplots(1, 2, figsize=(12.5, 7.4), sharey=True, layout="constrained")
    labels = {"n": "degrees of freedom n", "p": "parameters p"}
    ticks = {"n": (1, 2, 3, 5, 7, 10, 14, 20, 30, 38), "p": (5, 10, 20, 50, 100, 200, 500)}
    for axis, x in zip(axes, "np", strict=True):
        for name, (colour, mark, what) in STYLES.items():
            label = f"{what}: ∝ {x}$^{{{exponent(rows, name, x):.2f}}}$"
            for kind, look in (
                ("chain", {"marker": mark, "lw": 1.4, "label": label}),
                ("robot", {"marker": mark, "ls": "", "mfc": "white"}),
                ("vehicle", {"marker": "x", "ls": ""}),
            ):
                if some := [row for row in rows if row["kind"] == kind and name in row]:
                    low, median, high = np.array([row[name] for row in some]).T
                    spread = [median - low, high - median]
                    look |= {"color": colour, "ms": 5.5, "elinewidth": 0.8, "capsize": 2}
                    axis.errorbar([row[x] for row in some], median, yerr=spread, **look)
        axis.set(xscale="log", yscale="log")
        axis.set_xlabel(labels[x], fontsize=11)
        axis.set_xticks(ticks[x], map(str, ticks[x]))
        axis.minorticks_off()
        axis.yaxis.set_major_formatter("{x:g}")
        axis.grid(alpha=0.3, which="both")
        axis.legend(
            frameon=False,
            fontsize=11,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.1),
            title=f"exponents of the chains with n ≥ {LEAST}",
        )
    axes[0].set_ylabel("time per step [µs]", fontsize=11)
    words = "Serial chains, p = 13 n (lines), robots held or floating (open marks), vehicles"
    figure.suptitle(f"{words} (crosses)", fontsize=13)
    figure.savefig(path, dpi=110)


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
    """Measures the time of steps or, with --log, of an identification."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs"))
    parser.add_argument("--log", type=float, nargs="?", const=3600.0, metavar="SECONDS")
    chosen = parser.parse_args()
    if chosen.log:
        long_log(chosen.log)
    else:
        growth(chosen.folder)


if __name__ == "__main__":
    main()
