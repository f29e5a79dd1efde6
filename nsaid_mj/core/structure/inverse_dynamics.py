"""Inverse dynamics of an arm on a fixed base, for compiled controllers."""

from typing import NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import f8, helper, i8, kernel, matrix, vector, void
from ..parameters import Array
from .arrays import AT_Q, CIRCLE, KIND, Slopes, StructureArrays, Workspace, memory_of
from .compiled import SLOPES, STRUCTURE, WORKSPACE
from .forces import ALL, write_forces
from .forward_dynamics import require
from .kinematics import place


class InverseDynamics(NamedTuple):
    """An arm's structure and the workspace of `write_tracking_force`, which calls overwrite."""

    structure: StructureArrays
    still: Array  # (n,) commands of zero
    work: Workspace  # workspace of a stage
    slopes: Slopes  # workspace of derivatives

    @staticmethod
    def of(structure: StructureArrays, n: int) -> "InverseDynamics":
        """For a structure with n joints."""
        return InverseDynamics(structure, np.zeros(n), *memory_of(structure, n))


INVERSE_DYNAMICS = types.NamedTuple((STRUCTURE, vector, WORKSPACE, SLOPES), InverseDynamics)
"""The type of `InverseDynamics` in signatures of compiled functions."""


@helper(f8(STRUCTURE, i8, vector, f8))
def _position_error(structure, i, q, desired):
    """Angle or travel from joint i's position in q (m,) to a desired one, along the shorter arc."""
    at = structure.bodies[i, AT_Q]
    if structure.bodies[i, KIND] != CIRCLE:
        return desired - q[at]
    c = np.cos(desired)
    s = np.sin(desired)
    return np.arctan2(s * q[at] - c * q[at + 1], c * q[at] + s * q[at + 1])


@kernel(
    void(INVERSE_DYNAMICS, i8[::1], matrix, f8, vector, vector, vector, vector, vector), inner=True
)
def write_tracking_force(model, driven, desired, omega, q, v, theta, a, force):
    """Writes M a + C v − F(u = 0) (n,) with a = a_d + 2ω ė + ω² e, at θ (p,).

    Args:
        model: the arm.
        driven: (d,) numbers of the joints that track; of the others, a is kept.
        desired: (n, 3) position, velocity and acceleration.
        omega: bandwidth of the tracking loop [rad/s].
        q: (m,) position.
        v: (n,) velocity.
        theta: (p,) parameters.
        a: (n,) overwritten with the acceleration.
        force: (n,) written.
    """
    structure = model.structure
    for i in driven:
        error = _position_error(structure, i, q, desired[i, 0])
        a[i] = desired[i, 2] + 2 * omega * (desired[i, 1] - v[i]) + omega**2 * error
    slopes = model.slopes
    place(structure, q, v, slopes.state)
    write_forces(structure, slopes.state, q, v, model.still, ALL, model.work.scratch, slopes.F)
    require(structure, slopes.state, slopes.F, v, a, theta, model.work, force)
