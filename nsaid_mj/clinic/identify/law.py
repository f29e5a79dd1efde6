"""Runs a recursive law along a prepared log, by the loop of every run, beside the batch fit."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ...base import Finding
from ...core import (
    Array,
    Confidence,
    Identifier,
    Log,
    Measurement,
    NullspaceAID,
    State,
    Status,
)
from ...lab import (
    INTERVAL,
    Observer,
    Record,
    RobotDescription,
    Run,
    Scenario,
    followed,
    measured_identifiers,
    misfit_of,
)
from ...robots import RobotModel
from ..logs.recorded import Logs
from ..logs.recordings import Recordings
from .choose.cutoff import filter_for
from .fit import minimise, tempered
from .measured import log_robot, measured_scenario
from .problem import mean_squares
from .result import AlongLog, BatchFit, GainRatio, Identification, Structured, recording_shifts
from .smoothing import delayed, noise_levels, refined, smooth, smooth_commands
from .vehicles import smooth_pose

_ROWS = 400  # of the estimate along the log, at most
_ERROR = 1.0  # largest relative error of the prior: frictions and gains are guesses
_SLOW = 0.01  # gain of the flow beside a memory
_INTERVAL = 0.2  # time between two steps of a memory [s]
_LAST = 0.2  # last share of the rows, on which a law's earlier estimate is judged


class _Watch(Observer):
    """Keeps θ̂ and the deviations of the gains at intervals."""

    def __init__(self, identifier: Identifier, period: float):
        self._identifier = identifier
        self.period = period
        self.rows = []

    def start(self, scenario: Scenario, robot: RobotDescription, first: Measurement) -> None:
        """Does nothing: there is no estimate yet."""

    def see(self, log: Log, states: dict[str, State], levels: tuple[float, float]) -> None:
        """Keeps the estimate of a sample."""
        state = states[""]
        space = self._identifier.system.space
        stated = Confidence.of_gains(self._identifier.confidence(state), state.theta_hat, space)
        self.rows.append((float(log.t[-1]), state.theta_hat, stated))

    def stop(self) -> None:
        """Does nothing: no file is open."""


def with_law(
    found: Identification, law: str, folder: str | Path | None, report: Callable[[str], None]
) -> Identification:
    """An identification to which a law's run along the log, and findings about it, are added.

    `found` is that of the batch fit, `law` one of `CHOICES["law"]` but `batch`, `folder` that
    of the law's record; None keeps no files.

    Raises:
        InvalidInput: the law does not suit the robot or its log.
    """
    report(f"following the log by law {law}")
    with nullcontext(folder) if folder else TemporaryDirectory(prefix="nsaid-mj-") as place:
        along = follow_log(law, found, Path(place))
    findings = Finding.gravest_first((*found.findings, *law_findings(along)))
    return replace(found, law=along, findings=findings)


def follow_log(law: str, found: Identification, folder: Path) -> AlongLog:
    """Runs a law along the prepared logs of a batch fit, recording in `folder`; see `with_law`."""
    begin = time.perf_counter()
    fitted = found.fitted
    robot = found.robot
    logs, start, rate = law_logs(robot, found.recordings, fitted.made)
    steps = sum(len(log.t) for log in logs) - 1
    known = log_robot(found)
    levels = noise_levels(max(logs, key=lambda log: len(log.t)))
    scenario = measured_scenario(known, law, rate, levels, _ERROR, steps)
    unexplained: list[float] = []
    if robot.jointed:  # the density of its unexplained forces, over the last gain [units², times s]
        # residuals of variance σ² at intervals h, of which one in `share` is effectively
        # independent, act on the motion like a white force of density σ² h share
        problem = fitted.problem
        own = fitted.fit.theta
        residual = problem.residual(own) / own[problem.space.actuators[-1]]
        density = mean_squares(residual, problem.usable) * fitted.share
        unexplained = (density * float(np.median(np.diff(problem.t)))).tolist()
    config = scenario.identifier
    assert isinstance(config, NullspaceAID)
    config = replace(
        config,
        # between the memory's steps, the flow (45) would follow unmodelled effects
        gain=_SLOW if law in ("memory", "efficient") else 1.0,
        memory=replace(config.memory, interval=_INTERVAL),
        efficient=replace(config.efficient, unexplained=tuple(unexplained)),
    )
    scenario = replace(scenario, identifier=config)
    whole = known.robot_of(robot)
    identifiers = measured_identifiers(scenario, whole)
    watch = _Watch(identifiers[""], max(1.0, round(steps / _ROWS)) / rate)
    run = followed(scenario, whole, Logs(logs), identifiers, folder, [watch])
    run.record = Record.read(folder)  # which may be temporary
    t, theta, deviation = (np.array(column) for column in zip(*watch.rows, strict=True))
    misfit = misfit_of(run)
    if misfit:
        deviation = deviation * misfit.widening
    last, batch_last = _last_fifth(found, run, start)
    return AlongLog(
        law,
        run,
        fitted.problem.space.actuators,
        t + start,
        theta,
        deviation,
        _gains(fitted, theta[-1], deviation[-1]),
        last,
        batch_last,
        misfit.level if misfit else "",
        time.perf_counter() - begin,
    )


def law_logs(
    robot: RobotModel, recordings: Recordings, made: Structured
) -> tuple[list[Log], float, float]:
    """The segments as logs for a law: the motion of which the batch fit's rows are made.

    The logs share one clock that begins at 0. A command holds from one sample to the next: it is
    the smoothed one half-way between both, earlier by its delay, after the lag and the curve that
    the fit found, and reversed where the model file has a negative gear: gains are positive. Also
    returns the time of their start on the common axis [s], and samples per second.
    """
    recordings = refined(recordings) if robot.jointed else recordings
    chosen = filter_for(recordings, made.cutoff)
    rate = chosen.rate / chosen.every
    found = []
    shift = recording_shifts(recordings)
    start = float(recordings.segments[0].log.t[0] + shift[0])
    for own, given in zip(shift, recordings.segments, strict=True):
        acting = made.acting(given.log.u, recordings.rate)
        segment = given._replace(log=given.log._replace(u=acting))
        curve = smooth_commands(segment, chosen)
        held = delayed(segment, chosen, curve, made.delays - 0.5 / rate)
        if robot.jointed:
            motion = smooth(segment, chosen)
            held = held * np.sign(robot.gain)
            motion = motion._replace(q=robot.system.position(motion.q))
        else:
            motion = smooth_pose(robot.system, segment, chosen)
        if len(motion.t) > 1:
            found.append(Log(motion.t + (own - start), motion.q, motion.v, held))
    return found, start, rate


def _gains(fitted: BatchFit, theta: Array, deviation: Array) -> tuple[GainRatio, ...]:
    """Gains of the law, θ̂ (p,) and deviations (a,), beside the batch fit's; none if one is ≤ 0."""
    space = fitted.problem.space
    own = fitted.fit.theta
    at = space.actuators
    if len(at) < 2 or not ((theta[at] > 0) & (own[at] > 0)).all():
        return ()
    ours, theirs = (np.exp(np.log(x[at]) - np.log(x[at]).mean()) for x in (theta, own))
    found = []
    for i, index in enumerate(at):
        weights = np.zeros(len(own))
        weights[at] = ((np.arange(len(at)) == i) - 1 / len(at)) / own[at]
        half = INTERVAL * float(deviation[i]), INTERVAL * fitted.exact.of(weights)
        label = space.labels[index]
        found.append(GainRatio(label, float(ours[i]), half[0], float(theirs[i]), half[1]))
    return tuple(found)


def _last_fifth(found: Identification, run: Run, start: float) -> tuple[Array, Array]:
    """(n,) NRMSE of the last rows under the law's θ̂ before them, and (n,) under a batch fit's."""
    problem = found.fitted.problem
    first = round((1 - _LAST) * len(problem.t))
    before = problem.select(np.arange(first))
    last = problem.select(np.arange(first, len(problem.t)))
    shift = recording_shifts(found.recordings)[problem.segment[first]]
    row = int(np.searchsorted(run.record["t"], problem.t[first] + shift - start))
    theta = np.array(run.record["theta_hat"][min(max(row - 1, 0), len(run.record) - 1)])
    fitted = minimise(before, tempered(before, found.fitted.share)).theta
    return last.nrmse(theta, problem), last.nrmse(fitted, problem)


def law_findings(along: AlongLog) -> list[Finding]:
    """Warnings about a law's result: it ended early, or differs from the batch fit."""
    status = along.run.ending.status
    found = []
    if status is not Status.completed:
        text = f"the law ended at {along.run.ending.time:.2f} s: {status.words}"
        found.append(Finding("warning", "law", f"law {along.name}", text, status.remedy))
    apart = [gain.label for gain in along.gains if gain.apart]
    if apart:
        text = f"it differs from the batch fit by more than both intervals in {', '.join(apart)}"
        remedy = (
            "Trust neither interval there; the batch fit uses all rows at once, and leaves out "
            "those at rest."
        )
        found.append(Finding("warning", "law", f"law {along.name}", text, remedy))
    return found
