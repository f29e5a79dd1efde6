"""The true set of a run's plant, and how far estimates are from it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ..experiment.loop import Run
from ..experiment.setup import Seeds
from ..nullspace import Nullspace, structural
from ..parameters import Array


def true_theta(run: Run) -> Array:
    """(p,) the true θ at the run's end."""
    return run.plant.truth_at(run.ending.time)


def true_nullspace(run: Run) -> Nullspace:
    """P_s(θ) of the run's plant under its true θ at the end, structural: over all motions."""
    return nullspace_at(run, bool(run.plant.struck(run.ending.time)))


@lru_cache(maxsize=2)
def nullspace_at(run: Run, struck: bool) -> Nullspace:
    """P_s(θ) of the run's plant before or after its fault struck."""
    rng = np.random.default_rng(Seeds.of(run.scenario.seed).structure)
    return structural(run.plant.system, true_theta(run) if struck else run.plant.truth, rng)


def distance(run: Run, t: Array, theta_hat: Array) -> Array:
    """(N,) ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (N, p), each under the true θ of its time t (N,)."""
    struck, theta_s = run.plant.struck(t), theta_hat / run.plant.system.space.scale
    ratio = np.empty(len(t))
    for state in np.unique(struck):
        ratio[struck == state] = nullspace_at(run, bool(state)).ratio(theta_s[struck == state])
    return ratio
