"""`make bench`: the cost of a time step, as ratios measured within one process.

    python scripts/benchmark.py [FILE.json]

Blocks of time steps of both sides alternate, and the median and quartiles of the blocks' ratios are
printed, so that drift of the machine's clock affects both sides. The runs are complete: the
scenarios' plants, drivers and gains, and `experiment.run` with its record on disk.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from machine import machine
from wide import cost

from nsaid_mj import ArmPlant, Scenario
from nsaid_mj.control import Driver
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.loop import run
from nsaid_mj.experiment.setup import Setup, trajectory
from nsaid_mj.log import Log
from nsaid_mj.plants import Plant
from nsaid_mj.plants.arm import Backend

BLOCKS = 15
STEPS = 4000  # time steps of a closed loop in a block
LAWS = ("paper", "cone", "memory")
WITH_FILTER = (*LAWS, "efficient")
LASTING = 20.0  # time that the law `efficient` runs in a block; its memory pauses ever longer [s]
VEHICLES = (
    "scalar_rov",
    "bluerov2",
    "remus100",
    "hummingbird",
    "crazyflie",
    "f1tenth",
    "bmw320i",
    "astrobee",
    "borinot",
    "uvms",
)


def seven_joints(backend: Backend) -> Scenario:
    """An arm of 7 joints and 91 parameters: no rotor inertias, low friction for its light wrist."""
    arm = ArmPlant(
        "xarm7", armature=0.0, damping=3e-3, friction=3e-3, friction_speed=0.3, backend=backend
    )
    return replace(load("ur5"), plant=arm, dt=1e-3)


def arm_on(name: str, backend: Backend) -> Scenario:
    """The scenario of an arm, with a backend."""
    scenario = load(name)
    assert isinstance(scenario.plant, ArmPlant)
    return replace(scenario, plant=replace(scenario.plant, backend=backend))


@dataclass
class Row:
    """A comparison of two costs.

    Attributes:
        what: the two sides, in words.
        ours: seconds per step in every block.
        theirs: seconds per step in every block.
        bar: largest ratio that is acceptable, or None.
    """

    what: str
    ours: list[float]
    theirs: list[float]
    bar: float | None = None

    def summary(self) -> dict[str, Any]:
        """Median ratio, quartiles and costs, as in benchmark.json."""
        ratios = np.array(self.ours) / np.array(self.theirs)
        low, median, high = np.percentile(ratios, [25, 50, 75]).tolist()
        return {
            "what": self.what,
            "ratio": median,
            "quartiles": [low, high],
            "bar": self.bar,
            "ours_us": 1e6 * float(np.median(self.ours)),
            "theirs_us": 1e6 * float(np.median(self.theirs)),
        }


def alternating(
    what: str, ours: Callable[[], float], theirs: Callable[[], float], bar: float | None = None
) -> Row:
    """Times both sides in alternating blocks, after one warm-up block of each."""
    ours()
    theirs()
    pairs = [(ours(), theirs()) for _ in range(BLOCKS)]
    return Row(what, [a for a, _ in pairs], [b for _, b in pairs], bar)


def seconds(action: Callable[[], object], repeats: int) -> Callable[[], float]:
    """A block that measures the mean time of an action [s]."""

    def block() -> float:
        begin = time.perf_counter()
        for _ in range(repeats):
            action()
        return (time.perf_counter() - begin) / repeats

    return block


# -- the whole loop --------------------------------------------------------------------------------


def under(scenario: Scenario, law: str, steps: int) -> Scenario:
    """A scenario with another law and duration; `efficient` under noise, for which it is made."""
    scenario = replace(scenario, identifier=replace(scenario.identifier, law=law))
    if law == "efficient":
        return replace(scenario, sensors="noisy", duration=LASTING)
    return replace(scenario, duration=steps * scenario.dt)


def closed_loop(scenario: Scenario, law: str) -> Callable[[], float]:
    """A block that runs the whole loop: plant, driver, identifier, excitation levels, record."""
    scenario = under(scenario, law, STEPS)

    def block() -> float:
        with tempfile.TemporaryDirectory() as folder:
            cost = run(scenario, Path(folder)).cost
        assert cost.steps == scenario.steps
        return cost.wall / cost.steps

    return block


def plant_alone(scenario: Scenario) -> Callable[[], float]:
    """A block of MuJoCo's RK4 along the scenario's motion, stepped from Python as a user would."""
    plant, driver, log = driven(replace(scenario, duration=STEPS * scenario.dt))

    def block() -> float:
        with plant.running():
            plant.reset(*driver.start())
            model, data, ctrl = plant.model, plant.data, plant.data.ctrl
            begin = time.perf_counter()
            for u in log.u[:-1]:
                ctrl[:] = u
                mujoco.mj_step(model, data)
            return (time.perf_counter() - begin) / STEPS

    return block


def driven(scenario: Scenario) -> tuple[Plant, Driver, Log]:
    """A scenario's plant, its driver, and the log of its run."""
    setup = Setup.of(scenario)
    plant, driver = setup.plant, setup.driver()
    with plant.running():
        return plant, driver, trajectory(plant, driver, scenario.steps)


def loops() -> list[Row]:
    """Closed loops compared with MuJoCo alone, and the law `memory` with the other laws."""
    rows = []
    for name, scenario, laws, bar in (
        ("7 joints, 91 parameters, compiled", seven_joints("compiled"), LAWS, 2.0),
        ("7 joints, 91 parameters, Pinocchio", seven_joints("pinocchio"), LAWS[:1], 10.0),
        ("bluerov2", load("bluerov2"), WITH_FILTER, 3.0),
        ("ur5, compiled", arm_on("ur5", "compiled"), WITH_FILTER, None),
    ):
        alone = plant_alone(scenario)
        for law in laws:
            rows.append(
                alternating(
                    f"closed loop / MuJoCo RK4 alone: {name}, {law}",
                    closed_loop(scenario, law),
                    alone,
                    {"paper": bar, "efficient": 6.0}.get(law),
                )
            )
        for other in laws[:2] if "memory" in laws else ():
            rows.append(
                alternating(
                    f"closed loop with memory / with the {other}'s law alone: {name}",
                    closed_loop(scenario, "memory"),
                    closed_loop(scenario, other),
                    1.5 if other == "paper" else None,
                )
            )
    return rows


# -- the identifier --------------------------------------------------------------------------------


def following(scenario: Scenario, law: str, steps: int = 2000) -> Callable[[], float]:
    """A block in which an identifier follows a log in stretches of half a second, as in a run."""
    scenario = under(scenario, law, steps)
    setup, steps = Setup.of(scenario), scenario.steps
    with setup.plant.running():
        log = setup.simulate()
    identifier = setup.identifiers()[""]
    stretch = max(1, round(0.5 / scenario.dt))

    def block() -> float:
        state = identifier.init(log.at(0))
        begin = time.perf_counter()
        for k in range(0, steps, stretch):
            state, _ = identifier.follow(state, log.part(k, k + stretch + 1))
        return (time.perf_counter() - begin) / steps

    return block


def step_by_step(scenario: Scenario, law: str, steps: int = 200) -> Callable[[], float]:
    """A block in which an identifier is called from Python at every sample, as on a robot."""
    scenario = replace(
        scenario, duration=steps * scenario.dt, identifier=replace(scenario.identifier, law=law)
    )
    log = driven(scenario)[2]
    rows, identifier = log.rows, Setup.of(scenario).identifiers()[""]

    def block() -> float:
        state = identifier.init(rows[0])
        begin = time.perf_counter()
        for k in range(steps):
            state = identifier.step(state, rows[k], rows[k + 1])
        return (time.perf_counter() - begin) / steps

    return block


def identifiers() -> list[Row]:
    """Identifiers compared with one Pinocchio regressor, or with a MuJoCo step of a UR5."""
    scenario, rows = seven_joints("compiled"), []
    robot: Any = scenario.plant.build(scenario.dt, 0)
    model, zero = robot.system.model, np.zeros(7)
    data = model.createData()
    q = pin.neutral(model)
    regressor = seconds(lambda: pin.computeJointTorqueRegressor(model, data, q, zero, zero), 2000)
    for law in LAWS:
        what = f"identifier RK4 step / one Pinocchio torque regressor: 91 parameters, {law}"
        bar = 4.0 if law == "paper" else None
        rows.append(alternating(what, following(scenario, law), regressor, bar))
    rows.append(
        alternating(
            "the same, sample by sample from Python: paper",
            step_by_step(scenario, "paper"),
            regressor,
        )
    )
    for law in WITH_FILTER:
        what = f"identifier RK4 step / one Pinocchio torque regressor of 91 parameters: ur5, {law}"
        rows.append(alternating(what, following(arm_on("ur5", "compiled"), law), regressor))
    rows += [
        alternating(
            "the same, sample by sample from Python: ur5, paper",
            step_by_step(arm_on("ur5", "compiled"), "paper"),
            regressor,
        ),
        alternating(
            "the same, along a log on Pinocchio's regressors: ur5, paper",
            following(arm_on("ur5", "pinocchio"), "paper", 500),
            regressor,
        ),
    ]
    arm = load("ur5").plant.build(1e-3, 0)
    arm.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    arm.reset(np.zeros(6), np.zeros(6))

    def euler() -> float:
        with arm.running():
            return seconds(lambda: mujoco.mj_step(arm.model, arm.data), 2000)()

    for name in VEHICLES:
        several = {"bluerov2": WITH_FILTER, "uvms": LAWS, "borinot": LAWS}
        for law in several.get(name, LAWS[:1]):
            what = f"identifier RK4 step / MuJoCo Euler step of a UR5: {name}, {law}"
            ours = following(load(name), law, 400 if name in ("uvms", "borinot") else 2000)
            rows.append(alternating(what, ours, euler, 5.0 if law == "paper" else None))
    return rows


def main() -> None:
    """Prints a table; also writes JSON if a file is named."""
    where = machine()
    print(", ".join(f"{key} {value}" for key, value in where.items()), flush=True)
    summaries = []
    for part in (loops, identifiers):
        for row in part():
            summaries.append(row.summary())
            print_summary(summaries[-1])
    wide = []
    for name in ("xarm7", "ur5", "bluerov2"):
        wide.append(cost(name, "paper"))
        print(
            f"{wide[-1]['us_per_run_and_step']:6.2f} µs per run and step: {wide[-1]['what']}",
            flush=True,
        )
    if len(sys.argv) > 1:
        document = {"machine": where, "blocks": BLOCKS, "rows": summaries, "monte_carlo": wide}
        Path(sys.argv[1]).write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")


def print_summary(row: dict[str, Any]) -> None:
    """Prints a comparison in one line."""
    low, high = row["quartiles"]
    bar = f" (bar {row['bar']:g})" if row["bar"] else ""
    print(
        f"{row['ratio']:6.2f} ({low:.2f} … {high:.2f}){bar}  {row['what']}  "
        f"[{row['ours_us']:.1f} µs / {row['theirs_us']:.2f} µs]",
        flush=True,
    )


if __name__ == "__main__":
    main()
