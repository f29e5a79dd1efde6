"""Compiled computed-torque control along a Fourier series: the law of `FourierTracking`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..dynamics.structures import Linkage
from ..dynamics.tree import CIRCLE, tree_place, tree_room, tree_torque
from ..parameters import Array
from .signals import Series, fourier


class Tracking(NamedTuple):
    """Parameters of a computed-torque controller for an arm on a fixed base.

    Attributes:
        linkage: the arm's kinematics; every joint has a motor.
        theta: (p,) the controller's model θ̂₀.
        series: the reference trajectory of the joints.
        omega: bandwidth of the tracking loop [rad/s].
        limit: (n,) largest commands, > 0.
    """

    linkage: Linkage
    theta: Array
    series: Series
    omega: float
    limit: Array


@njit(cache=True)
def tracking_workspace(tracking):
    """Allocates the workspace of `computed_torque`, which every call overwrites."""
    bodies = tracking.linkage.numbers.shape[0]
    state = tree_room(tracking.linkage)
    return np.empty((bodies, 3)), np.empty(bodies), state, np.empty((bodies, 12))


@njit(cache=True)
def computed_torque(tracking, t, q, v, workspace, u):
    """Writes u = K̂⁻¹ [M̂ a + Ĉ v − F̂(u = 0)] with a = a_d + 2ω ė + ω² e into u (n,).

    Like a motor's, the command is limited: a model far from the truth can make the sampled loop
    unstable, whose motion then remains bounded.

    Args:
        tracking: `Tracking`.
        t: time [s].
        q: (m,) measured position.
        v: (n,) measured velocity.
        workspace: of `tracking_workspace`; overwritten.
        u: (n,) receives the command.
    """
    linkage, theta, series, omega, limit = tracking
    desired, a, state, work = workspace
    numbers, gain = linkage.numbers, linkage.columns[3]
    fourier(series, t, desired)
    for i in range(v.shape[0]):
        at = numbers[i, 1]
        if numbers[i, 2] == CIRCLE:  # error along the shorter arc
            c, s = np.cos(desired[i, 0]), np.sin(desired[i, 0])
            error = np.arctan2(s * q[at] - c * q[at + 1], c * q[at] + s * q[at + 1])
        else:
            error = desired[i, 0] - q[at]
        a[i] = desired[i, 2] + 2 * omega * (desired[i, 1] - v[i]) + omega**2 * error
    tree_place(linkage, q, v, state)
    tree_torque(linkage, state, v, a, theta, work, u)
    for i in range(v.shape[0]):
        u[i] = min(max(u[i] / theta[gain + i], -limit[i]), limit[i])
