"""`make bench`: the cost of a time step, as ratios measured within one process.

    python scripts/benchmark.py [FILE.json]

Blocks of time steps of both sides alternate, and the median and quartiles of the blocks' ratios are
printed, so that drift of the machine's clock affects both sides. The runs are complete: the
scenarios' plants, drivers and gains, and `experiment.run` with its record on disk. Then the cost of
256 identifiers along one motion, on two threads.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from machine import machine

from nsaid_mj import ArmPlant, Scenario
from nsaid_mj.core.log import Log
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.plants.jointed import Backend
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.setup import Setup
from nsaid_mj.plans.studies.montecarlo import follow, grouped, simulate
from nsaid_mj.plans.studies.study import seed_of

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
RUNS, THREADS, REPEATS = 256, 2, 5  # of the identifiers along one motion
MANY = 0.35  # largest acceptable share of a single identifier's step

Block = Callable[[], float]
"""Runs some time steps; returns the seconds for each."""
Comparison = tuple[str, Block, Block, float | None]
"""What is compared, our side, theirs, and the largest acceptable ratio, if there is any."""


def seven_joints(backend: Backend = "compiled") -> Scenario:
    """An arm of 7 joints and 91 parameters: no rotor inertias, low friction for its light wrist."""
    arm = ArmPlant(
        "xarm7", armature=0.0, damping=3e-3, friction=3e-3, friction_speed=0.3, backend=backend
    )
    return replace(load("ur5"), plant=arm, dt=1e-3)


def ur5(backend: Backend = "compiled") -> Scenario:
    """The scenario of a UR5, with a backend."""
    scenario = load("ur5")
    return replace(scenario, plant=replace(scenario.plant, backend=backend))  # type: ignore[call-arg]


def under(scenario: Scenario, law: str, steps: int) -> Scenario:
    """A scenario with another law and duration; `efficient` under noise, for which it is made."""
    scenario = replace(scenario, identifier=replace(scenario.identifier, law=law))
    if law == "efficient":
        return replace(scenario, sensors="noisy", duration=LASTING)
    return replace(scenario, duration=steps * scenario.dt)


def compared(what: str, ours: Block, theirs: Block, bar: float | None) -> dict[str, Any]:
    """Times both sides in alternating blocks, after one warm-up block of each, and prints a row."""
    ours()
    theirs()
    own, other = np.array([(ours(), theirs()) for _ in range(BLOCKS)]).T
    low, median, high = np.percentile(own / other, [25, 50, 75]).tolist()
    costs = 1e6 * float(np.median(own)), 1e6 * float(np.median(other))
    print(
        f"{median:6.2f} ({low:.2f} … {high:.2f}){f' (bar {bar:g})' if bar else ''}  {what}  "
        f"[{costs[0]:.1f} µs / {costs[1]:.2f} µs]",
        flush=True,
    )
    row: dict[str, Any] = {"what": what, "ratio": median, "quartiles": [low, high], "bar": bar}
    return row | {"ours_us": costs[0], "theirs_us": costs[1]}


def seconds(action: Callable[[], object], repeats: int = 2000) -> Block:
    """A block that measures the mean CPU time of an action, which other processes do not change."""

    def block() -> float:
        begin = time.process_time()
        for _ in range(repeats):
            action()
        return (time.process_time() - begin) / repeats

    return block


# -- the whole loop --------------------------------------------------------------------------------


def closed_loop(scenario: Scenario, law: str) -> Block:
    """The whole loop: plant, driver, identifier, excitation levels, record."""
    scenario = under(scenario, law, STEPS)

    def block() -> float:
        with tempfile.TemporaryDirectory() as folder:
            cost = run(scenario, Path(folder)).cost
        assert cost.steps == scenario.steps
        return cost.wall / cost.steps

    return block


def driven(scenario: Scenario) -> tuple[Plant, Driver, Log]:
    """A scenario's plant, its driver, and the log of its run."""
    setup = Setup.of(scenario)
    plant, driver = setup.plant, setup.driver()
    with plant.running():
        return plant, driver, plant.trajectory(driver, scenario.steps)


def plant_alone(scenario: Scenario) -> Block:
    """MuJoCo's RK4 along the scenario's motion, stepped from Python as a user would."""
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


def loops() -> Iterator[Comparison]:
    """Closed loops compared with MuJoCo alone, and the law `memory` with the other laws."""
    for name, scenario, laws, bar in (
        ("7 joints, 91 parameters, compiled", seven_joints(), LAWS, 2.0),
        ("7 joints, 91 parameters, Pinocchio", seven_joints("pinocchio"), LAWS[:1], 12.0),
        ("bluerov2", load("bluerov2"), WITH_FILTER, 2.0),
        ("ur5, compiled", ur5(), WITH_FILTER, None),
    ):
        alone = plant_alone(scenario)
        for law in laws:
            what = f"closed loop / MuJoCo RK4 alone: {name}, {law}"
            largest = {"paper": bar, "memory": 4.0, "efficient": 6.0}.get(law)
            yield what, closed_loop(scenario, law), alone, largest
        for other in laws[:2] if "memory" in laws else ():
            what = f"closed loop with memory / with the {other}'s law alone: {name}"
            blocks = closed_loop(scenario, "memory"), closed_loop(scenario, other)
            yield what, *blocks, 1.5 if other == "paper" else None


# -- the identifier --------------------------------------------------------------------------------


def following(scenario: Scenario, law: str, steps: int = 2000) -> Block:
    """An identifier follows a log in stretches of half a second, as in a run; CPU time."""
    scenario = under(scenario, law, steps)
    setup, steps = Setup.of(scenario), scenario.steps
    with setup.plant.running():
        log = setup.simulate()
    identifier = setup.identifiers()[""]
    stretch = max(1, round(0.5 / scenario.dt))

    def block() -> float:
        state = identifier.init(log.at(0))
        begin = time.process_time()
        for k in range(0, steps, stretch):
            state, _ = identifier.follow(state, log.part(k, k + stretch + 1))
        return (time.process_time() - begin) / steps

    return block


def step_by_step(scenario: Scenario, steps: int = 200) -> Block:
    """An identifier is called from Python at every sample (CPU time); the paper's law."""
    scenario = under(scenario, "paper", steps)
    rows, identifier = driven(scenario)[2].rows, Setup.of(scenario).identifiers()[""]

    def block() -> float:
        state = identifier.init(rows[0])
        begin = time.process_time()
        for k in range(steps):
            state = identifier.step(state, rows[k], rows[k + 1])
        return (time.process_time() - begin) / steps

    return block


def identifiers() -> Iterator[Comparison]:
    """Identifiers compared with one Pinocchio regressor, or with a MuJoCo step of a UR5."""
    arm: Any = seven_joints().plant.build(1e-3, 0)
    model, zero = arm.system.model, np.zeros(7)
    data, q = model.createData(), pin.neutral(model)
    regressor = seconds(lambda: pin.computeJointTorqueRegressor(model, data, q, zero, zero))
    over = "identifier RK4 step / one Pinocchio torque regressor"
    by_sample = "the same, sample by sample from Python"
    for law in LAWS:
        block, bar = following(seven_joints(), law), 4.0 if law == "paper" else None
        yield f"{over}: 91 parameters, {law}", block, regressor, bar
    yield f"{by_sample}: paper", step_by_step(seven_joints()), regressor, None
    for law in WITH_FILTER:
        yield f"{over} of 91 parameters: ur5, {law}", following(ur5(), law), regressor, None
    yield f"{by_sample}: ur5, paper", step_by_step(ur5()), regressor, None
    on_pinocchio = following(ur5("pinocchio"), "paper", 500)
    what = "the same, along a log on Pinocchio's regressors: ur5, paper"
    yield what, on_pinocchio, regressor, None

    robot = load("ur5").plant.build(1e-3, 0)
    robot.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    robot.reset(np.zeros(6), np.zeros(6))

    def euler() -> float:
        with robot.running():
            return seconds(lambda: mujoco.mj_step(robot.model, robot.data))()

    several = {"bluerov2": WITH_FILTER, "uvms": LAWS, "borinot": LAWS}
    for name in VEHICLES:
        for law in several.get(name, LAWS[:1]):
            what = f"identifier RK4 step / MuJoCo Euler step of a UR5: {name}, {law}"
            ours = following(load(name), law, 400 if name in ("uvms", "borinot") else 2000)
            yield what, ours, euler, 5.5 if law == "paper" else None


def many(name: str, scenario: Scenario) -> dict[str, Any]:
    """Wall and processor time per run and step of identifiers along one motion; prints a row.

    Simulation is not timed; drawing priors and building identifiers is. Nothing is evaluated. The
    ratio is that to the step of one identifier which follows the motion alone.
    """
    scenario = replace(under(scenario, "paper", 1000), initial_error=0.1, rivals={})
    draws = [replace(scenario, seed=seed_of(scenario.seed, k)) for k in range(RUNS)]
    alone = following(scenario, "paper", 1000)
    single = 1e6 * min(alone() for _ in range(REPEATS))
    times = []
    with ThreadPoolExecutor(THREADS) as pool:
        (course,) = simulate([scenario], pool)
        follow(course, grouped(draws, THREADS)[0])  # compiles
        for _ in range(REPEATS):
            begin = time.perf_counter(), time.process_time()
            waiting = [pool.submit(follow, course, group) for group in grouped(draws, THREADS)]
            ends = [run.following.ended for done in waiting for run in done.result()]
            assert not any(ends), "a run ended early, which would cost less"
            times.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    wall, processor = (1e6 * np.array(times) / (RUNS * scenario.steps)).T
    low, median, high = np.percentile(wall, [25, 50, 75]).tolist()
    p = course.setup.system.p
    what = f"{RUNS} runs on {THREADS} threads: {name}, {p} parameters, paper"
    ratio = median / single
    print(
        f"{ratio:6.2f} of one identifier's step (bar {MANY}): {what} [{median:.2f} µs]", flush=True
    )
    row = {"what": what, "us_per_run_and_step": median, "quartiles": [low, high], "ratio": ratio}
    return row | {"processor_us": float(np.median(processor))}


def main() -> None:
    """Prints a table; also writes JSON if a file is named."""
    where = machine()
    print(", ".join(f"{key} {value}" for key, value in where.items()), flush=True)
    rows = [compared(*each) for part in (loops, identifiers) for each in part()]
    seven = replace(load("xarm7"), plant=seven_joints().plant)
    scenarios = {"xarm7": seven, "ur5": ur5(), "bluerov2": load("bluerov2")}
    wide = [many(name, scenario) for name, scenario in scenarios.items()]
    if len(sys.argv) > 1:
        document = {"machine": where, "blocks": BLOCKS, "rows": rows, "monte_carlo": wide}
        Path(sys.argv[1]).write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
