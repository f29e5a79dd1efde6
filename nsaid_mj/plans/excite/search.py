"""A seeded evolution strategy: minimises a function of many numbers without its gradient.

The separable CMA-ES (R. Ros, N. Hansen, A simple modification in CMA-ES achieving linear time and
space complexity, PPSN X, 2008) of the package `cmaes`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from cmaes import SepCMA

from ...core import Array


class Found(NamedTuple):
    """The best candidate x (d,) of a search; its cost is inf if none was feasible."""

    x: Array
    cost: float
    evaluations: int


def minimise(
    costs: Callable[[Sequence[Array]], Sequence[float]],
    start: Array,
    step: float,
    evaluations: int,
    rng: np.random.Generator,
    report: Callable[[float], None] = lambda _share: None,
    population: int = 16,
) -> Found:
    """Searches from a start.

    Args:
        costs: costs of several candidates (d,), d ≥ 2; inf for one that cannot be evaluated.
        start: (d,) mean of the first candidates, itself a candidate.
        step: standard deviation of the first candidates about it.
        evaluations: least number of candidates to try.
        rng: generator of the candidates.
        report: called with the completed share of the search.
        population: candidates in a generation.
    """
    seed = int(rng.integers(2**32))
    strategy = SepCMA(start.copy(), step, seed=seed, population_size=population)
    best = Found(start, float(costs([start])[0]), 1)
    for tried in range(1, evaluations, population):
        candidates = [strategy.ask() for _ in range(population)]
        cost = [float(each) for each in costs(candidates)]
        least = int(np.argmin(cost))
        if cost[least] < best.cost:
            best = Found(candidates[least], cost[least], 0)
        best = best._replace(evaluations=tried + population)
        report(min(1.0, (tried + population) / evaluations))
        if np.isfinite(cost[least]):  # a generation without a feasible candidate teaches nothing
            strategy.tell(list(zip(candidates, cost, strict=True)))
    mean = strategy.mean.copy()
    last = float(costs([mean])[0])  # the mean of good candidates is often better than each
    return best if best.cost <= last else Found(mean, last, best.evaluations)
