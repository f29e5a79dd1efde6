"""What is true of the plant behind a run, read once the run has ended.

Everything in this package that needs the truth takes a `Truth | None`. A robot's log has none.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..experiment.loop import Run, SimulatedRun
from ..experiment.setup import Setup
from ..log import Log
from ..nullspace import Nullspace, structural
from ..parameters import Array
from ..system import SecondOrderSystem


class Truth:
    """The true parameters of a simulated plant, and what follows from them.

    A fault changes them during the run: what carries no time is meant at `end`.

    Args:
        setup: what was simulated.
        end: time of the run at which estimates are judged [s].

    Attributes:
        system: the structure whose parameters these are.
        end: as given.
        mismatches: what the plant does and the structure does not know, in words.
        fault: the actuator fault in words, "" where there is none.
    """

    def __init__(self, setup: Setup, end: float):
        self._setup, self._plant = setup, setup.plant
        self._nullspaces: dict[bool, Nullspace] = {}
        self.system: SecondOrderSystem = setup.system
        self.end = end
        self.mismatches: Sequence[str] = setup.plant.mismatches
        self.fault: str = setup.plant.fault.in_words(setup.system)

    def theta_at(self, t: ArrayLike) -> Array:
        """(..., p) the true θ at times t (...) of the run [s]."""
        return self._plant.truth_at(t)

    def struck(self, t: ArrayLike) -> NDArray[np.bool_]:
        """(...) whether the fault has struck by times t (...) of the run [s]."""
        return self._plant.struck(t)

    @property
    def initial(self) -> Array:
        """(p,) the true θ before any fault."""
        return self._plant.truth

    @cached_property
    def theta(self) -> Array:
        """(p,) the true θ at the end."""
        return self.theta_at(self.end)

    @property
    def nullspace(self) -> Nullspace:
        """P_s(θ) of the true θ at the end, structural: over all motions."""
        return self.nullspace_at(self.end)

    def nullspace_at(self, t: float) -> Nullspace:
        """P_s(θ) of the true θ at time t of the run [s], structural: over all motions."""
        struck = bool(self.struck(t))
        if struck not in self._nullspaces:
            rng = np.random.default_rng(self._setup.seeds.structure)
            self._nullspaces[struck] = structural(self.system, self.theta_at(t), rng)
        return self._nullspaces[struck]

    def distance(self, t: Array, theta_hat: Array) -> Array:
        """(N,) ‖P̄_⊥ᵀ θ̂_s‖ / ‖θ̂_s‖ of estimates (N, p) from the true set at their times t (N,)."""
        struck, theta_s = self.struck(t), theta_hat / self.system.space.scale
        ratio = np.empty(len(t))
        for state in np.unique(struck):
            rows = struck == state
            ratio[rows] = self.nullspace_at(float(t[rows][0])).ratio(theta_s[rows])
        return ratio

    @cached_property
    def held_out(self) -> Log | None:
        """A trajectory of the plant, as it is at the end, that no identifier has seen.

        None where the plant diverges, as it may where the run did.
        """
        return self._setup.held_out(self.end)

    @property
    def exact(self) -> Array | None:
        """(p,) the true θ, where (29) with it gives the plant's true acceleration, else None."""
        return None if self.mismatches else self.theta


@overload
def truth_of(run: SimulatedRun) -> Truth: ...
@overload
def truth_of(run: Run) -> Truth | None: ...
def truth_of(run: Run) -> Truth | None:
    """What is true of the plant behind a run; None where no simulated plant is behind it."""
    return Truth(run.setup, run.ending.time) if isinstance(run, SimulatedRun) else None
