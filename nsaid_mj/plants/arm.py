"""Arms and floating robots: a MuJoCo model built from a Pinocchio model, body by body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from operator import attrgetter
from typing import Any, ClassVar, Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ..bounds import Name, NonNegative, Positive, Share, config
from ..errors import BadRobot, EnginesDisagree
from ..parameters import Array
from ..robot.loading import Base, load_robot
from ..robot.tree import set_inertias, tree_spec
from ..structure.blocks import guessed
from ..structure.joints import Actuator, JointScales, JointTree
from ..structure.multibody import CompiledMultibody, Multibody
from ..structure.optional import pin
from .world.quiet import quiet
from .world.simulated import Known, KnownPlant, SimulatedRobot

Backend = Literal["compiled", "pinocchio"]
"""Implementation of a robot's regressors: its structure's, or Pinocchio's."""

AGREEMENT = 1e-10  # largest relative difference of M and bias between the engines
_SAMPLES = 5  # random states at which they are compared


@config
class ArmPlant(KnownPlant):
    """A robot with a motor or servo on every joint; a floating base is fixed to a stand.

    Joints without an actuator in the robot's file are passive. Friction, rotor inertia and gain
    have one nominal value for all joints, as in a data sheet; None uses those of an MJCF (their
    median for a joint without any), or else values typical of the robot's size. The hidden true
    values, drawn from the seed, deviate from these joint by joint, by up to `spread`.

    Attributes:
        robot: a name of example-robot-data, or the path of a URDF or MJCF file.
        damping: nominal viscous friction [N·m·s/rad or N·s/m].
        friction: nominal Coulomb friction [N·m or N].
        armature: nominal reflected rotor inertia [kg·m² or kg]; 0 leaves it out of θ.
        gain: nominal gain of a motor [N·m or N per unit of command] or servo [N·m/rad or N/m];
            None for the file's kp of a servo, and 1 of a motor.
        spread: largest relative deviation of the true values from the nominal ones.
        friction_speed: s in the Coulomb friction −c tanh(q̇/s) [rad/s or m/s].
        backend: implementation of the identifier's regressors: `compiled`, checked against
            Pinocchio at every start, or `pinocchio`, several times slower.
        actuator: `motor`, with torque gain · command, or `servo`, with gain · (target − position),
            at most the file's `forcerange`; None for servos where the file has position servos on
            all joints, whose kv is part of the damping, else motors.
    """

    robot: Name = "ur5"
    damping: Positive | None = None
    friction: Positive | None = None
    armature: NonNegative | None = None
    gain: Positive | None = None
    spread: Share = 0.2
    friction_speed: Positive = 0.05
    backend: Backend = "compiled"
    actuator: Actuator | None = None
    _base: ClassVar[Base] = "held"
    _refuses: ClassVar[tuple[str, ...]] = ("an arm in air", "flow", "fluid")

    def _published(self) -> Known:
        """The robot's description and structure; θ of its file and data sheet.

        Raises:
            BadRobot: the robot cannot be simulated, or has no joint for a motor.
        """
        robot = load_robot(self.robot, self._base)
        if robot.model.joints[robot.model.njoints - 1].nv != 1:
            raise BadRobot(self.robot, "", "it has no joint for a motor", "Use FlyingArmPlant.")
        driven = [k for k, name in enumerate(robot.joints) if name not in robot.passive]
        servos = None if self.actuator == "motor" else robot.servos
        own = {"damping": robot.damping, "friction": robot.friction, "armature": robot.rotor}
        if servos is not None:
            own["damping"] = robot.damping.copy()
            own["damping"][driven] += servos.kv
        middle = {name: float(np.median(x)) for name, x in own.items() if robot.kind == "mjcf"}
        stated = {n: np.where(own[n] > 0, own[n], x) for n, x in middle.items() if x > 0}
        chosen = self.actuator or ("motor" if servos is None else "servo")
        nominal = nominal_scales(robot.model, replace(self, actuator=chosen), stated)
        if servos is not None and self.gain is None:
            nominal.gain[driven] = servos.kp
            nominal.command[driven] /= servos.kp
            limit = robot.limits[driven] / servos.kp
            nominal = replace(nominal, saturation=limit if np.isfinite(limit).any() else None)
        if robot.passive:
            gain, command = nominal.gain[driven], nominal.command[driven]
            nominal = replace(nominal, gain=gain, command=command, driven=tuple(driven))
        structure = CompiledMultibody if self.backend == "compiled" else Multibody
        speed = np.full(len(nominal.viscous), self.friction_speed)
        system = structure(robot.model, nominal, speed)
        joints = [block.name for block in system.space.blocks if block.geometry == "positive"]
        unsure = [(name, 1.0) for name in joints]
        return Known(robot, system, published_theta(robot.model, system), unsure)

    def _made(self, known: Known, dt: float, theta: Array) -> SimulatedRobot:
        """Makes the plant, and compares MuJoCo with Pinocchio.

        Raises:
            BadRobot: MuJoCo rejects it, or its friction is too fast for the time step.
            EnginesDisagree: MuJoCo and Pinocchio compute different dynamics.
        """
        robot, system = known.source, known.system
        model, space, acting = true_model(robot.model, theta), system.space, np.zeros(system.p)
        coulomb = space["Coulomb friction"]
        acting[coulomb] = theta[coulomb]  # `frictionloss` creeps
        if system.scales.actuator == "servo":
            acting[space["servo gain"]] = theta[space["servo gain"]]
        spec = arm_spec(model, system, theta, dt)
        names, looks = list(model.names)[1:], robot.visuals
        try:
            made = SimulatedRobot(system, theta, acting, spec, names, self.mismatch, looks)
        except ValueError as error:
            raise BadRobot(
                robot.name, "", f"MuJoCo rejects it: {error}", "Correct the named body's inertia."
            ) from error
        made.targets = system.scales.actuator == "servo"
        if made.targets and robot.servos is not None:
            if robot.servos.delay.any():
                made.late = np.round(robot.servos.delay / dt).astype(np.intp)
            if robot.servos.profile.any():
                made.profile = robot.servos.profile
        with quiet():
            compare_engines(made, robot.name, model)
            check_stiffness(made, robot.name)
        return made


@config
class FloatingBasePlant(ArmPlant):
    """A floating-base robot in free fall, with a motor on every joint and none on its base.

    Its attributes are those of `ArmPlant`.
    """

    robot: Name = "solo12"
    _base: ClassVar[Base] = "free"


def published_theta(model: pin.Model, system: JointTree) -> Array:
    """(p,) θ of a description's inertias and of its joints' nominal values."""
    bodies = [inertia.toDynamicParameters() for inertia in list(model.inertias)[1:]]
    joints = [block.scale for block in system.space.blocks if block.geometry == "positive"]
    return np.concatenate([*bodies, *joints])


def true_model(model: pin.Model, theta: Array) -> pin.Model:
    """A copy of a model with the bodies' inertias in θ (p,), which begins with them."""
    model = pin.Model(model)
    set_inertias(model, theta[: 10 * (model.njoints - 1)])
    return model


def arm_spec(model: pin.Model, system: JointTree, theta: Array, dt: float) -> Any:
    """MuJoCo's specification of a Pinocchio model, with an actuator on every driven joint.

    Viscous friction, rotor inertias and motor gains are those in θ (p,). A servo's actuator has no
    gain: its torque is a column.
    """
    spec, space = tree_spec(model, dt), system.space
    give_rotors(spec, system, theta)
    for name, viscous in zip(system.joint_names, theta[space["viscous friction"]], strict=True):
        spec.joint(name).damping = [viscous, 0, 0]
    gains = theta[space.actuators] * (system.scales.actuator == "motor")
    for joint, gain in zip(system.driven, gains, strict=True):
        name = system.joint_names[joint]
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = gain
    return spec


def give_rotors(spec: Any, system: JointTree, theta: Array) -> None:
    """Sets the rotor inertias in θ (p,), if modelled, in MuJoCo's specification."""
    if system.scales.rotor is not None:
        rotor = theta[system.space["rotor inertia"]]
        for name, inertia in zip(system.joint_names, rotor, strict=True):
            spec.joint(name).armature = inertia


def compare_engines(plant: SimulatedRobot, name: str, model: pin.Model) -> None:
    """Compares M and bias forces of MuJoCo and Pinocchio at random states, with the true inertias.

    Raises:
        EnginesDisagree: names the link and the quantity that differ.
    """
    rng, joints = np.random.default_rng(0), plant.joints
    data, rotor = model.createData(), np.zeros(model.nv)
    rotor[plant.system.group :] = plant.model.dof_armature[joints.motors]
    for _ in range(_SAMPLES):
        coordinates = rng.uniform(*plant.system.limits)  # type: ignore[attr-defined]  # a tree
        v = rng.uniform(-1, 1, model.nv)
        q = plant.position(coordinates)
        joints.write(plant.data, coordinates, v)
        mujoco.mj_forward(plant.model, plant.data)
        M = pin.crba(model, data, q) + np.diag(rotor - model.armature)
        bias = pin.nonLinearEffects(model, data, q, v)
        force = max(np.abs(bias).max(), np.abs(M).max())  # a balanced robot has no bias
        for quantity, difference in (
            ("mass matrix", joints.mass_matrix(plant.model, plant.data) - M),
            ("bias force", joints.bias(plant.model, plant.data) - bias),
        ):
            relative = np.abs(difference) / (np.abs(M).max() if difference.ndim == 2 else force)
            if not relative.max() <= AGREEMENT:
                own = np.diag(relative) if relative.ndim == 2 else relative
                last = int(np.flatnonzero(~(own <= AGREEMENT))[-1:].sum())  # ancestors follow
                moved = max(j.id for j in list(model.joints)[1:] if j.idx_v <= last)
                link = f"link of joint {model.names[moved]}"
                raise EnginesDisagree(name, link, quantity, float(relative.max()), AGREEMENT)


def check_stiffness(plant: SimulatedRobot, name: str) -> None:
    """Checks RK4's stability, |λ| dt < 2.78; friction's |λ| is at most (viscous + c/s)/M_ii.

    The robot has motors on its joints only; it is reset.

    Raises:
        BadRobot: names the joint and a time step that is small enough, or M is singular.
    """
    system, theta = plant.system, plant.truth
    assert isinstance(system, JointTree)
    plant.reset(np.mean(system.limits, axis=0), np.zeros(system.n))
    mujoco.mj_forward(plant.model, plant.data)
    try:
        inertia = 1 / np.diag(np.linalg.inv(plant.joints.mass_matrix(plant.model, plant.data)))
    except np.linalg.LinAlgError as error:
        raise BadRobot(
            name,
            "",
            "its mass matrix is singular: a moving link has almost no inertia",
            "Give the link its mass, or the joints rotor inertia (--plant.armature 0.01).",
        ) from error
    viscous, coulomb = (theta[system.space[f"{kind} friction"]] for kind in ("viscous", "Coulomb"))
    rate = (viscous + coulomb / system.friction_speed) / inertia[system.group :]
    worst = int(np.argmax(rate))
    if rate[worst] * plant.dt > 2.5:
        raise BadRobot(
            name,
            f"joint {system.joint_names[worst]}",
            f"its friction acts at {rate[worst]:.0f}/s, too fast for steps of {plant.dt:g} s",
            f"Use dt ≤ {2 / rate[worst]:.1g} s, less friction, or a larger friction_speed.",
        )


def nominal_scales(
    model: pin.Model, config: ArmPlant, stated: Mapping[str, Array] | None = None
) -> JointScales:
    """An engineer's guess: sizes to within a factor of two, and the data sheet's values.

    Masses and lengths are rounded to powers of two, so that the scale of θ does not reveal the true
    inertias. `stated` are (k,) `damping`, `friction` and `armature` that the model's file states,
    where the data sheet `config` does not.
    """
    inertias = list(model.inertias)[1:]
    mass, length = (
        _octaves([value(inertia) for inertia in inertias]) for value in (attrgetter("mass"), extent)
    )
    size, weight = joint_sizes(model)
    k = len(size)
    guesses = {"damping": 0.5 * size, "friction": 0.5 * size, "armature": 0.1 * size}
    sheet = {n: np.full(k, x) for n in guesses if (x := getattr(config, n)) is not None}
    damping, friction, armature = (guesses | dict(stated or {}) | sheet).values()
    gain = 1.0 if config.gain is None else config.gain
    limit = model.velocityLimit[model.nv - k :]
    speed = np.where(limit > 0.1, np.minimum(limit, 2.0), 2.0)
    speed = np.where(np.isfinite(speed), speed, 2.0)
    torque = weight + (size + armature) * speed * 5 + friction + damping * speed
    return JointScales(
        mass=mass,
        length=length,
        viscous=damping,
        coulomb=friction,
        gain=np.full(k, gain),
        speed=speed,
        command=torque / gain,
        rotor=armature if armature.any() else None,
        actuator=config.actuator or "motor",
    )


def joint_sizes(model: pin.Model) -> tuple[Array, Array]:
    """(k,) inertia [kg·m² or kg] and (k,) weight [N·m or N] that each 1-DOF joint carries.

    Both are rounded to powers of two. The weight is the bound g·√(m I), as (m r)² ≤ m · m r².
    """
    data = model.createData()
    joints = [joint for joint in list(model.joints)[1:] if joint.nv == 1]
    size = np.diag(pin.crba(model, data, pin.neutral(model)))[[joint.idx_v for joint in joints]]
    pin.computeSubtreeMasses(model, data)
    carried = np.array([data.mass[joint.id] for joint in joints])
    weight = np.linalg.norm(model.gravity.linear) * np.sqrt(carried * size)
    return _octaves(size), _octaves(weight)


def _octaves(values: ArrayLike) -> Array:
    """The nearest powers of two: guesses by order of magnitude."""
    return guessed(np.maximum(values, 1e-9))


def extent(inertia: pin.Inertia) -> float:
    """A link's size [m]: its radius of gyration about the joint."""
    about_joint = np.trace(inertia.inertia) + 2 * inertia.mass * inertia.lever @ inertia.lever
    return float(np.sqrt(about_joint / (2 * inertia.mass)))
