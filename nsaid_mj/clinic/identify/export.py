"""Calibrated model files of an identification, and their trial by simulations on the log."""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from ...base import Finding, InvalidInput, NsaidError
from ...core import Array, number
from ...lab import JointMap
from ...robots import (
    Identified,
    RobotModel,
    SharedFriction,
    Spring,
    actuators_of,
    mjcf_text,
    quiet,
    with_inertias,
    write_model,
    write_table,
)
from ..logs.recordings import Recordings
from .joints import joint_of
from .result import Identification
from .smoothing import fed_back


def write_models(result: Identification, folder: Path) -> tuple[list[Path], list[Finding]]:
    """Writes the calibrated model, in all formats that can represent it, into a folder.

    Returns the files, and the deviation of the exported model from the log.

    Raises:
        NotWritten: a file of the user's is in the way, or the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    robot = result.robot
    files = [folder / "calibrated.yaml"]
    write_parameters(result, files[0])
    if robot.model is None:
        return files, []
    values = identified(result)
    if robot.kind == "urdf":
        files.append(folder / f"{_file_name(robot.name)}.urdf")
        write_model(robot, values, files[-1])
    files.append(folder / f"{_file_name(robot.name)}.xml")
    write_model(robot, values, files[-1])
    files.append(folder / "sysid.yaml")
    write_model(robot, values, files[-1])
    return files, [_followed(result, values)]


def with_trial(result: Identification, findings: Sequence[Finding]) -> Identification:
    """The result with findings about the exported model, which must not diverge to explain."""
    result = replace(result, findings=(*result.findings, *findings))
    trials = [np.asarray(f.data["exported"]) for f in findings if "exported" in f.data]
    if all(np.isfinite(errors).all() for errors in trials):
        return result
    sentence = "The exported model diverges in MuJoCo at its own time step: do not use it."
    sentence += " Shorten the time step, or record faster motion, which tells inertias."
    return replace(result, explains="no", verdict=f"{sentence} {result.verdict}")


def write_parameters(result: Identification, path: Path) -> None:
    """Writes parameters with units, 95 % intervals and status, and the scale's anchor, as YAML."""
    parameters = [
        {
            "name": p.label,
            "value": float(p.value),
            "unit": p.unit,
            "interval": [float(p.low), float(p.high)],
            "status": p.status,
        }
        for p in result.parameters
    ]
    table = {"robot": result.robot.name, "anchor": result.anchor, "notes": _notes(result)}
    write_table(path, {**table, "parameters": parameters})


def _notes(result: Identification) -> list[str]:
    """The verdict and the warnings."""
    return [result.verdict, *(f.text for f in result.findings if f.level == "warning")]


def identified(result: Identification) -> Identified:
    """The values of a tree of joints for the exporters.

    Files hold viscous and Coulomb friction only: where further friction columns were identified,
    the least-squares approximation of the friction along the log.
    """
    robot = result.robot
    k = len(robot.joints)
    links = result.theta[: 10 * (robot.model.njoints - 1)].reshape(-1, 10)
    model = with_inertias(robot.model, links, _of(result, "rotor inertia", k))
    damping, friction = result.friction
    joints = result.joints[-k:]
    speed = np.array([joint.friction_speed for joint in joints])
    gain = _of(result, "motor gain", k) * np.sign(robot.gain)
    couplings = tuple(
        SharedFriction((i, j), sign, *(p.value for p in result.of(f"coupling of {a} and {b}")))
        for i, j, sign in result.fitted.made.coupled
        for a, b in [(robot.joints[i], robot.joints[j])]
    )
    value = {p.name: p.value for p in result.parameters}
    springs = []
    for j, joint in enumerate(joints):  # an offset gives the spring's rest position
        if "spring" in joint.columns:
            stiffness = value[f"stiffness_{j + 1}"]
            springs.append(Spring(j, stiffness, -value[f"offset_{j + 1}"] / stiffness))
    return Identified(
        model,
        damping,
        friction,
        speed,
        gain,
        result.anchor,
        tuple(_notes(result)),
        couplings,
        tuple(springs),
    )


def _file_name(name: str) -> str:
    """A robot's name as the name of a file."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._") or "robot"


def _of(result: Identification, block: str, k: int) -> Array:
    """(k,) parameters of a block of at most one per joint; 0 for joints without."""
    values = np.zeros(k)
    for parameter in result.of(block):
        values[joint_of(parameter.name)] = parameter.value
    return values


def _followed(result: Identification, values: Identified) -> Finding:
    """Deviation of the exported model from the log, compared with the original model file."""
    if result.robot.floating:
        return _stepped(result, values)
    loaded = result.fitted.made.loaded  # the exported model carries none
    bare = tuple(s for s in result.recordings.segments if s.source not in loaded)
    recordings = replace(result.recordings, segments=bare)
    try:
        exported, nominal = (
            replay(result.robot, own, recordings)
            for own in (values, Identified.nominal(result.robot))
        )
    except NsaidError as error:
        return Finding("note", "replay", "", f"the exported model was not simulated: {error}")
    leading = list(result.robot.independent)  # the others follow these
    exported = exported[leading]
    nominal = nominal[leading]
    rows = list(zip(result.robot.leaders, exported, nominal, strict=True))
    figures = ", ".join(f"{name} {_figure(own)} ({_figure(file)})" for name, own, file in rows)
    worse = ", ".join(name for name, own, file in rows if own > file)
    drive = "commands" if recordings.feedback is None else "targets, by the PD law"
    text = (
        f"rms error of MuJoCo over windows of 0.2 s, driven by the log's {drive}"
        f"{' without the load' if loaded else ''} [rad or m], with the exported "
        f"model (in brackets: with the original model file): {figures}"
    )
    remedy = f"The exported model is worse at {worse}." if worse else ""
    data = {"exported": exported.tolist(), "nominal": nominal.tolist()}
    return Finding("warning" if worse else "note", "replay", "", text, remedy, data)


def _stepped(result: Identification, values: Identified) -> Finding:
    """Errors of the exported model's forces in stance and in swing, and of the original file's."""
    from .ground.search import filter_of
    from .ground.trial import trial

    robot = result.robot
    chosen = filter_of(result.recordings, result.cutoff)
    delay = np.array([joint.delay for joint in result.joints[-len(robot.joints) :]])
    each = [
        trial(robot, _without_contacts(robot, own), own.gain, result.recordings, chosen, delay)
        for own in (values, Identified.nominal(robot))
    ]
    own, nominal = each
    figures = [f"in stance {100 * own.stance:.2g} % ({100 * nominal.stance:.2g} %)"]
    if np.isfinite(own.swing):
        figures.append(f"of swinging legs {100 * own.swing:.2g} % ({100 * nominal.swing:.2g} %)")
    text = (
        "error of MuJoCo's inverse dynamics of the exported model along the log, contact forces "
        f"projected out, in % of what the commands do: {', '.join(figures)}; in brackets with the "
        "original model file. "
    )
    if np.isfinite(own.replay):
        text += (
            "Simulated for 0.2 s by the commands along the base's measured motion, joints of "
            f"swinging legs are off by {_figure(own.replay)} ({_figure(nominal.replay)}) rad, rms. "
        )
    text += (
        "The whole robot is not simulated: a foot that touches down a moment earlier gives another "
        "motion, however good the model is"
    )
    data = {
        "exported": [own.stance, own.swing if np.isfinite(own.swing) else own.stance],
        "nominal": [nominal.stance, nominal.swing if np.isfinite(own.swing) else nominal.stance],
    }
    if np.isfinite(own.replay):
        data["simulated"] = [own.replay, nominal.replay]
    return Finding("note", "replay", "", text, data=data)


def _without_contacts(robot: RobotModel, values: Identified) -> Any:
    """The compiled model that `write_mjcf` writes, whose bodies touch nothing."""
    assert robot.file is not None  # a tree of joints comes from a file
    folder = robot.file.resolve().parent
    spec = mujoco.MjSpec.from_string(mjcf_text(robot, values, folder))
    for directory in ("meshdir", "texturedir"):
        setattr(spec, directory, str(folder / getattr(spec, directory)))
    spec.option.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    )
    with quiet():
        return spec.compile()


def _figure(value: float) -> str:
    return number(value, significant=2) if value < _LOST else "diverges"


_WINDOW = 0.2  # length of a simulation [s]
_LOST = 100.0  # error [rad or m] that no joint makes in that time unless its simulation diverges
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


def _close_loop(mj: Any, actuator: int, kp: float, kd: float) -> None:
    """Makes a motor's command c the part of the targets in a PD law: its own is c − kp q − kd v.

    kp and kd are in the command's unit per rad or m, and s per rad or m.
    """
    gain = mj.actuator_gainprm[actuator, 0]
    gear = mj.actuator_gear[actuator, 0]
    mj.actuator_biastype[actuator] = mujoco.mjtBias.mjBIAS_AFFINE
    mj.actuator_biasprm[actuator, 1:3] = [-gain * kp / gear, -gain * kd / gear]
    if mj.actuator_ctrllimited[actuator]:  # the limits are those of the motor's own command
        mj.actuator_forcerange[actuator] = np.sort(gain * mj.actuator_ctrlrange[actuator])
        mj.actuator_forcelimited[actuator] = True
        mj.actuator_ctrllimited[actuator] = False


def departures(
    robot: RobotModel, values: Identified, recordings: Recordings, horizon: float, every: int = 1
) -> Array:
    """(N, n) simulated minus measured positions, driven by a log's commands [rad or m].

    Motors under a PD law follow the log's targets, by the law at the simulated motion. After
    `horizon` [s], at least one sample, the simulation restarts from the measured position and
    velocity; inf for once per segment. Of these windows, only one of `every` so many is simulated.
    """
    mj = _without_contacts(robot, values)
    joints = JointMap(mj, robot.joints)
    joint_ids = [mj.joint(name).id for name in robot.joints]
    command = {k: own[0] for k, i in enumerate(joint_ids) if (own := actuators_of(mj, i))}
    longest = mj.opt.timestep if robot.kind == "mjcf" else _LONGEST_STEP  # the user's own
    substeps = int(np.ceil(1 / (recordings.rate * longest) - 1e-9))
    mj.opt.timestep = 1 / (recordings.rate * substeps)
    if recordings.feedback is not None:
        for k, actuator in command.items():
            _close_loop(mj, actuator, *recordings.feedback[:, k])
    found = [np.zeros((0, len(robot.joints)))]
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    for log in (segment.log for segment in recordings.segments):
        length = len(log.t) - 1
        samples = max(1, length if np.isinf(horizon) else round(horizon * recordings.rate))
        starts = np.arange(0, len(log.t) - samples, samples * every)
        if not len(starts):
            continue
        data = mujoco.MjData(mj)
        state = np.zeros((len(starts), mujoco.mj_stateSize(mj, kind)))
        for row, k in zip(state, starts, strict=True):
            joints.write(data, log.q[k], log.v[k])
            mujoco.mj_getState(mj, data, row, kind)
        within = starts[:, None] + np.arange(samples)
        control = np.zeros((len(starts), samples * substeps, mj.nu))
        targets = log.u + fed_back(recordings.feedback, log.q, log.v)
        u = targets[within][:, :, list(command)]
        control[:, :, list(command.values())] = np.repeat(u, substeps, axis=1)
        with quiet():  # a simulation that diverges has a large error
            states: Any = rollout.rollout(mj, data, state, control)[0]
        with np.errstate(invalid="ignore", over="ignore"):
            errors = joints.angles(states[:, substeps - 1 :: substeps]) - log.q[within + 1]
        found.append(errors.reshape(-1, len(robot.joints)))
    return np.concatenate(found)
