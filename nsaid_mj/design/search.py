"""A seeded evolution strategy: minimises a function of many numbers without its gradient.

The separable CMA-ES (R. Ros, N. Hansen, A simple modification in CMA-ES achieving linear time and
space complexity, PPSN X, 2008): candidates are drawn from a normal distribution with a diagonal
covariance, whose mean moves to the better half of them, whose step length grows while successive
moves agree, and whose variances follow the successful moves.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..parameters import Array


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
        costs: costs of several candidates (d,); inf for one that cannot be evaluated.
        start: (d,) mean of the first candidates, itself a candidate.
        step: standard deviation of the first candidates about it.
        evaluations: least number of candidates to try.
        rng: generator of the candidates.
        report: called with the completed share of the search.
        population: candidates in a generation.
    """
    d, half = len(start), population // 2
    weights = np.log(half + 0.5) - np.log(np.arange(1, half + 1))
    weights /= weights.sum()
    mass = 1 / np.sum(weights**2)  # effective number of parents
    c_step, c_path = (mass + 2) / (d + mass + 5), 4 / (d + 4)
    separable = (d + 1.5) / 3  # a diagonal has fewer entries to learn
    c_one = min(1.0, separable * 2 / ((d + 1.3) ** 2 + mass))
    c_rank = min(1 - c_one, separable * 2 * (mass - 2 + 1 / mass) / ((d + 2) ** 2 + mass))
    expected = np.sqrt(d) * (1 - 1 / (4 * d) + 1 / (21 * d**2))
    mean, variance = start.copy(), np.ones(d)
    step_path, path = np.zeros(d), np.zeros(d)
    best = Found(start, float(costs([start])[0]), 1)
    for tried in range(1, evaluations, population):
        moves = rng.standard_normal((population, d)) * np.sqrt(variance)
        candidates = [mean + step * move for move in moves]
        cost = np.array(costs(candidates), dtype=np.float64)
        order = np.argsort(cost, kind="stable")
        if cost[order[0]] < best.cost:
            best = Found(candidates[order[0]], float(cost[order[0]]), 0)
        best = best._replace(evaluations=tried + population)
        report(min(1.0, (tried + population) / evaluations))
        if not np.isfinite(cost[order[0]]):
            continue
        parents = moves[order[:half]]
        move = weights @ parents
        mean = mean + step * move
        step_path += c_step * -step_path
        step_path += np.sqrt(c_step * (2 - c_step) * mass) * move / np.sqrt(variance)
        path += -c_path * path + np.sqrt(c_path * (2 - c_path) * mass) * move
        variance = (1 - c_one - c_rank) * variance + c_one * path**2
        variance += c_rank * (weights @ parents**2)
        drift = c_step / (1 + c_step) * (np.linalg.norm(step_path) / expected - 1)
        step *= float(np.exp(min(1.0, drift)))
    last = float(costs([mean])[0])  # the mean of good candidates is often better than each
    return best if best.cost <= last else Found(mean, last, best.evaluations)
