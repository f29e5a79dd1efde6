"""Accuracy of `nsaid identify` on simulated logs that have what real ones have.

    python scripts/calibration.py [--robots ur5,panda] [--seeds 0:5] [--duration 40] [--rate 500]

MuJoCo moves an arm with hidden gains (± 30 %), frictions and inertias (± 20 %). The commands are
recorded in A with a quantised current, load-dependent friction and a constant offset are added to
them, they precede the motion by 15 ms, rows come at 500 Hz, or `--rate`, with jittered times and
one gap, and positions alone are measured. The model file has the nominal inertias; the scale is
fixed by one known gain. Prints errors of the gain ratios and whether the stated intervals hold.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from nsaid_mj.calibration.data import RobotModel
from nsaid_mj.calibration.identify import identify
from nsaid_mj.calibration.models import load_robot_model
from nsaid_mj.experiment.library import load
from nsaid_mj.experiment.setup import Setup
from nsaid_mj.plants.arm import true_model

DELAY, JITTER = 0.015, 2e-4
CONSTANT = 0.1  # nominal torque constant through the gear [N·m/A] over the joint's torque


class Simulated:
    """A log of an arm with its hidden gains.

    Args:
        name: of the scenario.
        seed: of plant, motion and noise.
        duration: [s].
        plain: leave out everything but noise.
        rate: rows per second.
    """

    def __init__(
        self, name: str, seed: int, duration: float, plain: bool = False, rate: float = 500.0
    ):
        scenario = load(name)
        scenario = replace(scenario, duration=duration, seed=seed, sensors="ideal")
        setup = Setup.of(scenario)
        with setup.plant.running():
            log = setup.simulate()
        rng = np.random.default_rng([seed, 13])
        true = setup.plant.truth
        model = true_model(setup.system.model, true)
        n = model.nv
        gain = true[setup.system.space["motor gain"]]
        coordinates = _coordinates(model, log.q)
        force = gain * log.u  # torque of the motors
        constant = rng.uniform(0.7, 1.3, n) * _typical(force) / 5.0  # N·m/A: about 5 A
        if not plain:
            weight = np.array(
                [pin.computeGeneralizedGravity(model, model.createData(), q)
                 for q in log.q]
            )  # fmt: skip
            force = force + 0.05 * np.tanh(log.v / 0.02) * np.abs(weight)
            force = force + 0.02 * _typical(force) * rng.uniform(-1, 1, n)
        current = force / constant
        if not plain:
            current = np.round(current / 0.004) * 0.004
        t = log.t[0] + np.arange(0, log.t[-1] - log.t[0], 1 / rate)
        shift = 0.0 if plain else DELAY
        u = np.column_stack([_held(t + shift, log.t, current[:, j]) for j in range(n)])
        jitter = 0.0 if plain else JITTER * rng.uniform(-1, 1, len(t))
        q = np.column_stack([np.interp(t + jitter, log.t, c) for c in coordinates.T])
        q = q + 1e-4 * rng.standard_normal(q.shape)
        keep = np.ones(len(t), dtype=bool)
        if not plain:
            keep[int(0.4 * len(t)) : int(0.4 * len(t) + 1.5 * rate)] = False
        self.t, self.q, self.u = (t + jitter)[keep], q[keep], u[keep]
        names = [str(j) for j in list(model.names)[1:]]
        arm = [j for j, name in enumerate(names) if "finger" not in name]  # they are locked
        self.q, self.u = self.q[:, arm], self.u[:, arm]
        self.gain, self.joints = constant[arm], [names[j] for j in arm]
        self.setup = setup

    def write(self, path: Path, **changes: object) -> Path:
        """Writes the log as CSV; `changes` may replace q or u."""
        q, u = np.asarray(changes.get("q", self.q)), np.asarray(changes.get("u", self.u))
        names = [f"{j}_position" for j in self.joints] + [f"{j}_current" for j in self.joints]
        table = np.column_stack([self.t, q, u])
        np.savetxt(path, table, delimiter=",", header=",".join(["time", *names]), comments="")
        return path


def _typical(force: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(force**2, axis=0))


def _held(at: np.ndarray, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    index = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 1)
    return u[index]


def _coordinates(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """(N, n) angles of Pinocchio's q."""
    found = np.empty((len(q), model.nv))
    for joint in list(model.joints)[1:]:
        if joint.nq == 2:
            angle = np.arctan2(q[:, joint.idx_q + 1], q[:, joint.idx_q])
            found[:, joint.idx_v] = np.unwrap(angle)
        else:
            found[:, joint.idx_v] = q[:, joint.idx_q]
    return found


def nominal_model(simulated: Simulated, seed: int) -> RobotModel:
    """The model file's robot, its inertias off by up to 20 % from the plant's."""
    robot = load_robot_model(simulated.setup.scenario.plant.robot, joints=simulated.joints)
    rng = np.random.default_rng([seed, 14])
    for i in range(1, robot.model.njoints):
        factor = 1 + 0.2 * rng.uniform(-1, 1)
        phi = factor * robot.model.inertias[i].toDynamicParameters()
        robot.model.inertias[i] = pin.Inertia.FromDynamicParameters(phi)
    return robot


def main() -> None:
    """Runs the trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default="ur5,panda,kinova")
    parser.add_argument("--seeds", default="0:5")
    parser.add_argument("--duration", type=float, default=40.0)
    parser.add_argument("--plain", action="store_true")
    parser.add_argument("--rate", type=float, default=500.0)
    arguments = parser.parse_args()
    first, last = (int(part) for part in arguments.seeds.split(":"))
    total, held = 0, 0
    for name in arguments.robots.split(","):
        for seed in range(first, last):
            simulated = Simulated(name, seed, arguments.duration, arguments.plain, arguments.rate)
            robot = nominal_model(simulated, seed)
            with tempfile.TemporaryDirectory() as folder:
                path = simulated.write(Path(folder) / "log.csv")
                found = identify(robot, path, known={"gain_1": float(simulated.gain[0])})
            gains = found.of("motor gain")
            ratio = np.array([p.value for p in gains]) / simulated.gain
            inside = [p.low <= k <= p.high for p, k in zip(gains, simulated.gain, strict=True)]
            sure = [p.status == "identified" for p in gains]
            total += sum(sure)
            held += sum(a and b for a, b in zip(inside, sure, strict=True))
            delays = np.mean([j.delay for j in found.joints]) * 1e3
            print(f"{name} {seed}: {found.explains}, delay {delays:.1f} ms, {found.seconds:.1f} s")
            print("   gain/true", np.round(ratio, 3), "inside", np.array(inside, int))
            print("   half-width", np.round([p.high / p.value - 1 for p in gains], 3),
                  "".join("i" if s else "-" for s in sure))  # fmt: skip
            held_out = np.round([j.held_out for j in found.joints], 3)
            print("   NRMSE", held_out, np.round([j.least_squares for j in found.joints], 3))
    print(f"intervals of identified gains hold: {held} of {total}")


if __name__ == "__main__":
    main()
