"""Arms: a MuJoCo model built from a Pinocchio model, one body for each regressor column block."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from ..errors import BadRobot, EnginesDisagree, InvalidInput
from ..parameters import Array
from ..systems.multibody import JointScales, Multibody
from .callbacks import coulomb_friction
from .coordinates import JointMap
from .mismatch import Mismatch
from .plant import Plant, PlantConfig, set_options
from .robots import Robot, load_robot
from .shapes import VisualMesh

AGREEMENT = 1e-10  # largest relative difference of M and bias between the engines


@dataclass(frozen=True)
class ArmPlant(PlantConfig):
    """A robot with a motor on every joint.

    Friction, rotor inertia and motor gain are given as a data sheet would: one nominal number for
    all joints, or None for numbers that suit the robot's own size. The true ones differ from it,
    joint by joint, by up to `spread`, drawn from the seed and told to nobody.

    Attributes:
        robot: a name of example-robot-data, or the path of a URDF file.
        damping: nominal viscous friction [N·m·s/rad or N·s/m].
        friction: nominal Coulomb friction [N·m or N].
        armature: nominal reflected rotor inertia [kg·m² or kg]; 0 leaves it out of θ.
        gain: nominal motor gain [N·m or N per unit of command].
        spread: largest relative deviation of the true numbers from the nominal ones.
        friction_speed: joint speed at which Coulomb friction is developed [rad/s or m/s].
    """

    robot: str = "ur5"
    damping: float | None = None
    friction: float | None = None
    armature: float | None = None
    gain: float = 1.0
    spread: float = 0.2
    friction_speed: float = 0.05

    def __post_init__(self) -> None:
        for name in ("damping", "friction", "armature"):
            value = getattr(self, name)
            smallest = "≥ 0" if name == "armature" else "> 0"
            if value is not None and not (
                np.isfinite(value) and (value > 0 or (value == 0 and name == "armature"))
            ):
                raise InvalidInput(
                    f"plant.{name}", f"a number {smallest}", value, "None suits the robot's size."
                )
        if not (np.isfinite(self.gain) and self.gain > 0):
            raise InvalidInput("plant.gain", "a number > 0", self.gain, "1.0 will do.")
        if not 0 <= self.spread < 1:
            raise InvalidInput("plant.spread", "a number in [0, 1)", self.spread, "0.2 is 20 %.")
        if not (np.isfinite(self.friction_speed) and self.friction_speed > 0):
            raise InvalidInput(
                "plant.friction_speed", "a speed > 0", self.friction_speed, "0.05 will do."
            )
        self.mismatch.refuse("an arm in air", "flow", "fluid")

    def build(self, dt: float, seed: int) -> Arm:
        """Loads the robot, draws the hidden numbers, compares the engines."""
        robot = load_robot(self.robot)
        nominal = nominal_scales(robot.model, self)
        rng = np.random.default_rng(seed)
        n = robot.model.nv

        def hidden(value: Array) -> Array:
            return value * (1 + self.spread * rng.uniform(-1, 1, n))

        hidden_joints = HiddenJoints(
            rotor=hidden(nominal.rotor) if nominal.rotor is not None else None,
            viscous=hidden(nominal.viscous),
            coulomb=hidden(nominal.coulomb),
            gain=hidden(nominal.gain),
        )
        system = Multibody(robot.model, nominal, np.full(n, self.friction_speed))
        return Arm(robot, system, hidden_joints, dt, self.mismatch)


@dataclass(frozen=True)
class HiddenJoints:
    """The true numbers of the joints, (n,) each; units as in `JointScales`."""

    rotor: Array | None
    viscous: Array
    coulomb: Array
    gain: Array


class Arm(Plant):
    """An arm in MuJoCo.

    Args:
        robot: the description; its inertias are the true ones.
        system: its structure.
        hidden: the true numbers of its joints.
        dt: step [s].
        mismatch: what the structure does not know.

    Raises:
        BadRobot: MuJoCo refuses a body, or a joint's friction is too stiff for dt.
        EnginesDisagree: the two engines compute different dynamics.
    """

    system: Multibody

    def __init__(
        self,
        robot: Robot,
        system: Multibody,
        hidden: HiddenJoints,
        dt: float,
        mismatch: Mismatch,
    ):
        self.robot, self.system, self._hidden = robot, system, hidden
        spec = arm_spec(robot.model, hidden, dt)
        try:
            self._compile(spec, mismatch)
        except ValueError as error:
            raise BadRobot(
                robot.name, "", f"MuJoCo refuses it: {error}", "Mend the named body's inertia."
            ) from error
        self.joints = JointMap(robot.model, self.model)
        self.passive = coulomb_friction()
        self._compare_engines()
        self._check_stiffness(dt)
        self.reset(np.mean(system.limits, axis=0), np.zeros(system.n))

    @cached_property
    def truth(self) -> Array:
        """(p,) the true θ."""
        links = [self.robot.model.inertias[i].toDynamicParameters()
                 for i in range(1, self.robot.model.njoints)]  # fmt: skip
        h = self._hidden
        rotor = [h.rotor] if h.rotor is not None else []
        return np.concatenate([*links, *rotor, h.viscous, h.coulomb, h.gain])

    def _place(self, position: Array, velocity: Array) -> None:
        self.joints.write(self.data, position, velocity)
        nv = self.model.nv
        self.data.userdata[0] = nv
        self.data.userdata[1 + self.joints.dof] = self._hidden.coulomb
        self.data.userdata[1 + nv + self.joints.dof] = 1 / self.system.friction_speed

    def coordinates(self) -> tuple[Array, Array]:
        """(n,) joint angles [rad] or travels [m], (n,) joint velocities."""
        return self.joints.read(self.data)

    def position(self, coordinates: Array) -> Array:
        """(..., m) Pinocchio's q for joint numbers (..., n)."""
        return self.system.position(coordinates)

    def visuals(self) -> list[VisualMesh]:
        """The robot's own meshes, where its description has any."""
        return list(self._meshes.values())

    @cached_property
    def _meshes(self) -> dict[int, VisualMesh]:
        """What can be drawn, by its index in Pinocchio's visual geometry."""
        meshes = ((i, _mesh(g)) for i, g in enumerate(self.robot.visual.geometryObjects))
        return {i: mesh for i, mesh in meshes if mesh is not None}

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m)."""
        visual = self.robot.visual
        data, geometry = self.robot.model.createData(), visual.createData()
        drawn = list(self._meshes)
        translations = np.zeros((len(q), len(drawn), 3))
        quaternions = np.zeros((len(q), len(drawn), 4))
        for k, configuration in enumerate(q):
            pin.updateGeometryPlacements(self.robot.model, data, visual, geometry, configuration)
            for j, i in enumerate(drawn):
                pose = geometry.oMg[i]
                translations[k, j] = pose.translation
                quaternions[k, j] = pin.Quaternion(pose.rotation).coeffs()
        return translations, quaternions

    def _compare_engines(self, samples: int = 5) -> None:
        """M and bias forces of both engines at random states."""
        rng = np.random.default_rng(0)
        model, data = self.robot.model, self.robot.model.createData()
        rotor = self._hidden.rotor if self._hidden.rotor is not None else np.zeros(model.nv)
        for _ in range(samples):
            coordinates = rng.uniform(*self.system.limits)
            v = rng.uniform(-1, 1, model.nv)
            q = self.position(coordinates)
            self.joints.write(self.data, coordinates, v)
            mujoco.mj_forward(self.model, self.data)
            M = pin.crba(model, data, q) + np.diag(rotor - model.armature)
            bias = pin.nonLinearEffects(model, data, q, v)
            force = max(np.abs(bias).max(), np.abs(M).max())  # also where a balanced robot has none
            for quantity, difference in (
                ("mass matrix", self.joints.mass_matrix(self.model, self.data) - M),
                ("bias force", self.joints.bias(self.data) - bias),
            ):
                relative = np.abs(difference) / (np.abs(M).max() if difference.ndim == 2 else force)
                if not relative.max() <= AGREEMENT:
                    own = np.diag(relative) if relative.ndim == 2 else relative
                    last = int(np.flatnonzero(~(own <= AGREEMENT))[-1:].sum())  # ancestors follow
                    link = f"link of joint {model.names[1 + last]}"
                    raise EnginesDisagree(
                        self.robot.name, link, quantity, float(relative.max()), AGREEMENT
                    )

    def _check_stiffness(self, dt: float) -> None:
        """RK4 is stable up to |λ| dt = 2.78; friction's λ is (viscous + c/s)/M_ii at most."""
        self.reset(np.mean(self.system.limits, axis=0), np.zeros(self.system.n))
        mujoco.mj_forward(self.model, self.data)
        inertia = 1 / np.diag(np.linalg.inv(self.joints.mass_matrix(self.model, self.data)))
        rate = (self._hidden.viscous + self._hidden.coulomb / self.system.friction_speed) / inertia
        worst = int(np.argmax(rate))
        if rate[worst] * dt > 2.5:
            raise BadRobot(
                self.robot.name,
                f"joint {self.robot.model.names[1 + worst]}",
                f"its friction acts at {rate[worst]:.0f}/s, too fast for steps of {dt:g} s",
                f"Take dt ≤ {2 / rate[worst]:.1g} s, less friction, or a larger friction_speed.",
            )


def arm_spec(model: pin.Model, hidden: HiddenJoints, dt: float) -> Any:
    """MuJoCo's specification of a Pinocchio model: one body for each joint, motors on all.

    URDF's traps are avoided by not going through it: no effort limit clips a hidden gain, no
    joint limit becomes a soft constraint, no inertia is silently repaired.
    """
    spec = mujoco.MjSpec()
    set_options(spec, dt)
    spec.option.gravity = model.gravity.linear
    spec.nuserdata = 1 + 2 * model.nv
    bodies = {0: spec.worldbody}
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for i in range(1, model.njoints):
        name, placement = model.names[i], model.jointPlacements[i]
        body = bodies[model.parents[i]].add_body(name=name)
        bodies[i] = body
        body.pos, body.quat = placement.translation, _wxyz(placement.rotation)
        body.explicitinertial = True
        body.mass, body.ipos = model.inertias[i].mass, model.inertias[i].lever
        moments, axes = np.linalg.eigh(model.inertias[i].inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        body.iquat, body.inertia = _wxyz(axes), moments
        k = model.joints[i].idx_v
        jacobian = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL)
        subspace = jacobian.reshape(6, -1)[:, k]  # Pinocchio squeezes a single column
        slides = np.linalg.norm(subspace[:3]) > np.linalg.norm(subspace[3:])
        joint = body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=subspace[:3] if slides else subspace[3:],
        )
        joint.damping = [hidden.viscous[k], 0, 0]
        joint.armature = hidden.rotor[k] if hidden.rotor is not None else 0.0
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = hidden.gain[k]
    return spec


def nominal_scales(model: pin.Model, config: ArmPlant) -> JointScales:
    """What an engineer would guess: sizes to a factor of two, and the data sheet's numbers.

    Masses and lengths are rounded to powers of two, so that the scale of θ is a guess and not the
    truth in disguise.
    """
    inertias = [model.inertias[i] for i in range(1, model.njoints)]
    mass = np.array([_octave(inertia.mass) for inertia in inertias])
    length = np.array([_octave(_extent(inertia)) for inertia in inertias])
    size, weight = joint_sizes(model)
    damping = 0.5 * size if config.damping is None else np.full(model.nv, config.damping)
    friction = 0.5 * size if config.friction is None else np.full(model.nv, config.friction)
    armature = 0.1 * size if config.armature is None else np.full(model.nv, config.armature)
    speed = np.where(model.velocityLimit > 0.1, np.minimum(model.velocityLimit, 2.0), 2.0)
    speed = np.where(np.isfinite(speed), speed, 2.0)
    torque = weight + (size + armature) * speed * 5 + friction + damping * speed
    return JointScales(
        mass=mass,
        length=length,
        viscous=damping,
        coulomb=friction,
        gain=np.full(model.nv, config.gain),
        speed=speed,
        command=torque / config.gain,
        rotor=armature if armature.any() else None,
    )


def joint_sizes(model: pin.Model) -> tuple[Array, Array]:
    """(n,) inertia [kg·m² or kg] and (n,) weight [N·m or N] that each joint carries, about.

    The weight is bounded by g·√(m I), as (m r)² ≤ m · m r².
    """
    data = model.createData()
    size = np.diag(pin.crba(model, data, pin.neutral(model)))
    pin.computeSubtreeMasses(model, data)
    carried = np.array([data.mass[i] for i in range(1, model.njoints)])
    weight = np.linalg.norm(model.gravity.linear) * np.sqrt(carried * size)
    return np.array([_octave(x) for x in size]), np.array([_octave(x) for x in weight])


def _octave(value: float) -> float:
    """The nearest power of two: what one guesses without measuring."""
    return float(2.0 ** np.round(np.log2(max(value, 1e-9))))


def _extent(inertia: pin.Inertia) -> float:
    """A link's size [m]: its radius of gyration about the joint."""
    about_joint = np.trace(inertia.inertia) + 2 * inertia.mass * inertia.lever @ inertia.lever
    return float(np.sqrt(about_joint / (2 * inertia.mass)))


def _wxyz(rotation: Array) -> Array:
    """MuJoCo's quaternion (w, x, y, z) of a rotation matrix."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])


def _mesh(geometry: Any) -> VisualMesh | None:
    """A Pinocchio geometry object as triangles, or None if it is not a mesh."""
    shape = geometry.geometry
    if not hasattr(shape, "vertices") or not hasattr(shape, "num_tris"):
        return None
    vertices = np.array([shape.vertex(i) for i in range(shape.num_vertices)])
    triangles = np.array(
        [[t[0], t[1], t[2]] for t in (shape.tri_indices(i) for i in range(shape.num_tris))]
    )
    red, green, blue, alpha = np.asarray(geometry.meshColor, dtype=float).ravel().tolist()
    return VisualMesh(geometry.name, vertices, triangles, (red, green, blue, alpha))
