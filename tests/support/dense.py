"""Equations, interpolation and one step of the laws in numpy, from W_M, W_C and F of one sample."""

from __future__ import annotations

from typing import Any

import numpy as np

from nsaid_mj.core.laws.cone import chart
from nsaid_mj.core.laws.nullspace_aid import NullspaceIdentifier
from nsaid_mj.core.log import Log, Measurement, Middle
from nsaid_mj.core.numerics.linalg import solve_positive
from nsaid_mj.core.numerics.spatial import bracket
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.quotient import cone as geometry
from nsaid_mj.core.structure.arrays import FALL, FRAME
from nsaid_mj.core.structure.configuration_space import plain
from nsaid_mj.core.structure.kinematics import place
from nsaid_mj.core.structure.motion import balance
from nsaid_mj.core.structure.system import SecondOrderSystem, Stage

DIFFERENCE = 1e-5  # step of central differences along v [s·(1 + |v|)]


def transport(system: SecondOrderSystem, q: Array, v: Array) -> Array:
    """(n, p) regressor of Cᵀ v = Ṁ v − C v, so that d/dt(M v) = F θ + Cᵀ v."""
    if system.reference is not None:
        return system.reference.transport(q, v)
    v, size, own, arrays = plain(v), (system.n, system.p), system._memory, system.structure.arrays
    place(arrays, plain(q), v, own.state)
    fall = (len(arrays.bodies) + system.n) * FRAME + FALL
    own.state[fall : fall + 3] = 0.0  # without weight
    terms, none, F = np.zeros((2, *size)), np.empty((0, *size)), np.empty((3, 0, 0))
    empty, out = np.empty((0, 0)), np.empty(size)
    balance(
        arrays,
        0.0,
        v[None],
        empty,
        own.state[None],
        empty,
        F,
        own.work,
        out,
        terms[0],
        terms[1:],
        none,
        none,
        none,
    )
    return out


class Dense:
    """A system known by its regressors of one sample only."""

    def __init__(self, system: SecondOrderSystem):
        self.system = system

    def evaluate_at(self, t: float, q: Array, v: Array, u: Array, w: Array, theta: Array) -> Stage:
        """â of (29), W of (10) and M̂'s pivot; where M̂ is not PD, â is NaN and W lacks W_M."""
        s, n = self.system, self.system.n
        M = np.stack([s._W_M(q, e) @ theta for e in np.eye(n)], axis=1)
        W = s._W_C(q, v, w) - s._F(t, q, v, u)
        a = -W @ theta
        pivot = solve_positive(np.ascontiguousarray(M), np.zeros((n, n)), a)
        if not pivot > 0:
            return Stage(np.full(n, np.nan), W, pivot)
        return Stage(a, W + s._W_M(q, a), pivot)

    def transport(self, q: Array, v: Array) -> Array:
        """(n, p) Ṁ v − C v by differences along the motion."""
        s = self.system
        step = DIFFERENCE / (1.0 + float(np.abs(v).max(initial=0.0)))  # Ṁ v to about 1e-10
        ahead, behind = s.integrate(q, step * v), s.integrate(q, -step * v)
        return (s._W_M(ahead, v) - s._W_M(behind, v)) / (2 * step) - s._W_C(q, v, v)

    def momentum_balance(self, leak: float, log: Log, q: Array, v: Array) -> tuple[Array, ...]:
        """The four arrays of `SecondOrderSystem.momentum_balance`, sample by sample."""
        s = self.system

        def rows(q: Array, v: Array, u: Array) -> Array:
            each = zip(log.t, q, v, u, strict=False)
            return np.stack(
                [leak * s._W_M(q, v) + transport(s, q, v) + s._F(t, q, v, u) for t, q, v, u in each]
            )

        momenta = np.stack([s._W_M(*row) for row in zip(log.q, log.v, strict=True)])
        held = log.u[:-1]
        ends = (
            rows(log.q[:-1], log.v[:-1], held),
            rows(q, v, held),
            rows(log.q[1:], log.v[1:], held),
        )
        return momenta, *ends

    def midpoints(self, log: Log, hermite: bool) -> Middle:
        """The states half-way between a log's samples."""
        made = []
        for k, dt in enumerate(np.diff(log.t)):
            dq = self.system.difference(log.q[k], log.q[k + 1])
            half, v = half_way(dq, log.v[k], log.v[k + 1], dt, hermite, self.system.group)
            made.append((self.system.integrate(log.q[k], half), v))
        return Middle(*(np.array(part) for part in zip(*made, strict=True)))


def half_way(dq: Array, v0: Array, v1: Array, dt: float, hermite: bool, group: int):
    """The tangent step (n,) to, and the velocity (n,) at, the middle between two samples.

    Where the velocities are a body twist, the cubic interpolates the tangent step ξ, with
    v = ξ̇ − ½[ξ, ξ̇] + ⅙[ξ, [ξ, ξ̇]] …
    """
    once = bracket(group, dq, v1)
    slope1 = v1 + 0.5 * once + bracket(group, dq, once) / 12
    half = 0.5 * dq + 0.125 * dt * (v0 - slope1)
    if not hermite:
        return half, 0.5 * (v0 + v1)
    slope = 1.5 / dt * dq - 0.25 * (v0 + slope1)
    once = bracket(group, half, slope)
    return half, slope - 0.5 * once + bracket(group, half, once) / 6


def to_chart(cone, theta: Array) -> Array:
    """(p,) η of θ (p,)."""
    eta = np.empty(len(theta))
    chart.to_chart_into(cone, theta, eta, chart.chart_of(cone))
    return eta


def from_chart(cone, eta: Array, pairing: Array) -> Array:
    """(p,) θ of η (p,)."""
    theta = np.empty(len(eta))
    chart.from_chart_into(cone, eta, pairing, theta, chart.chart_of(cone))
    return theta


def full(gain: Array) -> Array:
    """(k, k) of a gain (k,) or (k, k)."""
    return gain if gain.ndim == 2 else np.diag(gain)


def rk4_step(
    law: NullspaceIdentifier,
    v_hat: Array,
    theta_hat: Array,
    previous: Measurement,
    following: Measurement,
) -> tuple[Array, Array, float]:
    """v̂, θ̂ and M̂'s smallest pivot after one RK4 step of (44, 45), with a dense metric.

    A pivot that is not positive ends the step; v̂ and θ̂ are then NaN.
    """
    dense, n, dt = Dense(law.system), law.system.n, following.t - previous.t
    middle = dense.midpoints(Log.of([previous, following]), law.hermite)
    half = Measurement(previous.t + 0.5 * dt, middle.q[0], middle.v[0], previous.u)
    last, K, Gamma = following._replace(u=previous.u), full(law.K), full(law.metric.Gamma)
    cone = getattr(law.metric, "cone", None)
    pairing: Any = None if cone is None else geometry.coordinates(cone)
    pivots: list[float] = []

    def slope(sample: Measurement, z: Array) -> Array:
        theta = z[n:] if cone is None else from_chart(cone, z[n:], pairing)
        a_hat, W, pivot = dense.evaluate_at(*sample, z[:n], theta)
        pivots.append(pivot)
        dv = z[:n] - sample.v
        if cone is None:
            return np.r_[a_hat - K @ dv, Gamma @ (W.T @ dv)]
        metric = np.linalg.inv(Gamma)
        metric += law.metric.mu * cone.derivatives(theta)[1]
        rate = np.linalg.solve(metric, W.T @ dv)
        return np.r_[a_hat - K @ dv, chart.chart_rate(cone, z[n:], rate)]

    start = np.r_[v_hat, theta_hat if cone is None else to_chart(cone, theta_hat)]
    total, z = 0.0, start
    for sample, weight, reach in ((previous, 1, 0.5), (half, 2, 0.5), (half, 2, 1.0), (last, 1, 0)):
        rate = slope(sample, z)
        if not pivots[-1] > 0:
            return np.full(n, np.nan), np.full(len(theta_hat), np.nan), pivots[-1]
        total, z = total + weight * rate, start + reach * dt * rate
    end = start + dt / 6 * total
    theta = end[n:] if cone is None else from_chart(cone, end[n:], pairing)
    return end[:n], theta, min(pivots)
