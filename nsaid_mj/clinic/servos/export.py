"""The user's own MJCF with identified servos, and its open-loop simulation.

For comparison, also one with servos by `mujoco.sysid`, MuJoCo's toolbox, with its stock options and
with better ones. Both fit kp, kv, armature and frictionloss of every joint, from the values of a
model file, by open-loop simulations of whole logs with steps of 5 ms, in at most 15 iterations. The
toolbox has no prior; its search has bounds:

- stock: from a tenth of the start to ten times it, with the file's friction, the toolbox's own
  optimiser and normalised residuals;
- best: a factor of 1,100 about the start, in logarithms, with hard friction, residuals over 5 mrad,
  finite differences of 1 %, scaled variables, and a target 20 ms late, which it does not fit.
"""

import io
import math
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from lxml.etree import SubElement
from lxml.etree import _Element as Node
from mujoco import rollout as batch
from numpy.typing import ArrayLike

from ...base import Finding, OutputFile
from ...core import Array
from ...lab import JointMap, Toolbox, followed_targets
from ...robots import MjcfFile, MjcfText, quiet
from .logs import ServoLog, ServoLogs
from .result import Replayed, Servo, ServoIdentification, concluded

HARD = "0.9999 0.9999 0.001 0.5 2"
"""solimpfriction: MuJoCo's default is so soft that a joint creeps under its load."""

_QUICK = "0.002 1"
# solreffriction: MuJoCo takes twice its time step if that is longer; the default lets a joint slide
# for 20 ms before it sticks
_IMMOVABLE = 1e8  # [kg·m² or kg]
_REMARK = """Servos identified by nsaid from logs of targets and positions.
{verdict}
kp, kv, armature and frictionloss are identified; damping is part of kv; forcerange is removed where
no saturation was seen. Targets act after the delays below, which MuJoCo ignores and nsaid applies:
shift the targets, or set the actuators' `delay` and `nsample` (MuJoCo 4) and fill the buffers with
the first targets (mj_initCtrlHistory), as a buffer of zeros pulls the arm to 0. Their bias is 0.
{profile}{masses}{joints}"""
_IMPLICIT = """The integrator is implicitfast: with an explicit one, this damping is too large for
the time step.
"""
_IMPLICIT_ONES = [
    int(mujoco.mjtIntegrator.mjINT_IMPLICIT),
    int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST),
]
_COARSE = 1.0  # kv·dt/inertia: above 1 an explicit step overshoots, above 2 it diverges
_POSES = 20  # in which the least inertia is sought
_PROFILED = """Limits of the targets' speed and acceleration, and time constants of their filters,
are in the numeric target_profile, which MuJoCo ignores and nsaid applies.
"""


def write_servo_mjcf(result: ServoIdentification, path: Path) -> None:
    """Writes the model's own MJCF with the servos of a result; nothing else is changed.

    Files that it includes are put in their places.
    """
    source = result.robot.source
    assert source is not None  # a model with servos comes from a file
    file = MjcfFile(source)
    text = file.text()
    delays = file.delays
    profiles = file.profiles
    stated = result.robot.servos
    assert stated is not None  # as the logs were of targets
    for servo, profile in zip(result.servos, stated.profile, strict=True):
        index = file.servos_on([servo.name])[0]
        own = text.joints[servo.name]
        text.set(own, armature=servo.armature, damping=0.0, frictionloss=servo.friction)
        own.attrib.update({"solimpfriction": HARD, "solreffriction": _QUICK})
        _set_actuator(text.actuators[index], servo)
        delays[index] = servo.delay
        profiles[index] = profile
        if profile[2] == 0:
            text.actuators[index].attrib.pop("timeconst", None)
    stiff = _stiff(file.model, result.servos)
    if stiff:
        _set_integrator(text.root)
    text.state_targets(delays, profiles)
    lines = "\n".join(
        f"{s.name}: delay {s.delay * 1e3:.1f} ms, kp "
        + ("determined by gravity" if s.gravity else "a convention")
        for s in result.servos
    )
    weighed = "".join(
        f"All masses are {scale.value:.3g} of the original file's, by a weighed load.\n"
        for scale in result.scale
    )
    remarks = (_PROFILED if profiles.any() else "") + (_IMPLICIT if stiff else "")
    parts = {"masses": weighed, "joints": lines, "profile": remarks}
    total = [scale.value * file.model.body_subtreemass[0] for scale in result.scale]
    text.write(path, _REMARK.format(verdict=result.verdict, **parts), *total)


def servos_of_file(result: ServoIdentification) -> Array:
    """(4, n) kp, kv with the joint's damping, armature and frictionloss in the user's own file."""
    source = result.robot.source
    assert source is not None  # a model with servos comes from a file
    file = MjcfFile(source)
    mj = file.model
    joints = [servo.name for servo in result.servos]
    own = file.servos_on(joints)
    dof = JointMap(mj, joints).dof
    kv = mj.dof_damping[dof] - mj.actuator_biasprm[own, 2]
    return np.array(
        [mj.actuator_gainprm[own, 0], kv, mj.dof_armature[dof], mj.dof_frictionloss[dof]]
    )


def stiff_notes(result: ServoIdentification) -> tuple[Finding, ...]:
    """Reports servos for which the exported file has another integrator."""
    source = result.robot.source
    assert source is not None  # a model with servos comes from a file
    mj = MjcfFile(source).model
    found = _stiff(mj, result.servos)
    if not found:
        return ()
    names = ", ".join(f"{name} {ratio:.2g}" for name, ratio in found.items())
    text = (
        f"with the file's own integrator and time step of {1e3 * mj.opt.timestep:g} ms, damping is "
        f"too large for the inertia (kv·dt/inertia, unstable above 2: {names}), so the exported "
        'file states `integrator="implicitfast"`'
    )
    remedy = "Keep that integrator where you include the file, or shorten the time step."
    return (Finding("note", "integrator", "", text, remedy, found),)


def _stiff(mj: Any, servos: Sequence[Servo]) -> dict[str, float]:
    """kv·dt/inertia of servos for which an explicit integrator is too coarse, by joint.

    The least inertia counts, of poses within the joints' ranges.
    """
    if mj.opt.integrator in _IMPLICIT_ONES:
        return {}
    data = mujoco.MjData(mj)
    rng = np.random.default_rng(0)
    where = JointMap(mj, [servo.name for servo in servos])
    limits = [mj.joint(servo.name) for servo in servos]
    ends = np.array([j.range if mj.jnt_limited[j.id] else (-1.0, 1.0) for j in limits])
    own = np.full(mj.nv, np.inf)
    M = np.empty((mj.nv, mj.nv))
    for _ in range(_POSES):
        where.write(data, rng.uniform(*ends.T), np.zeros(len(servos)))
        mujoco.mj_forward(mj, data)
        mujoco.mj_fullM(mj, data, M)
        own = np.minimum(own, np.diag(M) - mj.dof_armature)
    found = {}
    for servo in servos:
        inertia = own[mj.joint(servo.name).dofadr[0]] + servo.armature
        ratio = float(servo.kv * mj.opt.timestep / max(inertia, 1e-12))
        if ratio > _COARSE:
            found[servo.name] = ratio
    return found


def _set_integrator(root: Node) -> None:
    """States the integrator that treats the servos' damping implicitly."""
    options = root.findall("option")
    option = options[-1] if options else SubElement(root, "option")
    option.set("integrator", "implicitfast")


def _set_actuator(element: Node, servo: Servo) -> None:
    """Gives an actuator its gains."""
    for key in ("dampratio", "forcerange", "damping", "armature", "delay", "nsample"):
        element.attrib.pop(key, None)
    element.set("forcelimited", "false" if servo.limit is None else "true")
    if servo.limit is not None:
        MjcfText.set(element, forcerange=[-servo.limit, servo.limit])
    if element.tag == "position":
        MjcfText.set(element, kp=servo.kp, kv=servo.kv)
    else:
        MjcfText.set(element, gainprm=servo.kp, biasprm=[0.0, -servo.kp, -servo.kv])


def rollout(
    path: Path,
    joints: Sequence[str],
    log: ServoLog,
    delay: ArrayLike | None = None,
    horizon: float = np.inf,
) -> Array:
    """(N, n) positions of an MJCF driven open loop by a log's targets, in full MuJoCo.

    It starts at rest at the first position; contacts are off, and other joints stay where they are.
    Steps are those of the file, or a little shorter, so that they end at the log's times.

    Args:
        path: path of the MJCF.
        joints: (n,) names of the joints, in the log's order.
        log: targets, held until the next, and where the motion starts. If the file states a profile
            of its targets, it replaces that of the log.
        delay: delay of the targets [s], one or (n,); None for those of the file.
        horizon: time after which the simulation starts again from the measured position and
            velocity [s]. The row at which it does holds what was predicted for it.
    """
    file = MjcfFile(path)
    spec = file.spec
    mj = file.model
    servos = file.servos_on(joints)
    delay = file.delays[servos] if delay is None else np.broadcast_to(delay, len(servos))
    profile = file.profiles[servos]
    target = log.target
    if profile.any():
        target = followed_targets(log.t, log.issued, profile)
    for i, late in zip(servos, delay, strict=True):
        spec.actuators[i].dyntype = mujoco.mjtDyn.mjDYN_NONE  # a filter is part of the profile
        spec.actuators[i].gainprm[0] *= log.stiffer
        spec.actuators[i].biasprm[1] *= log.stiffer
        spec.actuators[i].delay = late
        spec.actuators[i].nsample = math.ceil(1.2 * late / mj.opt.timestep) + 2
    with quiet():
        mj = spec.compile()
    mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data = mujoco.MjData(mj)
    where = JointMap(mj, joints)
    hold_others(mj, data, where)
    where.write(data, log.position[0], np.zeros(len(joints)))
    for u, i in zip(target[0], servos, strict=True):
        if mj.actuator_history[i, 0]:
            mujoco.mj_initCtrlHistory(mj, data, i, None, np.full(mj.actuator_history[i, 0], u))
    longest = mj.opt.timestep
    out = np.empty_like(log.position)
    begin = log.t[0]
    velocity = np.gradient(log.position, log.t, axis=0)
    out[0] = log.position[0]
    with quiet():
        for k, interval in enumerate(np.diff(log.t)):
            if log.t[k] - begin >= horizon - 1e-9:
                where.write(data, log.position[k], velocity[k])
                begin = log.t[k]
            steps = math.ceil(interval / longest - 1e-3)
            mj.opt.timestep = interval / steps
            data.ctrl[servos] = target[k]
            mujoco.mj_step(mj, data, steps)
            out[k + 1] = where.read(data)[0]
    return out


def replayed(
    result: ServoIdentification, path: Path, given: ServoLogs, others: ServoLogs | None = None
) -> tuple[ServoIdentification, Replayed]:
    """The result judged by MuJoCo on motion that was left out of the fit, and the simulations.

    The exported file is at a path. The logs are `others`, which took no part in the fit, or else
    those of the fit, `given`, each predicted by the servos as identified without it.
    """
    source = result.robot.source
    joints = result.robot.joints
    logs = [log for log in (others or given).logs if not log.loaded]  # of the file's own links
    assert source is not None  # a model with servos comes from a file
    simulated, nominal = ([rollout(file, joints, log) for log in logs] for file in (path, source))
    own, before = (
        1e3 * np.mean([np.abs(q - log.position).mean(axis=0) for q, log in pairs], axis=0)
        for pairs in (zip(simulated, logs, strict=True), zip(nominal, logs, strict=True))
    )
    what = ", ".join(dict.fromkeys(log.source for log in logs))
    unit = result.robot.small_unit
    text = (
        f"driven by the targets of {what} alone, MuJoCo's mean absolute error is {own.mean():.1f} "
        f"{unit} with the exported file and its delays, and {before.mean():.1f} {unit} with yours"
    )
    data: dict[str, object] = {"exported": own.tolist(), "nominal": before.tolist()}
    level = "note" if own.mean() < before.mean() else "warning"
    rows = sum(len(log.t) for log in logs)
    used = result.used[:rows] if others is None else np.ones(rows)  # logs with a load are the last
    finding = Finding(level, "replay", "", text, "", data)
    result = replace(result, findings=(*result.findings, finding, *stiff_notes(result)))
    motion = f"{what}, which took no part in the fit"
    errors = own / 1e3
    if others is None:
        motion = "the logs of the fit"
        if result.left_out:
            motion = "motion left out of the fit"
            errors = _unseen(result, logs)
    result = concluded(result, errors, motion, own / 1e3)
    return result, Replayed(tuple(logs), tuple(simulated), used)


def _unseen(result: ServoIdentification, logs: Sequence[ServoLog]) -> Array:
    """(n,) mean absolute errors of MuJoCo on each part of the logs, identified without it."""
    found = []
    with TemporaryDirectory(prefix="nsaid-mj-") as folder:
        for number, part in enumerate(result.left_out, 1):
            path = Path(folder, f"without-{number}.xml")
            write_servo_mjcf(replace(result, servos=part.servos), path)
            log = logs[part.log].part(slice(0, part.rows.stop))
            simulated = rollout(path, result.robot.joints, log)
            found.append(np.abs(simulated - log.position)[part.rows])
    return np.asarray(np.concatenate(found).mean(axis=0), dtype=np.float64)


def with_replay(
    result: ServoIdentification, given: ServoLogs, others: ServoLogs | None
) -> ServoIdentification:
    """The result with the deviation of its exported file from logs, see `replayed`."""
    with TemporaryDirectory(prefix="nsaid-mj-") as folder:
        path = Path(folder, f"{result.robot.name}.xml")
        write_servo_mjcf(result, path)
        return replayed(result, path, given, others)[0]


def hold_others(mj: Any, data: Any, where: JointMap) -> None:
    """Holds all joints that are not simulated, at 0 or at the limit nearest to it.

    Inertia of their own that is far above that of any robot keeps them there.
    """
    others = np.setdiff1d(np.arange(mj.nv), where.dof)
    mj.dof_armature[others] = _IMMOVABLE
    ball = mujoco.mjtJoint.mjJNT_BALL
    held = map(mj.joint, set(mj.dof_jntid[others]))
    limited = [joint for joint in held if mj.jnt_limited[joint.id] and joint.type[0] != ball]
    ends = {joint.name: joint.range for joint in limited if joint.name}
    if ends:
        middle = [np.clip(0.0, *limits) for limits in ends.values()]
        JointMap(mj, list(ends)).write(data, np.array(middle), np.zeros(len(ends)))
    if len(others):
        mujoco.mj_setConst(mj, mujoco.MjData(mj))  # what constraints know of inertias


_STEP = 5e-3  # of a simulation [s]
_LEAST = np.array([[1e-3], [1e-3], [2e-3], [1.1e-2]])  # start of kp, kv, armature, frictionloss
_RANGE = 10.0  # of the searches: multiples of the start; ± in logarithms
_FACTOR = 7.0
_LATE = 0.02  # of the target, with the best options [s]
_UNIT = 5e-3  # of its residuals [rad or m]
_ITERATIONS = 15
_FAR = 1e3  # residual where a simulation diverges


def write_by_toolbox(given: ServoLogs, path: Path, best: bool) -> float:
    """Writes the MJCF that the toolbox finds for logs, from the values in the arm's own file.

    `given` are the arm and its logs, without loads; `best` chooses the better options. Returns the
    delay of the targets [s].

    Raises:
        NoEstimate: the toolbox is not installed.
    """
    search = _ReplaySearch(given, best)
    search.model(search.fitted())
    OutputFile(path).write_text(search.spec.to_xml())
    return search.late


class _ReplaySearch:
    """An arm as a function of (4, n) kp, kv, armature and frictionloss, and its logs."""

    def __init__(self, given: ServoLogs, best: bool):
        source = given.robot.source
        self.joints = given.robot.joints
        self.best = best
        assert source is not None  # a model with servos comes from a file
        file = MjcfFile(source)
        self.spec = file.spec
        mj = file.model
        for folder in ("meshdir", "texturedir"):
            setattr(self.spec, folder, str(source.resolve().parent / getattr(self.spec, folder)))
        self.spec.option.timestep = _STEP
        self.spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        dof = JointMap(mj, self.joints).dof
        self.servos = file.servos_on(self.joints)
        kv = mj.dof_damping[dof] - mj.actuator_biasprm[self.servos, 2]
        start = given.kp, kv, mj.dof_armature[dof], mj.dof_frictionloss[dof]
        self.start = np.maximum(np.array(start), _LEAST)
        self.late = _LATE * best
        self.logs = []
        for log in given.logs:
            t = np.arange(log.t[0], log.t[-1], _STEP)
            held = np.maximum(np.searchsorted(log.t, t - self.late, side="right") - 1, 0)
            control = np.zeros((len(t), mj.nu))
            control[:, self.servos] = log.target[held]
            measured = np.column_stack([np.interp(t + _STEP, log.t, x) for x in log.position.T])
            self.logs.append((control, measured, log.position[0]))

    def model(self, values: Array) -> Any:
        """MuJoCo's model with given parameters, which are then those of the specification."""
        for name, i, own in zip(self.joints, self.servos, values.T, strict=True):
            kp, kv, armature, friction = (float(x) for x in own)
            joint = self.spec.joint(name)
            servo = self.spec.actuators[i]
            joint.armature = armature
            joint.frictionloss = friction
            joint.damping = [0, 0, 0]
            if self.best:
                joint.solimp_friction = [float(x) for x in HARD.split()]
            servo.gainprm[0] = kp
            servo.biasprm[1] = -kp
            servo.biasprm[2] = -kv
            servo.forcelimited = 0
        with quiet():
            return self.spec.compile()

    def residual(self, values: Array) -> Array:
        """Simulated minus measured positions of all logs, over 5 mrad or the measured ones' rms."""
        mj = self.model(values)
        found = []
        where = JointMap(mj, self.joints)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        at = [1 + mj.joint(joint).qposadr[0] for joint in self.joints]  # after the time
        state = np.zeros((1, mujoco.mj_stateSize(mj, kind)))
        still = np.zeros(len(at))
        for control, measured, first in self.logs:
            data = mujoco.MjData(mj)
            hold_others(mj, data, where)
            where.write(data, first, still)
            mujoco.mj_getState(mj, data, state[0], kind)
            out: Any = batch.rollout(mj, data, state, control[None])[0]
            unit = _UNIT if self.best else np.maximum(measured.std(axis=0), 1e-6)
            found.append((out[0][:, at] - measured) / unit)
        return np.nan_to_num(np.concatenate(found).ravel(), nan=_FAR, posinf=_FAR, neginf=-_FAR)

    def fitted(self) -> Array:
        """(4, n) parameters at the end of the toolbox's search."""
        own = Toolbox().module
        shape = self.start.shape
        start = self.start
        low = start / _RANGE
        high = start * _RANGE
        if self.best:
            start = np.log(start)
            low = start - _FACTOR
            high = start + _FACTOR
        parameters = own.ParameterDict()
        parameters.add(own.Parameter("all", start.ravel(), low.ravel(), high.ravel()))

        def values(x: Array) -> Array:
            x = np.asarray(x).reshape(shape)
            return np.exp(x) if self.best else x

        def residual(x: Array, _: Any, **__: Any) -> Any:
            found = [self.residual(values(column)) for column in np.atleast_2d(x.T)]
            return [found[0] if x.ndim == 1 else np.column_stack(found)], [], []

        options = {"x_scale": "jac", "diff_step": 1e-2} if self.best else {}
        optimiser = "scipy_parallel_fd" if self.best else "mujoco"
        with quiet(), redirect_stdout(io.StringIO()):
            found = own.optimize(
                parameters, residual, optimiser, verbose=False, max_iters=_ITERATIONS, **options
            )[1]
        return values(found.x)
