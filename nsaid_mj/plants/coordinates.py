"""The one place where MuJoCo's coordinates become the system's, and back."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pinocchio as pin

from ..parameters import Array


class JointMap:
    """Joint numbers in Pinocchio's order ↔ MuJoCo's qpos and qvel, matched by joint name.

    Only 1-DOF joints: a joint's number is its angle [rad] or travel [m] in both engines, and
    MuJoCo orders bodies depth first where Pinocchio need not.
    """

    def __init__(self, pinocchio: pin.Model, model: Any):
        joints = [model.joint(name) for name in list(pinocchio.names)[1:]]
        self.qpos = np.array([joint.qposadr[0] for joint in joints])
        self.dof = np.array([joint.dofadr[0] for joint in joints])

    def read(self, data: Any) -> tuple[Array, Array]:
        """(n,) joint numbers and (n,) joint velocities."""
        return data.qpos[self.qpos], data.qvel[self.dof]

    def write(self, data: Any, coordinates: Array, velocity: Array) -> None:
        """Sets qpos and qvel from joint numbers and velocities."""
        data.qpos[self.qpos] = coordinates
        data.qvel[self.dof] = velocity

    def mass_matrix(self, model: Any, data: Any) -> Array:
        """(n, n) MuJoCo's M at its present state, in Pinocchio's order."""
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        return full[np.ix_(self.dof, self.dof)]

    def bias(self, data: Any) -> Array:
        """(n,) MuJoCo's Coriolis, centrifugal and gravity forces, in Pinocchio's order."""
        return data.qfrc_bias[self.dof]
