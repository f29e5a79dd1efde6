"""Vehicles that are a single body in MuJoCo, on a free joint or on two slides and a hinge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from ...errors import InvalidInput
from ...numerics.spatial import rotation
from ...parameters import Array
from ...resources import vehicle_files
from ...robot.shapes import DRAWN, VisualMesh, of_geom
from ...robot.tree import set_options
from ...systems.structured import StructuredSystem
from .coordinates import PlanarMap, PoseMap
from .forces import Forces, column_forces
from .mismatch import Mismatch
from .plant import Plant

BODY = "vehicle"
"""Name of the moving body in every vehicle's model.xml; its free joint is called `pose`."""


NED = np.array([1.0, -1.0, -1.0])
"""Signs that convert x forward, y right, z down to x forward, y left, z up, and back."""


class Vehicle(Plant):
    """A single rigid body with actuators.

    Args:
        system: the structure that an identifier may know.
        truth: (p,) the true θ.
        spec: MuJoCo's specification from `vehicle_spec`, with the true inertia of the rigid body.
        acting: (p,) θ of the forces on that body, 0 for its own inertia; see `Forces`.
        mismatch: the effects outside the structure.

    Raises:
        InvalidInput: MuJoCo rejects the body, or the mismatch does not suit the time step.
    """

    system: StructuredSystem

    def __init__(
        self,
        system: StructuredSystem,
        truth: Array,
        spec: Any,
        acting: Array,
        mismatch: Mismatch,
    ):
        self.system, self._truth, self.passive = system, truth, column_forces()
        forces = Forces(system.structure, acting, np.array(mismatch.flow))
        self.gain_places, spec.nuserdata = forces.gain_places, forces.size
        command_inputs(spec, system.n_u)
        try:
            self._compile(spec, mismatch)
        except InvalidInput:
            raise
        except ValueError as error:
            raise InvalidInput(
                f"vehicle {spec.modelname}",
                "a body that MuJoCo can simulate",
                error,
                "Check mass and inertia in its vehicle.toml.",
            ) from error
        self.body = PoseMap(self.model, "pose") if system.n == 6 else PlanarMap(self.model)
        self.reading = self.body.reading
        self._numbers = forces.numbers(self.reading, mismatch.lag > 0)
        self.reset(np.zeros(system.n), np.zeros(system.n))

    @property
    def truth(self) -> Array:
        """(p,) the true θ."""
        return self._truth

    def _place(self, position: Array, velocity: Array) -> None:
        self.body.write(self.data, position, velocity)
        self.data.userdata[:] = self._numbers

    def coordinates(self) -> tuple[Array, Array]:
        """(n,) position numbers and (n,) body twist."""
        return self.body.read(self.data)

    def visuals(self) -> list[VisualMesh]:
        """The body's geoms as meshes."""
        return [of_geom(self.model, i) for i in range(self.model.ngeom)]

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the geoms at poses q (k, m) of the body.

        Returns:
            translations (k, geoms, 3) [m] and quaternions (k, geoms, 4) in x, y, z, w.
        """
        places, attitudes = body_poses(q)
        local = np.array([_rotation(quaternion) for quaternion in self.model.geom_quat])
        translations = places[:, None] + np.einsum("kab,gb->kga", attitudes, self.model.geom_pos)
        return translations, composed(attitudes, local)


def body_poses(q: Array) -> tuple[Array, Array]:
    """(k, 3) positions [m] and (k, 3, 3) rotation matrices of poses q (k, 7), or (k, 3) x, y, ψ."""
    if q.shape[1] == 7:
        return q[:, :3], np.array([rotation(row) for row in q[:, 3:]])
    places = np.c_[q[:, :2], np.zeros(len(q))]
    upright = np.c_[np.zeros((len(q), 2)), np.sin(q[:, 2] / 2), np.cos(q[:, 2] / 2)]
    return places, np.array([rotation(row) for row in upright])


def composed(attitudes: Array, local: Array) -> Array:
    """(k, g, 4) quaternions x, y, z, w of k attitudes (k, 3, 3) times g local ones (g, 3, 3)."""
    from scipy.spatial.transform import Rotation

    both = np.einsum("kab,gbc->kgac", attitudes, local).reshape(-1, 3, 3)
    return Rotation.from_matrix(both).as_quat().reshape(len(attitudes), len(local), 4)


class Inertia(NamedTuple):
    """Inertia of a rigid body.

    Attributes:
        mass: [kg].
        lever: (3,) centre of mass [m].
        inertia: (3, 3) about the centre of mass [kg·m²].
    """

    mass: float
    lever: Array
    inertia: Array

    @staticmethod
    def of_matrix(M: Array) -> Inertia:
        """From the mass matrix (6, 6) about the origin."""
        mass, lever = float(M[0, 0]), np.array([M[1, 5], M[2, 3], M[0, 4]]) / M[0, 0]
        return Inertia(mass, lever, M[3:, 3:] - mass * _steiner(lever))

    def matrix(self) -> Array:
        """(6, 6) mass matrix about the origin."""
        S = self.mass * np.cross(self.lever, np.eye(3))
        about = self.inertia + self.mass * _steiner(self.lever)
        return np.block([[self.mass * np.eye(3), S], [S.T, about]])


def _steiner(c: Array) -> Array:
    """(3, 3) inertia about the origin of a unit mass at c (3,)."""
    return (c @ c) * np.eye(3) - np.outer(c, c)


_FREE = '<freejoint name="pose"/>'
_PLANAR = """<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="yaw" type="hinge" axis="0 0 1"/>"""
_BOX = """<mujoco model="{name}"><worldbody><body name="vehicle">{joints}
<geom name="hull" type="box" size="{size}" mass="0" rgba="0.35 0.45 0.55 1"/>
</body></worldbody></mujoco>"""


def vehicle_spec(
    vehicle: str,
    dt: float,
    mass: float,
    centre: Array,
    inertia: Array,
    size: Sequence[float] | None = None,
    planar: bool = False,
) -> Any:
    """MuJoCo's specification of a vehicle's model.xml with a given inertia, without gravity.

    Only the geometry of model.xml is used: its masses, damping and medium are overwritten.

    Args:
        vehicle: an included vehicle's name, or the path of its TOML file or folder.
        dt: time step [s].
        mass: of the body [kg].
        centre: (3,) centre of mass in body axes [m].
        inertia: (3, 3) about the centre of mass, in body axes [kg·m²].
        size: (3,) of the box that is drawn if there is no model.xml [m].
        planar: whether the body moves in the plane, on two slides and a hinge.

    Raises:
        InvalidInput: there is neither a model.xml nor a size, or the model.xml does not describe
            a single body with the required joints and no actuators.
    """
    spec = _visual_spec(vehicle, size, planar)
    set_options(spec, dt)
    spec.option.gravity = [0, 0, 0]
    spec.option.density, spec.option.viscosity = 0.0, 0.0
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    body = spec.body(BODY)
    for joint in body.joints:
        joint.damping, joint.stiffness = [0, 0, 0], [0, 0, 0]
        joint.armature, joint.frictionloss = 0.0, 0.0
    body.explicitinertial, body.gravcomp = True, 0.0
    body.mass, body.ipos, body.iquat = mass, centre, [1, 0, 0, 0]
    body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    return spec


def _visual_spec(vehicle: str, size: Sequence[float] | None, planar: bool) -> Any:
    """MuJoCo's specification of a vehicle's model.xml, or of a box of the given size."""
    files = vehicle_files(vehicle)
    path = files.model
    if not path.is_file():
        if size is None:
            raise InvalidInput(
                str(path),
                f"a model.xml, or `size = [length, width, height]` in {files.sheet.name}",
                "neither",
                "Add one of the two: a box will do.",
            )
        half = " ".join(f"{0.5 * length:.9g}" for length in size)
        joints = _PLANAR if planar else _FREE
        return mujoco.MjSpec.from_string(_BOX.format(name="box", joints=joints, size=half))
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InvalidInput(
            str(path), "a model that MuJoCo can load", error, "Correct it."
        ) from error
    bodies = [body.name for body in spec.bodies]
    if bodies != ["world", BODY]:
        raise InvalidInput(
            str(path), f"one body, called {BODY}", bodies[1:], "Put all geoms into it."
        )
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    wanted = (
        [("x", slide), ("y", slide), ("yaw", hinge)]
        if planar
        else [("pose", mujoco.mjtJoint.mjJNT_FREE)]
    )
    if [(joint.name, joint.type) for joint in spec.joints] != wanted:
        raise InvalidInput(
            str(path),
            f"the joints {_PLANAR if planar else _FREE}",
            [joint.name for joint in spec.joints],
            "Copy them from here.",
        )
    if len(spec.actuators):
        raise InvalidInput(
            str(path),
            "no actuators",
            [a.name for a in spec.actuators],
            f"They are made from {files.sheet.name}.",
        )
    if strange := [geom.name for geom in spec.geoms if geom.type not in DRAWN]:
        raise InvalidInput(
            str(path),
            "boxes, cylinders, capsules, ellipsoids and spheres",
            strange,
            "Meshes are not drawn: take one of these in their place.",
        )
    return spec


def command_inputs(spec: Any, count: int, body: str = BODY) -> None:
    """Adds `count` actuators of zero gain: their commands act through the callback only."""
    for i in range(count):
        actuator = spec.add_actuator(name=f"command {i + 1}", target=body)
        actuator.trntype = mujoco.mjtTrn.mjTRN_BODY
        actuator.gainprm[0] = 0.0


def hidden(nominal: Array | float, spread: Array | float, rng: np.random.Generator) -> Array:
    """Nominal values, each multiplied by its own random factor within 1 ± spread."""
    nominal = np.asarray(nominal, dtype=np.float64)
    return nominal * (1 + spread * rng.uniform(-1, 1, nominal.shape))


def guessed(value: Array | float) -> Array:
    """The nearest powers of two of |value|: a guess by order of magnitude."""
    return np.exp2(np.round(np.log2(np.abs(np.asarray(value, dtype=np.float64))))).astype(
        np.float64
    )


def _rotation(wxyz: Array) -> Array:
    """(3, 3) rotation matrix of MuJoCo's quaternion w, x, y, z."""
    return rotation(np.roll(np.asarray(wxyz, dtype=np.float64), -1))
