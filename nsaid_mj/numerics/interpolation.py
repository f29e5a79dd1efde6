"""Interpolation half-way between two samples, for RK4's middle stages and Simpson's rule."""

from __future__ import annotations

from .kernels import kernel
from .spatial import bracket


@kernel()
def half_way(dq, v0, v1, dt, hermite, group):
    """The tangent step (n,) to, and the velocity (n,) at, the middle between two samples.

    The velocity is the slope of the cubic through both positions and velocities. This is Simpson's
    rule solved for the middle, exact to dt⁴, while the cubic itself is exact to dt³ only. Where the
    velocities are a body twist, the cubic interpolates the tangent step ξ, with
    v = ξ̇ − ½[ξ, ξ̇] + ⅙[ξ, [ξ, ξ̇]] …

    Args:
        dq: (n,) tangent step from the first sample to the second.
        v0: (n,) velocity at the first sample.
        v1: (n,) velocity at the second sample.
        dt: time between the samples [s].
        hermite: cubic Hermite interpolation; else the velocity is the mean of both.
        group: 6 or 3 where the leading velocities are a body twist, else 0.
    """
    once = bracket(group, dq, v1)
    slope1 = v1 + 0.5 * once + bracket(group, dq, once) / 12
    half = 0.5 * dq + 0.125 * dt * (v0 - slope1)
    if not hermite:
        return half, 0.5 * (v0 + v1)
    slope = 1.5 / dt * dq - 0.25 * (v0 + slope1)
    once = bracket(group, half, slope)
    return half, slope - 0.5 * once + bracket(group, half, once) / 6
