"""A small robot on three round feet in MuJoCo, for tests: three legs of three joints, an IMU."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from nsaid_mj.clinic.identify.ground.feet import feet_of, imu_pose
from nsaid_mj.clinic.identify.ground.rows import Ground, GroundRows
from nsaid_mj.clinic.identify.ground.search import filter_of
from nsaid_mj.clinic.identify.identify import recordings_of
from nsaid_mj.clinic.identify.models import floating, load_robot_model

GAINS = np.array([1.2, 0.8, 0.9, 1.1, 1.0, 0.85, 0.95, 1.15, 1.05])
"""Of the true motors [N·m per unit]; the model file has 2 each."""

_LEG = """
<body name="{name}_shoulder" pos="{x} {y} 0">
<inertial pos="0 0 0" mass="0.4" diaginertia="0.0005 0.0005 0.0005"/>
<joint name="{name}_tilt" axis="1 0 0" armature="0.01" damping="0.1" frictionloss="0.02"/>
<body name="{name}_thigh" pos="0 0.03 0">
  <inertial pos="0 0 -0.1" mass="0.8" diaginertia="0.004 0.004 0.001"/>
  <joint name="{name}_hip" axis="0 1 0" armature="0.01" damping="0.1" frictionloss="0.02"/>
  <body name="{name}_shank" pos="0 0 -0.2">
    <inertial pos="0 0 -0.1" mass="0.3" diaginertia="0.002 0.002 0.0002"/>
    <joint name="{name}_knee" axis="0 1 0" armature="0.01" damping="0.1" frictionloss="0.02"/>
    <geom name="{name}_foot" type="sphere" size="0.02" pos="0 0 -0.2" mass="0"/>
  </body>
</body></body>"""
_STANDING = 500  # steps before the log begins
_LEGS = {"left": (0.2, 0.25), "right": (0.2, -0.25), "hind": (-0.35, 0.0)}  # it stays upright


def model_text(servos: bool = False) -> str:
    """The MJCF of the robot as its user has it, with motors or with position servos."""
    legs = "".join(_LEG.format(name=n, x=x, y=y) for n, (x, y) in _LEGS.items())
    joints = [f"{leg}_{joint}" for leg in _LEGS for joint in ("tilt", "hip", "knee")]
    motors = "".join(f'<motor name="{j}" joint="{j}" gear="2"/>' for j in joints)
    if servos:
        motors = "".join(f'<position name="{j}" joint="{j}" kp="150" kv="4"/>' for j in joints)
    return f"""<mujoco model="tripod"><compiler angle="radian"/>
<option timestep="0.001" integrator="implicitfast"/>
<worldbody><geom name="floor" type="plane" size="0 0 1"/>
<body name="trunk" pos="0 0 0.4"><freejoint name="root"/>
<inertial pos="0 0 0" mass="5" diaginertia="0.06 0.08 0.1"/>
<site name="imu" pos="0.05 0 0.03"/>{legs}</body></worldbody>
<actuator>{motors}</actuator>
<sensor><framequat objtype="site" objname="imu"/><gyro site="imu"/><accelerometer site="imu"/>
</sensor></mujoco>"""


class Walked(NamedTuple):
    """A simulated log."""

    model: Path  # what the user has
    log: Path  # positions, velocities, currents and the IMU
    joints: list[str]
    mass: float  # true mass of the whole robot [kg]


def walked(folder: Path, seconds: float = 12.0, rate: int = 250, servos: bool = False) -> Walked:
    """A log of squats of a robot whose trunk is heavier than the file says.

    With `servos` it logs position targets, which hold from row to row.
    """
    (folder / "tripod.xml").write_text(model_text(servos))
    spec = mujoco.MjSpec.from_string(model_text(servos))
    spec.body("trunk").mass = 6.2
    mj = spec.compile()
    joints = [mj.joint(j).name for j in range(1, mj.njnt)]
    for k, gain in enumerate(GAINS):
        if servos:
            mj.actuator_gainprm[k, 0] *= gain
            mj.actuator_biasprm[k, 1:3] *= gain
        else:
            mj.actuator_gear[k, 0] = gain
    data = mujoco.MjData(mj)
    rows = []
    data.qpos[2] = 0.36
    data.qpos[7:] = _target(0.0)
    every = round(1 / (rate * mj.opt.timestep))
    for step in range(-_STANDING, round(seconds / mj.opt.timestep)):
        t = step * mj.opt.timestep
        wanted = _target(max(t, 0.0))
        if not servos:
            data.ctrl[:] = (150 * (wanted - data.qpos[7:]) - 3 * data.qvel[6:]) / GAINS.mean()
        elif step % every == 0:
            data.ctrl[:] = wanted
        mujoco.mj_forward(mj, data)
        if step >= 0 and step % every == 0:
            rows.append(np.r_[t, data.qpos[7:], data.qvel[6:], data.ctrl, data.sensordata])
        mujoco.mj_step(mj, data)
    command = "target" if servos else "current"
    names = ["t", *(f"{what}_{j}" for what in ("q", "dq", command) for j in joints)]
    names += ["imu_quat_0", "imu_quat_1", "imu_quat_2", "imu_quat_3"]
    names += [f"{what}_{axis}" for what in ("imu_gyro", "imu_acc") for axis in "xyz"]
    log = folder / "walk.csv"
    np.savetxt(log, np.array(rows), delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    return Walked(folder / "tripod.xml", log, joints, float(mj.body_subtreemass[1]))


def _target(t: float) -> np.ndarray:
    """(9,) angles of the legs: the body rises, sinks, pitches and rolls."""
    q = []
    for leg in range(3):
        bend = 0.6 + 0.15 * np.sin(2.3 * t) + 0.06 * np.sin(5.1 * t + 2 * leg)
        swing = 0.06 * np.sin(3.1 * t + 1.3 * leg)
        tilt = 0.06 * np.sin(2.7 * t) + 0.02 * np.sin(5.3 * t + leg)
        q += [tilt, bend + swing, -2 * bend + 0.5 * swing]
    return np.array(q)


def rows_of(log: Walked) -> GroundRows:
    """The rows of a log under its model, all feet on the ground."""
    held = load_robot_model(str(log.model))
    recordings = recordings_of([log.log], None, held)
    robot = floating(held)
    feet, _ = feet_of(robot, recordings.contacts)
    assert recordings.imu is not None
    pose, _ = imu_pose(robot, recordings.imu)
    return GroundRows(robot, recordings, filter_of(recordings, 20.0), Ground(feet, pose), 4)
