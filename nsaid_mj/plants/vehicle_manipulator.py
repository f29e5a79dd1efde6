"""Vehicles with an arm in MuJoCo: a floating base, joints, and the exact forces on them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, Self

import mujoco
import numpy as np
from pydantic import model_validator

from ..bounds import Name, Share, config
from ..errors import UnknownName
from ..parameters import Array
from ..resources import numbers
from ..systems.flying_arm import FlyingArm
from ..systems.multibody import JointScales
from ..systems.optional import pin
from ..systems.underwater_manipulator import Cylinders, LinkFluidScales, UnderwaterManipulator
from ..systems.vehicle_manipulator import VehicleManipulator
from .arm import ArmPlant, HiddenJoints, extent, nominal_scales, set_tree
from .underwater import UnderwaterSheet, drawn, nominal_numbers, scales_of, with_theta
from .world.body import command_inputs, guessed, hidden, vehicle_spec
from .world.coordinates import joint_map
from .world.hydrodynamics import Hydrodynamics
from .world.mismatch import Mismatch
from .world.plant import ParametricPlantConfig, Plant
from .world.robots import Robot, load_robot
from .world.shapes import VisualMesh
from .world.tree import GeomVisuals, RobotVisuals, set_inertias, tree_spec
from .world.tree_forces import TreeForces, tree_forces

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
        model: Pinocchio's model, with the true inertias.
        rotor: (k,) true reflected rotor inertias of the joints [kg·m² or kg].
        forces: true parameters of the forces.
        spec: MuJoCo's specification of the model, from `tree_spec`.
        visuals: the meshes that show it; None for the specification's geoms.
        mismatch: the effects outside the structure.
    """

    system: VehicleManipulator

    def __init__(
        self,
        system: VehicleManipulator,
        truth: Array,
        model: pin.Model,
        rotor: Array,
        forces: TreeForces,
        spec: Any,
        visuals: Visuals | None,
        mismatch: Mismatch,
    ):
        self.system, self._truth, self.passive = system, truth, tree_forces()
        names = list(model.names)[1:]
        for name, inertia in zip(names[1:], rotor, strict=True):
            spec.joint(name).armature = inertia
        command_inputs(spec, system.n_u, names[0])
        spec.nuserdata = forces.size
        self._compile(spec, mismatch)
        self.joints = joint_map(self.model, names)
        self._numbers = forces.numbers(self.model, self.joints.motors, mismatch.lag > 0)
        self.gain_places = forces.gain_places
        self._visuals = GeomVisuals(self.model, system.model) if visuals is None else visuals
        self.reset(np.mean(system.limits, axis=0), np.zeros(system.n))

    @property
    def truth(self) -> Array:
        """(p,) the true θ."""
        return self._truth

    def _place(self, position: Array, velocity: Array) -> None:
        self.joints.write(self.data, position, velocity)
        self.data.userdata[: len(self._numbers)] = self._numbers

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
        arm, base = numbers("uvms"), nominal_numbers(UnderwaterSheet.of("bluerov2"))
        nominal, rng = nominal_forces(base, arm), np.random.default_rng(seed)
        true = drawn(base, self.spread, rng)
        forces = replace(
            nominal_forces(true, arm),
            cylinder_added=hidden(nominal.cylinder_added, self.spread, rng),
            cylinder_drag=hidden(nominal.cylinder_drag, self.spread, rng),
            cylinder_buoyancy=hidden(nominal.cylinder_buoyancy, self.spread, rng),
            viscous=hidden(nominal.viscous, self.spread, rng),
            coulomb=hidden(nominal.coulomb, self.spread, rng),
            gain=hidden(nominal.gain, self.spread, rng),
        )
        rotor = hidden(_nominal_rotor(arm), self.spread, rng)
        return self._plant(dt, true, uvms_model(base, arm), forces, rotor)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or the published ones.

        See `split_mass` for how M of the base is divided into rigid-body and added mass.
        """
        arm, base = numbers("uvms"), nominal_numbers(UnderwaterSheet.of("bluerov2"))
        if theta is None:
            forces, rotor = nominal_forces(base, arm), _nominal_rotor(arm)
            return self._plant(dt, base, uvms_model(base, arm), forces, rotor)
        k = len(arm["links"])
        ends = 21 + np.cumsum([10 * k, *[k] * 5, 16, k, k])
        M, links, added, rotor, viscous, coulomb, gain, base_theta, drag, buoyancy, thrust = (
            np.split(theta, [21, *ends])
        )
        true = with_theta(base, np.concatenate([M, base_theta, thrust]))
        model = uvms_model(true, arm)
        set_inertias(model, links, 2)
        forces = replace(
            nominal_forces(true, arm),
            cylinder_added=added,
            cylinder_drag=drag,
            cylinder_buoyancy=buoyancy,
            viscous=viscous,
            coulomb=coulomb,
            gain=gain,
        )
        return self._plant(dt, true, model, forces, rotor)

    def _plant(
        self, dt: float, true: Hydrodynamics, model: pin.Model, forces: TreeForces, rotor: Array
    ) -> Plant:
        arm, sheet = numbers("uvms"), UnderwaterSheet.of("bluerov2")
        base = nominal_numbers(sheet)
        published = uvms_model(base, arm)
        nominal, shapes = nominal_forces(base, arm), cylinders(arm)
        system = UnderwaterManipulator(
            published,
            _joint_guesses(published, arm),
            scales_of(base, sheet.guess),
            LinkFluidScales(
                added=guessed(nominal.cylinder_added),
                drag=guessed(nominal.cylinder_drag),
                buoyancy=guessed(nominal.cylinder_buoyancy),
            ),
            shapes,
            arm["joints"]["friction_speed"],
            base.positions,
            base.directions,
            base.curve,
        )
        forces = replace(forces, flow=np.array(self.mismatch.flow))
        links = [inertia.toDynamicParameters() for inertia in list(model.inertias)[2:]]
        truth = np.concatenate(
            [
                (true.rigid + true.added)[np.triu_indices(6)],
                *links,
                forces.cylinder_added,
                rotor,
                forces.viscous,
                forces.coulomb,
                forces.gain,
                true.linear,
                true.quadratic,
                [true.net_weight],
                true.righting,
                forces.cylinder_drag,
                forces.cylinder_buoyancy,
                true.thrust,
            ]
        )
        spec = tree_spec(model, dt)
        _add_visual_geoms(spec, arm)
        vehicle = VehicleWithArm(system, truth, model, rotor, forces, spec, None, self.mismatch)
        return vehicle.failing(self.faults, self)


def _nominal_rotor(arm: dict[str, Any]) -> Array:
    return np.full(len(arm["links"]), arm["joints"]["rotor"])


def uvms_model(base: Hydrodynamics, arm: dict[str, Any]) -> pin.Model:
    """Pinocchio's model of an underwater base with an arm, with the published inertias."""
    model = pin.Model()
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), BASE)
    mass = base.rigid[0, 0]
    model.appendBodyToJoint(
        root, pin.Inertia(mass, np.zeros(3), base.rigid[3:, 3:]), pin.SE3.Identity()
    )
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


def nominal_forces(base: Hydrodynamics, arm: dict[str, Any]) -> TreeForces:
    """Forces on a base in water with the given parameters, and on the arm with nominal ones."""
    shapes, d, k = cylinders(arm), arm["joints"], len(arm["links"])
    radius = np.array([link["cylinder"]["radius"] for link in arm["links"]])
    water, g = arm["water_density"], 9.81
    displaced = water * np.pi * radius**2 * shapes.lengths
    curve = np.zeros(9)
    curve[::2] = base.curve
    return TreeForces(
        base=BASE,
        added=base.added,
        linear=base.linear,
        quadratic=base.quadratic,
        buoyancy=base.rigid[0, 0] * g - base.net_weight,
        righting=base.righting,
        positions=base.positions,
        directions=base.directions,
        thrust=base.thrust,
        torque=np.zeros(len(base.thrust)),
        curve=curve,
        links=tuple(f"joint {i + 1}" for i in range(k)),
        centres=shapes.centres,
        axes=shapes.axes,
        lengths=shapes.lengths,
        cylinder_added=displaced,
        cylinder_drag=0.5 * water * arm["drag_coefficient"] * 2 * radius,
        cylinder_buoyancy=g * displaced,
        viscous=np.full(k, d["viscous"]),
        coulomb=np.full(k, d["coulomb"]),
        friction_speed=d["friction_speed"],
        gain=np.full(k, d["gain"]),
        flow=np.zeros(3),
    )


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
        rotor = np.zeros(0) if true.rotor is None else true.rotor
        d = numbers("flying_arm")[self.robot]
        positions, spins = np.array(d["positions"]), np.array(d["spins"], dtype=float)
        directions = np.tile([0.0, 0.0, 1.0], (len(positions), 1))
        friction_speed = ArmPlant().friction_speed
        system = FlyingArm(
            published.model,
            joints,
            guessed(nominal[0]),
            guessed(nominal[1]),
            np.array(d["speed"]),
            friction_speed,
            positions,
            directions,
            spins,
        )
        still, square = np.zeros(6), np.zeros(9)
        square[1] = 1.0
        forces = TreeForces(
            base=robot.model.names[1],
            added=np.zeros((6, 6)),
            linear=still,
            quadratic=still,
            buoyancy=0.0,
            righting=np.zeros(3),
            positions=positions,
            directions=directions,
            thrust=thrust,
            torque=spins * torque,
            curve=square,
            links=(),
            centres=np.zeros((0, 3)),
            axes=np.zeros((0, 3)),
            lengths=np.zeros(0),
            cylinder_added=np.zeros(0),
            cylinder_drag=np.zeros(0),
            cylinder_buoyancy=np.zeros(0),
            viscous=true.viscous,
            coulomb=true.coulomb,
            friction_speed=friction_speed,
            gain=true.gain,
            flow=np.zeros(3),
        )
        bodies = [inertia.toDynamicParameters() for inertia in list(robot.model.inertias)[1:]]
        truth = np.concatenate(
            [*bodies, rotor, forces.viscous, forces.coulomb, forces.gain, thrust, torque]
        )
        spec = tree_spec(robot.model, dt)
        return VehicleWithArm(
            system, truth, robot.model, rotor, forces, spec, RobotVisuals(robot), self.mismatch
        ).failing(self.faults, self)
