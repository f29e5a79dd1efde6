"""A Pinocchio model in MuJoCo, one body for each joint."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from ..errors import InvalidInput
from ..parameters import Array
from ..structure.joints import bodies_of
from ..structure.optional import pin


def tree_spec(model: pin.Model, dt: float) -> Any:
    """MuJoCo's specification, with time step dt [s], of a Pinocchio model; no friction, no motors.

    MuJoCo's URDF importer is not used, so that no effort limit clips a hidden gain, no joint limit
    becomes a soft constraint, and no inertia is silently altered. Bodies and joints have the names
    of the model's joints, of one degree of freedom, after a free flyer if there is one; MuJoCo
    reserves "world" for its own body.
    """
    spec = mujoco.MjSpec()
    set_options(spec, dt)
    spec.option.gravity = model.gravity.linear
    bodies = {0: spec.worldbody}
    for i, own in enumerate(bodies_of(model), start=1):
        name, placement = model.names[i], model.jointPlacements[i]
        body = bodies[model.parents[i]].add_body(name="joint world" if name == "world" else name)
        bodies[i] = body
        body.pos, body.quat = placement.translation, wxyz(placement.rotation)
        _give_inertia(body, model.inertias[i])
        if own.joint == "free":
            body.add_freejoint(name=name)
        else:
            slides = own.joint == "slide"
            kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(name=name, type=kind, axis=own.axis)
    return spec


def set_options(spec: Any, dt: float) -> None:
    """Sets all plants' options: RK4 by dt [s], no automatic reset, no contacts, no joint limits.

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


def wxyz(rotation: Array) -> Array:
    """MuJoCo's quaternion (w, x, y, z) of a rotation matrix."""
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return np.array([w, x, y, z])


def pose(position: Array, wxyz: Array) -> pin.SE3:
    """The pose with MuJoCo's position (3,) and quaternion (4,)."""
    return pin.SE3(pin.Quaternion(*wxyz).normalized().toRotationMatrix(), np.array(position))
