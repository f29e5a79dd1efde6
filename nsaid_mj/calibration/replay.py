"""Compares a calibrated model with the log, by short simulations from measured states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from ..errors import InvalidInput
from ..logs.recordings import Recordings, Segment
from ..parameters import Array
from ..plants.world.coordinates import JointMap
from ..plants.world.quiet import quiet
from ..robot.identified import Identified
from ..robot.mjcf_export import mjcf_text
from ..robot.model import RobotModel
from ..robot.tree import actuators_of

_WINDOW = 0.2  # length of a simulation [s]
_LONGEST_STEP = 2e-3  # of the simulation [s]
_MOST = 1000  # windows, at most, of a long log: their rms is known to a few percent


def replay(robot: RobotModel, values: Identified, recordings: Recordings) -> Array:
    """(n,) rms position errors of the model that `write_mjcf` writes, driven by a log's commands.

    The simulations last 0.2 s each, and start at the measured positions and velocities. Errors are
    in rad or m, and inf where the simulation diverges.

    Raises:
        InvalidInput: the robot is a vehicle, or no segment lasts 0.2 s.
    """
    rows = sum(len(segment.log.t) for segment in recordings.segments)
    every = max(1, int(rows / (recordings.rate * _WINDOW * _MOST)))
    found = departures(robot, values, recordings, _WINDOW, every)
    if not len(found):
        remedy = "Use a log without so many gaps."
        raise InvalidInput("recordings", f"a segment of {_WINDOW:g} s", "shorter ones", remedy)
    error = np.sqrt(np.mean(found**2, axis=0))
    return np.where(np.isfinite(error), error, np.inf)


def departures(
    robot: RobotModel, values: Identified, recordings: Recordings, horizon: float, every: int = 1
) -> Array:
    """(N, n) simulated minus measured positions, driven by a log's commands [rad or m].

    After `horizon` [s], at least one sample, the simulation restarts from the measured position and
    velocity; inf for once per segment. Of these windows, only one of `every` so many is simulated.
    """
    assert robot.file is not None  # a tree of joints comes from a file
    folder = robot.file.resolve().parent
    mj = _compiled(mjcf_text(robot, values, folder), folder)
    joints = JointMap(mj, robot.joints)
    joint_ids = [mj.joint(name).id for name in robot.joints]
    command = {k: own[0] for k, i in enumerate(joint_ids) if (own := actuators_of(mj, i))}
    substeps = int(np.ceil(1 / (recordings.rate * _LONGEST_STEP)))
    mj.opt.timestep = 1 / (recordings.rate * substeps)
    found = [np.zeros((0, len(robot.joints)))]
    for segment in recordings.segments:
        length = len(segment.log.t) - 1
        samples = max(1, length if np.isinf(horizon) else round(horizon * recordings.rate))
        windows = _simulate(mj, joints, command, segment, samples, substeps, every)
        found.append(windows.reshape(-1, len(robot.joints)))
    return np.concatenate(found)


def _simulate(
    mj: Any,
    joints: JointMap,
    command: dict[int, int],
    segment: Segment,
    samples: int,
    substeps: int,
    every: int,
) -> Array:
    """(windows, samples, n) errors of position in one of `every` so many windows of a segment.

    `mj` is MuJoCo's model, `command` the number of the motor of each joint that has one, by the
    joint's; each of the `samples` time steps of a window takes `substeps` steps of the simulation.
    """
    log = segment.log
    starts = np.arange(0, len(log.t) - samples, samples * every)
    if not len(starts):
        return np.zeros((0, samples, log.v.shape[1]))
    data, kind = mujoco.MjData(mj), mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros((len(starts), mujoco.mj_stateSize(mj, kind)))
    for row, k in zip(state, starts, strict=True):
        joints.write(data, log.q[k], log.v[k])
        mujoco.mj_getState(mj, data, row, kind)
    control = np.zeros((len(starts), samples * substeps, mj.nu))
    within = starts[:, None] + np.arange(samples)
    u = log.u[within][:, :, list(command)]
    control[:, :, list(command.values())] = np.repeat(u, substeps, axis=1)
    with quiet():  # a simulation that diverges has a large error
        found: Any = rollout.rollout(mj, data, state, control)[0]
    position = joints.angles(found[:, substeps - 1 :: substeps])
    with np.errstate(invalid="ignore", over="ignore"):
        return position - log.q[within + 1]


def _compiled(text: str, folder: Path) -> Any:
    """MuJoCo's model of an MJCF text whose paths are relative to a folder, without contacts."""
    spec = mujoco.MjSpec.from_string(text)
    for directory in ("meshdir", "texturedir"):
        setattr(spec, directory, str(folder / getattr(spec, directory)))
    spec.option.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    return spec.compile()
