"""One servo-driven joint, simulated open loop from its targets: exact Coulomb stick–slip.

Divided by the servo's stiffness kp, joint j of an arm obeys

    (a + g M_jj) q̈ = u(t − d) − q − T q̇ − f sgn q̇ − g Γ_j(q),

with g = 1/kp [rad/(N·m)], T = (kv + damping)/kp [s], f = friction/kp [rad], a = armature/kp [s²]
and the target's delay d [s]. Gravity Γ_j and inertia M_jj are those of the model file at given
positions, which decouples the joints: first the measured ones, then those of a simulation, whose
Γ_j includes what the other joints' accelerations and speeds exert on this one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ...parameters import Array

STEP = 4e-3
"""Longest step of the simulation [s]."""
FALL = 0.1  # speed at which Stribeck friction has fallen to 1/e [rad/s or m/s]


class JointLog(NamedTuple):
    """One joint's part of a log of N samples.

    Attributes:
        t: (N,) times [s], strictly increasing.
        target: (N,) of the servo [rad or m], held until the next sample.
        position: (N,) measured [rad or m].
        load: (N,) torque or force that the arm requires of the joint beside M_jj q̈ [N·m or N].
        inertia: (N,) M_jj without armature [kg·m² or kg].
        limit: largest torque or force of the servo [N·m or N].
    """

    t: Array
    target: Array
    position: Array
    load: Array
    inertia: Array
    limit: float = np.inf


class Effects(NamedTuple):
    """Effects beyond the equation above.

    Attributes:
        stribeck: excess of friction over kp at rest, which falls with speed [rad or m].
        load: friction per torque of the load [1].
    """

    stribeck: float = 0.0
    load: float = 0.0


NONE = Effects()


def simulate(log: JointLog, theta: Array, effects: Effects = NONE) -> Array:
    """(N,) positions of a joint that starts at rest at its first measured position.

    Args:
        log: its targets, load and inertia.
        theta: (5,) T [s], f [rad], g [rad/(N·m)], a [s²], d [s]; of a slide in m instead of rad.
        effects: beyond the equation.
    """
    out, last = np.empty(len(log.t)), len(log.t) - 1
    out[0] = q = log.position[0]
    apart = log.t, log.target, log.load, log.inertia, log.limit
    move(*apart, theta, effects, STEP, 0, last, 0, q, 0.0, out)
    return out


@njit(cache=True, error_model="numpy")
def move(t, target, load, inertia, limit, theta, effects, longest, first, last, held, q, v, out):
    """Writes the positions after sample `first` up to sample `last` to `out` (N,).

    Returns position, velocity and number of the target in force at sample `last`, from those at
    sample `first`.

    Steps of the θ-method; the joint sticks where friction can hold what drives it. θ between 1/2
    and 1 makes the decay of a speed by damping alone, exp(−h T/J), exact, so that steps may be
    longer than J/T. The target is averaged over each step after its delay, so that positions are
    continuous in it. A servo that saturates exerts its largest force over a step.
    """
    T, f, g, a, d = theta
    stribeck, rising = effects
    end = len(t) - 1
    for i in range(first, last):
        steps = int(np.ceil((t[i + 1] - t[i]) / longest))
        h = (t[i + 1] - t[i]) / steps
        J = a + g * (inertia[i] + inertia[i + 1]) / 2
        decay, resisted = h * T / J, h * T + h * h / 2
        part = 1 / (1 - np.exp(-decay)) - 1 / decay if decay > 1e-3 else 0.5
        for s in range(steps):
            begin = t[i] + s * h - d
            while held < end and t[held + 1] <= begin:
                held += 1
            at, k, area = begin, held, 0.0
            while k < end and t[k + 1] < begin + h:
                area += target[k] * (t[k + 1] - at)
                at = t[k + 1]
                k += 1
            area += target[k] * (begin + h - at)
            w = (s + 0.5) / steps
            hold = g * ((1 - w) * load[i] + w * load[i + 1])
            error, grip = area - h * q, h * (f + rising * abs(hold))
            if stribeck > 0:
                grip += h * stribeck * np.exp(-((v / FALL) ** 2))
            drive = (J - (1 - part) * resisted) * v + error - h * hold
            before, v = v, 0.0
            if abs(drive) > grip:
                v = (drive - np.sign(drive) * grip) / (J + part * resisted)
            servo = error - resisted * ((1 - part) * before + part * v)
            if abs(servo) > h * g * limit:
                drive = J * before + np.sign(servo) * h * g * limit - h * hold
                v = np.sign(drive) * max(abs(drive) - grip, 0.0) / J
            q += h * ((1 - part) * before + part * v)
        out[i + 1] = q
    return q, v, held
