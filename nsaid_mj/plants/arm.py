"""Arms and robots that float: a MuJoCo model built from a Pinocchio model, body by body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, Self

import mujoco
import numpy as np
from pydantic import model_validator

from ..bounds import Name, NonNegative, Positive, Share, config
from ..errors import BadRobot, EnginesDisagree
from ..parameters import Array
from ..robot.robots import Base, Robot, load_robot
from ..robot.shapes import VisualMesh
from ..robot.tree import RobotVisuals, set_inertias, tree_spec
from ..systems.compiled import CompiledMultibody
from ..systems.joints import Actuator
from ..systems.multibody import JointScales, MotorTree, Multibody
from ..systems.optional import pin
from .world.coordinates import joint_map
from .world.forces import Forces, column_forces
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant
from .world.quiet import quiet

Backend = Literal["compiled", "pinocchio"]
"""Implementation of a robot's regressors: its structure's, or Pinocchio's."""

AGREEMENT = 1e-10  # largest relative difference of M and bias between the engines


@config
class ArmPlant(ParametricPlantConfig):
    """A robot with a motor or servo on every joint; a floating base is fixed to a stand.

    Friction, rotor inertia and motor gain have one nominal value for all joints, as in a data
    sheet, or None for values that suit the robot's size. The hidden true values, drawn from the
    seed, deviate from the nominal ones joint by joint, by up to `spread`.

    Attributes:
        robot: a name of example-robot-data, or the path of a URDF file.
        damping: nominal viscous friction [N·m·s/rad or N·s/m].
        friction: nominal Coulomb friction [N·m or N].
        armature: nominal reflected rotor inertia [kg·m² or kg]; 0 leaves it out of θ.
        gain: nominal gain of a motor [N·m or N per unit of command] or servo [N·m/rad or N/m].
        spread: largest relative deviation of the true values from the nominal ones.
        friction_speed: s in the Coulomb friction −c tanh(q̇/s) [rad/s or m/s].
        backend: implementation of the identifier's regressors: `compiled`, which are
            checked against Pinocchio at every start, or `pinocchio`, several times slower.
        actuator: `motor`, with torque gain · command, or `servo`, with gain · (target − position).
    """

    robot: Name = "ur5"
    damping: Positive | None = None
    friction: Positive | None = None
    armature: NonNegative | None = None
    gain: Positive = 1.0
    spread: Share = 0.2
    friction_speed: Positive = 0.05
    backend: Backend = "compiled"
    actuator: Actuator = "motor"
    _base: ClassVar[Base] = "held"

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        self.mismatch.refuse("an arm in air", "flow", "fluid")
        return self

    def build(self, dt: float, seed: int) -> Arm:
        """Loads the robot, draws the hidden parameters, compares MuJoCo with Pinocchio.

        Raises:
            BadRobot: the robot cannot be simulated, or has no joint for a motor.
            EnginesDisagree: MuJoCo and Pinocchio compute different dynamics.
        """
        robot, nominal = self._published()
        rng = np.random.default_rng(seed)
        n = len(nominal.gain)

        def hidden(value: Array) -> Array:
            return value * (1 + self.spread * rng.uniform(-1, 1, n))

        joints = HiddenJoints(
            rotor=hidden(nominal.rotor) if nominal.rotor is not None else None,
            viscous=hidden(nominal.viscous),
            coulomb=hidden(nominal.coulomb),
            gain=hidden(nominal.gain),
        )
        return self._plant(dt, robot, nominal, joints)

    def simulating(self, dt: float, theta: Array | None = None) -> Arm:
        """Makes the robot with the true parameters θ (p,), or those of URDF and data sheet."""
        robot, nominal = self._published()
        joints = HiddenJoints.of(nominal)
        if theta is not None:
            joints = set_tree(robot.model, theta, len(nominal.gain))
        return self._plant(dt, robot, nominal, joints)

    def _published(self) -> tuple[Robot, JointScales]:
        """The robot's description, and the joints' nominal values."""
        robot = load_robot(self.robot, self._base)
        if robot.model.joints[robot.model.njoints - 1].nv != 1:
            raise BadRobot(self.robot, "", "it has no joint for a motor", "Take FlyingArmPlant.")
        return robot, nominal_scales(robot.model, self)

    def _plant(self, dt: float, robot: Robot, nominal: JointScales, joints: HiddenJoints) -> Arm:
        n = len(nominal.gain)
        structure = CompiledMultibody if self.backend == "compiled" else Multibody
        system = structure(robot.model, nominal, np.full(n, self.friction_speed))
        return Arm(robot, system, joints, dt, self.mismatch).failing(self.faults, self)


@config
class FloatingBasePlant(ArmPlant):
    """A floating-base robot in free fall, with a motor on every joint and none on its base.

    Its attributes are those of `ArmPlant`.
    """

    robot: Name = "solo12"
    _base: ClassVar[Base] = "free"


@dataclass(frozen=True)
class HiddenJoints:
    """True parameters of the joints, (k,) each; units as in `JointScales`."""

    rotor: Array | None
    viscous: Array
    coulomb: Array
    gain: Array

    @staticmethod
    def of(nominal: JointScales) -> HiddenJoints:
        """Joints with the nominal values."""
        return HiddenJoints(nominal.rotor, nominal.viscous, nominal.coulomb, nominal.gain)


def set_tree(model: pin.Model, theta: Array, joints: int) -> HiddenJoints:
    """Overwrites the inertias of a model by those in θ = [bodies, joints]; returns the joints."""
    links = 10 * (model.njoints - 1)
    set_inertias(model, theta[:links])
    values = theta[links:].reshape(-1, joints) if joints else np.zeros((3, 0))
    return HiddenJoints(values[0] if len(values) == 4 else None, *values[-3:])


class Arm(Plant):
    """An arm or a floating-base robot in MuJoCo.

    Args:
        robot: the description; its inertias are the true ones.
        system: the structure that an identifier may know.
        hidden: the true parameters of its joints.
        dt: time step [s].
        mismatch: the effects outside the structure.

    Raises:
        BadRobot: MuJoCo rejects a body, or a joint's friction is too stiff for dt.
        EnginesDisagree: MuJoCo and Pinocchio compute different dynamics.
    """

    system: MotorTree

    def __init__(
        self,
        robot: Robot,
        system: MotorTree,
        hidden: HiddenJoints,
        dt: float,
        mismatch: Mismatch,
    ):
        self.robot, self.system, self._hidden = robot, system, hidden
        spec, k = arm_spec(robot.model, hidden, dt, system.scales.actuator), system.n_u
        acting = np.zeros(system.p)
        acting[-2 * k : -k] = hidden.coulomb  # MuJoCo's own `frictionloss` creeps
        if system.scales.actuator == "servo":
            acting[-k:] = hidden.gain
        forces = Forces(system.structure, acting, np.zeros(3))
        self.gain_places = forces.gain_places if acting[-k:].any() else ()
        spec.nuserdata, self.passive = forces.size, column_forces()
        try:
            self._compile(spec, mismatch)
        except ValueError as error:
            raise BadRobot(
                robot.name, "", f"MuJoCo rejects it: {error}", "Correct the named body's inertia."
            ) from error
        self.joints = joint_map(self.model, list(robot.model.names)[1:])
        self.reading = self.joints.reading([joint.nq == 2 for joint in system.joints])
        self._numbers = forces.numbers(self.reading, mismatch.lag > 0)
        with quiet():
            self._compare_engines()
            self._check_stiffness(dt)
        self.reset(np.mean(system.limits, axis=0), np.zeros(system.n))

    @cached_property
    def truth(self) -> Array:
        """(p,) the true θ."""
        links = [
            self.robot.model.inertias[i].toDynamicParameters()
            for i in range(1, self.robot.model.njoints)
        ]
        h = self._hidden
        rotor = [h.rotor] if h.rotor is not None else []
        return np.concatenate([*links, *rotor, h.viscous, h.coulomb, h.gain])

    def _place(self, position: Array, velocity: Array) -> None:
        self.joints.write(self.data, position, velocity)
        self.data.userdata[:] = self._numbers

    def coordinates(self) -> tuple[Array, Array]:
        """(n,) position numbers, joint angles [rad] or displacements [m], and (n,) velocities."""
        return self.joints.read(self.data)

    def visuals(self) -> list[VisualMesh]:
        """The visual meshes of the robot's description; there may be none."""
        return self._visuals.visuals()

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        return self._visuals.poses(q)

    @cached_property
    def _visuals(self) -> RobotVisuals:
        return RobotVisuals(self.robot)

    def _compare_engines(self, samples: int = 5) -> None:
        """Compares M and bias forces of MuJoCo and Pinocchio at random states.

        Raises:
            EnginesDisagree: names the link and the quantity that differ.
        """
        rng = np.random.default_rng(0)
        model, data = self.robot.model, self.robot.model.createData()
        rotor = np.zeros(model.nv)
        if self._hidden.rotor is not None:
            rotor[self.system.group :] = self._hidden.rotor
        for _ in range(samples):
            coordinates = rng.uniform(*self.system.limits)
            v = rng.uniform(-1, 1, model.nv)
            q = self.position(coordinates)
            self.joints.write(self.data, coordinates, v)
            mujoco.mj_forward(self.model, self.data)
            M = pin.crba(model, data, q) + np.diag(rotor - model.armature)
            bias = pin.nonLinearEffects(model, data, q, v)
            force = max(np.abs(bias).max(), np.abs(M).max())  # a balanced robot has no bias
            for quantity, difference in (
                ("mass matrix", self.joints.mass_matrix(self.model, self.data) - M),
                ("bias force", self.joints.bias(self.model, self.data) - bias),
            ):
                relative = np.abs(difference) / (np.abs(M).max() if difference.ndim == 2 else force)
                if not relative.max() <= AGREEMENT:
                    own = np.diag(relative) if relative.ndim == 2 else relative
                    last = int(np.flatnonzero(~(own <= AGREEMENT))[-1:].sum())  # ancestors follow
                    moved = max(j.id for j in list(model.joints)[1:] if j.idx_v <= last)
                    link = f"link of joint {model.names[moved]}"
                    raise EnginesDisagree(
                        self.robot.name, link, quantity, float(relative.max()), AGREEMENT
                    )

    def _check_stiffness(self, dt: float) -> None:
        """Checks RK4's stability, |λ| dt < 2.78; friction's |λ| is at most (viscous + c/s)/M_ii.

        Raises:
            BadRobot: names the joint and a time step that is small enough, or M is singular.
        """
        self.reset(np.mean(self.system.limits, axis=0), np.zeros(self.system.n))
        mujoco.mj_forward(self.model, self.data)
        try:
            inertia = 1 / np.diag(np.linalg.inv(self.joints.mass_matrix(self.model, self.data)))
        except np.linalg.LinAlgError as error:
            raise BadRobot(
                self.robot.name,
                "",
                "its mass matrix is singular: a moving link has next to no inertia",
                "Give the link its mass, or the joints rotor inertia (--plant.armature 0.01).",
            ) from error
        inertia = inertia[self.system.group :]
        rate = (self._hidden.viscous + self._hidden.coulomb / self.system.friction_speed) / inertia
        worst = int(np.argmax(rate))
        if rate[worst] * dt > 2.5:
            raise BadRobot(
                self.robot.name,
                f"joint {self.robot.model.names[self.system.joints[worst].id]}",
                f"its friction acts at {rate[worst]:.0f}/s, too fast for steps of {dt:g} s",
                f"Take dt ≤ {2 / rate[worst]:.1g} s, less friction, or a larger friction_speed.",
            )


def arm_spec(model: pin.Model, hidden: HiddenJoints, dt: float, actuator: Actuator) -> Any:
    """MuJoCo's specification of a Pinocchio model, with an actuator on every 1-DOF joint.

    A servo's has no gain: its torque is a column.
    """
    spec = tree_spec(model, dt)
    for k, name in enumerate(list(model.names)[-len(hidden.gain) :]):
        joint = spec.joint(name)
        joint.damping = [hidden.viscous[k], 0, 0]
        joint.armature = hidden.rotor[k] if hidden.rotor is not None else 0.0
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = hidden.gain[k] if actuator == "motor" else 0.0
    return spec


def nominal_scales(model: pin.Model, config: ArmPlant) -> JointScales:
    """An engineer's guess: sizes to within a factor of two, and the data sheet's values.

    Masses and lengths are rounded to powers of two, so that the scale of θ does not reveal the true
    inertias.
    """
    inertias = [model.inertias[i] for i in range(1, model.njoints)]
    mass = np.array([_octave(inertia.mass) for inertia in inertias])
    length = np.array([_octave(extent(inertia)) for inertia in inertias])
    size, weight = joint_sizes(model)
    k = len(size)
    damping = 0.5 * size if config.damping is None else np.full(k, config.damping)
    friction = 0.5 * size if config.friction is None else np.full(k, config.friction)
    armature = 0.1 * size if config.armature is None else np.full(k, config.armature)
    limit = model.velocityLimit[model.nv - k :]
    speed = np.where(limit > 0.1, np.minimum(limit, 2.0), 2.0)
    speed = np.where(np.isfinite(speed), speed, 2.0)
    torque = weight + (size + armature) * speed * 5 + friction + damping * speed
    return JointScales(
        mass=mass,
        length=length,
        viscous=damping,
        coulomb=friction,
        gain=np.full(k, config.gain),
        speed=speed,
        command=torque / config.gain,
        rotor=armature if armature.any() else None,
        actuator=config.actuator,
    )


def joint_sizes(model: pin.Model) -> tuple[Array, Array]:
    """Inertia and weight that each 1-DOF joint carries, rounded to powers of two.

    The weight is the bound g·√(m I), as (m r)² ≤ m · m r².

    Returns:
        (k,) inertia [kg·m² or kg] and (k,) weight [N·m or N].
    """
    data = model.createData()
    joints = [joint for joint in list(model.joints)[1:] if joint.nv == 1]
    size = np.diag(pin.crba(model, data, pin.neutral(model)))[[joint.idx_v for joint in joints]]
    pin.computeSubtreeMasses(model, data)
    carried = np.array([data.mass[joint.id] for joint in joints])
    weight = np.linalg.norm(model.gravity.linear) * np.sqrt(carried * size)
    return np.array([_octave(x) for x in size]), np.array([_octave(x) for x in weight])


def _octave(value: float) -> float:
    """The nearest power of two: a guess by order of magnitude."""
    return float(2.0 ** np.round(np.log2(max(value, 1e-9))))


def extent(inertia: pin.Inertia) -> float:
    """A link's size [m]: its radius of gyration about the joint."""
    about_joint = np.trace(inertia.inertia) + 2 * inertia.mass * inertia.lever @ inertia.lever
    return float(np.sqrt(about_joint / (2 * inertia.mass)))
