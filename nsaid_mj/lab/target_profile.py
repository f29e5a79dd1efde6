"""Limits and smoothing of position targets by a controller, before the servos.

Controllers limit a target's speed and acceleration, as do the profile registers of hobby servos,
and smooth it. A profile (k, 3) has the largest speed [rad/s or m/s], the largest acceleration
[rad/s² or m/s²] and the time constant of a first-order filter [s] of k targets; 0 where there is
none.
"""

import numpy as np

from ..core import Array, kernel

_STEP = 4e-3  # longest, between rows of a log [s]


def at_rest(target: Array) -> Array:
    """(k, 3) state of a profile that has reached its target (k,)."""
    return np.column_stack([target, 0 * target, target])


@kernel()
def advance(profile, target, h, state):
    """Advances a state (k, 3) by h [s]: limited target, its speed, and smoothed target."""
    for j in range(len(target)):
        speed, acceleration, lag = profile[j]
        off = target[j] - state[j, 0]
        fastest = abs(off) / h
        if speed > 0:
            fastest = min(fastest, speed)
        if acceleration > 0:  # it must still be able to stop at the target
            change = acceleration * h
            fastest = min(fastest, np.sqrt(2 * acceleration * abs(off)))
            wanted = np.sign(off) * fastest
            state[j, 1] += min(max(wanted - state[j, 1], -change), change)
        else:
            state[j, 1] = np.sign(off) * fastest
        state[j, 0] += h * state[j, 1]
        share = 1 - np.exp(-h / lag) if lag > 0 else 1.0
        state[j, 2] += share * (state[j, 0] - state[j, 2])


def followed_targets(t: Array, target: Array, profile: Array) -> Array:
    """(N, k) what servos follow of targets, as means over the time to the next row.

    target (N, k) is held from row to row, at times t (N,) [s]; profile (k, 3) has reached the
    first.
    """
    if not profile.any():
        return target
    out = np.empty_like(target)
    _follow(t, target, profile, at_rest(target[0]), out)
    return out


@kernel()
def _follow(t, target, profile, state, out):
    for i in range(len(t) - 1):
        steps = int(np.ceil((t[i + 1] - t[i]) / _STEP))
        out[i] = 0.0
        for _ in range(steps):
            out[i] += state[:, 2] / (2 * steps)
            advance(profile, target[i], (t[i + 1] - t[i]) / steps, state)
            out[i] += state[:, 2] / (2 * steps)
    out[-1] = state[:, 2]
