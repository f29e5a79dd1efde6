"""One RK4 step of v̇ = f(q, v, u, θ) and its derivatives, for any structure of `forward`.

Positions are integrated in the tangent step ξ from the step's start, with
ξ̇ = v + ½[ξ, v] + 1/12 [ξ, [ξ, v]]. A deviation (δq, δv, δθ), with δq the tangent step from the
undisturbed position, obeys

    δ̇q = δv − [v, δq],    δ̇v = ∂v̇/∂q δq + ∂v̇/∂v δv + c,    c = ∂v̇/∂θ δθ.

The derivatives are held in the step at their values in RK4's third stage, half-way: by symmetry the
error is of third order in the step. θ acts through the n components of c alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from ..numerics.spatial import bracket
from ..structure.arrays import StructureArrays
from ..structure.transition import step as structure_step
from .forward import forward_work, group_of, integrate_into, linearise, write_acceleration


@njit(cache=True)
def transition_work(structure, n, m, p):
    """Allocates the workspace of `transition`."""
    return _work(structure, n, m, p)


@njit(cache=True)
def transition(structure, q, v, u, dt, theta, scale, work, q1, v1):
    """Writes the state after a step with the command held, and its derivatives.

    Args:
        structure: the structure.
        q: (m,) position at the step's start.
        v: (n,) velocity at the step's start.
        u: (n_u,) command.
        dt: the step [s].
        theta: (p,) parameters.
        scale: (p,) their scale.
        work: workspace of `transition_work`.
        q1: (m,) position at the end; written.
        v1: (n,) velocity at the end; written.

    Returns:
        M's smallest pivot, > 0 if it succeeded; (2n, 3n) the derivatives of the end with respect to
        (q, v) at the start and c; and (n, p) those of c with respect to θ/scale.
    """
    return _step(structure, q, v, u, dt, theta, scale, work, q1, v1)


def _work(structure, n, m, p) -> Any:
    """`transition_work`, selected by the structure's type."""


def _step(structure, q, v, u, dt, theta, scale, work, q1, v1) -> Any:
    """`transition`, selected by the structure's type."""


@overload(_work)
def _choose_work(structure, n, m, p):
    def data(structure, n, m, p):
        own, rates, flow = forward_work(structure, n, p), np.empty((1, n)), np.empty((2 * n, 3 * n))
        return own, np.empty(m), np.empty((n, p)), rates, flow

    def other(structure, n, m, p):
        return (
            forward_work(structure, n, p),
            np.empty((n, 2 * n)),
            np.empty((n, p)),
            np.empty((2, n)),
            np.empty((2, n)),
            np.empty((2, n)),
            np.empty(m),
            np.empty((2 * n, 3 * n)),
            np.empty((2 * n, 3 * n)),
        )

    return data if structure.instance_class is StructureArrays else other


@overload(_step)
def _choose_step(structure, q, v, u, dt, theta, scale, work, q1, v1):
    def data(structure, q, v, u, dt, theta, scale, work, q1, v1):
        (stage, slopes), at, B, _, F = work
        own, size = theta.copy(), scale.copy()  # kernels take no array that is read-only
        pivot = structure_step(structure, q, v, u, dt, own, size, stage, slopes, at, q1, v1, F, B)
        return pivot, F, B

    def other(structure, q, v, u, dt, theta, scale, work, q1, v1):
        forward, A, B, rates, now, sums, at, F, product = work
        group, pivot = group_of(structure), np.inf
        way, speed, a = now[0], now[1], rates[0]
        _begin(q, v, at, now, sums)
        for stage in range(4):
            if stage == 2:
                own = linearise(structure, at, speed, u, theta, scale, forward, a, A, B)
                _write_flow(group, dt, speed, A, F, product)
            else:
                own = write_acceleration(structure, at, speed, u, theta, forward, a)
            pivot = min(pivot, own)
            if not pivot > 0.0:
                return pivot, F, B
            _advance(group, stage, dt, v, rates, now, sums)
            if stage < 3:
                integrate_into(structure, q, way, at)
        _end(v, sums, v1)
        integrate_into(structure, q, sums[0], q1)
        return pivot, F, B

    return data if structure.instance_class is StructureArrays else other


# Whatever does not depend on the structure is a function of its own, which is compiled only once.


@njit(cache=True)
def _begin(q, v, at, now, sums):
    """Sets the first stage (2, n), tangent step and velocity, its position and the sums (2, n)."""
    at[:], now[0], now[1], sums[:] = q, 0.0, v, 0.0


@njit(cache=True)
def _advance(group, stage, dt, v, rates, now, sums):
    """Adds a stage's rates (2, n), v̇ and ξ̇, to the sums, and moves `now` to the next stage."""
    a, rate, way, speed = rates[0], rates[1], now[0], now[1]
    _way_rate(group, way, speed, rate)
    weight = dt / 3 if stage in (1, 2) else dt / 6
    reach = dt if stage == 2 else 0.5 * dt
    for i in range(v.shape[0]):
        sums[0, i] += weight * rate[i]
        sums[1, i] += weight * a[i]
        way[i], speed[i] = reach * rate[i], v[i] + reach * a[i]


@njit(cache=True)
def _end(v, sums, v1):
    """Writes the velocity at the step's end."""
    for i in range(v.shape[0]):
        v1[i] = v[i] + sums[1, i]


@njit(cache=True)
def _way_rate(group, way, v, rate):
    """Writes ξ̇ (n,) at the tangent step ξ = `way` (n,) and the velocity v (n,)."""
    rate[:] = v
    if group:
        once = bracket(group, way, v)
        twice = bracket(group, way, once)
        for i in range(group):
            rate[i] += 0.5 * once[i] + twice[i] / 12


@njit(cache=True)
def _write_flow(group, dt, v, A, F, rates):
    """Writes the flow of deviations under constant derivatives, to fourth order in the step.

    Args:
        group: number of leading velocities that form a body twist.
        dt: the step [s].
        v: (n,) velocity.
        A: (n, 2n) ∂v̇/∂q and ∂v̇/∂v.
        F: (2n, 3n) the deviation at the end per (δq, δv, c); written.
        rates: (2n, 3n) workspace.
    """
    n, size = v.shape[0], F.shape[1]
    F[:] = 0.0
    for i in range(2 * n):
        F[i, i] = 1.0
    for order in range(4, 0, -1):  # Horner's scheme: F ← [1, 0] + dt/order (the rates of F)
        for i in range(n):
            for k in range(size):
                rates[i, k], rates[n + i, k] = F[n + i, k], 0.0
            rates[n + i, 2 * n + i] = 1.0
            for j in range(2 * n):
                for k in range(size):
                    rates[n + i, k] += A[i, j] * F[j, k]
        if group == 6:
            for k in range(size):
                _subtract_bracket(v, F, rates, k)
        elif group == 3:
            for k in range(size):
                rates[0, k] -= v[1] * F[2, k] - v[2] * F[1, k]
                rates[1, k] -= v[2] * F[0, k] - v[0] * F[2, k]
        for i in range(2 * n):
            for k in range(size):
                F[i, k] = dt / order * rates[i, k]
            F[i, i] += 1.0


@njit(cache=True, inline="always")
def _subtract_bracket(a, X, K, k):
    """Subtracts the Lie bracket of the twist a (6,) with column k of X from that of K."""
    x, y, z, r, s, t = X[0, k], X[1, k], X[2, k], X[3, k], X[4, k], X[5, k]
    K[0, k] -= a[4] * z - a[5] * y + a[1] * t - a[2] * s
    K[1, k] -= a[5] * x - a[3] * z + a[2] * r - a[0] * t
    K[2, k] -= a[3] * y - a[4] * x + a[0] * s - a[1] * r
    K[3, k] -= a[4] * t - a[5] * s
    K[4, k] -= a[5] * r - a[3] * t
    K[5, k] -= a[3] * s - a[4] * r
