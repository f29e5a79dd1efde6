"""`make bench`: what a step costs, as ratios measured inside one process.

Blocks of steps of both sides alternate, and the median of the blocks' ratios is told with its
quartiles, so that a machine whose clock drifts changes neither side alone.
"""

import json
import platform
import sys
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from nsaid_mj import ArmPlant, Measurement, NullspaceAID, ScalarRovPlant
from nsaid_mj.cli import load
from nsaid_mj.plants import Plant

BLOCKS = 60
VEHICLES = ("bluerov2", "remus100", "hummingbird", "crazyflie", "f1tenth", "bmw320i", "astrobee")


def seconds(action: Callable[[], object], repeats: int) -> float:
    """Mean time of an action [s]."""
    begin = time.perf_counter()
    for _ in range(repeats):
        action()
    return (time.perf_counter() - begin) / repeats


def compare(
    ours: Callable[[], object], theirs: Callable[[], object], repeats: int = 100
) -> dict[str, float | list[float]]:
    """Cost of ours over theirs: median and quartiles of alternating blocks."""
    seconds(ours, 20)
    seconds(theirs, 20)
    rows = np.array([(seconds(ours, repeats), seconds(theirs, 5 * repeats)) for _ in range(BLOCKS)])
    low, median, high = np.percentile(rows[:, 0] / rows[:, 1], [25, 50, 75])
    return {
        "ratio": float(median),
        "quartiles": [float(low), float(high)],
        "ours_us": float(1e6 * np.median(rows[:, 0])),
        "theirs_us": float(1e6 * np.median(rows[:, 1])),
    }


def identifier_step(plant: Plant, dt: float) -> Callable[[], object]:
    """One RK4 step of (44, 45) on a random motion."""
    system, rng = plant.system, np.random.default_rng(0)
    q, v, u = system.random_state(rng)
    a = system.acceleration(0.0, np.r_[q, v], v, u, plant.truth)
    first = Measurement(0.0, q, v, u)
    second = Measurement(dt, system.integrate(q, dt * v + 0.5 * dt**2 * a), v + dt * a, u)
    law = NullspaceAID().build(system, plant.truth, dt)
    state = law.init(first)
    assert law.step(state, first, second).pivot > 0
    return lambda: law.step(state, first, second)


def plant_step(plant: Plant, integrator: int) -> Callable[[], object]:
    """One step of MuJoCo from rest, with everything the plant needs."""
    plant.reset(np.zeros(plant.system.n), np.zeros(plant.system.n))
    plant.model.opt.integrator = integrator
    return lambda: mujoco.mj_step(plant.model, plant.data)


def benchmarks() -> list[dict]:
    """All rows."""
    rows = []
    arms = [("xarm7", 0.0), ("xarm7", None), ("ur5", 0.1)]
    for robot, armature in arms:
        plant = ArmPlant(robot, armature=armature).build(1e-3, 0)
        system = plant.system
        name = f"{robot}, {system.n} joints, {system.p} parameters"
        step = identifier_step(plant, 1e-3)
        with plant.running():
            euler = plant_step(plant, mujoco.mjtIntegrator.mjINT_EULER)
            rows.append({"what": f"identifier RK4 step / MuJoCo Euler step: {name}",
                         **compare(step, euler)})  # fmt: skip
            rk4 = plant_step(plant, mujoco.mjtIntegrator.mjINT_RK4)
            rows.append({"what": f"identifier RK4 step / MuJoCo RK4 step: {name}",
                         **compare(step, rk4)})  # fmt: skip
        model, data = plant.robot.model, plant.robot.model.createData()
        q, zero = pin.neutral(model), np.zeros(model.nv)
        rows.append({
            "what": f"identifier RK4 step / one Pinocchio torque regressor: {name}",
            **compare(step, lambda m=model, d=data, q=q, z=zero: (
                pin.computeJointTorqueRegressor(m, d, q, z, z))),
        })  # fmt: skip
    rov = ScalarRovPlant().build(0.01, 0)
    with rov.running():
        euler = plant_step(rov, mujoco.mjtIntegrator.mjINT_EULER)
        rows.append({"what": "identifier RK4 step / MuJoCo Euler step: scalar_rov, 4 parameters",
                     **compare(identifier_step(rov, 0.01), euler)})  # fmt: skip
    return rows + vehicles()


def vehicles() -> list[dict]:
    """Vehicles' identifiers against a UR5 in MuJoCo, and what an exact callback costs a plant."""
    rows = []
    arm = ArmPlant("ur5", armature=0.1).build(1e-3, 0)
    for name in VEHICLES:
        scenario = load(name)
        plant = scenario.plant.build(scenario.dt, 0)
        with arm.running():
            euler = plant_step(arm, mujoco.mjtIntegrator.mjINT_EULER)
            what = f"identifier RK4 step / MuJoCo Euler step of a UR5: {name}, "
            rows.append({"what": what + f"{plant.system.p} parameters",
                         **compare(identifier_step(plant, scenario.dt), euler)})  # fmt: skip
    plant = load("bluerov2").plant.build(0.01, 0)
    callback: Any = plant.passive
    rk4 = plant_step(plant, mujoco.mjtIntegrator.mjINT_RK4)
    mujoco.mj_resetData(plant.model, plant.data)

    def with_callback() -> None:
        mujoco.set_mjcb_passive(callback.ctypes)
        for _ in range(100):
            rk4()
        mujoco.set_mjcb_passive(None)

    def without() -> None:
        for _ in range(100):
            rk4()

    try:
        rows.append({"what": "100 RK4 steps of bluerov2 with / without the hydrodynamic callback",
                     **compare(with_callback, without, 5)})  # fmt: skip
    finally:
        mujoco.set_mjcb_passive(None)
    return rows


def main() -> None:
    """Prints a table and writes benchmark.json beside where it runs."""
    rows = benchmarks()
    machine = {
        "machine": platform.machine(),
        "processor": next((line.split(":")[1].strip() for line in
                           Path("/proc/cpuinfo").read_text().splitlines()
                           if line.startswith("model name")), platform.processor())
        if Path("/proc/cpuinfo").is_file() else platform.processor(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("mujoco", "pin", "numpy", "numba")},
    }  # fmt: skip
    print(", ".join(f"{key} {value}" for key, value in machine.items()))
    for row in rows:
        low, high = row["quartiles"]
        print(f"{row['ratio']:6.1f} ({low:.1f} … {high:.1f})  {row['what']}  "
              f"[{row['ours_us']:.1f} µs / {row['theirs_us']:.2f} µs]")  # fmt: skip
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(json.dumps({"machine": machine, "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
