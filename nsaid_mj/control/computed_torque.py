"""Computed torque along a Fourier series, the law of `FourierTracking`, compiled."""

from typing import NamedTuple

import numpy as np
from numba import types

from ..numerics.kernels import f8, i8, kernel, matrix, vector, void
from ..parameters import Array, Indices
from ..structure.arrays import AT_Q, CIRCLE, KIND, Slopes, StructureArrays, Workspace, memory_of
from ..structure.compiled import SLOPES, STRUCTURE, WORKSPACE
from ..structure.forces import ALL, write_forces
from ..structure.kinematics import place
from ..structure.stage import require
from .signals import SERIES, Series, fourier


class Tracking(NamedTuple):
    """Parameters of a computed-torque controller for an arm on a fixed base."""

    structure: StructureArrays  # structure of the arm
    driven: Indices  # (d,) numbers of the joints that have a motor
    theta: Array  # (p,) the controller's model θ̂₀; the gains of the motors come last
    series: Series  # the reference trajectory of the joints
    omega: float  # bandwidth of the tracking loop [rad/s]
    limit: Array  # (d,) largest commands, > 0


class TrackingMemory(NamedTuple):
    """Workspace of `computed_torque`."""

    desired: Array  # (n, 3) position, velocity and acceleration
    a: Array  # (n,) requested acceleration, 0 of passive joints
    force: Array  # (n,) that it requires
    still: Array  # (n,) zeros
    stage: Workspace  # workspace of a stage
    slopes: Slopes  # workspace of derivatives


def tracking_workspace(tracking: Tracking) -> TrackingMemory:
    """Allocates the workspace of `computed_torque`."""
    n = len(tracking.series.centre)
    own = np.empty((n, 3)), np.zeros(n), np.empty(n), np.zeros(n)
    return TrackingMemory(*own, *memory_of(tracking.structure, n))


TRACKING = types.NamedTuple((STRUCTURE, i8[::1], vector, SERIES, f8, vector), Tracking)
TRACKING_MEMORY = types.NamedTuple(
    (matrix, vector, vector, vector, WORKSPACE, SLOPES), TrackingMemory
)


@kernel(void(TRACKING, f8, vector, vector, TRACKING_MEMORY, vector))
def computed_torque(tracking, t, q, v, workspace, u):
    """Writes u = K̂⁻¹ [M̂ a + Ĉ v − F̂(u = 0)] with a = a_d + 2ω ė + ω² e into u (d,).

    Passive joints swing freely: a is 0 for them, and their actual acceleration is a disturbance of
    the loop. The command is limited like a motor's: a model far from the truth can make the sampled
    loop unstable, whose motion then stays bounded. q (m,) and v (n,) are measured.
    """
    structure, driven, theta, series, omega, limit = tracking
    desired, a, force, still, work, slopes = workspace
    bodies, gain = structure.bodies, theta.shape[0] - driven.shape[0]
    fourier(series, t, desired)
    for i in driven:
        at = bodies[i, AT_Q]
        if bodies[i, KIND] == CIRCLE:  # error along the shorter arc
            c, s = np.cos(desired[i, 0]), np.sin(desired[i, 0])
            error = np.arctan2(s * q[at] - c * q[at + 1], c * q[at] + s * q[at + 1])
        else:
            error = desired[i, 0] - q[at]
        a[i] = desired[i, 2] + 2 * omega * (desired[i, 1] - v[i]) + omega**2 * error
    place(structure, q, v, slopes.state)
    write_forces(structure, slopes.state, q, v, still, ALL, work.scratch, slopes.F)
    require(structure, slopes.state, slopes.F, v, a, theta, work, force)
    for k in range(driven.shape[0]):
        u[k] = min(max(force[driven[k]] / theta[gain + k], -limit[k]), limit[k])
