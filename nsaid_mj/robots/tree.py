"""A tree of joints as Pinocchio's or MuJoCo's model, with the same mass matrix and forces.

From a Pinocchio model, MuJoCo gets one body for each joint; from a compiled MuJoCo model, joints,
bodies and actuators are read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import mujoco
import numpy as np

from ..base import LARGEST, Finding, InvalidInput, pin
from ..core import Array, JointTree
from .model import Servos


def tree_spec(model: pin.Model, dt: float) -> Any:
    """MuJoCo's specification, with time step dt [s], of a Pinocchio model; no friction, no motors.

    MuJoCo's URDF importer is not used, so that no effort limit clips a hidden gain, no joint limit
    becomes a soft constraint, and no inertia is silently altered. Bodies and joints have the names
    of the model's joints, of one degree of freedom, after a free flyer if there is one; MuJoCo
    reserves "world" for its own body.
    """
    spec = mujoco.MjSpec()
    set_options(spec, dt)
    spec.option.gravity = model.gravity.linear
    bodies = {0: spec.worldbody}
    for i, own in enumerate(JointTree.links(model).structure.bodies, start=1):
        name = model.names[i]
        placement = model.jointPlacements[i]
        body = bodies[model.parents[i]].add_body(name="joint world" if name == "world" else name)
        bodies[i] = body
        body.pos, body.quat = placement.translation, wxyz(placement.rotation)
        _give_inertia(body, model.inertias[i])
        if own.joint == "free":
            body.add_freejoint(name=name)
        else:
            slides = own.joint == "slide"
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=name, type=kind, axis=own.axis)
    return spec


def set_options(spec: Any, dt: float) -> None:
    """Sets all plants' options: RK4 by dt [s], no automatic reset, no contacts, no joint limits.

    Raises:
        InvalidInput: dt is not a positive number.
    """
    if not (np.isfinite(dt) and dt > 0):
        raise InvalidInput("dt", "a step > 0 s", dt, "Try 1e-3 for an arm.")
    spec.option.timestep = dt
    off = mujoco.mjtDisableBit
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    unused = off.mjDSBL_AUTORESET | off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT
    spec.option.disableflags |= int(unused)


def _give_inertia(body: Any, inertia: pin.Inertia) -> None:
    """Sets the inertia of a body in MuJoCo's specification, in principal axes."""
    body.explicitinertial = True
    body.mass = inertia.mass
    body.ipos = inertia.lever
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    body.iquat = wxyz(axes)
    body.inertia = moments


def set_inertias(model: pin.Model, theta: Array, first: int = 1) -> None:
    """Overwrites the inertias of the bodies from `first` on with ten parameters each (10 b,).

    Unchanged ones keep their bits.
    """
    for i, own in enumerate(theta.reshape(-1, 10)):
        if not np.array_equal(own, model.inertias[first + i].toDynamicParameters()):
            model.inertias[first + i] = pin.Inertia.FromDynamicParameters(own)


def wxyz(rotation: Array) -> Array:
    """MuJoCo's quaternion (w, x, y, z) of a rotation matrix."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])


def pose(position: Array, wxyz: Array) -> pin.SE3:
    """The pose with MuJoCo's position (3,) and quaternion (4,)."""
    return pin.SE3(pin.Quaternion(*wxyz).normalized().toRotationMatrix(), np.array(position))


TARGET_DELAY = "target_delay"
"""Custom numeric of an MJCF: delays of all actuators' targets [s], which MuJoCo does not apply."""
TARGET_PROFILE = "target_profile"
"""Another one: the speeds, accelerations and lags of `target_profile` of all actuators' targets."""

_KINDS = {  # of Pinocchio's joints: along an axis, and the general one
    mujoco.mjtJoint.mjJNT_HINGE: ("JointModelR", "JointModelRevoluteUnaligned"),
    mujoco.mjtJoint.mjJNT_SLIDE: ("JointModelP", "JointModelPrismaticUnaligned"),
}


def rigid_tree(mj: Any, name: str) -> pin.Model:
    """Pinocchio's model of a MuJoCo model's bodies and joints.

    Every joint has the axes of its MuJoCo body, and lies at the joint's anchor; positions of hinges
    and slides are those of MuJoCo. A body of several joints becomes a chain of links, all but the
    last without mass. Bodies without a joint are merged into their parents. Rotor inertias, of
    joints and of actuators, are in `armature`.
    """
    model = pin.Model()
    model.name = name
    model.gravity.linear = np.array(mj.opt.gravity)
    taken = set(model.names)
    places: dict[int, tuple[int, pin.SE3]] = {0: (0, pin.SE3.Identity())}  # of each body's frame
    for b in range(1, mj.nbody):
        joint, place = places[mj.body_parentid[b]]
        place = place * pose(mj.body_pos[b], mj.body_quat[b])
        first = mj.body_jntadr[b]
        count = mj.body_jntnum[b]
        for j in range(first, first + count):
            joint, place = _add_joint(model, mj, j, joint, place, _unique(mj, j, taken))
            model.addJointFrame(joint)
        places[b] = joint, place
        inertia = pin.Inertia(mj.body_mass[b], np.zeros(3), np.diag(mj.body_inertia[b]))
        principal = place * pose(mj.body_ipos[b], mj.body_iquat[b])
        if joint:
            model.appendBodyToJoint(joint, inertia, principal)
        moving = model.getFrameId(model.names[joint], pin.FrameType.JOINT) if joint else 0
        frame = pin.Frame(body_name(mj, b), joint, moving, place, pin.FrameType.BODY)
        model.addFrame(frame, False)
    model.armature = rotors(mj)
    return model


def body_name(mj: Any, b: int) -> str:
    """The name of a body, or its number."""
    return mj.body(b).name or f"body {b}"


def joint_names(mj: Any) -> list[str]:
    """The names of all joints in Pinocchio's model; an unnamed one gets its body's name."""
    taken = {"universe"}
    return [_unique(mj, j, taken) for j in range(mj.njnt)]


def rotors(mj: Any) -> Array:
    """(nv,) reflected rotor inertia of every velocity, of joints and actuators [kg·m² or kg]."""
    found = mj.dof_armature.copy()
    for j in range(mj.njnt):
        if mujoco.mjtJoint(mj.jnt_type[j]) in _KINDS:
            for i in actuators_of(mj, j):
                found[mj.jnt_dofadr[j]] += mj.actuator_armature[i] * mj.actuator_gear[i, 0] ** 2
    return found


def actuators_of(mj: Any, joint: int) -> list[int]:
    """The actuators that act on a joint alone."""
    kinds = {mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT}
    return [
        int(i)
        for i in np.flatnonzero(mj.actuator_trnid[:, 0] == joint)
        if mujoco.mjtTrn(mj.actuator_trntype[i]) in kinds
    ]


def motor_name(mj: Any, joint: int) -> str:
    """The name of a joint's first actuator; "" if it has none, or that has no name."""
    own = actuators_of(mj, joint)
    return mj.actuator(own[0]).name if own else ""


def _add_joint(
    model: pin.Model, mj: Any, j: int, parent: int, place: pin.SE3, name: str
) -> tuple[int, pin.SE3]:
    """Adds MuJoCo's joint j behind Pinocchio's joint `parent`.

    `place` is that of the body's frame in the frame of the parent, without this joint's motion.
    Returns the index of the new joint, and the place of the body's frame in its frame.
    """
    kind = mujoco.mjtJoint(mj.jnt_type[j])
    axis = mj.jnt_axis[j].copy()
    anchor = mj.jnt_pos[j].copy()
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        free = model.addJoint(parent, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        return free, pin.SE3.Identity()
    at = pin.SE3(np.eye(3), anchor)
    back = pin.SE3(np.eye(3), -anchor)
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        return model.addJoint(parent, pin.JointModelSpherical(), place * at, name), back
    aligned, general = _KINDS[kind]
    exact = [letter for letter, e in zip("XYZ", np.eye(3), strict=True) if np.array_equal(axis, e)]
    joint = getattr(pin, aligned + exact[0])() if exact else getattr(pin, general)(axis)
    offset = -mj.qpos0[mj.jnt_qposadr[j]]  # MuJoCo draws the body with the joint at qpos0
    if kind == mujoco.mjtJoint.mjJNT_HINGE:
        start = pin.SE3(pin.exp3(offset * axis), np.zeros(3))
    else:
        start = pin.SE3(np.eye(3), offset * axis)
    low, high = mj.jnt_range[j] if mj.jnt_limited[j] else (-np.inf, np.inf)
    unlimited = np.array([np.inf])
    index = model.addJoint(
        parent, joint, place * at * start, name, unlimited, unlimited, np.r_[low], np.r_[high]
    )
    return index, back


def _unique(mj: Any, j: int, taken: set[str]) -> str:
    """A unique name for a joint, which is added to `taken`."""
    base = mj.joint(j).name or f"{body_name(mj, mj.jnt_bodyid[j])}_joint"
    name = base
    number = 2
    while name in taken:
        name = f"{base}_{number}"
        number = number + 1
    taken.add(name)
    return name


def motors(
    mj: Any, names: Sequence[str], joints: tuple[str, ...]
) -> tuple[Array, Array, Array, tuple[str, ...], list[Finding]]:
    """The motors of k joints of a MuJoCo model, whose joints have these names.

    The command of a motor is its `ctrl`, and its gain is gear · gainprm. A joint with a servo, or
    without any actuator, has commands in N·m or N and gain 1.

    Returns:
        (k,) force per unit of command [N·m or N], (k,) largest absolute commands, inf where there
        is none, (k,) damping of the actuators [N·m·s/rad or N·s/m], names of the joints without an
        actuator in a file that has some, and findings on the meaning of commands.
    """
    gain = np.ones(len(joints))
    damping = np.zeros(len(joints))
    limits = np.full(len(joints), np.inf)
    servos = []
    bare = []
    lagging = []
    several = []
    for k, joint in enumerate(joints):
        j = names.index(joint)
        actuators = actuators_of(mj, j)
        if not actuators:
            bare.append(joint)
            continue
        i = actuators[0]
        gear = mj.actuator_gear[actuators[0], 0]
        damping[k] = sum(mj.actuator_damping[a] * mj.actuator_gear[a, 0] ** 2 for a in actuators)
        if len(actuators) > 1:
            several.append(joint)
        if mj.actuator_dyntype[i] != mujoco.mjtDyn.mjDYN_NONE:
            lagging.append(joint)
        if is_motor(mj, i):
            gain[k] = gear * mj.actuator_gainprm[i, 0]
        else:
            servos.append(joint)
        limits[k] = _limit(mj, i, j, gear, float(gain[k]))
    noticed: tuple[tuple[str, Literal["note", "warning"], list[str], str], ...] = (
        ("no_actuator", "note", bare, "no actuator in the file; u must be the joint's force"),
        (
            "servo",
            "warning",
            servos,
            "position or velocity servos in the file; u must be the "
            "joint's force or motor current, not the setpoint",
        ),
        ("actuator_lag", "note", lagging, "actuators with an activation; the lag was left out"),
        ("several_actuators", "warning", several, "several actuators; u is taken as the first's"),
    )
    findings = [
        Finding(level, code, ", ".join(where), text, data={"joints": where})
        for code, level, where, text in noticed
        if where
    ]
    driven = [joint for joint in joints if joint not in {*servos, *bare}]
    if driven:
        gears = [f"{gain[joints.index(joint)]:g}" for joint in driven]
        same = f"all gears in the file are {gears[0]}"
        text = f"u is the motors' ctrl; {same}"
        if len(set(gears)) > 1:
            text = f"u is the motors' ctrl; the gears in the file are {', '.join(gears)}"
        findings.append(Finding("note", "command", ", ".join(driven), text))
    return gain, limits, damping, tuple(bare) if mj.nu else (), findings


def position_servos(mj: Any, names: Sequence[str], joints: Sequence[str]) -> Servos | None:
    """The servos of k joints of a MuJoCo model; None unless each has one, and no other actuator."""
    found = []
    delays = target_delays(mj)
    profiles = target_profiles(mj)
    for joint in joints:
        own = actuators_of(mj, names.index(joint))
        if len(own) != 1 or mj.actuator_biastype[own[0]] != mujoco.mjtBias.mjBIAS_AFFINE:
            return None
        gain = mj.actuator_gainprm[own[0], 0]
        bias = mj.actuator_biasprm[own[0]]
        if gain <= 0 or not np.isclose(bias[1], -gain) or mj.actuator_gear[own[0], 0] != 1:
            return None
        limited = mj.actuator_ctrllimited[own[0]]
        limits = mj.actuator_ctrlrange[own[0]] if limited else [-np.inf, np.inf]
        found.append((gain, -bias[2], *limits, delays[own[0]], *profiles[own[0]]))
    numbers = np.array(found, dtype=np.float64).reshape(-1, 8)
    kp, kv, _, _, delay = numbers[:, :5].T
    return Servos(kp, kv, numbers[:, 2:4], delay, numbers[:, 5:]) if found else None


def target_delays(mj: Any) -> Array:
    """(nu,) delays of a MuJoCo model's targets [s]: of its actuators, or of `TARGET_DELAY`.

    Raises:
        InvalidInput: `TARGET_DELAY` does not have a number for every actuator.
    """
    stated = _stated(mj, TARGET_DELAY, mj.nu, 1.0, f"a delay from 0 to 1 s for each of {mj.nu}")
    return np.where(mj.actuator_delay > 0, mj.actuator_delay, stated)


def target_profiles(mj: Any) -> Array:
    """(nu, 3) profiles of a MuJoCo model's targets: `TARGET_PROFILE`, and its actuators' filters.

    Raises:
        InvalidInput: `TARGET_PROFILE` does not have three numbers for every actuator.
    """
    expected = f"speeds, accelerations and lags, 0 or more, for each of {mj.nu}"
    found = _stated(mj, TARGET_PROFILE, 3 * mj.nu, LARGEST, expected).reshape(3, -1).T
    filters = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    smooth = np.isin(mj.actuator_dyntype, filters) & (found[:, 2] == 0)
    found[smooth, 2] = mj.actuator_dynprm[smooth, 0]
    return found


def _stated(mj: Any, name: str, count: int, most: float, expected: str) -> Array:
    """(count,) numbers of a custom numeric, or zeros."""
    if name not in {mj.numeric(i).name for i in range(mj.nnumeric)}:
        return np.zeros(count)
    stated = mj.numeric(name).data.copy()
    if len(stated) != count or not np.all((stated >= 0) & (stated <= most)):
        remedy = "Correct the file's <custom>."
        raise InvalidInput(f"numeric {name}", f"{expected} actuators", stated.tolist(), remedy)
    return stated


def is_motor(mj: Any, actuator: int) -> bool:
    """Whether an actuator's force is a constant gain times its command or activation."""
    constant = mj.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
    unbiased = mj.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
    unbiased |= not mj.actuator_biasprm[actuator].any()
    acts = mj.actuator_gainprm[actuator, 0] != 0 and mj.actuator_gear[actuator, 0] != 0
    return bool(constant and unbiased and acts)


def _limit(mj: Any, actuator: int, joint: int, gear: float, gain: float) -> float:
    """The largest absolute command of an actuator; inf if there is none."""
    found = [np.inf]
    if mj.actuator_ctrllimited[actuator] and is_motor(mj, actuator):
        found.append(np.abs(mj.actuator_ctrlrange[actuator]).max())
    if mj.actuator_forcelimited[actuator]:
        found.append(abs(gear / gain) * np.abs(mj.actuator_forcerange[actuator]).max())
    if mj.jnt_actfrclimited[joint]:
        found.append(np.abs(mj.jnt_actfrcrange[joint]).max() / abs(gain))
    return float(min(found))
