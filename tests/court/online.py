"""Runs the laws `efficient` and `memory` on a case's log, as `nsaid run` would, but in memory."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nsaid_mj.base.threads import single_threaded
from nsaid_mj.core.laws.base import Status
from nsaid_mj.core.laws.config import NullspaceAID
from nsaid_mj.core.laws.efficient.estimator import KalmanFilter
from nsaid_mj.core.laws.faults import FaultEvent
from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.evaluation.run_evaluation import confidence_of
from nsaid_mj.lab.evaluation.run_misfit import misfit_of
from nsaid_mj.lab.evaluation.statistics import StatedConfidence
from nsaid_mj.lab.evaluation.truth import Truth
from nsaid_mj.lab.following import RunTimes
from nsaid_mj.lab.loop import Ending, SimulatedRun
from nsaid_mj.lab.record import Record
from nsaid_mj.lab.setup import with_prior_error

from .cases import Case
from .simulation import Simulated, simulated


class _Unheld(Truth):
    """The truth, without a held-out trajectory, which would have to be simulated."""

    held_out = None  # type: ignore[assignment]


@dataclass(eq=False, kw_only=True)
class _Run(SimulatedRun):
    """A run whose faults are those of its last state, not of a file."""

    @property
    def faults(self) -> tuple[FaultEvent, ...]:
        """The faults found."""
        return self.states[""].faults


@dataclass(frozen=True)
class Stated:
    """What a law says at the end of a run.

    Attributes:
        status: `completed`, or how the run ended.
        theta: (p,) θ̂.
        truth: (p,) the true θ at the end.
        misfit: its level; None if there is none.
        innovations: mean squared normalised innovation of the misfit's filter; None without one.
        confidence: as in the run's result; None if the law states none.
        events: the faults found.
    """

    status: str
    theta: Array
    truth: Array
    misfit: str | None
    innovations: float | None
    confidence: StatedConfidence | None
    events: tuple[FaultEvent, ...]


@single_threaded
def identified(simulated: Simulated) -> Stated:
    """Follows a log with the scenario's law and asks what it says."""
    setup, log = simulated.setup, simulated.log
    identifier = setup.identifiers()[""]
    state, estimates = identifier.follow(identifier.init(log.at(0)), log)
    log = log.first(len(estimates.pivot))
    record = Record(
        dict(log._asdict()) | {"theta_hat": estimates.theta_hat, "v_hat": estimates.v_hat},
        {},
        True,
    )
    end = float(log.t[-1])
    run = _Run(
        scenario=setup.scenario,
        folder=Path("/nonexistent"),
        record=record,
        system=setup.system,
        prior=setup.prior,
        identifiers={"": identifier},
        statuses={"": state.status},
        ending=Ending(state.status, end),
        cost=RunTimes(),
        states={"": state},
        setup=setup,
    )
    truth = _Unheld(setup, end)
    theta, true = estimates.theta_hat[-1], truth.theta
    if state.status is not Status.completed:
        return Stated(state.status.words, theta, true, None, None, None, state.faults)
    misfit = misfit_of(run)
    level = misfit.level if misfit else None
    stated = confidence_of(run, truth, misfit.widening if misfit else 1.0)
    innovations = misfit.innovations if misfit else None
    return Stated("completed", theta, true, level, innovations, stated, state.faults)


@single_threaded
def trace_of(case: Case) -> float:
    """What an effect leaves to be seen: the sum of the squared changes of all innovations.

    They are the normalised innovations of the filter of `efficient`, once it has learned what it
    may, of the run with the effect less those of the same run, with the same noise, without it. A
    test by one who knew the form of the change, but not its size, would see the root of this sum
    in standard deviations; no test sees more.
    """
    innovations = []
    for one in (case, replace(case, effect="none", size=0.0)):
        found = simulated(one)
        setup, log = found.setup, found.log
        config = with_prior_error(setup.scenario.identifier, setup.scenario)
        assert isinstance(config, NullspaceAID)
        estimator = KalmanFilter(setup.system, setup.scenario.dt, config.efficient)
        P = estimator.covariance(setup.prior)
        learned = estimator.replay(setup.prior, P, log).filter
        again = estimator.replay(learned.theta, learned.Ptt, log)
        innovations.append(again.along.innovation)
    return float(np.nansum((innovations[0] - innovations[1]) ** 2))
