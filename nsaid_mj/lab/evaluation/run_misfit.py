"""The misfit of a finished run: what of its record is judged, and under which signals.

Faults and gaps divide the log. How a piece is judged is in `watch.misfit`, which is imported only
for a law that is judged.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ...core import Log, NullspaceAID, SecondOrderSystem, Status
from ..loop import Run
from ..scenario import Scenario
from ..setup import with_prior_error
from ..source import Source

if TYPE_CHECKING:
    from ...core import KalmanFilter, Signals
    from ...watch import Misfit


def filter_of(scenario: Scenario, system: SecondOrderSystem) -> KalmanFilter | None:
    """The filter that judges a run.

    None for a law that does not use all information in the data, whose own error could be mistaken
    for the structure's, and where the system has no compiled forward dynamics. On the ground also
    with ideal sensors: touch-downs within a step then exceed any noise that is assumed.
    """
    config = scenario.identifier
    if system.structure.contacts and scenario.sensors == "ideal":
        return None
    if not isinstance(config, NullspaceAID) or config.law not in {"memory", "efficient"}:
        return None
    config = with_prior_error(config, scenario)
    assert isinstance(config, NullspaceAID)
    from ...core import KalmanFilter

    return KalmanFilter(system, scenario.dt, config.efficient) if system.forward else None


def misfit_of(run: Run) -> Misfit | None:
    """The misfit at the end of a run's log; None where `filter_of` is, or rows are missing.

    It takes several passes over the log, for which nobody waits who has just pressed Ctrl-C: it is
    None then, and is judged when the run is rebuilt from its record.
    """
    if run.ending.status is Status.interrupted and run.states:
        return None
    system = run.system
    record = run.record
    estimator = filter_of(run.scenario, system)
    if estimator is None or run.scenario.record_every != 1:
        return None
    from ...watch import Misfit

    found: list[Misfit] = []
    stated = run.identifiers[""].confidence(run.states[""]) if "" in run.states else None
    for log, rows, signals in _pieces(run, record.log):
        last = rows.stop == len(record)
        drift = _drifting(run, log, rows) if last else None
        acting = signals.acting(system, log)
        if drift is None:
            theta = np.array(record.rows("theta_hat", rows.stop - 1))
            own = stated if last else None
            found.append(Misfit.of_estimate(estimator, theta, own, run.prior, acting))
        else:
            start, variance = drift
            along = record.rows("theta_hat", rows)[start:]
            acting = acting.part(start, len(acting.t))
            found.append(Misfit.of_drift(estimator, along, variance, acting))
    return Misfit.worst(found) if found else None


def _drifting(run: Run, log: Log, rows: slice) -> tuple[int, float] | None:
    """The row of the run's last piece of a log from which the gains were found to drift.

    Also the variance of a gain's random walk per second [1/s]; None if gains are constant.
    """
    from ...watch import Misfit, drift_of

    drift, since = drift_of(run.states[""]) if "" in run.states else (0.0, 0.0)
    if not drift:
        return None
    start = int(np.searchsorted(log.t, since + 1e-9))
    return (start, drift) if rows.stop - rows.start - start >= Misfit.FEWEST else None


def _pieces(run: Run, log: Log) -> Iterator[tuple[Log, slice, Signals]]:
    """Parts of a log between faults and gaps, their rows in the record, and acting signals."""
    from ...watch import Misfit, signals_after

    known = [event for event in run.faults if event.kind != "unknown"]
    first = int(np.searchsorted(log.t, log.t[-1] - Misfit.longest(run.system)))
    starts = [0, *(int(np.searchsorted(log.t, event.found)) + 1 for event in known)]
    ends = [*(int(np.searchsorted(log.t, event.time)) for event in known), len(log.t)]
    gaps = np.flatnonzero(np.diff(log.t) > Source.LONGEST_STEP * run.scenario.dt) + 1
    for i, (begin, end) in enumerate(zip(starts, ends, strict=True)):
        cuts = [max(first, begin), *gaps[(gaps > max(first, begin)) & (gaps < end)].tolist(), end]
        for start, stop in itertools.pairwise(cuts):
            if stop - start >= Misfit.FEWEST:
                signals = signals_after(run.system, known[:i])
                yield log.part(start, stop), slice(start, stop), signals
