"""Motions of arms and vehicles, planned sample by sample, and the driver that follows them.

The motion `own` is that of the scenario: for arms, that of `nsaid run arm`. Otherwise arms follow a
planned motion by computed torque under the prior, as `FourierTracking` does, and the commands of a
vehicle's own driver are shaped.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.configuration_space import plain
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.control.computed_torque import Tracking, computed_torque, tracking_workspace
from nsaid_mj.lab.control.driver import Driver
from nsaid_mj.lab.control.signals import Series

ARM_MOTIONS = ("own", "own", "lively", "gentle", "one axis", "rest", "chirp", "steps", "small")
VEHICLE_MOTIONS = ("own", "weak", "rest", "steps")
_HALF = 1.5  # largest half range of a planned motion [rad or m]
_BANDWIDTH = 2.0  # of the tracking loop [Hz]


def planned(kind: str, system: JointTree, dt: float, steps: int, rng: np.random.Generator) -> Array:
    """(steps + 1, n) positions of a motion within the joints' limits.

    Args:
        kind: one of `ARM_MOTIONS` other than `own`.
        system: the arm.
        dt: time step [s].
        steps: number of time steps.
        rng: source of the motion.
    """
    low, high = system.limits
    half = np.minimum(0.4 * (high - low), _HALF)
    centre = 0.5 * (low + high) + 0.5 * rng.uniform(-1, 1, system.n) * (0.5 * (high - low) - half)
    t, speed, n = dt * np.arange(steps + 1), np.minimum(system.scales.speed, 2.5), system.n
    if kind == "gentle":
        return centre + _sines(t, 0.05, 0.3, 0.6 * half, 0.15 * speed, rng)
    if kind == "small":
        return centre + _sines(t, 0.2, 2.0, 0.05 * half, speed, rng)
    if kind == "chirp":
        top = rng.uniform(1.0, 3.0)
        rate = 0.1 + (top - 0.1) * t / t[-1]
        phase = 2 * np.pi * np.cumsum(rate) * dt
        share = np.minimum(half, speed / (2 * np.pi * rate[:, None]))
        return centre + share * np.sin(phase[:, None] + rng.uniform(0, 2 * np.pi, n))
    if kind == "steps":
        return centre + _steps(t, half, dt, rng)
    if kind == "rest":
        moving = _smooth(np.repeat(rng.random(len(t) // 500 + 1) < 0.6, 500)[: len(t)], 0.15, dt)
        warped = np.cumsum(moving) * dt
        return centre + _sines(warped, 0.1, 1.5, half, speed, rng)
    lively = _sines(t, 0.1, 1.5, half, speed, rng)
    if kind == "one axis":
        turn = np.floor(t / t[-1] * n * 0.9999).astype(int)
        lively = lively * _smooth(turn[:, None] == rng.permutation(n), 0.2, dt)
    return centre + lively


def _sines(t: Any, low: float, high: float, half: Any, speed: Any, rng: Any) -> Array:
    """(N, n) sums of sines at times t (N,) within ±half (n,) and ±speed (n,)."""
    rate = 2 * np.pi * low * (high / low) ** rng.random((6, len(half)))
    amplitude = rng.standard_normal((6, len(half))) / rate**0.5
    phase = rng.uniform(0, 2 * np.pi, (6, len(half)))
    angle = rate * t[:, None, None] + phase
    position = (amplitude * np.sin(angle)).sum(axis=1)
    velocity = (amplitude * rate * np.cos(angle)).sum(axis=1)
    reach = np.maximum(np.abs(position).max(axis=0) / half, np.abs(velocity).max(axis=0) / speed)
    return position / np.maximum(reach, 1e-9)


def _steps(t: Any, half: Any, dt: float, rng: Any) -> Array:
    """(N, n) a new target every one to two seconds, reached smoothly."""
    count = int(t[-1]) + 2
    times = np.cumsum(rng.uniform(1.0, 2.0, count))
    targets = half * rng.uniform(-0.6, 0.6, (count + 1, len(half)))
    targets[0] = 0.0
    return _smooth(targets[np.searchsorted(times, t)], 0.12, dt)


def _smooth(values: Any, tau: float, dt: float) -> Array:
    """Values (N, …) through four first-order lags of tau seconds, twice differentiable."""
    found, share = np.array(values, dtype=np.float64), 1 - np.exp(-dt / tau)
    for _ in range(4):
        state = found[0].copy()
        for k in range(len(found)):
            state = state + share * (found[k] - state)
            found[k] = state
    return found


class Planned(Driver):
    """Follows planned positions by computed torque under the prior.

    Args:
        system: the arm.
        prior: (p,) θ̂(0).
        positions: (N, n) at all samples.
        dt: time step [s].
    """

    def __init__(self, system: JointTree, prior: Array, positions: Array, dt: float):
        velocities = np.gradient(positions, dt, axis=0)
        self._motion = positions, velocities, np.gradient(velocities, dt, axis=0)
        self._dt, n = dt, system.n
        # one sine of 1 rad/s at t = 0 has any position, velocity and acceleration
        self._series = Series(np.ones(1), np.zeros((n, 2)), np.zeros(n))
        limit = 5.0 * system.scales.command
        omega = 2 * np.pi * _BANDWIDTH
        arm = system.inverse_dynamics()
        model = np.array(prior)
        self._tracking = Tracking(arm, system.driven, model, self._series, omega, limit)
        self._workspace = tracking_workspace(self._tracking)

    def start(self) -> tuple[Array, Array]:
        """Position and velocity of the first sample."""
        return self._motion[0][0].copy(), self._motion[1][0].copy()

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n,) command u."""
        k = min(round(t / self._dt), len(self._motion[0]) - 1)
        position, velocity, acceleration = (part[k] for part in self._motion)
        self._series.coefficients[:, 0] = velocity
        self._series.coefficients[:, 1] = -acceleration
        self._series.centre[:] = position + acceleration
        u = np.empty(len(v))
        computed_torque(self._tracking, 0.0, plain(q), plain(v), self._workspace, u)
        return u


class Shaped(Driver):
    """A vehicle's driver, with its commands weaker, resting now and then, or held for a while.

    Args:
        driver: the scenario's.
        kind: one of `VEHICLE_MOTIONS`; other than `own` only for open-loop drivers.
        dt: time step [s].
        rng: source of the pauses.
    """

    def __init__(self, driver: Driver, kind: str, dt: float, rng: np.random.Generator):
        self._driver, self._kind = driver, kind
        self._held = max(1, round(0.5 / dt)) * dt
        self._moves = rng.random(1000) < 0.6

    def start(self) -> tuple[Array, Array]:
        """That of the driver."""
        return self._driver.start()

    def command(self, t: float, q: Array, v: Array) -> Array:
        """(n_u,) the driver's command, shaped."""
        if self._kind == "steps":
            t = np.floor(t / self._held + 1e-9) * self._held
        u = self._driver.command(t, q, v)
        if self._kind == "weak":
            return 0.3 * u
        if self._kind == "rest":
            return u * self._moves[int(t / 2.0)]
        return u
