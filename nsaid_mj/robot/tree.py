"""Conversion of a Pinocchio model to MuJoCo, one body for each joint, and its meshes."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import mujoco
import numpy as np

from ..errors import InvalidInput
from ..parameters import Array
from ..structure.optional import pin
from .shapes import VisualMesh


def tree_spec(model: pin.Model, dt: float) -> Any:
    """MuJoCo's specification of a Pinocchio model, without friction and motors.

    MuJoCo's URDF importer is not used, so that no effort limit clips a hidden gain, no joint limit
    becomes a soft constraint, and no inertia is silently altered. Bodies and joints have the names
    of the model's joints; MuJoCo reserves "world" for its own body.

    Args:
        model: Pinocchio's model, of 1-DOF joints and possibly a free flyer.
        dt: time step [s].
    """
    spec = mujoco.MjSpec()
    set_options(spec, dt)
    spec.option.gravity = model.gravity.linear
    bodies = {0: spec.worldbody}
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    for i in range(1, model.njoints):
        name, placement = model.names[i], model.jointPlacements[i]
        body = bodies[model.parents[i]].add_body(name="joint world" if name == "world" else name)
        bodies[i] = body
        body.pos, body.quat = placement.translation, wxyz(placement.rotation)
        _give_inertia(body, model.inertias[i])
        if model.joints[i].nv == 6:
            body.add_freejoint(name=name)
            continue
        jacobian = pin.getJointJacobian(model, data, i, pin.ReferenceFrame.LOCAL)
        # Pinocchio returns a single column as (6,)
        subspace = jacobian.reshape(6, -1)[:, model.joints[i].idx_v]
        slides = np.linalg.norm(subspace[:3]) > np.linalg.norm(subspace[3:])
        body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=subspace[:3] if slides else subspace[3:],
        )
    return spec


def set_options(spec: Any, dt: float) -> None:
    """Sets the options of all plants: RK4, no automatic reset, no contacts, no joint limits.

    Args:
        spec: MuJoCo's specification.
        dt: time step [s].

    Raises:
        InvalidInput: dt is not a positive number.
    """
    if not (np.isfinite(dt) and dt > 0):
        raise InvalidInput("dt", "a step > 0 s", dt, "Try 1e-3 for an arm.")
    spec.option.timestep = dt
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= int(
        mujoco.mjtDisableBit.mjDSBL_AUTORESET
        | mujoco.mjtDisableBit.mjDSBL_CONTACT
        | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )


def _give_inertia(body: Any, inertia: pin.Inertia) -> None:
    """Sets the inertia of a body in MuJoCo's specification, in principal axes."""
    body.explicitinertial = True
    body.mass, body.ipos = inertia.mass, inertia.lever
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    body.iquat, body.inertia = wxyz(axes), moments


def set_inertias(model: pin.Model, theta: Array, first: int = 1) -> None:
    """Overwrites the inertias of the bodies from `first` on by ten parameters each (10 b,).

    Those that are unchanged keep their bits.
    """
    for i, own in enumerate(theta.reshape(-1, 10)):
        if not np.array_equal(own, model.inertias[first + i].toDynamicParameters()):
            model.inertias[first + i] = pin.Inertia.FromDynamicParameters(own)


class Described(Protocol):
    """A robot's kinematics and its shapes."""

    @property
    def model(self) -> pin.Model:
        """Pinocchio's model."""
        ...

    @property
    def visual(self) -> pin.GeometryModel:
        """Pinocchio's visual geometry."""
        ...


class RobotVisuals:
    """The visual meshes of a robot's description; there may be none.

    Args:
        robot: the description.
    """

    def __init__(self, robot: Described):
        self._robot = robot

    def visuals(self) -> list[VisualMesh]:
        """All meshes."""
        return list(self._meshes.values())

    @cached_property
    def _meshes(self) -> dict[int, VisualMesh]:
        """The meshes by their index in Pinocchio's visual geometry; other shapes are left out."""
        meshes = ((i, mesh_of(g)) for i, g in enumerate(self._robot.visual.geometryObjects))
        return {i: mesh for i, mesh in meshes if mesh is not None}

    def poses(self, q: Array) -> tuple[Array, Array]:
        """World poses of the meshes at positions q (k, m).

        Returns:
            translations (k, meshes, 3) [m] and quaternions (k, meshes, 4) in x, y, z, w.
        """
        model, visual = self._robot.model, self._robot.visual
        data, geometry = model.createData(), visual.createData()
        drawn = list(self._meshes)
        translations = np.zeros((len(q), len(drawn), 3))
        quaternions = np.zeros((len(q), len(drawn), 4))
        for k, configuration in enumerate(q):
            pin.updateGeometryPlacements(model, data, visual, geometry, configuration)
            for j, i in enumerate(drawn):
                pose = geometry.oMg[i]
                translations[k, j] = pose.translation
                quaternions[k, j] = pin.Quaternion(pose.rotation).coeffs()
        return translations, quaternions


def wxyz(rotation: Array) -> Array:
    """MuJoCo's quaternion (w, x, y, z) of a rotation matrix."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])


def mesh_of(geometry: Any) -> VisualMesh | None:
    """The triangle mesh of a Pinocchio geometry object, None for other shapes."""
    shape = geometry.geometry
    if not hasattr(shape, "vertices") or not hasattr(shape, "num_tris"):
        return None
    vertices = np.array(shape.vertices())
    triangles = np.array(
        [(t[0], t[1], t[2]) for t in map(shape.tri_indices, range(shape.num_tris))]
    )
    red, green, blue, alpha = np.asarray(geometry.meshColor, dtype=float).ravel().tolist()
    return VisualMesh(geometry.name, vertices, triangles, (red, green, blue, alpha))
