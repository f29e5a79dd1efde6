"""Robots of joints on a fixed or floating base, from Pinocchio's models.

A joint's coordinate is its angle [rad] or travel [m]. There is one position coordinate for each
velocity: for a free-flyer root, the base's position [m] and rotation vector [rad], and then
one coordinate per joint. q is Pinocchio's: the base's pose [p, quaternion] (7,), then an angle, a
travel, or (cos, sin) for each joint. v is the base's twist [v, ω] in its own axes, then the joints'
rates.

θ = ten inertial parameters of every link, the floating base first if there is one; then, for every
joint, rotor inertia (if modelled), viscous and Coulomb friction; for every motor its gain; then
what a vehicle adds. Link inertias are about the joint-frame origin in joint axes, in Pinocchio's
order: m, m·c (3), Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...base import EnginesDisagree, pin
from ..parameters import Array, Block, ParameterSpace
from .blocks import Term, mounts_of, placed
from .columns import KINDS
from .inverse_dynamics import InverseDynamics
from .parts import Actuator, Body, Inertia, Operation, Rotor
from .pinocchio_links import PinocchioLinks
from .structure import Structure
from .system import SecondOrderSystem

AGREEMENT = 1e-10
"""Largest accepted difference from Pinocchio, relative to the largest entry."""
_SAMPLES = 20  # random states at which both are compared
_UNLIMITED = np.pi  # range of probes of joints without limits, ± [rad or m]
_PLACE = 1.0  # range of probes of a base, ± [m], ± [rad] per axis: 1.8 √3 < π
_TURN = 1.8
_BASE_SPEED = 1.0  # largest speed of a floating base in probes of the structure [m/s, rad/s]


@dataclass(frozen=True)
class JointScales:
    """Data-sheet guesses for the b bodies and k joints of a robot.

    Attributes:
        mass: (b,) masses of the bodies, a floating base first [kg].
        length: (b,) sizes of the bodies [m].
        viscous: (k,) viscous friction [N·m·s/rad or N·s/m].
        coulomb: (k,) Coulomb friction [N·m or N].
        gain: (d,) motor gains [N·m or N per unit of command], or of servos [N·m/rad or N/m].
        speed: (k,) speeds of operation [rad/s or m/s].
        command: (d,) commands of operation [units of command].
        rotor: (k,) reflected rotor inertias [kg·m² or kg]; None omits them from θ.
        actuator: whether a command is a motor's, or the position target of a servo.
        driven: (d,) numbers of the joints that have an actuator; None for all.
        saturation: (d,) error u − q at which a servo exerts its largest force [rad or m]; None
            where it is not limited.
    """

    mass: Array
    length: Array
    viscous: Array
    coulomb: Array
    gain: Array
    speed: Array
    command: Array
    rotor: Array | None = None
    actuator: Actuator = "motor"
    driven: tuple[int, ...] | None = None
    saturation: Array | None = None


class JointTree(SecondOrderSystem):
    """M(q, θ) v̇ + C(x, θ) v = −g(q, θ) − f(v, θ) + diag(k) u (5): motors on a tree's 1-DOF joints.

    With position servos, whose commands are targets, the last term is diag(k) (u − q). Friction is
    `viscous·v + coulomb·tanh(v/friction_speed)`. The root may be a free flyer, that of a vehicle
    with thrusters too (4–6); the joints' commands come first.

    C is Pinocchio's: with R_g and R_0 the joint torque regressors with and without gravity,
    C(q, v) w = R_0(q, (v+w)/2, ½[v, w]) π − R_0(q, (v−w)/2, 0) π, whose Ṁ − 2C is skew. [v, w] is
    the Lie bracket of the base's twists, 0 where the base is fixed: rates of joints commute.

    Args:
        model: kinematics and gravity; its inertias are discarded.
        scales: data-sheet guesses, which become the scale of θ.
        friction_speed: (k,) joint speed at which Coulomb friction saturates [rad/s or m/s].
        terms: of a vehicle at the root, fluid forces and thrust, which come last in θ; commands
            count from the first thruster's. None if all actuators are on joints.
        operation: ranges of the root's velocities, and of the thrusters' commands.
        inertias: of all bodies, if they are not rigid ones alone.
        bodies: their blocks, which come first in θ.

    Attributes:
        model: Pinocchio's model without any inertia.
        joints: the 1-DOF joints, in order.
        joint_names: their names in the model.
        body_names: names of the moving bodies' links, the base first where it floats; an unnamed
            link gets its number.
        slides: which joints are prismatic.
        bodies: number of moving bodies: one for each joint, and the base where it floats.
        driven: (d,) numbers of the joints that have an actuator; the others are passive.
        scales: as given.
        friction_speed: as given.
        command_limits: (n_u,), (n_u,) range of the commands of operation; of servos, about the
            position.
    """

    def __init__(
        self,
        model: pin.Model,
        scales: JointScales,
        friction_speed: Array,
        terms: Sequence[Term] | None = None,
        operation: Operation | None = None,
        inertias: Sequence[Inertia] = (),
        bodies: Sequence[Block] = (),
    ):
        model = without_inertia(model)
        tree = bodies_of(model)
        if operation is None:
            still = _BASE_SPEED * np.ones(6 if floats(model) else 0)
            operation = Operation.within(still, np.zeros(0))
        if not bodies:
            inertias = [Inertia(b, 10 * b) for b in range(len(tree))]
            bodies = _link_blocks(model, scales.mass, scales.length)
        forces = terms or []
        speed = np.array(friction_speed, dtype=np.float64)
        joints = joint_terms(model, scales, speed)
        blocks = [term.block for term in (*joints, *forces)]
        space = ParameterSpace((*bodies, *blocks))
        self.driven = np.array(range(len(speed)) if scales.driven is None else scales.driven, int)
        columns = placed(space, joints)
        # those of one body follow one another: kernels compute its surroundings once
        carried = placed(space, forces, len(self.driven))
        columns += sorted(carried, key=lambda column: (column.input >= 0, column.body))
        first = model.nv - len(speed)
        start = sum(map(len, bodies))
        turning = range(0 if scales.rotor is None else len(speed))
        rotors = [Rotor(first + i, start + i) for i in turning]
        low, high = operation.command
        self.command_limits = np.r_[-scales.command, low], np.r_[scales.command, high]
        structure = Structure(
            tree,
            inertias,
            columns,
            len(space),
            len(self.command_limits[0]),
            rotors,
            model.gravity.linear.copy(),
        )
        mounts = None if terms is None else mounts_of(space, columns)
        super().__init__(structure, space, mounts)
        self.model = model
        self.joints = moving_joints(model)
        self.joint_names = joint_names(model)
        self.own_names = self.joint_names
        self.body_names = body_names(model)
        self.slides = [_slides(joint) for joint in self.joints]
        self.bodies = len(tree)
        self.scales = scales
        self.friction_speed = speed
        self._speed = np.concatenate([operation.velocity[1], scales.speed])

    @classmethod
    def checked(cls, model: pin.Model, scales: JointScales, friction_speed: Array) -> JointTree:
        """A tree after its comparison with Pinocchio, see `check_consistency`."""
        tree = JointTree(model, scales, friction_speed)
        tree.check_consistency()
        return tree

    @classmethod
    def by_pinocchio(
        cls, model: pin.Model, scales: JointScales, friction_speed: Array
    ) -> JointTree:
        """A tree whose links have Pinocchio's regressors: the reference, which is slower.

        Rotors and the forces on joints are the structure's.
        """
        tree = JointTree(model, scales, friction_speed)
        tree.reference = PinocchioLinks(tree)
        return tree

    @classmethod
    def links(
        cls, model: pin.Model, speed: Array | None = None, command: Array | None = None
    ) -> JointTree:
        """The links of a model, with one command for each joint, but no force on any.

        speed (k,) and command (k,) are the largest in probes of the structure, 1 by default.
        """
        bodies = model.njoints - 1
        per_body = np.ones(bodies)  # guesses, on which nothing depends
        per_joint = np.ones(len(joint_names(model)))
        speed = per_joint if speed is None else speed
        command = per_joint if command is None else command
        scales = JointScales(per_body, per_body, per_joint, per_joint, per_joint, speed, command)
        tree = JointTree(model, scales, per_joint)
        space = ParameterSpace(tree.space.blocks[:bodies])
        return tree.rebuilt(replace(tree.structure, columns=(), rotors=(), p=len(space)), space)

    def inverse_dynamics(self) -> InverseDynamics:
        """The inverse dynamics of an arm on a fixed base, for compiled controllers."""
        return InverseDynamics.of(self.structure.arrays, self.n)

    def link_blocks(
        self, mass: Sequence[float] | Array, length: Sequence[float] | Array
    ) -> list[Block]:
        """The inertial parameters of every body; a floating base is number 0.

        mass (b,) [kg] and length (b,) [m] of the bodies are guesses.
        """
        return _link_blocks(self.model, mass, length)

    def bones(self, positions: Array) -> Array:
        """(k, bones, 2, 3) line segments that sketch the robot at positions (k, m) [m].

        They connect each joint with its parent's, and with frames that are fixed to it, such as a
        tool. A floating base has no parent.
        """
        model = self.model
        data = model.createData()
        frames = [f for f in model.frames if not np.allclose(f.placement.translation, 0)]
        joints = range(2 if self.group else 1, model.njoints)
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

    @cached_property
    def limits(self) -> tuple[Array, Array]:
        """(n,), (n,) range of the position coordinates; ±π for joints without limits."""
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
        """(..., k) the joints' angles [rad] or travels [m] at q (..., m)."""
        columns = [
            np.arctan2(q[..., j.idx_q + 1], q[..., j.idx_q]) if j.nq == 2 else q[..., j.idx_q]
            for j in self.joints
        ]
        return np.stack(columns, axis=-1) if columns else np.zeros((*q.shape[:-1], 0))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose and a configuration within the limits, speeds and commands of operation."""
        q = self.position(rng.uniform(*self.limits))
        v = self._speed * rng.uniform(-1, 1, self.n)
        low, high = self.command_limits
        u = 0.5 * (low + high) + 0.5 * (high - low) * rng.uniform(-1, 1, self.n_u)
        return q, v, u if self.scales.actuator == "motor" else self.angles(q)[self.driven] + u

    def check_consistency(self) -> None:
        """Compares its regressors with Pinocchio's at random states.

        This includes the torque regressor of the links and, under random physical inertias, the
        mass matrix and the bias forces.

        Raises:
            EnginesDisagree: they differ by more than `AGREEMENT` of the largest entry.
        """
        rng = np.random.default_rng(0)
        model = pin.Model(self.model)
        links = 10 * self.bodies
        theta = np.zeros(self.p)
        for i in range(1, model.njoints):
            model.inertias[i] = pin.Inertia.Zero()
            model.inertias[i].mass = rng.uniform(0.5, 2.0)
            model.inertias[i].lever = rng.uniform(-0.3, 0.3, 3)
            moments = rng.uniform(0.05, 0.1, 3)
            model.inertias[i].inertia = np.diag(moments)
            theta[10 * (i - 1) : 10 * i] = model.inertias[i].toDynamicParameters()
        data = model.createData()
        still = np.zeros(self.n)
        for _ in range(_SAMPLES):
            q, v, _ = self.random_state(rng)
            a = rng.uniform(-1, 1, self.n)
            u = np.zeros(self.n_u)
            regressor = pin.computeJointTorqueRegressor(model, data, q, v, a)
            mass = pin.crba(model, data, q)
            bias = pin.nonLinearEffects(model, data, q, v)
            ours = self._W(0.0, q, v, v, a, u)[:, :links]
            ours_bias = self._W(0.0, q, v, v, still, u)[:, :links]
            for quantity, own, theirs in (
                ("torque regressor", ours, regressor.reshape(self.n, links)),
                ("mass matrix", self._mass_tensor(q) @ theta, np.triu(mass) + np.triu(mass, 1).T),
                ("bias force", ours_bias @ theta[:links], bias),
            ):
                apart = float(np.max(np.abs(own - theirs)) / max(np.max(np.abs(theirs)), 1e-300))
                if not apart <= AGREEMENT:
                    worst = int(np.argmax(np.max(np.abs(own - theirs).reshape(self.n, -1), axis=1)))
                    joint = max(j.id for j in list(model.joints)[1:] if j.idx_v <= worst)
                    raise EnginesDisagree(
                        model.name,
                        f"joint {model.names[joint]}",
                        quantity,
                        apart,
                        AGREEMENT,
                        ("The compiled structure", "Pinocchio"),
                        "Use --backend pinocchio.",
                    )


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


def _slides(joint: pin.JointModel) -> bool:
    """Whether a joint is prismatic."""
    return bool(joint.shortname().startswith("JointModelP"))


def bodies_of(model: pin.Model) -> list[Body]:
    """The bodies of a Pinocchio model of 1-DOF joints, whose root may be a free flyer."""
    data = model.createData()
    bodies = []
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


def body_names(model: pin.Model) -> list[str]:
    """Names of the links that the joints move, the base's first where the root is a free flyer.

    An unnamed link gets its number.
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


# -- blocks of θ -----------------------------------------------------------------------------------


def joint_terms(model: pin.Model, s: JointScales, friction_speed: Array) -> list[Term]:
    """The terms of k joints, if any: rotor inertia if modelled, friction, gains of d actuators.

    Coulomb friction saturates at the speeds (k,) [rad/s or m/s].
    """
    sliding = [_slides(joint) for joint in moving_joints(model)]
    names = joint_names(model)
    if not names:
        return []
    first = model.nv - len(names)
    every = tuple(range(len(names)))

    def of(kind: str, own: tuple[int, ...], scale: Array, **constants: Any) -> Term:
        letter = KINDS[kind].letter
        part = KINDS[kind].block.removeprefix("motor ")
        labels = {f"{letter}_{i + 1}": f"{part} of {names[i]}" for i in own}
        slides = [sliding[i] for i in own]
        dofs = [first + i for i in own]
        return Term.of(kind, labels, scale, scale, sliding=slides, dof=dofs, **constants)

    driven = every if s.driven is None else s.driven
    acting: dict[str, Sequence[Any]] = {"input": range(len(driven))}
    if s.saturation is not None:
        acting["limit"] = s.saturation.tolist()
    terms = [
        of("viscous", every, s.viscous),
        of("coulomb", every, s.coulomb, speed=friction_speed.tolist()),
        *([of(s.actuator, driven, s.gain, **acting)] if driven else []),
    ]
    if s.rotor is None:
        return terms
    own = tuple(f"rotor_{i + 1}" for i in every)
    units = tuple("kg" if slide else "kg·m²" for slide in sliding)
    labels = tuple(f"rotor inertia of {name}" for name in names)
    rotor = Block("rotor inertia", own, units, s.rotor, "positive", labels=labels)
    return [Term(rotor, [], s.rotor), *terms]


def _link_blocks(
    model: pin.Model, mass: Sequence[float] | Array, length: Sequence[float] | Array
) -> list[Block]:
    """The inertial parameters of every body; see `JointTree.link_blocks`."""
    first = 0 if floats(model) else 1
    guesses = zip(body_names(model), mass, length, strict=True)
    return [Block.of_link(first + i, name, *own) for i, (name, *own) in enumerate(guesses)]
