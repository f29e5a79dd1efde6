"""How many harmonics P_⊥ needs: the rank of a motion's regressor against their number.

See docs/theory.md, section 6, for the proofs. The rank is that of `nullspace.split`,
the one rank decision of this package, along random motions with the first 1, 2, … harmonics.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..control import DriverConfig, FourierTracking
from ..log import Log
from ..nullspace import split
from .experiment import Experiment
from .limits import Limits
from .motions import JointMotions

_SAMPLES = 1500  # of a motion, at most
_MOST = 8


@dataclass(frozen=True)
class Ranks:
    """Ranks of motions with few harmonics.

    Attributes:
        needed: p − r of the structure: the dimension of P_⊥.
        bound: number of harmonics that a system with a regressor linear in its signals needs at
            least: n (2h + 1) ≥ p − r.
        measured: (h, rank) of random motions with the first h harmonics or tones of every signal.
    """

    needed: int
    bound: int
    measured: tuple[tuple[int, int], ...]

    @property
    def enough(self) -> int | None:
        """The smallest number of harmonics found to excite all of P_⊥."""
        return next((h for h, rank in self.measured if rank >= self.needed), None)


def ranks(experiment: Experiment, limits: Limits, seed: int = 0) -> Ranks:
    """Measures the rank of motions with 1, 2, … harmonics, until P_⊥ is excited."""
    system, base = experiment.system, experiment.scenario.excitation
    needed = system.p - experiment.nullspace.r
    bound = max(1, int(np.ceil((needed / system.n - 1) / 2)))
    measured = []
    for count in range(1, _MOST + 1):
        log = _motion(experiment, limits, base, count, seed)
        if log is None:
            break
        measured.append((count, _rank(experiment, log)))
        if measured[-1][1] >= needed:
            break
    return Ranks(needed, bound, tuple(measured))


def _motion(
    experiment: Experiment, limits: Limits, base: DriverConfig, count: int, seed: int
) -> Log | None:
    """A random motion with few harmonics, under the prior's first draw."""
    rng = np.random.default_rng(seed)
    if isinstance(base, FourierTracking):
        if count > base.harmonics:
            return None
        motions = JointMotions(experiment, limits, replace(base, harmonics=count))
        return motions.motion(motions.series(motions.random(rng)), 0)[0]
    if "tones" not in {f.name for f in fields(base)}:
        return None
    few = replace(base, tones=count)  # type: ignore[call-arg]  # a driver with tones
    return experiment.simulate(few, 0, experiment.scenario.duration, seed)


def _rank(experiment: Experiment, log: Log) -> int:
    """Rank of W·diag(scale) along a motion, with v̇ by (29)."""
    system = experiment.system
    t, q, v, u = (part[:: max(1, len(log.t) // _SAMPLES)] for part in log)
    x = np.hstack([q, v])
    _, W = system.evaluate(t, x, v, u, experiment.draws[0])
    rows = (W * system.space.scale).reshape(-1, system.p)
    return system.p - split(rows).r
