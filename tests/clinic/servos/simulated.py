"""An SO-101 with known servos, simulated by MuJoCo alone, and logged as the real one is.

50 Hz with ±2 ms of jitter, ticks of a 4096th of a turn, joints read one after another. Friction is
hard and the time step short, so that it sticks and slips as Coulomb's law says.
"""

from pathlib import Path

import mujoco
import numpy as np
from scipy.signal import lfilter

from nsaid_mj.robots.assets import asset

MODEL = asset("so101", "so101.xml")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
KP = np.array([14.0, 15.0, 12.0, 11.0, 9.0, 8.0])  # [N·m/rad]
T = np.array([0.06, 0.05, 0.07, 0.055, 0.06, 0.05])  # kv/kp [s]
F = np.array([0.012, 0.03, 0.035, 0.015, 0.012, 0.006])  # friction/kp [rad]
ARMATURE, DELAY, SKEW, STEP = 0.02, 0.015, 3e-4, 5e-4  # [kg·m², s, s, s]
PLACE = (0.01, 0.0, -0.09)  # of a load, in the gripper's frame [m]
TICK = 2 * np.pi / 4096


def arm(heavier=1.0, load=0.0):
    """MuJoCo's model with the true servos; the delay is applied by `log`.

    Args:
        heavier: the true masses over those of the file.
        load: mass of a ball in the gripper [kg].
    """
    spec = mujoco.MjSpec.from_file(str(MODEL))
    for body in spec.bodies[1:]:
        body.mass *= heavier
        body.fullinertia *= heavier
        body.inertia *= heavier
    if load:
        spec.body("gripper").add_body(
            pos=PLACE,
            ipos=[0, 0, 0],
            mass=load,
            inertia=[0.4 * load * 0.03**2] * 3,
            explicitinertial=True,
        )
    spec.option.timestep = STEP
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    for k, servo in enumerate(spec.actuators):
        servo.gainprm[0], servo.biasprm[:3] = KP[k], [0, -KP[k], -KP[k] * T[k]]
        servo.forcelimited = 0
        joint = spec.joint(servo.target)
        joint.damping[:], joint.armature, joint.frictionloss = 0, ARMATURE, KP[k] * F[k]
        joint.solimp_friction[:], joint.solref_friction[:] = (
            [0.9999, 0.9999, 1e-3, 0.5, 2],
            [1e-3, 1],
        )
    return spec.compile()


def targets(rng, t, speed=2.5):
    """(N, 6) moves from point to point at constant speeds, with pauses, inside the limits."""
    low, high = np.array([-1.0] * 5 + [0.1]), np.array([1.0] * 5 + [1.0])
    found = np.zeros((len(t), 6))
    for j in range(6):
        now, at = 0.0, max(low[j], 0.0)
        points = [(now, at)]
        while now < t[-1]:
            goal, rate = rng.uniform(low[j], high[j]), rng.uniform(0.4, 1) * speed
            pause = now + rng.uniform(0, 0.7)
            now = pause + abs(goal - at) / rate + 0.02
            points += [(pause, at), (now, goal)]
            at = goal
        found[:, j] = np.interp(t, *np.array(points).T)
    return np.round(found / TICK) * TICK


def limited(most):
    """What a controller makes of targets (M, 6), step by step, that follows at a speed [rad/s]."""

    def follow(wanted):
        found = wanted.copy()
        for k in range(1, len(found)):
            off = wanted[k] - found[k - 1]
            found[k] = found[k - 1] + np.clip(off, -most * STEP, most * STEP)
        return found

    return follow


def smoothed(lag):
    """What a controller makes of targets (M, 6), step by step, that smooths over a time [s]."""
    b, a = [STEP / lag], [1, STEP / lag - 1]
    return lambda wanted: wanted[0] + lfilter(b, a, wanted - wanted[0], axis=0)


def log(
    seed,
    seconds=40.0,
    speed=2.5,
    push=None,
    heavier=1.0,
    load=0.0,
    change=None,
    follow=None,
    stiffer=1.0,
):
    """(N,) times, (N, 6) targets and (N, 6) positions of one log.

    Args:
        seed: of the motion.
        seconds: length.
        speed: of the fastest moves [rad/s].
        push: begin [s], end [s] and torque [N·m] of a external force on the shoulder's lift.
        heavier: the true masses over those of the file.
        load: mass of a ball in the gripper [kg].
        change: called with MuJoCo's model and data before every step.
        follow: what the controller makes of the targets, see `limited`.
        stiffer: kp over `KP`; kv stays.
    """
    rng, mj = np.random.default_rng(seed), arm(heavier, load)
    mj.actuator_gainprm[:, 0] *= stiffer
    mj.actuator_biasprm[:, 1] *= stiffer
    t = np.arange(0, seconds, 0.02) + rng.uniform(-2e-3, 2e-3, round(seconds / 0.02))
    t -= t[0]
    u = targets(rng, t, speed)
    data, ends = mujoco.MjData(mj), np.round(t / STEP).astype(int)
    data.qpos[:] = u[0]
    instants = np.arange(ends[-1]) * STEP
    held = np.maximum(np.searchsorted(t, instants - DELAY + 1e-9, side="right") - 1, 0)
    acting = u[held] if follow is None else follow(u[held])
    q = np.repeat(u[:1], len(t), axis=0)
    for k in range(1, len(t)):
        for i in range(ends[k - 1], ends[k]):
            data.ctrl[:] = acting[i]
            if push is not None:
                data.qfrc_applied[1] = push[2] if push[0] < instants[i] < push[1] else 0.0
            if change is not None:
                change(mj, data)
            mujoco.mj_step(mj, data)
        q[k] = data.qpos
    q += np.gradient(q, t, axis=0) * SKEW * np.arange(6)
    return t, u, np.round(q / TICK) * TICK


def write(path: Path, t, u, q) -> Path:
    """A CSV file with the real log's names of columns."""
    names = ["time", *(f"target_{n}" for n in JOINTS), *(f"position_{n}" for n in JOINTS)]
    rows = np.column_stack([t, u, q])
    np.savetxt(path, rows, "%.7g", ",", header=",".join(names), comments="")
    return path
