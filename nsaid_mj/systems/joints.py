"""Coordinates of a tree of joints on a fixed or floating base.

A joint's coordinate is its angle [rad] or travel [m]. There is one position coordinate for each
velocity: for a free-flyer root, the base's position [m] and rotation vector [rad], and then
one coordinate per joint. q is Pinocchio's: the base's pose [p, quaternion] (7,), then an angle, a
travel, or (cos, sin) for each joint. v is the base's twist [v, ω] in its own axes, then the joints'
rates.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..numerics.spatial import pose_jacobian, quaternion_of
from ..parameters import Array
from ..system import SecondOrderSystem
from .optional import pin
from .structured import SPATIAL_UNITS

_UNLIMITED = np.pi  # range of probes of joints without limits, ± [rad or m]
_PLACE, _TURN = 1.0, 1.8  # range of probes of a base, ± [m], ± [rad] per axis: 1.8 √3 < π


class JointTree(SecondOrderSystem):
    """A system with the kinematics of a tree of 1-DOF joints; subclasses supply the regressors.

    Args:
        model: kinematics and gravity; its inertias are discarded.

    Attributes:
        model: Pinocchio's model without any inertia.
        joints: the 1-DOF joints, in order.
        joint_names: their names in the model.
        body_names: names of the moving bodies' links, the base first where it floats.
        bodies: number of moving bodies: one for each joint, and the base where it floats.
    """

    def __init__(self, model: pin.Model):
        self.model = pin.Model(model)
        for i in range(self.model.njoints):
            self.model.inertias[i] = pin.Inertia.Zero()  # structure only: no true value in here
        self.model.armature[:] = 0.0
        self.n, self.m = self.model.nv, self.model.nq
        self.bodies = self.model.njoints - 1
        self.group = 6 if floats(self.model) else 0
        first = 2 if self.group else 1
        self.joints = list(self.model.joints)[first:]
        self.joint_names = list(self.model.names)[first:]
        self.body_names = body_names(self.model)
        self._plain = self.m == self.n  # no floating base and no continuous joint: positions add

    def integrate(self, q: Array, dq: Array) -> Array:
        """q ⊕ dq; continuous joints stay on the unit circle, the base's attitude on the sphere."""
        return q + dq if self._plain else pin.integrate(self.model, q, dq)

    def difference(self, q0: Array, q1: Array) -> Array:
        """q1 ⊖ q0; the shorter rotation for continuous joints and the base's attitude."""
        return q1 - q0 if self._plain else pin.difference(self.model, q0, q1)

    def J(self, q: Array) -> Array:
        """(m, n) with q̇ = J v (3): 1 for a joint's coordinate, (−sin, cos) if it is continuous."""
        J = np.zeros((self.m, self.n))
        if self.group:
            J[:7, :6] = pose_jacobian(q)
        for joint in self.joints:
            if joint.nq == 2:
                J[joint.idx_q : joint.idx_q + 2, joint.idx_v] = -q[joint.idx_q + 1], q[joint.idx_q]
            else:
                J[joint.idx_q, joint.idx_v] = 1.0
        return J

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

    def position(self, coordinates: Array) -> Array:
        """(..., m) position q of position coordinates (..., n)."""
        if self._plain:
            return np.array(coordinates, dtype=np.float64)
        coordinates = np.asarray(coordinates, dtype=np.float64)
        q = np.zeros((*coordinates.shape[:-1], self.m))
        if self.group:
            q[..., :3] = coordinates[..., :3]
            for numbers, pose in zip(
                coordinates.reshape(-1, self.n), q.reshape(-1, self.m), strict=True
            ):
                pose[3:7] = quaternion_of(numbers[3:6])
        for joint in self.joints:
            c = coordinates[..., joint.idx_v]
            if joint.nq == 2:
                q[..., joint.idx_q], q[..., joint.idx_q + 1] = np.cos(c), np.sin(c)
            else:
                q[..., joint.idx_q] = c
        return q

    @cached_property
    def velocity_units(self) -> tuple[str, ...]:
        """One unit for each velocity: rad/s, or m/s for a prismatic joint."""
        units = tuple("m/s" if slides else "rad/s" for slides in self.slides)
        return SPATIAL_UNITS[: self.group] + units

    @cached_property
    def slides(self) -> list[bool]:
        """Which joints are prismatic."""
        return [joint.shortname().startswith("JointModelP") for joint in self.joints]


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
