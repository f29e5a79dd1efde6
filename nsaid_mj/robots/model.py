"""A robot as its model file describes it, and its reduction to the joints of a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from ..base import Finding, InvalidInput, UnknownName, pin
from ..core import Array, JointTree
from .errors import BadRobot


class Servos(NamedTuple):
    """Position servos on k joints: force = kp (u − q) − kv q̇."""

    kp: Array  # (k,) stiffness [N·m/rad or N/m]
    kv: Array  # (k,) damping [N·m·s/rad or N·s/m]
    range: Array  # (k, 2) least and largest target [rad or m]; ±inf without limit
    delay: Array  # (k,) from a target to the servo [s]; see `tree.target_delays`
    profile: Array  # (k, 3) profile of the targets; see `target_profile`


class MimicLaw(NamedTuple):
    """The law of a joint that follows another: q = multiplier · q_leader + offset."""

    leader: str  # name of the joint that it follows
    multiplier: float  # ratio of the positions
    offset: float  # its position where the leader is at 0 [rad or m]


class JointCoupling(NamedTuple):
    """Joints of which some follow others rigidly: positions q = S y + c of all n joints."""

    ratio: Array  # (n, k) S
    offset: Array  # (n,) c [rad or m]
    leaders: tuple[int, ...]  # (k,) numbers of the joints y that move by themselves


@dataclass(frozen=True)
class RobotModel:
    """A robot as its model file describes it: kinematics, and guesses of its parameters.

    Attributes:
        name: name of the robot.
        source: the file; None for a packed robot or vehicle.
        kind: format of the file, or `vehicle`.
        model: Pinocchio's model (`pin.Model`), joints locked; None for a vehicle.
        joints: (n_u,) names of the 1-DOF joints, in order; of the actuators of a vehicle.
        damping: (n_u,) nominal viscous friction [N·m·s/rad or N·s/m]; 0 where the file has none.
        friction: (n_u,) nominal Coulomb friction [N·m or N]; 0 where the file has none.
        rotor: (n_u,) nominal reflected rotor inertia [kg·m² or kg]; 0 where the file has none.
        gain: (n_u,) nominal force per unit of command [N·m or N]; 1 where the file has none.
        limits: (n_u,) largest absolute command; inf where the file has none.
        system: the structure (a `SecondOrderSystem`): of a vehicle its sheet's, of a tree of joints
            always the links of `model`, to which friction and motors are added (`JointTree.links`).
        prior: (p,) θ̂(0) of a vehicle, its published values; None for a tree of joints.
        findings: about the file, such as inertias moved inside the cone or meshes not found.
        visuals: data for drawing the robot, for `recording`.
        file: the file that describes a tree of joints, also of packed robots.
        passive: names of the joints without an actuator in a file that has some.
        servos: servos of the joints that are not passive; None unless each has a position servo.
            Their `limits` are forces.
        motors: names of the joints' actuators, "" for one without; () if the file names none.
        dry_mass: mass of a vehicle without the added mass of the water [kg]; None where its sheet
            has no added mass.
        weighed: whether the user states the dry mass.
        coupling: how some of the joints follow others; None if all move by themselves. Followers
            are passive, and their nominal friction and rotors are part of their leaders'.
        top_speed: speed of the rotors at full command [rad/s]; inf where the sheet has none.
    """

    name: str
    source: Path | None
    kind: Literal["urdf", "mjcf", "vehicle"]
    model: Any
    joints: tuple[str, ...]
    damping: Array
    friction: Array
    rotor: Array
    gain: Array
    limits: Array
    system: Any = None
    prior: Array | None = None
    findings: tuple[Finding, ...] = ()
    visuals: Any = None
    file: Path | None = None
    passive: tuple[str, ...] = ()
    servos: Servos | None = None
    motors: tuple[str, ...] = ()
    dry_mass: float | None = None
    weighed: bool = False
    coupling: JointCoupling | None = None
    top_speed: float = np.inf

    def __post_init__(self) -> None:
        if self.jointed:  # it follows from the model, and changes with it
            object.__setattr__(self, "system", JointTree.links(self.model))

    @property
    def independent(self) -> tuple[int, ...]:
        """Numbers of the joints that move by themselves, from 0."""
        return tuple(range(len(self.joints))) if self.coupling is None else self.coupling.leaders

    @property
    def leaders(self) -> tuple[str, ...]:
        """Names of the joints that move by themselves."""
        return tuple(self.joints[j] for j in self.independent)

    @property
    def followers(self) -> tuple[str, ...]:
        """Names of the joints that follow others."""
        return tuple(joint for joint in self.joints if joint not in self.leaders)

    @property
    def floating(self) -> bool:
        """Whether the base of a tree of joints floats: the robot stands and walks."""
        return self.jointed and bool(self.system.group)

    @property
    def held(self) -> bool:
        """Whether it is a tree of joints on a fixed base: every row of its fit is a joint's."""
        return self.jointed and not self.floating

    @property
    def walks(self) -> bool:
        """Whether its base could move: the file has a free joint, or a link is called a foot."""
        if self.floating or any(finding.code == "base_held" for finding in self.findings):
            return True
        return self.jointed and any("foot" in f.name.lower() for f in self.model.frames)

    @property
    def jointed(self) -> bool:
        """Whether it is a tree of joints from a model file, and no vehicle from a sheet."""
        return self.model is not None

    @property
    def weightless(self) -> bool:
        """Whether the model file has no masses, so that all inertias are guesses."""
        return any(finding.code == "no_masses" for finding in self.findings)

    @property
    def small_unit(self) -> str:
        """Unit of a thousandth of the joints' positions."""
        return " or ".join(sorted({f"m{unit}" for unit in self.units}, reverse=True))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of the position along each velocity, rad or m."""
        return tuple(unit.removesuffix("/s") for unit in self.system.velocity_units)


def coupled(robot: RobotModel, laws: Mapping[str, MimicLaw]) -> RobotModel:
    """The robot whose joints of these names follow others, with a note, or a warning if welded.

    Motors, rotors and friction of followers act on their leaders, which have them in the model.
    """
    joints = robot.joints
    held = [f for f, law in laws.items() if f not in joints and law.leader in joints]
    for leader in dict.fromkeys(laws[name].leader for name in held):
        names = [name for name in held if laws[name].leader == leader]
        text = f"it moves {', '.join(names)} with it; their links were welded, so the inertia of "
        text += "their own motion is not in the model"
        where = f"joint {leader}"
        welded = Finding("warning", "mimic_joint", where, text, data={"followers": names})
        robot = replace(robot, findings=(*robot.findings, welded))
    laws = {name: law for name, law in laws.items() if name in joints}
    if not laws:
        return robot
    leaders = tuple(j for j, name in enumerate(joints) if name not in laws)
    ratio = np.zeros((len(joints), len(leaders)))
    offset = np.zeros(len(joints))
    for j, name in enumerate(joints):
        law = laws.get(name, MimicLaw(name, 1.0, 0.0))
        ratio[j, leaders.index(joints.index(law.leader))] = law.multiplier
        offset[j] = law.offset

    def led(values: Array, size: Array) -> Array:
        found = np.zeros(len(joints))
        found[list(leaders)] = size.T @ values
        return found

    pairs = (f"{name} = {law.multiplier:g} · {law.leader}" for name, law in laws.items())
    text = f"joints that follow others are one coordinate with these: {', '.join(pairs)}; their "
    text += "inertia and friction are those of the joint that they follow"
    data = {"followers": list(laws)}
    note = Finding("note", "coupled_joints", ", ".join(laws), text, data=data)
    return replace(
        robot,
        damping=led(robot.damping, ratio**2),
        friction=led(robot.friction, np.abs(ratio)),
        rotor=led(robot.rotor, ratio**2),
        passive=tuple(dict.fromkeys((*robot.passive, *laws))),
        coupling=JointCoupling(ratio, offset, leaders),
        findings=(*robot.findings, note),
    )


def resolved(robot: str, laws: dict[str, MimicLaw]) -> dict[str, MimicLaw]:
    """The laws with leaders that follow no other joint.

    Raises:
        BadRobot: a joint follows itself.
    """
    return {name: _resolved(robot, laws, name) for name in laws}


def _resolved(robot: str, followers: dict[str, MimicLaw], name: str) -> MimicLaw:
    """A follower in terms of a leader that is not itself a follower."""
    found = followers[name]
    passed = {name}
    while found.leader in followers:
        if found.leader in passed:
            remedy = "Let one of them move freely."
            raise BadRobot(robot, f"joint {name}", "it mimics itself in a circle", remedy)
        passed.add(found.leader)
        leader, multiplier, offset = followers[found.leader]
        factor = found.multiplier
        found = MimicLaw(leader, factor * multiplier, factor * offset + found.offset)
    return found


LOCK = "Lock it, if it stood still in the log: `--lock {}`."
_MARK = "\1"  # occurs in no name: XML forbids the character


def locked_joints(
    names: Sequence[str], lock: Sequence[str], keep: Sequence[str] | None
) -> set[str]:
    """The joints to lock: those of `lock`, and all but those of `keep` unless that is None.

    Raises:
        UnknownName: there is no such joint.
        InvalidInput: a joint is to be both locked and kept.
    """
    for name in [*lock, *(keep or ())]:
        if name not in names:
            raise UnknownName("moving joint", name, names)
    both = sorted(set(lock) & set(keep or ()))
    if both:
        remedy = "Name it in one of the two lists."
        raise InvalidInput("lock", "joints that are not to be kept", both[0], remedy)
    return set(lock) if keep is None else set(names) - set(keep)


def home(model: pin.Model) -> Array:
    """(nq,) joints at 0 or at the nearest limit; floating joints at the origin."""
    q = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        if joint.nq == 1:
            low = model.lowerPositionLimit[joint.idx_q]
            high = model.upperPositionLimit[joint.idx_q]
            if low <= high:
                q[joint.idx_q] = np.clip(0.0, low, high)
    return q


def reduced(
    model: pin.Model, geometry: pin.GeometryModel, locked: set[str], q: Array
) -> tuple[pin.Model, pin.GeometryModel]:
    """A model and its shapes with joints locked at a configuration q (nq,)."""
    ids = [i for i in range(1, model.njoints) if model.names[i] in locked]
    if not ids:
        return model, geometry
    marked = pin.Model(model)  # Pinocchio finds a joint's frame by its name, which a body may share
    for frame in marked.frames:
        if frame.type == pin.FrameType.BODY:
            frame.name = _MARK + frame.name
    small, shapes = pin.buildReducedModel(marked, geometry, ids, q)
    for frame in small.frames:
        frame.name = frame.name.removeprefix(_MARK)
    return small, shapes


def check_tree(
    robot: str, model: pin.Model, base: str | None = None, floating: bool = False
) -> None:
    """Checks that a model consists of 1-DOF joints, after a free flyer if its base is `floating`.

    `base` is None for a robot to identify, whose joints can be locked.

    Raises:
        BadRobot: a joint has several degrees of freedom, no joint moves, or the base is fixed.
    """
    if model.nv == 0:
        raise BadRobot(robot, "", "no joint moves", "Keep at least one joint.")
    if floating and model.joints[1].nv != 6:
        remedy = "Use ArmPlant, or a robot that floats." if base else "Give its body a <freejoint>."
        raise BadRobot(robot, "", "its base is fixed", remedy)
    for i in range(2 if floating else 1, model.njoints):
        joint = model.joints[i]
        name = model.names[i]
        if joint.nv != 1:
            reason = f"it has {joint.nv} degrees of freedom, not one as a hinge or a slide"
            remedy = "Make it fixed in a copy of the file." if base else LOCK.format(name)
            raise BadRobot(robot, f"joint {name}", reason, remedy)
