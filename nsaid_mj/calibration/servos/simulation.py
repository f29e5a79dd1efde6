"""One servo-driven joint, simulated open loop from its targets: exact Coulomb stick–slip.

Divided by the servo's stiffness kp, joint j of an arm obeys

    (a + g M_jj) q̈ = u(t − d) − q − T q̇ − f sgn q̇ − g Γ_j(q),

with g = 1/kp [rad/(N·m)], T = (kv + damping)/kp [s], f = friction/kp [rad], a = armature/kp [s²] and
the target's delay d [s]. Gravity Γ_j and inertia M_jj are those of the model file at the *measured*
positions, which decouples the joints.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...numerics import kernels as kernels  # sets the folder of compiled kernels
from ...parameters import Array

STEP = 4e-3
"""Longest step of the simulation [s]."""


class JointLog(NamedTuple):
    """One joint's part of a log of N samples.

    Attributes:
        t: (N,) times [s], strictly increasing.
        target: (N,) of the servo [rad or m], held until the next sample.
        position: (N,) measured [rad or m].
        gravity: (N,) torque or force that gravity asks of the joint [N·m or N].
        inertia: (N,) M_jj without armature [kg·m² or kg].
    """

    t: Array
    target: Array
    position: Array
    gravity: Array
    inertia: Array


def simulate(log: JointLog, theta: Array) -> Array:
    """(N,) positions of a joint that starts at rest at its first measured position.

    Args:
        log: its targets, gravity and inertia.
        theta: (5,) T [s], f [rad], g [rad/(N·m)], a [s²], d [s]; of a slide in m instead of rad.
    """
    out = np.empty(len(log.t))
    _simulate(log.t, log.target, log.position[0], log.gravity, log.inertia, theta, STEP, out)
    return out


@njit(cache=True)
def _simulate(t, target, q, gravity, inertia, theta, longest, out):
    """Implicit Euler steps; the joint sticks where the drive J v + h e is within h f.

    The target is averaged over each step after its delay, so that positions are continuous in it.
    """
    T, f, g, a, d = theta
    last, held, v = len(t) - 1, 0, 0.0
    out[0] = q
    for i in range(last):
        steps = int(np.ceil((t[i + 1] - t[i]) / longest))
        h = (t[i + 1] - t[i]) / steps
        for s in range(steps):
            begin = t[i] + s * h - d
            while held < last and t[held + 1] <= begin:
                held += 1
            at, k, area = begin, held, 0.0
            while k < last and t[k + 1] < begin + h:
                area += target[k] * (t[k + 1] - at)
                at = t[k + 1]
                k += 1
            area += target[k] * (begin + h - at)
            w = (s + 0.5) / steps
            load = g * ((1 - w) * gravity[i] + w * gravity[i + 1])
            J = a + g * ((1 - w) * inertia[i] + w * inertia[i + 1])
            drive = J * v + area - h * (q + load)
            if abs(drive) <= h * f:
                v = 0.0
            else:
                v = (drive - np.sign(drive) * h * f) / (J + h * T + h * h)
            q += h * v
        out[i + 1] = q
