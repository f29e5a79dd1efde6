"""Robots in the manner of MuJoCo Menagerie, with known actuators, and logs of their motion.

Their files are a user's: what they say of actuators and joints is not what the simulated robots
have. Encoders have ticks, the clock jitters, and a command acts late.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

FOLDER = Path(__file__).parents[1] / "data" / "menagerie"
_HARD = [0.9999, 0.9999, 1e-3, 0.5, 2]


class Robot(NamedTuple):
    """A robot's file, and what its actuators and joints really are.

    Attributes:
        file: name of its MJCF.
        joints: (n,) those that are logged.
        kp: (n,) stiffness of the servos [N·m/rad]; 0 of motors.
        kv: (n,) damping of servo and joint [N·m·s/rad].
        friction: (n,) Coulomb friction [N·m].
        armature: (n,) [kg·m²].
        delay: of the command [s].
        rate: of the log [Hz].
        tick: of the encoders [rad].
        low: (n,) least and
        high: (n,) largest target [rad].
        speed: of the fastest moves [rad/s].
        step: of the simulation [s].
    """

    file: str
    joints: tuple[str, ...]
    kp: np.ndarray
    kv: np.ndarray
    friction: np.ndarray
    armature: np.ndarray
    delay: float
    rate: float
    tick: float
    low: np.ndarray
    high: np.ndarray
    speed: float
    step: float = 2.5e-4

    @property
    def path(self) -> Path:
        """Of the user's file."""
        return FOLDER / self.file


_ARM = ("pan", "shoulder", "elbow", "wrist")
STIFF_ARM = Robot(
    "position_arm.xml",
    _ARM,
    np.array([2100.0, 2300.0, 1900.0, 1700.0]),
    np.array([110.0, 140.0, 75.0, 60.0]),
    np.array([5.0, 7.0, 4.0, 2.0]),
    np.array([0.30, 0.35, 0.25, 0.12]),
    6e-3,
    500.0,
    2 * np.pi / 2**17,
    np.array([-1.5, -1.2, -1.5, -1.2]),
    np.array([1.5, 1.2, 1.5, 1.2]),
    4.0,
)
SOFT_ARM = STIFF_ARM._replace(
    kp=np.array([160.0, 190.0, 120.0, 70.0]),
    kv=np.array([14.0, 16.0, 9.0, 5.0]),
    friction=np.array([2.0, 3.0, 1.5, 0.7]),
    armature=np.array([0.30, 0.35, 0.25, 0.12]),
    delay=0.012,
    rate=100.0,
    tick=2 * np.pi / 2**14,
    speed=2.0,
)
HEAVY_ARM = Robot(
    "heavy_arm.xml",
    _ARM,
    np.array([20.0, 40.0, 22.0, 9.0]),
    np.array([0.8, 1.6, 0.9, 0.4]),
    np.array([0.2, 0.4, 0.3, 0.15]),
    np.array([0.02, 0.02, 0.015, 0.01]),
    0.02,
    50.0,
    2 * np.pi / 4096,
    -np.ones(4),
    np.ones(4),
    2.5,
    5e-4,
)
LEG = Robot(
    "leg.xml",
    ("FL_hip_joint", "FL_thigh_joint", "FL_calf_joint"),
    np.array([20.0, 21.0, 19.5]),
    np.array([0.55, 0.6, 0.7]),
    np.array([0.2, 0.25, 0.3]),
    np.array([0.011, 0.013, 0.025]),
    8e-3,
    200.0,
    2 * np.pi / 2**15,
    np.array([-0.5, 0.0, -2.3]),
    np.array([0.5, 1.6, -0.7]),
    15.0,
)
TORQUE_ARM = Robot(
    "torque_arm.xml",
    ("turret", "upper", "fore"),
    np.zeros(3),
    np.array([0.03, 0.04, 0.03]),
    np.array([0.15, 0.2, 0.1]),
    np.array([0.014, 0.016, 0.008]),
    2e-3,
    500.0,
    2 * np.pi / 2**16,
    np.array([-1.2, -1.2, -1.2]),
    np.array([1.2, 1.2, 1.2]),
    6.0,
)
_DRIVE = np.array([30.0, 12.0, 6.0]), np.array([2.0, 1.0, 0.4])
# of the controller that computes torques [N·m/rad, N·m·s/rad]


def true_model(robot: Robot, fixed: bool = True):
    """MuJoCo's model of the user's file with the true actuators, without delay."""
    spec = mujoco.MjSpec.from_file(str(robot.path))
    spec.option.timestep = robot.step
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for joint in spec.joints:
        if fixed and joint.type == mujoco.mjtJoint.mjJNT_FREE:
            spec.delete(joint)
    for k, name in enumerate(robot.joints):
        joint = spec.joint(name)
        joint.damping[:], joint.armature, joint.frictionloss = 0, robot.armature[k], 0
        joint.frictionloss = robot.friction[k]
        joint.solimp_friction[:], joint.solref_friction[:] = _HARD, [2 * robot.step, 1]
        (actuator,) = [a for a in spec.actuators if a.target == name]
        if robot.kp[k]:
            actuator.gainprm[0] = robot.kp[k]
            actuator.biasprm[:3] = [0, -robot.kp[k], -robot.kv[k]]
        else:
            joint.damping[0] = robot.kv[k]
    return spec.compile()


def targets(robot: Robot, rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """(N, n) moves from point to point at constant speeds, with pauses."""
    found = np.zeros((len(t), len(robot.joints)))
    for j, (low, high) in enumerate(zip(robot.low, robot.high, strict=True)):
        now, at = 0.0, (low + high) / 2
        points = [(now, at)]
        while now < t[-1]:
            goal, rate = rng.uniform(low, high), rng.uniform(0.2, 1) * robot.speed
            pause = now + rng.uniform(0, 0.4)
            now = pause + abs(goal - at) / rate + 1e-3
            points += [(pause, at), (now, goal)]
            at = goal
        found[:, j] = np.interp(t, *np.array(points).T)
    return found


def log(robot: Robot, seed: int, seconds: float = 30.0, command=targets, disturb=None):
    """(N,) times, (N, n) commands and (N, n) positions of one log.

    Commands of motors are the torques of a controller that follows the targets.

    Args:
        robot: what moves.
        seed: of motion and jitter.
        seconds: length.
        command: (N, n) of a robot, a generator and times.
        disturb: called with MuJoCo's model and data before every step.
    """
    rng, mj = np.random.default_rng(seed), true_model(robot)
    count = round(seconds * robot.rate)
    t = (np.arange(count) + rng.uniform(-0.1, 0.1, count)) / robot.rate
    t -= t[0]
    u, data = command(robot, rng, t), mujoco.MjData(mj)
    where = [mj.joint(name).qposadr[0] for name in robot.joints]
    own = [np.flatnonzero(mj.actuator_trnid[:, 0] == mj.joint(name).id)[0] for name in robot.joints]
    data.qpos[where] = u[0] if robot.kp.any() else 0.0
    ends = np.round(t / robot.step).astype(int)
    instants = np.arange(ends[-1]) * robot.step
    held = np.maximum(np.searchsorted(t, instants - robot.delay + 1e-9, side="right") - 1, 0)
    q = np.repeat(data.qpos[None, where], count, axis=0)
    for k in range(1, count):
        if not robot.kp.any():
            u[k - 1] = _DRIVE[0] * (u[k - 1] - data.qpos[where]) - _DRIVE[1] * data.qvel[where]
        for i in range(ends[k - 1], ends[k]):
            data.ctrl[own] = u[held[i]]
            if disturb is not None:
                disturb(mj, data)
            mujoco.mj_step(mj, data)
        q[k] = data.qpos[where]
    u[-1] = u[-1] if robot.kp.any() else u[-2]
    return t, u, np.round(q / robot.tick) * robot.tick


def write(path: Path, robot: Robot, t, u, q) -> Path:
    """A CSV file, with the joints' names."""
    command = "target" if robot.kp.any() else "torque"
    names = ["time", *(f"{command}_{n}" for n in robot.joints)]
    names += [f"position_{n}" for n in robot.joints]
    rows = np.column_stack([t, u, q])
    np.savetxt(path, rows, "%.9g", ",", header=",".join(names), comments="")
    return path
