"""Plants with joints or wheels, as parts of a scenario: arms, floating robots, vehicles with arms.

The plants themselves are made in the files of the same names, which are imported when one is built.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from ...base import NonNegative, Positive, UnknownName, config
from ...core import GRAVITY
from ...robots import BadRobot, published_numbers
from ..fields import Share
from .world.config import KnownPlant, PlantConfig, PublishedRobot

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pinocchio as pin

    from ...core import Array, JointScales, JointTree
    from .world.plant import Plant
    from .world.simulated import SimulatedRobot

Backend = Literal["compiled", "pinocchio"]
"""Implementation of a robot's regressors: its structure's, or Pinocchio's."""

# Half of a foot's mean depth in the ground, over g softness²: 1.04 mm of a go2 that walks on ground
# of .02 s. MuJoCo's contact forces act half-way between the surfaces.
_SINKING = 0.13

_UNSURE = (
    ("rotor inertia", 1.0),
    ("rotor thrust gain", 1.0),
    ("rotor torque gain", 0.25),
    ("viscous friction", 1.0),
    ("Coulomb friction", 1.0),
    ("motor gain", 1.0),
)
"""Blocks of θ of a flying arm, and the share of the spread of each."""


@config
class JointedPlant(KnownPlant, ABC):
    """A robot with a motor or servo on every joint. Its attributes are those of `ArmPlant`."""

    robot: str = "ur5"
    damping: Positive | None = None
    friction: Positive | None = None
    armature: NonNegative | None = None
    gain: Positive | None = None
    spread: Share = 0.2
    friction_speed: Positive = 0.05
    backend: Backend = "compiled"
    actuator: Literal["motor", "servo"] | None = None
    _base: ClassVar[Literal["held", "free"]] = "held"
    _refuses: ClassVar[tuple[str, ...]] = ("an arm in air", "flow", "fluid")

    def nominal_scales(
        self, model: pin.Model, stated: Mapping[str, Array] | None = None
    ) -> JointScales:
        """An engineer's guess of a model's parameters, and the values of this data sheet.

        `stated` are (k,) `damping`, `friction` and `armature` of the model's file, which count
        where the data sheet has none.
        """
        from .arm import nominal_scales

        return nominal_scales(model, self, stated)

    def _published(self) -> PublishedRobot:
        """The robot's description and structure; θ of its file and data sheet.

        Raises:
            BadRobot: the robot cannot be simulated, or has no joint for a motor.
        """
        from ...core import JointTree
        from ...robots import load_robot
        from .arm import published_theta

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
        nominal = replace(self, actuator=chosen).nominal_scales(robot.model, stated)
        if servos is not None and self.gain is None:
            nominal.gain[driven] = servos.kp
            nominal.command[driven] /= servos.kp
            limit = robot.limits[driven] / servos.kp
            nominal = replace(nominal, saturation=limit if np.isfinite(limit).any() else None)
        if robot.passive:
            gain = nominal.gain[driven]
            command = nominal.command[driven]
            nominal = replace(nominal, gain=gain, command=command, driven=tuple(driven))
        compiled = self.backend == "compiled"
        structure = JointTree.checked if compiled else JointTree.by_pinocchio
        speed = np.full(len(nominal.viscous), self.friction_speed)
        system = structure(robot.model, nominal, speed)
        joints = [block.name for block in system.space.blocks if block.geometry == "positive"]
        unsure = [(name, 1.0) for name in joints]
        known = PublishedRobot(robot, system, published_theta(robot.model, system), unsure)
        return self._standing(known)

    def _made(self, known: PublishedRobot, dt: float, theta: Array) -> SimulatedRobot:
        """Makes the plant, and compares MuJoCo with Pinocchio.

        Raises:
            BadRobot: MuJoCo rejects it, or its friction is too fast for the time step.
            EnginesDisagree: MuJoCo and Pinocchio compute different dynamics.
        """
        from ...robots import quiet
        from .arm import arm_spec, check_stiffness, compare_engines, true_model
        from .world.simulated import SimulatedRobot

        robot = known.source
        system = known.system
        model = true_model(robot.model, theta)
        space = system.space
        acting = np.zeros(system.p)
        coulomb = space["Coulomb friction"]
        acting[coulomb] = theta[coulomb]  # `frictionloss` creeps
        if system.scales.actuator == "servo":
            acting[space["servo gain"]] = theta[space["servo gain"]]
        spec = arm_spec(model, system, theta, dt)
        self._surround(spec, system)
        names = list(model.names)[1:]
        looks = robot.visuals
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

    @abstractmethod
    def _standing(self, known: PublishedRobot) -> PublishedRobot:
        """The robot with its contacts as part of the structure."""

    @abstractmethod
    def _surround(self, spec: Any, system: JointTree) -> None:
        """Adds what surrounds the robot to MuJoCo's specification."""


@config
class ArmPlant(JointedPlant):
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

    def _standing(self, known: PublishedRobot) -> PublishedRobot:
        return known

    def _surround(self, spec: Any, system: JointTree) -> None:
        pass


@config
class FloatingBasePlant(ArmPlant):
    """A floating-base robot in free fall, with a motor on every joint and none on its base.

    Its attributes are those of `ArmPlant`.
    """

    robot: str = "solo12"
    _base: ClassVar[Literal["held", "free"]] = "free"


@config
class WalkingPlant(JointedPlant):
    """A robot that stands on round feet on level ground, with a motor on every joint.

    Other attributes are those of `ArmPlant`.

    Attributes:
        feet: end of the names of the links at whose origins the feet's centres are.
        foot_radius: of round feet [m].
        sole: of flat feet: how far ahead of the link's origin and below it the sole's middle is,
            half its length, and half its width [m], along the link's axes; none for round feet.
        sliding: coefficient of friction between feet and ground.
        softness: time constant of the ground's contact force, MuJoCo's `solref` [s].
    """

    robot: str = "go2"
    feet: str = "_foot"
    foot_radius: Positive = 0.022  # of the go2 in MuJoCo Menagerie
    sole: tuple[NonNegative, NonNegative, Positive, Positive] | None = None
    sliding: Positive = 0.8
    softness: Positive = 0.02
    _base: ClassVar[Literal["held", "free"]] = "free"

    def _standing(self, known: PublishedRobot) -> PublishedRobot:
        """The structure knows where the feet are, but not the forces on them.

        Raises:
            BadRobot: no link has such a name.
        """
        from ...core import ContactPoint

        model = known.source.model
        links = {f.name: f for f in model.frames if f.name.endswith(self.feet) and f.parentJoint}
        if not links:
            remedy = "Name them: --plant.feet FOOT."
            raise BadRobot(self.robot, "", f"no moving link's name ends in {self.feet!r}", remedy)
        sinking = _SINKING * GRAVITY * self.softness**2
        middle = np.zeros(3)
        flat = self.sole is not None
        if self.sole is not None:
            middle[:] = self.sole[0], 0.0, -self.sole[1]
            sinking = 0.0  # its torques make up for a force that acts elsewhere
        contacts = tuple(
            ContactPoint(
                f.parentJoint - 1,
                f.placement.act(middle),
                0.0 if flat else self.foot_radius,
                flat=flat,
                name=name,
                sinking=sinking,
            )
            for name, f in links.items()
        )
        structure = replace(known.system.structure, contacts=contacts)
        return known._replace(system=known.system.rebuilt(structure, known.system.space))

    def _surround(self, spec: Any, system: JointTree) -> None:
        """Adds the ground, and the feet."""
        from .arm import give_feet

        give_feet(spec, system, self.sliding, self.softness, self.sole)


@config
class FlyingArmPlant(KnownPlant):
    """A flying robot of example-robot-data; rotor parameters and sources in assets/flying_arm.

    Attributes:
        robot: `borinot`, a hexarotor with an arm, or `iris`, a quadrotor without one.
        spread: largest relative deviation of the true joint friction, rotor inertia, motor gains
            and thrusts from the nominal values; a quarter of it for the rotors' torques, because
            yaw authority is small.
    """

    _refuses: ClassVar[tuple[str, ...]] = ("a flying arm in still air", "flow", "fluid")

    robot: str = "borinot"
    spread: Share = 0.2

    def _published(self) -> PublishedRobot:
        """The robot's description, its structure, and its published or nominal θ.

        Raises:
            UnknownName: assets/flying_arm/vehicle.toml does not list this robot's rotors.
        """
        from ...robots import load_robot
        from .arm import published_theta
        from .flying_arm import flying_arm

        known = published_numbers("flying_arm")
        if self.robot not in known:
            remedy = "Rotors are listed in assets/flying_arm/vehicle.toml."
            raise UnknownName("flying robot", self.robot, known, remedy)
        robot = load_robot(self.robot, "free")
        d = known[self.robot]
        sheet = ArmPlant()
        scales = sheet.nominal_scales(robot.model)
        system = flying_arm(robot.model, scales, sheet.friction_speed, d)
        theta = published_theta(robot.model, system)
        count = len(d["spins"])
        theta[-2 * count :] = np.repeat([d["thrust"], d["torque"]], count)
        return PublishedRobot(robot, system, theta, _UNSURE)

    def _made(self, known: PublishedRobot, dt: float, theta: Array) -> SimulatedRobot:
        from ...robots import tree_spec
        from .arm import give_rotors, true_model
        from .world.body import command_inputs
        from .world.simulated import SimulatedRobot

        robot = known.source
        system = known.system
        model = true_model(robot.model, theta)
        acting = theta.copy()
        spec = tree_spec(model, dt)
        names = list(model.names)[1:]
        give_rotors(spec, system, theta)
        acting[~np.isin(np.arange(system.p), [c.parameter for c in system.structure.columns])] = 0.0
        command_inputs(spec, system.n_u, names[0])
        return SimulatedRobot(system, theta, acting, spec, names, self.mismatch, robot.visuals)


@config
class UvmsPlant(KnownPlant):
    """A BlueROV2 Heavy with a Reach Alpha 5; parameters and sources in assets/uvms.

    No hydrodynamics of the arm are published; those used here are of cylinders.

    Attributes:
        spread: largest relative deviation of the true drags, weight, buoyancies, righting moment,
            links' added mass, friction, rotor inertias and gains from the nominal values.
    """

    _refuses: ClassVar[tuple[str, ...]] = ("a vehicle with an arm", "fluid")

    spread: Share = 0.2

    def _published(self) -> PublishedRobot:
        from .uvms import uvms

        return uvms()

    def _made(self, known: PublishedRobot, dt: float, theta: Array) -> SimulatedRobot:
        """See `Blueprint.split` for how M of the base is divided into rigid-body and added mass."""
        from ...robots import set_inertias, tree_spec
        from .arm import give_rotors
        from .uvms import BASE, add_visual_geoms, uvms_model
        from .world.body import command_inputs
        from .world.simulated import SimulatedRobot

        base = known.source
        system = known.system
        arm = published_numbers("uvms")
        space = known.system.space
        body, added = base.split(theta[:21])
        rigid = body.matrix()
        links = slice(21, 21 + 10 * len(arm["links"]))
        model = uvms_model(rigid, arm)
        set_inertias(model, theta[links], 2)
        spec = tree_spec(model, dt)
        acting = theta.copy()
        give_rotors(spec, system, theta)
        acting[:21] = added
        acting[links] = 0.0
        acting[space["rotor inertia"]] = 0.0
        acting[space["net weight"]] -= rigid[0, 0] * GRAVITY  # MuJoCo's bodies have weight
        add_visual_geoms(spec, arm)
        command_inputs(spec, system.n_u, BASE)
        names = list(model.names)[1:]
        return SimulatedRobot(system, theta, acting, spec, names, self.mismatch)


@config
class RoverPlant(PlantConfig):
    """A four-wheeled rover; parameters and sources in assets/rover.

    Attributes:
        spread: largest relative deviation of the true load, motors, bearings, servo and tyres
            from the values given there.
    """

    _refuses: ClassVar[tuple[str, ...]] = ("a rover on level ground", "fluid", "level")

    spread: Share = 0.2

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        from .rover import Rover

        rover = Rover(self.spread, self.mismatch, dt, np.random.default_rng(seed))
        return rover.failing(self.faults, self)
