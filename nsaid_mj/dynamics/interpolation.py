"""The state half-way between two samples, which RK4's middle stages and Simpson's rule ask for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ..log import Log, Measurement
from ..numerics.spatial import (
    bracket,
    planar_difference,
    planar_integrate,
    pose_difference,
    pose_integrate,
)
from ..parameters import Array
from ..system import SecondOrderSystem
from .tree import BASE, CIRCLE


class Middle(NamedTuple):
    """The states half-way between the N samples of a log.

    Attributes:
        q: (N−1, m) positions.
        v: (N−1, n) velocities.
    """

    q: Array
    v: Array

    def part(self, start: int, end: int) -> Middle:
        """Its states start … end − 1."""
        return Middle(self.q[start:end], self.v[start:end])


def midpoints(system: SecondOrderSystem, log: Log, hermite: bool) -> Middle:
    """The states half-way between a log's samples; see `half_way`."""
    t, q, v, _ = log
    if system.linkage is not None:
        return Middle(*tree_midpoints(system.linkage, t, q, v, hermite))
    if system.loaded is not None:
        return Middle(*tree_midpoints(system.loaded.linkage, t, q, v, hermite))
    if system.inertia is not None:
        return Middle(*body_midpoints(system.group, t, q, v, hermite))
    between = [between_two(system, log.at(k), log.at(k + 1), hermite) for k in range(len(t) - 1)]
    return Middle(*(np.array(part) for part in zip(*between, strict=True)))


def between_two(
    system: SecondOrderSystem, previous: Measurement, following: Measurement, hermite: bool
) -> tuple[Array, Array]:
    """(m,) and (n,) the state half-way between two measurements, of any system."""
    dt = following.t - previous.t
    dq = system.difference(previous.q, following.q)
    half, v = half_way(dq, previous.v, following.v, dt, hermite, system.group)
    return system.integrate(previous.q, half), v


@njit(cache=True)
def body_half_way(group, q0, v0, q1, v1, dt, hermite):
    """The pose and the velocity half-way between two samples of a body; see `half_way`.

    Where no velocity belongs to a twist (group 0) positions add.
    """
    if group == 0:
        half, v = half_way(q1 - q0, v0, v1, dt, hermite, group)
        return q0 + half, v
    dq = pose_difference(q0, q1) if group == 6 else planar_difference(q0, q1)
    half, v = half_way(dq, v0, v1, dt, hermite, group)
    return pose_integrate(q0, half) if group == 6 else planar_integrate(q0, half), v


@njit(cache=True)
def half_way(dq, v0, v1, dt, hermite, group):
    """The tangent step to, and the velocity at, the middle of two samples dq (n,) apart.

    The slope of the cubic through both positions and velocities is Simpson's rule solved for the
    middle: exact to dt⁴, where the cubic itself is exact to dt³ only. Where the velocities are a
    body twist, the cubic is that of the tangent step ξ, with v = ξ̇ − ½[ξ, ξ̇] + ⅙[ξ, [ξ, ξ̇]] …
    """
    once = bracket(group, dq, v1)
    slope1 = v1 + 0.5 * once + bracket(group, dq, once) / 12
    half = 0.5 * dq + 0.125 * dt * (v0 - slope1)
    if not hermite:
        return half, 0.5 * (v0 + v1)
    slope = 1.5 / dt * dq - 0.25 * (v0 + slope1)
    once = bracket(group, half, slope)
    return half, slope - 0.5 * once + bracket(group, half, once) / 6


@njit(cache=True)
def tree_half_way(linkage, q0, v0, q1, v1, dt, hermite, q, v):
    """The same for a tree of joints, into q and v."""
    joint = 0
    for at, kind in linkage[1][:, 1:]:
        if kind == BASE:
            q[:7], v[:6] = body_half_way(6, q0[:7], v0[:6], q1[:7], v1[:6], dt, hermite)
            joint = 6
            continue
        if kind == CIRCLE:
            c, s = q0[at], q0[at + 1]
            dq = np.arctan2(c * q1[at + 1] - s * q1[at], c * q1[at] + s * q1[at + 1])
        else:
            dq = q1[at] - q0[at]
        half = 0.5 * dq + 0.125 * dt * (v0[joint] - v1[joint])
        if kind == CIRCLE:
            cosine, sine = np.cos(half), np.sin(half)
            q[at], q[at + 1] = c * cosine - s * sine, s * cosine + c * sine
        else:
            q[at] = q0[at] + half
        if hermite:
            v[joint] = 1.5 / dt * dq - 0.25 * (v0[joint] + v1[joint])
        else:
            v[joint] = 0.5 * (v0[joint] + v1[joint])
        joint += 1


@njit(cache=True)
def body_midpoints(group, t, q, v, hermite):
    """(N−1, m) poses and (N−1, n) velocities half-way between a log's N samples of a body."""
    steps = t.shape[0] - 1
    qm, vm = np.empty((steps, q.shape[1])), np.empty((steps, v.shape[1]))
    for k in range(steps):
        dt = t[k + 1] - t[k]
        qm[k], vm[k] = body_half_way(group, q[k], v[k], q[k + 1], v[k + 1], dt, hermite)
    return qm, vm


@njit(cache=True)
def tree_midpoints(linkage, t, q, v, hermite):
    """The same of a tree of joints."""
    steps = t.shape[0] - 1
    qm, vm = np.empty((steps, q.shape[1])), np.empty((steps, v.shape[1]))
    for k in range(steps):
        dt = t[k + 1] - t[k]
        tree_half_way(linkage, q[k], v[k], q[k + 1], v[k + 1], dt, hermite, qm[k], vm[k])
    return qm, vm
