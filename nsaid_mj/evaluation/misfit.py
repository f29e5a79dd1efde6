"""Whether the motion contradicts the structure, judged from measurements alone.

The filter of the law `efficient` runs along the log, from the run's last estimate but as uncertain
as a prior. It may learn any θ nearby; where even that leaves innovations larger than chance allows,
it is contradicted and starts again. A structure that explains the motion is hardly ever
contradicted; one that does not, again and again.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..experiment.loop import Run
from ..identifiers.cone.barrier import cone_of, inside
from ..identifiers.efficient.witness import Witness
from ..log import Log
from ..parameters import Array

NONE, SOME, CONTRADICTS = "none", "some", "contradicts"
_LONGEST = 30.0  # length of log that is judged, its end [s]
_FEWEST = 50  # rows that can be judged; the run that warms up has as many
_SETTLED = 1 / 3  # share of it in which the filter may still learn
_REPEATED = 2  # contradictions that are no single event, such as a fault
_LARGE = 1.3  # mean squared normalised innovation that is more than an error of the noise level


class Misfit(NamedTuple):
    """How well the structure explains a log.

    Attributes:
        level: `none`, `some` or `contradicts`.
        contradictions: times at which the innovations exceeded chance [s].
        innovations: mean squared normalised innovation; 1 where the structure explains the motion.
        seconds: length of log that was judged [s].
    """

    level: str
    contradictions: tuple[float, ...]
    innovations: float
    seconds: float

    def keys(self) -> dict[str, Any]:
        """The keys of summary.json."""
        return {
            "misfit": self.level,
            "misfit_contradictions": list(self.contradictions),
            "misfit_innovations": self.innovations,
            "misfit_seconds": self.seconds,
        }


def misfit_of(run: Run) -> Misfit | None:
    """Judges the end of a run's log.

    None for a law that does not use the data to the full, so that its own error could be taken for
    the structure's; and where rows are missing or the system has no compiled forward dynamics.
    """
    scenario, system, record = run.scenario, run.system, run.record
    law = getattr(scenario.identifier, "law", "")
    if law not in {"memory", "efficient"} or system.forward is None or scenario.record_every != 1:
        return None
    log, known = record.log, [event.time for event in run.faults if event.kind != "unknown"]
    if known:  # from then on something else moves than what the log tells
        log = log.first(int(np.searchsorted(log.t, min(known))))
    if len(log.t) < _FEWEST:
        return None
    theta = np.array(record["theta_hat"][len(log.t) - 1])
    log = log.part(int(np.searchsorted(log.t, log.t[-1] - _LONGEST)), len(log.t))
    if len(log.t) < _FEWEST or not inside(cone_of(system.space), theta):
        return None
    return judged(Witness(system, scenario.dt, scenario.identifier.efficient), theta, log)


def judged(witness: Witness, theta: Array, log: Log) -> Misfit:
    """Judges a log of N measurements, with the filter starting at θ (p,)."""
    times, innovations = witness.contradictions(theta, log)
    seconds = float(log.t[-1] - log.t[0])
    late = [time for time in times if time > log.t[0] + _SETTLED * seconds]
    if len(late) >= _REPEATED:
        level = CONTRADICTS
    else:
        level = SOME if late or innovations > _LARGE else NONE
    return Misfit(level, tuple(late), innovations, seconds)
