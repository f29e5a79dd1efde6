"""Logs of packed scenarios, and memories that follow them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from nsaid_mj.core.laws.memory.statistics import Memory, Recorder
from nsaid_mj.core.log import Log as Measured
from nsaid_mj.core.log import Measurement
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.world.noise import SensorNoise
from nsaid_mj.lab.plants.world.plant import Plant


class Log(NamedTuple):
    """What was measured of a plant, and its time step."""

    plant: Plant
    dt: float
    rows: list[Measurement]

    def every(self, k: int) -> Log:
        """Every k-th row; the command must have been held that long."""
        return Log(self.plant, k * self.dt, self.rows[::k])


def scenario_plant(name: str) -> Plant:
    """A packed scenario's plant."""
    return driven(name, 0.1).plant


@cache
def driven(name: str, seconds: float, hold: int = 1, seed: Any = 0) -> Log:
    """A packed scenario's plant and driver; the plant makes `hold` steps to each command."""
    scenario = load(name)
    dt = scenario.dt / hold
    plant, rng = scenario.plant.build(dt, 3), np.random.default_rng(seed)
    driver = scenario.excitation.build(plant.system, plant.truth, rng)
    rows: list[Measurement] = []
    with plant.running():
        if hold == 1:
            return Log(plant, dt, plant.trajectory(driver, round(seconds / dt)).rows)
        plant.reset(*driver.start())
        for k in range(round(seconds / dt)):
            coordinates, v = plant.coordinates()
            q, t = plant.position(coordinates), k * dt
            u = driver.command(t, q, v) if k % hold == 0 else rows[-1].u
            rows.append(Measurement(t, q, v, u))
            plant.step(u)
    return Log(plant, dt, rows)


def noisy(log: Log, noise: SensorNoise, seed: int) -> Log:
    """A log's motion and commands, measured by noisy sensors."""
    rng, system = np.random.default_rng(seed), log.plant.system
    rows = []
    for t, q, v, u in log.rows:
        step, velocity = noise.corrupt(np.zeros(system.n), v, rng)
        rows.append(Measurement(t, system.integrate(q, step), velocity, u))
    return Log(log.plant, log.dt, rows)


def added(recorder: Recorder, memory: Memory, a: Measurement, b: Measurement) -> Memory:
    """The memory at b, from that at a."""
    return recorder.follow(memory, Measured.of([a, b]))


def remember(recorder: Recorder, log: Log) -> Iterator[Memory]:
    """The memory at every row."""
    memory = recorder.begin(log.rows[0])
    yield memory
    for a, b in pairwise(log.rows):
        memory = added(recorder, memory, a, b)
        yield memory


def regressors(recorder: Recorder, log: Log) -> Array:
    """(N, n, p) Y at every row but the first."""
    W_M = recorder.system._W_M
    seen = zip(log.rows, remember(recorder, log), strict=True)
    return np.array([W_M(row.q, row.v) - kept.balance.lag for row, kept in seen][1:])


def blocks(recorder: Recorder, log: Log) -> Array:
    """(k, n, p) means of Y over whole blocks, by hand."""
    Y = regressors(recorder, log)
    whole = len(Y) // recorder.block
    return Y[: whole * recorder.block].reshape(whole, recorder.block, *Y.shape[1:]).mean(axis=1)


def off(Y: Array, theta: Array) -> float:
    """Largest |Y θ|, in shares of the largest of the terms it is the sum of."""
    return float(np.abs(Y @ theta).max() / np.abs(Y * theta).max())
