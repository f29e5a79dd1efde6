"""Computed torque along a Fourier series, the law of `FourierTracking`, compiled."""

from typing import NamedTuple

import numpy as np
from numba import f8, i8, types, void

from ...core import (
    INVERSE_DYNAMICS,
    Array,
    Indices,
    InverseDynamics,
    kernel,
    write_tracking_force,
)
from .signals import SERIES, Series, fourier


class Tracking(NamedTuple):
    """Parameters of a computed-torque controller for an arm on a fixed base."""

    arm: InverseDynamics  # the arm's structure
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


def tracking_workspace(tracking: Tracking) -> TrackingMemory:
    """Allocates the workspace of `computed_torque`."""
    n = len(tracking.series.centre)
    return TrackingMemory(desired=np.empty((n, 3)), a=np.zeros(n), force=np.empty(n))


TRACKING = types.NamedTuple((INVERSE_DYNAMICS, i8[::1], f8[::1], SERIES, f8, f8[::1]), Tracking)
TRACKING_MEMORY = types.NamedTuple((f8[:, ::1], f8[::1], f8[::1]), TrackingMemory)


@kernel(void(TRACKING, f8, f8[::1], f8[::1], TRACKING_MEMORY, f8[::1]))
def computed_torque(tracking, t, q, v, workspace, u):
    """Writes u = K̂⁻¹ [M̂ a + Ĉ v − F̂(u = 0)] with a = a_d + 2ω ė + ω² e into u (d,).

    Passive joints swing freely: a is 0 for them, and their actual acceleration is a disturbance of
    the loop. The command is limited like a motor's: a model far from the truth can make the sampled
    loop unstable, whose motion then stays bounded. q (m,) and v (n,) are measured.
    """
    arm, driven, theta, series, omega, limit = tracking
    desired, a, force = workspace
    gain = theta.shape[0] - driven.shape[0]
    fourier(series, t, desired)
    write_tracking_force(arm, driven, desired, omega, q, v, theta, a, force)
    for k in range(driven.shape[0]):
        u[k] = min(max(force[driven[k]] / theta[gain + k], -limit[k]), limit[k])
