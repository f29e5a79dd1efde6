"""A single body in MuJoCo: its inertia, and the specification of its model.xml."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ....base import InvalidInput
from ....core import Array
from ....robots import VehicleFiles

BODY = "vehicle"
"""Name of the moving body in every vehicle's model.xml; its free joint is called `pose`."""


_THINNEST = 0.02  # least side of a drawn box [m]
NED = np.array([1.0, -1.0, -1.0])
"""Signs that convert x forward, y right, z down to x forward, y left, z up, and back."""


class BodyInertia(NamedTuple):
    """Inertia of a rigid body."""

    mass: float  # [kg]
    lever: Array  # (3,) centre of mass [m]
    inertia: Array  # (3, 3) about the centre of mass [kg·m²]

    @staticmethod
    def of_matrix(M: Array) -> BodyInertia:
        """From the mass matrix (6, 6) about the origin."""
        mass = float(M[0, 0])
        lever = np.array([M[1, 5], M[2, 3], M[0, 4]]) / M[0, 0]
        return BodyInertia(mass, lever, M[3:, 3:] - mass * _steiner(lever))

    def matrix(self) -> Array:
        """(6, 6) mass matrix about the origin."""
        S = self.mass * np.cross(self.lever, np.eye(3))
        about = self.inertia + self.mass * _steiner(self.lever)
        return np.block([[self.mass * np.eye(3), S], [S.T, about]])


def _steiner(c: Array) -> Array:
    """(3, 3) inertia about the origin of a unit mass at c (3,)."""
    return (c @ c) * np.eye(3) - np.outer(c, c)


JOINTS = {6: ("pose",), 3: ("x", "y", "yaw"), 1: ("heave",)}
"""Names of the joints of a body with 6, 3 or 1 velocities."""
_XML = {
    6: '<freejoint name="pose"/>',
    3: """<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="yaw" type="hinge" axis="0 0 1"/>""",
    1: '<joint name="heave" type="slide" axis="0 0 1"/>',
}
_BOX = """<mujoco model="{name}"><worldbody><body name="vehicle">{joints}
<geom name="hull" type="box" size="{size}" mass="0" rgba="0.35 0.45 0.55 1"/>
</body></worldbody></mujoco>"""


def vehicle_spec(
    files: VehicleFiles,
    dt: float,
    inertia: BodyInertia,
    size: Sequence[float] | None = None,
    n: int = 6,
) -> Any:
    """MuJoCo's specification of a vehicle's model.xml with a given inertia, without gravity.

    Only the geometry of model.xml is used: its masses, damping and medium are overwritten. `dt` is
    the time step [s], the inertia in body axes; size (3,) is of the box drawn without a model.xml
    [m], None for a solid box of this inertia. The body has `n` velocities: 6 on a free joint, 3 on
    two slides and a hinge, 1 on a slide.

    Raises:
        InvalidInput: the model.xml is not of a single body with such joints and no actuators.
    """
    import mujoco

    from ....robots import set_options

    mass, centre, about = inertia
    spec = _visual_spec(files, size or box_of(mass, about), n)
    set_options(spec, dt)
    spec.option.gravity = [0, 0, 0]
    spec.option.density = 0.0
    spec.option.viscosity = 0.0
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    body = spec.body(BODY)
    for joint in body.joints:
        joint.damping = [0, 0, 0]
        joint.stiffness = [0, 0, 0]
        joint.armature = 0.0
        joint.frictionloss = 0.0
    body.explicitinertial = True
    body.gravcomp = 0.0
    body.mass = mass
    body.ipos = centre
    body.iquat = [1, 0, 0, 0]
    body.fullinertia = [*np.diag(about), about[0, 1], about[0, 2], about[1, 2]]
    return spec


def box_of(mass: float, inertia: Array) -> list[float]:
    """(3,) length, width and height of a solid box of a mass and inertia (3, 3) [m]."""
    diagonal = np.diag(inertia)
    squares = 6 * (diagonal.sum() - 2 * diagonal) / mass
    return np.sqrt(np.maximum(squares, _THINNEST**2)).tolist()


def _visual_spec(files: VehicleFiles, size: Sequence[float], n: int) -> Any:
    """MuJoCo's specification of a vehicle's model.xml, or of a box of the given size."""
    import mujoco

    from ....robots import VisualMesh, check_named_files

    path = files.model
    if not path.is_file():
        half = " ".join(f"{0.5 * length:.9g}" for length in size)
        return mujoco.MjSpec.from_string(_BOX.format(name="box", joints=_XML[n], size=half))
    try:
        check_named_files(path)
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InvalidInput(
            str(path), "a model that MuJoCo can load", error, "Correct it."
        ) from error
    kind = mujoco.mjtJoint
    bodies = [body.name for body in spec.bodies]
    wanted = {"pose": kind.mjJNT_FREE, "yaw": kind.mjJNT_HINGE}
    expected = [(name, wanted.get(name, kind.mjJNT_SLIDE)) for name in JOINTS[n]]
    joints = [(joint.name, joint.type) for joint in spec.joints]
    actuators = [actuator.name for actuator in spec.actuators]
    strange = [geom.name for geom in spec.geoms if not VisualMesh.is_drawn(geom.type)]
    drawn = "boxes, cylinders, capsules, ellipsoids and spheres"
    made = files.sheet.name
    for sound, needed, got, remedy in (
        (bodies == ["world", BODY], f"one body, called {BODY}", bodies[1:], "Put all geoms in it."),
        (
            joints == expected,
            f"the joints {_XML[n]}",
            [j for j, _ in joints],
            "Copy them from here.",
        ),
        (not actuators, "no actuators", actuators, f"They are made from {made}."),
        (not strange, drawn, strange, "Meshes are not drawn: use one of these in their place."),
    ):
        if not sound:
            raise InvalidInput(str(path), needed, got, remedy)
    return spec


def command_inputs(spec: Any, count: int, body: str = BODY) -> None:
    """Adds `count` actuators of zero gain: their commands act through the callback only."""
    import mujoco

    for i in range(count):
        actuator = spec.add_actuator(name=f"command {i + 1}", target=body)
        actuator.trntype = mujoco.mjtTrn.mjTRN_BODY
        actuator.gainprm[0] = 0.0


def hidden(nominal: Array | float, spread: Array | float, rng: np.random.Generator) -> Array:
    """Nominal values, each multiplied by its own random factor within 1 ± spread."""
    nominal = np.asarray(nominal, dtype=np.float64)
    return nominal * (1 + spread * rng.uniform(-1, 1, nominal.shape))
