"""Vehicles with an arm in MuJoCo: a floating base, joints, and the exact forces on them."""

from __future__ import annotations

from typing import Any, Protocol, Self

import mujoco
import numpy as np
from pydantic import model_validator

from ..bounds import Name, Share, config
from ..errors import UnknownName
from ..parameters import Array
from ..resources import numbers
from ..robot.robots import Robot, load_robot
from ..robot.shapes import VisualMesh
from ..robot.tree import GeomVisuals, RobotVisuals, set_inertias, tree_spec
from ..systems.flying_arm import FlyingArm
from ..systems.inertial import GRAVITY
from ..systems.multibody import JointScales
from ..systems.optional import pin
from ..systems.underwater_manipulator import Cylinders, LinkFluidScales, UnderwaterManipulator
from ..systems.vehicle_manipulator import VehicleManipulator
from .arm import ArmPlant, HiddenJoints, extent, nominal_scales, set_tree
from .underwater import UnderwaterSheet
from .world.blueprint import Blueprint
from .world.body import command_inputs, guessed, hidden, vehicle_spec
from .world.coordinates import joint_map
from .world.forces import Forces, column_forces
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant

BASE = "base"
"""Name of the free joint and of the base body in models that are assembled here."""

_LINK_COLOR, _JOINT_COLOR = [0.85, 0.55, 0.15, 1.0], [0.20, 0.22, 0.25, 1.0]


class Visuals(Protocol):
    """Meshes of a vehicle and their poses."""

    def visuals(self) -> list[VisualMesh]:
        """All meshes."""
        ...

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        ...


class VehicleWithArm(Plant):
    """A floating base with thrusters and an arm.

    Args:
        system: the structure that an identifier may know.
        truth: (p,) the true θ.
        acting: (p,) θ of the forces beyond MuJoCo's; see `Forces`.
        names: of MuJoCo's joints, the free joint first.
        spec: MuJoCo's specification, from `tree_spec`.
        visuals: the meshes that show it; None for the specification's geoms.
        mismatch: the effects outside the structure.
    """

    system: VehicleManipulator

    def __init__(
        self,
        system: VehicleManipulator,
        truth: Array,
        acting: Array,
        names: list[str],
        spec: Any,
        visuals: Visuals | None,
        mismatch: Mismatch,
    ):
        self.system, self._truth, self.passive = system, truth, column_forces()
        forces = Forces(system.structure, acting, np.array(mismatch.flow))
        command_inputs(spec, system.n_u, names[0])
        spec.nuserdata, self.gain_places = forces.size, forces.gain_places
        self._compile(spec, mismatch)
        self.joints = joint_map(self.model, names)
        self.reading = self.joints.reading([joint.nq == 2 for joint in system.joints])
        self._numbers = forces.numbers(self.reading, mismatch.lag > 0)
        self._visuals = GeomVisuals(self.model, system.model) if visuals is None else visuals
        self.reset(np.mean(system.limits, axis=0), np.zeros(system.n))

    @property
    def truth(self) -> Array:
        """(p,) the true θ."""
        return self._truth

    def _place(self, position: Array, velocity: Array) -> None:
        self.joints.write(self.data, position, velocity)
        self.data.userdata[:] = self._numbers

    def coordinates(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) velocities."""
        return self.joints.read(self.data)

    def visuals(self) -> list[VisualMesh]:
        """The meshes of base and links."""
        return self._visuals.visuals()

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        return self._visuals.poses(q)


# -- an underwater vehicle with an arm -----------------------------------------------------------


@config
class UvmsPlant(ParametricPlantConfig):
    """A BlueROV2 Heavy with a Reach Alpha 5; parameters and sources in assets/uvms.

    No hydrodynamics of the arm are published; those used here are of cylinders.

    Attributes:
        spread: largest relative deviation of the true drags, weight, buoyancies, righting moment,
            links' added mass, friction, rotor inertias and gains from the nominal values.
    """

    spread: Share = 0.2

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        self.mismatch.refuse("a vehicle with an arm", "fluid")
        return self

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        system, theta = uvms_system(), published_uvms()
        rng, space = np.random.default_rng(seed), system.space
        for name in _UNSURE:
            theta[space[name]] = hidden(theta[space[name]], self.spread, rng)
        return self.simulating(dt, theta)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or the published ones.

        See `Blueprint.split` for how M of the base is divided into rigid-body and added mass.
        """
        arm, base, system = numbers("uvms"), _base(), uvms_system()
        space, theta = system.space, published_uvms() if theta is None else theta
        body, added = base.split(theta[:21])
        rigid = body.matrix()
        links = slice(21, 21 + 10 * len(arm["links"]))
        model = uvms_model(rigid, arm)
        set_inertias(model, theta[links], 2)
        spec = tree_spec(model, dt)
        for i, inertia in enumerate(theta[space["rotor inertia"]]):
            spec.joint(f"joint {i + 1}").armature = inertia
        acting = theta.copy()
        acting[:21], acting[links] = added, 0.0
        acting[space["rotor inertia"]] = 0.0
        acting[space["net weight"]] -= rigid[0, 0] * GRAVITY  # MuJoCo's bodies have weight
        _add_visual_geoms(spec, arm)
        names = list(model.names)[1:]
        vehicle = VehicleWithArm(system, theta, acting, names, spec, None, self.mismatch)
        return vehicle.failing(self.faults, self)


_UNSURE = (
    "linear drag", "quadratic drag", "net weight", "righting moment", "thruster gain",
    "added mass", "link drag", "link buoyancy", "viscous friction", "Coulomb friction",
    "motor gain", "rotor inertia",
)  # fmt: skip


def _base() -> Blueprint:
    return UnderwaterSheet.of("bluerov2").blueprint()


def uvms_system() -> UnderwaterManipulator:
    """The structure of the vehicle with its arm."""
    arm, base = numbers("uvms"), _base()
    published, nominal = uvms_model(base.rigid, arm), published_links(arm)
    return UnderwaterManipulator(
        published,
        _joint_guesses(published, arm),
        base.system,
        LinkFluidScales(*map(guessed, nominal)),
        cylinders(arm),
        arm["joints"]["friction_speed"],
    )


def published_uvms() -> Array:
    """(p,) θ of the published and nominal values."""
    arm, base = numbers("uvms"), _base()
    d, k = arm["joints"], len(arm["links"])
    added, drag, buoyancy = published_links(arm)
    bodies = list(uvms_model(base.rigid, arm).inertias)[2:]
    split = base.system.space["thruster gain"].start
    return np.concatenate(
        [
            base.theta[:21],
            *(body.toDynamicParameters() for body in bodies),
            added,
            *(np.full(k, d[name]) for name in ("rotor", "viscous", "coulomb", "gain")),
            base.theta[21:split],
            drag,
            buoyancy,
            base.theta[split:],
        ]
    )


def uvms_model(rigid: Array, arm: dict[str, Any]) -> pin.Model:
    """Pinocchio's model of an underwater base with an arm, with the published inertias.

    Args:
        rigid: (6, 6) the base's rigid-body mass, its centre at the origin.
        arm: numbers of assets/uvms.
    """
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), BASE)
    body = pin.Inertia(rigid[0, 0], np.zeros(3), rigid[3:, 3:])
    model.appendBodyToJoint(root, body, pin.SE3.Identity())
    parent, place = root, _placement(arm["mount"]["position"], arm["mount"]["angles"])
    for i, link in enumerate(arm["links"]):
        place = place * _placement(link["origin"], link["angles"])
        low, high = link["limits"]
        parent = model.addJoint(
            parent,
            pin.JointModelRevoluteUnaligned(np.array(link["axis"])),
            place,
            f"joint {i + 1}",
            np.array([np.inf]),
            np.array([arm["joints"]["speed"]]),
            np.array([low]),
            np.array([high]),
        )
        inertia = pin.Inertia(link["mass"], np.array(link["centre"]), np.diag(link["inertia"]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        place = pin.SE3.Identity()
    return model


def cylinders(arm: dict[str, Any]) -> Cylinders:
    """Centres, axes and lengths of the links' cylinders."""
    shapes = [link["cylinder"] for link in arm["links"]]
    start, end = (np.array([shape[key] for shape in shapes]) for key in ("start", "end"))
    lengths = np.linalg.norm(end - start, axis=1)
    return Cylinders((start + end) / 2, (end - start) / lengths[:, None], lengths)


def published_links(arm: dict[str, Any]) -> tuple[Array, Array, Array]:
    """(k,) added mass [kg], drag per length [N·s²/m³] and buoyancy [N] of the links' cylinders."""
    shapes, water = cylinders(arm), arm["water_density"]
    radius = np.array([link["cylinder"]["radius"] for link in arm["links"]])
    displaced = water * np.pi * radius**2 * shapes.lengths
    drag = 0.5 * water * arm["drag_coefficient"] * 2 * radius
    return displaced, drag, GRAVITY * displaced


def _joint_guesses(model: pin.Model, arm: dict[str, Any]) -> JointScales:
    """Scales of the arm's joints and links, guessed from its data sheet."""
    d, k = arm["joints"], len(arm["links"])
    bodies = list(model.inertias)[1:]
    return JointScales(
        mass=guessed(np.array([inertia.mass for inertia in bodies])),
        length=guessed(np.array([extent(inertia) for inertia in bodies])),
        viscous=np.full(k, d["viscous"]),
        coulomb=np.full(k, d["coulomb"]),
        gain=np.full(k, d["gain"]),
        speed=np.full(k, d["speed"]),
        command=np.full(k, 0.5),
        rotor=np.full(k, d["rotor"]),
    )


def _add_visual_geoms(spec: Any, arm: dict[str, Any]) -> None:
    """Adds visual geoms without mass: the BlueROV2's to the base, cylinders to the links."""
    hull = vehicle_spec("bluerov2", 1.0, 1.0, np.zeros(3), np.eye(3)).compile()
    for i in range(hull.ngeom):
        spec.body(BASE).add_geom(
            name=hull.geom(i).name,
            type=hull.geom_type[i],
            size=hull.geom_size[i],
            pos=hull.geom_pos[i],
            quat=hull.geom_quat[i],
            rgba=hull.geom_rgba[i],
            mass=0.0,
        )
    for i, link in enumerate(arm["links"]):
        shape, body = link["cylinder"], spec.body(f"joint {i + 1}")
        body.add_geom(
            name=f"link {i + 1}",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=[*shape["start"], *shape["end"]],
            size=[shape["radius"], 0, 0],
            rgba=_LINK_COLOR,
            mass=0.0,
        )
        body.add_geom(
            name=f"joint {i + 1}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[1.15 * shape["radius"], 0, 0],
            rgba=_JOINT_COLOR,
            mass=0.0,
        )


def _placement(position: list[float], angles: list[float]) -> pin.SE3:
    """The pose with this position [m] and these roll, pitch and yaw angles [rad]."""
    return pin.SE3(pin.rpy.rpyToMatrix(*angles), np.array(position))


# -- a flying arm ----------------------------------------------------------------------------------


@config
class FlyingArmPlant(ParametricPlantConfig):
    """A flying robot of example-robot-data; rotor parameters and sources in assets/flying_arm.

    Attributes:
        robot: `borinot`, a hexarotor with an arm, or `iris`, a quadrotor without one.
        spread: largest relative deviation of the true joint friction, rotor inertia, motor gains
            and thrusts from the nominal values; a quarter of it for the rotors' torques, because
            yaw authority is small.
    """

    robot: Name = "borinot"
    spread: Share = 0.2

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        self.mismatch.refuse("a flying arm in still air", "flow", "fluid")
        return self

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant.

        Raises:
            UnknownName: assets/flying_arm/vehicle.toml does not list this robot's rotors.
        """
        robot, joints, thrust, torque = self._published()
        rng = np.random.default_rng(seed)
        rotor = None if joints.rotor is None else hidden(joints.rotor, self.spread, rng)
        thrust, torque = hidden(thrust, self.spread, rng), hidden(torque, self.spread / 4, rng)
        true = HiddenJoints(
            rotor,
            viscous=hidden(joints.viscous, self.spread, rng),
            coulomb=hidden(joints.coulomb, self.spread, rng),
            gain=hidden(joints.gain, self.spread, rng),
        )
        return self._plant(dt, robot, true, thrust, torque)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the robot with the true parameters θ (p,), or the published ones."""
        robot, nominal, thrust, torque = self._published()
        joints = HiddenJoints.of(nominal)
        if theta is not None:
            tree, thrust, torque = np.split(theta, [-2 * len(thrust), -len(thrust)])
            joints = set_tree(robot.model, tree, len(nominal.gain))
        return self._plant(dt, robot, joints, thrust, torque)

    def _published(self) -> tuple[Robot, JointScales, Array, Array]:
        """The description, the joints' nominal values, and the rotors' thrusts and torques."""
        known = numbers("flying_arm")
        if self.robot not in known:
            remedy = "Rotors are listed in assets/flying_arm/vehicle.toml."
            raise UnknownName("flying robot", self.robot, known, remedy)
        robot, d = load_robot(self.robot, "free"), known[self.robot]
        thrust, torque = (np.full(len(d["spins"]), d[what]) for what in ("thrust", "torque"))
        return robot, nominal_scales(robot.model, ArmPlant()), thrust, torque

    def _plant(
        self, dt: float, robot: Robot, true: HiddenJoints, thrust: Array, torque: Array
    ) -> Plant:
        published, joints, *nominal = self._published()
        d = numbers("flying_arm")[self.robot]
        positions, spins = np.array(d["positions"]), np.array(d["spins"], dtype=float)
        system = FlyingArm(
            published.model,
            joints,
            guessed(nominal[0]),
            guessed(nominal[1]),
            np.array(d["speed"]),
            ArmPlant().friction_speed,
            positions,
            np.tile([0.0, 0.0, 1.0], (len(positions), 1)),
            spins,
        )
        bodies = [inertia.toDynamicParameters() for inertia in list(robot.model.inertias)[1:]]
        rotor = np.zeros(0) if true.rotor is None else true.rotor
        inertias = np.concatenate([*bodies, rotor])
        forces = np.concatenate([true.viscous, true.coulomb, true.gain, thrust, torque])
        spec, names = tree_spec(robot.model, dt), list(robot.model.names)[1:]
        for name, inertia in zip(names[1:], rotor, strict=False):
            spec.joint(name).armature = inertia
        vehicle = VehicleWithArm(
            system,
            np.concatenate([inertias, forces]),
            np.concatenate([np.zeros(len(inertias)), forces]),
            names,
            spec,
            RobotVisuals(robot),
            self.mismatch,
        )
        return vehicle.failing(self.faults, self)
