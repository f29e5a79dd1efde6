"""Robots of joints on a fixed or floating base, from Pinocchio's models.

A joint's coordinate is its angle [rad] or travel [m]. There is one position coordinate for each
velocity: for a free-flyer root, the base's position [m] and rotation vector [rad], and then
one coordinate per joint. q is Pinocchio's: the base's pose [p, quaternion] (7,), then an angle, a
travel, or (cos, sin) for each joint. v is the base's twist [v, ω] in its own axes, then the joints'
rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Literal

import numpy as np

from ..parameters import Array, ParameterSpace
from ..structure.parts import Body, Column, Rotor
from ..structure.structure import Structure
from .optional import pin
from .structured import StructuredKinematics

Actuator = Literal["motor", "servo"]
"""What a joint's command is: a motor's torque over its gain, or a servo's target."""
_UNLIMITED = np.pi  # range of probes of joints without limits, ± [rad or m]
_PLACE, _TURN = 1.0, 1.8  # range of probes of a base, ± [m], ± [rad] per axis: 1.8 √3 < π


class JointTree(StructuredKinematics):
    """A tree of 1-DOF joints, whose root may be a free flyer; subclasses supply the regressors.

    Args:
        model: Pinocchio's, without any inertia; see `without_inertia`.
        structure: of the robot; its bodies are those of `bodies_of`.
        space: names, units and scale of θ.
        mounts: (k, 3) point of application of every actuator parameter's force, in the base's
            axes [m]; None if there is nothing to draw.

    Attributes:
        model: Pinocchio's model without any inertia.
        joints: the 1-DOF joints, in order.
        joint_names: their names in the model.
        body_names: names of the moving bodies' links, the base first where it floats.
        bodies: number of moving bodies: one for each joint, and the base where it floats.
    """

    def __init__(
        self,
        model: pin.Model,
        structure: Structure,
        space: ParameterSpace,
        mounts: Array | None = None,
    ):
        super().__init__(structure, space, mounts)
        self.model, self.joints = model, moving_joints(model)
        self.joint_names, self.body_names = joint_names(model), body_names(model)
        self.bodies = len(structure.bodies)

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """(n,), (n,) range of the position coordinates; ±π where the model has no limits."""
        high = _UNLIMITED * np.ones(self.n)
        high[: self.group] = ([_PLACE] * 3 + [_TURN] * 3)[: self.group]
        low = -high
        for joint in self.joints:
            if joint.nq == 1:
                a = self.model.lowerPositionLimit[joint.idx_q]
                b = self.model.upperPositionLimit[joint.idx_q]
                if np.isfinite([a, b]).all() and a < b:
                    low[joint.idx_v], high[joint.idx_v] = max(a, -10.0), min(b, 10.0)
        return low, high

    def angles(self, q: Array) -> Array:
        """(k,) the joints' angles [rad] or travels [m] at q (m,)."""
        return np.array(
            [
                np.arctan2(q[j.idx_q + 1], q[j.idx_q]) if j.nq == 2 else q[j.idx_q]
                for j in self.joints
            ]
        )

    @cached_property
    def slides(self) -> list[bool]:
        """Which joints are prismatic."""
        return [slides(joint) for joint in self.joints]


def without_inertia(model: pin.Model) -> pin.Model:
    """A copy of a model without inertias: structure only, no true value."""
    model = pin.Model(model)
    for i in range(model.njoints):
        model.inertias[i] = pin.Inertia.Zero()
    model.armature[:] = 0.0
    return model


def moving_joints(model: pin.Model) -> list[pin.JointModel]:
    """The 1-DOF joints, in order."""
    return list(model.joints)[2 if floats(model) else 1 :]


def joint_names(model: pin.Model) -> list[str]:
    """Names of the 1-DOF joints."""
    return list(model.names)[2 if floats(model) else 1 :]


def slides(joint: pin.JointModel) -> bool:
    """Whether a joint is prismatic."""
    return bool(joint.shortname().startswith("JointModelP"))


def bodies_of(model: pin.Model) -> list[Body]:
    """The bodies of a Pinocchio model of 1-DOF joints, whose root may be a free flyer."""
    data, bodies = model.createData(), []
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for joint, name in zip(list(model.joints)[1:], body_names(model), strict=True):
        if joint.nv == 6:
            bodies.append(Body("free", name=name))
            continue
        place = model.jointPlacements[joint.id]
        jacobian = pin.getJointJacobian(model, data, joint.id, pin.ReferenceFrame.LOCAL)
        twist = jacobian.reshape(6, -1)[:, joint.idx_v]  # of one joint it is (6,)
        turns = bool(np.linalg.norm(twist[3:]) > 0.5)
        bodies.append(
            Body(
                ("circle" if joint.nq == 2 else "hinge") if turns else "slide",
                int(model.parents[joint.id]) - 1,
                twist[3:] if turns else twist[:3],
                place.rotation.copy(),
                place.translation.copy(),
                name,
            )
        )
    return bodies


def joint_parts(
    model: pin.Model,
    start: int,
    rotors: bool,
    friction_speed: Array,
    actuator: Actuator = "motor",
    driven: Sequence[int] | None = None,
) -> tuple[list[Rotor], list[Column]]:
    """What friction and a motor or servo on every driven joint add to a structure.

    Args:
        model: with k 1-DOF joints.
        start: index in θ of the first of rotor inertias (k, if modelled), viscous friction (k),
            Coulomb friction (k) and gains (n_u).
        rotors: whether rotor inertias are modelled.
        friction_speed: (k,) speeds at which Coulomb friction saturates [rad/s or m/s].
        actuator: kind of all actuators.
        driven: (n_u,) numbers of the joints that have one; None for all.
    """
    k = len(friction_speed)
    first = model.nv - k
    rotating = [Rotor(first + i, start + i) for i in range(k if rotors else 0)]
    start += len(rotating)
    columns = [Column("viscous", start + i, dof=first + i) for i in range(k)]
    start += k
    columns += [
        Column("coulomb", start + i, dof=first + i, speed=speed)
        for i, speed in enumerate(friction_speed)
    ]
    start += k
    columns += [
        Column(actuator, start + i, dof=first + joint, input=i)
        for i, joint in enumerate(range(k) if driven is None else driven)
    ]
    return rotating, columns


def body_names(model: pin.Model) -> list[str]:
    """Names of the links that the joints move, the base's first where the root is a free flyer.

    A link that the model does not name is called by its number.
    """
    links = model.njoints - 1
    names = ["universe", *(["base"] if floats(model) else ())]
    names += [f"link {i + 1}" for i in range(links - (len(names) - 1))]
    for frame in reversed(list(model.frames)):  # the first of several links welded together counts
        if frame.type == pin.FrameType.BODY:
            names[frame.parentJoint] = frame.name
    return names[1:]


def floats(model: pin.Model) -> bool:
    """Whether the root of a Pinocchio model is a free flyer."""
    return model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"


def bones(model: pin.Model, positions: Array) -> Array:
    """(k, bones, 2, 3) line segments that sketch a robot at positions (k, m) [m].

    They connect each joint with its parent's, and with frames that are fixed to it, such as a tool.
    A floating base has no parent.
    """
    data = model.createData()
    frames = [f for f in model.frames if not np.allclose(f.placement.translation, 0)]
    joints = range(2 if floats(model) else 1, model.njoints)
    found = []
    for q in positions:
        pin.forwardKinematics(model, data, q)
        origin = [data.oMi[i].translation.copy() for i in range(model.njoints)]
        segments = [(origin[i], origin[model.parents[i]]) for i in joints]
        segments += [
            (data.oMi[f.parentJoint].act(f.placement).translation, origin[f.parentJoint])
            for f in frames
        ]
        found.append(segments)
    return np.array(found)
