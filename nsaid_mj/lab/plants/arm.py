"""Arms and floating robots: a MuJoCo model built from a Pinocchio model, body by body."""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from ...base import EnginesDisagree, pin
from ...core import Array, Block, JointScales, JointTree
from ...robots import BadRobot, set_inertias, tree_spec
from .world.simulated import SimulatedRobot

AGREEMENT = 1e-10  # largest relative difference of M and bias between the engines
_SOLE = 0.01  # half the thickness of a flat foot [m]
_SAMPLES = 5  # random states at which they are compared


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
    spec = tree_spec(model, dt)
    space = system.space
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


def give_feet(
    spec: Any,
    system: JointTree,
    sliding: float,
    softness: float,
    sole: tuple[float, ...] | None,
) -> None:
    """Adds level ground and the structure's feet to MuJoCo's specification.

    Contacts have a coefficient of friction `sliding`, and a time constant `softness` [s]; `sole` is
    that of `WalkingPlant`.
    """
    contact = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    spec.option.disableflags &= ~int(contact)
    bodies = [body.name for body in spec.bodies][1:]
    ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 0.1])
    ground.friction = [sliding, 0.005, 0.0001]
    ground.solref = [softness, 1.0]
    ground.priority = 1  # its values hold for the contacts
    for point in system.structure.contacts:
        foot = spec.body(bodies[point.body]).add_geom(name=point.name, pos=point.centre)
        foot.type = mujoco.mjtGeom.mjGEOM_BOX if sole else mujoco.mjtGeom.mjGEOM_SPHERE
        foot.size = [*sole[2:], _SOLE] if sole else [point.radius, 0, 0]
        if sole:
            foot.pos = np.add(point.centre, (0.0, 0.0, _SOLE))


def compare_engines(plant: SimulatedRobot, name: str, model: pin.Model) -> None:
    """Compares M and bias forces of MuJoCo and Pinocchio at random states, with the true inertias.

    Raises:
        EnginesDisagree: names the link and the quantity that differ.
    """
    rng = np.random.default_rng(0)
    joints = plant.joints
    data = model.createData()
    rotor = np.zeros(model.nv)
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
    system = plant.system
    theta = plant.truth
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
    model: pin.Model, config: Any, stated: Mapping[str, Array] | None = None
) -> JointScales:
    """An engineer's guess: sizes to within a factor of two, and the data sheet's values.

    Masses and lengths are rounded to powers of two, so that the scale of θ does not reveal the true
    inertias. `stated` are (k,) `damping`, `friction` and `armature` that the model's file states,
    where the data sheet `config`, an `ArmPlant`, does not.
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
    return Block.guessed(np.maximum(values, 1e-9))


def extent(inertia: pin.Inertia) -> float:
    """A link's size [m]: its radius of gyration about the joint."""
    about_joint = np.trace(inertia.inertia) + 2 * inertia.mass * inertia.lever @ inertia.lever
    return float(np.sqrt(about_joint / (2 * inertia.mass)))
