"""The common scale that `nsaid identify` finds on logs whose commands have unknown units.

    python scripts/scale.py [--robots ur5,panda,kinova,z1,xarm7] [--seeds 0:10] [--duration 30]

Inverse dynamics move an arm along random multisines. Its links are up to 25 % off the file's, each
by its own factor; the friction of the last three joints is 20 times a fifth of the torque that the
file's links need, that of the others once; rotors are a third of the joints' inertia, or thrice it
at a wrist. Currents are quantised, 10 ms early, and their constants unknown; positions have noise.
No number is known, so that the common scale rests on the file's masses. Prints the common scale of
the gains whose ratios the log tells over the true one, whether the intervals of these gains hold
it, the largest error of their ratios, and how many intervals of ratios hold.
"""

from __future__ import annotations

import argparse
import copy
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin

from nsaid_mj.calibration.data import RobotModel
from nsaid_mj.calibration.identify import identify
from nsaid_mj.calibration.links import positions
from nsaid_mj.calibration.models import load_robot_model

ROBOTS = ("ur5", "panda", "kinova", "z1", "xarm7")
RATE, DELAY, NOISE, STEPS = 250.0, 0.010, 5e-5, 4000  # Hz, s, rad, steps of the largest current
OFF, WRIST, TOLD = 0.25, 20.0, 0.2  # the last: relative half-width up to which a ratio is told


def arm(name: str) -> RobotModel:
    """The model file's robot without its fingers."""
    robot = load_robot_model(name)
    fingers = [j for j in robot.joints if "finger" in j.lower() or "gripper" in j.lower()]
    return load_robot_model(name, lock=fingers)


class Motion:
    """A random multisine of all joints: 0.1 to 0.8 Hz, inside their ranges and speeds."""

    def __init__(self, model: pin.Model, rng: np.random.Generator):
        low, high = (
            np.array([limit[j.idx_q] if j.nq == 1 else end for j in list(model.joints)[1:]])
            for limit, end in ((model.lowerPositionLimit, -2.0), (model.upperPositionLimit, 2.0))
        )
        low, high = np.maximum(low, -2.0), np.minimum(high, 2.0)
        self._centre = (low + high) / 2
        self._rate = 2 * np.pi * 0.1 * np.arange(1, 9)
        waves = rng.standard_normal((2, 8, model.nv)) / np.arange(1, 9)[:, None]
        t = np.arange(0, 10, 0.01)
        q, v = self._sum(waves, t, 0), self._sum(waves, t, 1)
        most = 0.6 * np.minimum(model.velocityLimit, 3.0)
        size = np.maximum(np.abs(q).max(0) / (0.45 * (high - low)), np.abs(v).max(0) / most)
        self._waves = waves / size

    def _sum(self, waves: np.ndarray, t: np.ndarray, order: int) -> np.ndarray:
        phase = t[:, None] * self._rate + order * np.pi / 2
        rate = self._rate**order
        return (np.cos(phase) * rate) @ waves[0] + (np.sin(phase) * rate) @ waves[1]

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(N, n) angles, velocities and accelerations."""
        q, v, a = (self._sum(self._waves, t, order) for order in range(3))
        return q + self._centre, v, a


class HeavyWrist:
    """A log of an arm that differs from its file.

    Args:
        name: of the robot.
        seed: of links, joints, motion and noise.
        duration: [s].
        off: largest relative deviation of a link's inertia from the file's.
    """

    def __init__(self, name: str, seed: int, duration: float, off: float = OFF):
        self.robot = arm(name)
        rng = np.random.default_rng([seed, 21])
        model, n = self.robot.model, len(self.robot.joints)
        self.true = true = pin.Model(model)
        for i in range(1, true.njoints):
            phi = (1 + off * rng.uniform(-1, 1)) * model.inertias[i].toDynamicParameters()
            true.inertias[i] = pin.Inertia.FromDynamicParameters(phi)
        self.t = np.arange(round(duration * RATE)) / RATE
        motion = Motion(model, rng)
        q, v, a = motion.at(self.t + DELAY)
        links = _torques(true, q, v, a)
        size = np.sqrt(np.mean(_torques(model, q, v, a) ** 2, axis=0))
        wrist = np.arange(n) >= n - 3
        share = 0.2 * size * np.where(wrist, WRIST, 1.0)
        viscous = share * rng.uniform(0.5, 1.5, n) / np.sqrt(np.mean(v**2, axis=0))
        coulomb = share * rng.uniform(0.5, 1.5, n)
        data, poses = true.createData(), positions(true, q[::250])
        inertia = np.mean([np.diag(pin.crba(true, data, pose)) for pose in poses], axis=0)
        rotor = inertia * np.where(wrist, 3.0, 0.3) * rng.uniform(0.5, 1.5, n)
        self._joint = rotor, viscous, coulomb
        force = links + self._on_joints(v, a)
        self.gain = rng.uniform(0.5, 2.0, n) * np.sqrt(np.mean(force**2, axis=0)) / 3.0
        self._record(motion, force, rng)

    def _on_joints(self, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        rotor, viscous, coulomb = self._joint
        return rotor * a + viscous * v + coulomb * np.tanh(v / 0.02)

    def _record(self, motion: Motion, force: np.ndarray, rng: np.random.Generator) -> None:
        u = force / self.gain
        self.u = np.round(u * STEPS / np.abs(u).max(axis=0)) * np.abs(u).max(axis=0) / STEPS
        q = motion.at(self.t)[0]
        self.q = q + NOISE * rng.standard_normal(q.shape)

    def loaded(self, seed: int, mass: float, centre: np.ndarray) -> HeavyWrist:
        """Another log of the same arm, with a small ball fixed to its last link.

        Args:
            seed: of motion and noise.
            mass: of the ball [kg].
            centre: (3,) of the ball in the frame of the last joint [m].
        """
        other, rng = copy.copy(self), np.random.default_rng([seed, 22])
        motion = Motion(self.robot.model, rng)
        true = pin.Model(self.true)
        ball = pin.Inertia.FromSphere(mass, 0.03)
        true.inertias[true.njoints - 1] += pin.Inertia(mass, centre, ball.inertia)
        q, v, a = motion.at(self.t + DELAY)
        other._record(motion, _torques(true, q, v, a) + self._on_joints(v, a), rng)
        return other

    def write(self, path: Path) -> Path:
        """Writes the log as CSV."""
        names = [f"{j}_{x}" for x in ("position", "current") for j in self.robot.joints]
        table = np.column_stack([self.t, self.q, self.u])
        np.savetxt(path, table, delimiter=",", header=",".join(["time", *names]), comments="")
        return path


def _torques(model: pin.Model, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """(N, n) torques of inertia and weight."""
    data = model.createData()
    rows = zip(positions(model, q), v, a, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows])


def main() -> None:
    """Runs the trials."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--seeds", default="0:10")
    parser.add_argument("--duration", type=float, default=30.0)
    arguments = parser.parse_args()
    first, last = (int(part) for part in arguments.seeds.split(":"))
    near, held, ratios, scales = [], [], [], []
    for name in arguments.robots.split(","):
        for seed in range(first, last):
            log = HeavyWrist(name, seed, arguments.duration)
            with tempfile.TemporaryDirectory() as folder:
                found = identify(log.robot, log.write(Path(folder) / "log.csv"))
            gains, true = found.of("motor gain"), log.gain
            off = np.log([p.value for p in gains] / true)
            half = np.array([np.inf if p.relative is None else p.relative for p in gains])
            told = half < TOLD if (half < TOLD).any() else half <= half.min()
            weight = told / np.maximum(half, 0.01) ** 2
            scale = float(np.exp(weight @ off / weight.sum()))
            inside = np.array([p.low <= k <= p.high for p, k in zip(gains, true, strict=True)])
            apart = np.abs(np.exp(off) / scale - 1)[told]
            near.append(1 / 1.3 <= scale <= 1.3)
            held.append(bool(inside[told].mean() > 0.5))
            ratios += (apart <= half[told]).tolist()
            scales.append(scale)
            marks = "".join("i" if p.status == "identified" else "-" for p in gains)
            print(f"{name} {seed}: {found.explains}, scale {scale:.2f}, inside "
                  f"{''.join('01'[i] for i in inside.astype(int))}, {marks}, "
                  f"ratios of {told.sum()} gains off by at most {apart.max():.1%}; all "
                  f"{np.round(np.exp(off), 2)}, {found.seconds:.1f} s")  # fmt: skip
    print(
        f"common scale {min(scales):.2f} to {max(scales):.2f}, within 1.3 × in {np.mean(near):.0%},"
        f" held by the intervals in {np.mean(held):.0%} of {len(near)} logs; "
        f"{np.mean(ratios):.0%} of {len(ratios)} intervals of ratios hold"
    )


if __name__ == "__main__":
    main()
