"""Choice of a vehicle's timing, cut-off and further columns.

A vehicle's forces are not linear in its commands, and several actuators act on one velocity. Delays
are therefore chosen by the cost of the fit: first a common one, then one per actuator.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ....base import Finding
from ....core import Array
from ....robots import RobotModel
from ...logs.recordings import Recordings
from ..fit import inflation, minimise, tempered, tempered_fit
from ..problem import FitProblem
from ..residuals import Suspect
from ..result import JointStructure, Options, Structured
from ..translation import Completed, completed, stated
from ..unmodelled_effects import command_suspects
from ..vehicles import VehicleRows
from .clocks import clock_offset
from .columns import EXTRA, offered
from .cutoff import FEWEST, NARROWER, filter_for
from .options import CUTOFF, FURTHER, FURTHER_COLUMNS, NUMBER, improves
from .thruster_curve import TRIALS, ThrusterCurve, fitted_curve, rough_curve
from .timing import Timed, Timing, search

_ALIKE = 0.1  # difference of the logarithms of errors in one band that speaks against a cut-off
_EXACT = 1e-3  # error that is as good as none
_RESOLVED = 0.05  # offset of clocks over the period of the cut-off, from which it is told
_IN_FLIGHT = 0.1  # quantile of a rotor's commands at which it turns for certain
_ROUNDS = 3  # of choosing timing and cut-off in turn


_COASTS = Finding(
    "note",
    "coasts",
    "surge",
    "no command that changes drives it, so its equation is left out",
    "Change the thrust during the log to identify drag and inertia of surge.",
)


def _first(rows: VehicleRows) -> frozenset[str]:
    """What manoeuvring adds, if it lowers the cost: without it no delay is right."""
    columns = frozenset({"manoeuvring"})
    if not offered(rows.system, "manoeuvring"):
        return frozenset()
    cost = _cost(rows, columns, Timing())
    before, after = (cost(each, Timing()) for each in (frozenset[str](), columns))
    return columns if improves(before, after, FURTHER) else frozenset()


def _richer(rows: VehicleRows, timing: Timing) -> tuple[frozenset[str], list[Finding]]:
    """The further columns that significantly lower the cost, and notes about them."""
    columns = frozenset[str]()
    notes = []
    cost = _cost(rows, frozenset(), timing)
    best = cost(columns, timing)
    for option in FURTHER_COLUMNS:
        name = option.name
        if not offered(rows.system, name):
            continue
        if name == "offset" and rows.steady.any():  # the force of a steady command is one
            continue
        trial = cost(columns | {name}, timing)
        if improves(best, trial, option.criterion):
            text = f"added {name} on every velocity (log-likelihood +{best - trial:.0f})"
            if name == "manoeuvring":
                text = "added manoeuvring forces, products of surge, sway and yaw rate "
                text += f"(log-likelihood +{best - trial:.0f}): the sheet has none, or others"
            columns = columns | {name}
            best = trial
            data = {"columns": sorted(columns)}
            notes.append(Finding("note", "columns", "", text, data=data))
    return columns, notes


def structured_vehicle(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    report: Callable[[str], None],
) -> Structured:
    """Chooses delays and further columns of a vehicle and makes the rows of the fit.

    `recordings` are training logs, `validation` is a log excluded from the fit, or None; `report`
    is called with the name of every stage.
    """
    report("filtering")
    measured = recordings
    whole = _completed(robot, measured)
    recordings = whole.recordings if whole is not None else measured
    chosen = filter_for(recordings, options.cutoff)
    rows = VehicleRows(robot, recordings, chosen, options.loads)
    columns = (options.columns or frozenset()) & frozenset(EXTRA)
    trials = [rows] if options.cutoff is not None else _narrower(rows)
    rows = trials[len(trials) // 2]
    if options.columns is None:
        columns = _first(rows)
    rows, timed = _timed(trials, columns, options, report)
    timing = timed.timing
    if whole is not None:  # again, by what the log says of actuators and inertia
        theta = minimise(rows.problem(columns, timing)).theta[: robot.system.p]
        whole = completed(
            robot.system, theta, measured, lambda u: rows.acting_on_sheet(u, measured.rate, timing)
        )
        rows = rows.like(whole.recordings, rows.chosen)
    findings = list(timed.findings)
    findings += stated(robot, whole) if whole is not None else []
    if rows.coasts:
        findings.append(_COASTS)
    # a velocity that is not measured looks like such columns
    if options.columns is None and whole is None:
        report("choosing columns")
        columns, notes = _richer(rows, timing)
        findings.extend(notes)
    problem = rows.problem(columns, timing)
    checked = None
    if validation is not None:
        checked = _checked(rows, validation).problem(columns, timing)
    at = problem.space.actuators
    labels = [problem.space.labels[i] for i in at]

    def suspects(theta: Array) -> Iterator[Suspect]:
        yield from command_suspects(problem.t, problem.Y[:, :, at] * theta[at], labels)
        flow = rows.flow(theta, timing)
        if flow.shape[2]:
            remedy = "Record in still water or air, or with the speed relative to it as `linear`."
            yield Suspect("a steady current or wind", "", flow, remedy)

    parts = {
        "columns": tuple(sorted(columns)),
        "delay": float(np.median(rows.delays(timing))),
        "delay_interval": timed.delay,
    }
    return Structured(
        problem,
        _alternatives(rows, columns, timing, timed.others),
        checked,
        tuple(JointStructure(name, **parts) for name in rows.system.rate_labels),
        tuple(findings),
        rows.chosen.cutoff,
        rows.delays(timing),
        suspects,
        acting=lambda u, rate: rows.acting_on_sheet(u, rate, timing),
        columns=rows.further(columns),
        rivals=tuple(_rivals(rows, columns, timing, whole)),
    )


def _completed(robot: RobotModel, recordings: Recordings) -> Completed | None:
    """A log of a rotation, completed by the sheet; None of one with its translation."""
    if not recordings.turns_only:
        return None
    assert robot.prior is not None  # every vehicle has one
    return completed(robot.system, robot.prior, recordings)


def _checked(rows: VehicleRows, validation: Recordings) -> VehicleRows:
    """The rows of a validation log, of the equations that are fitted."""
    whole = _completed(rows.robot, validation)
    recordings = whole.recordings if whole is not None else validation
    found = rows.like(recordings, filter_for(validation, rows.chosen.cutoff))
    found.usable &= rows.usable.any(axis=0)
    return found


def _timed(
    trials: list[VehicleRows],
    columns: frozenset[str],
    options: Options,
    report: Callable[[str], None],
) -> tuple[VehicleRows, Timed]:
    """The rows of the best cut-off, of several, and their timing with the thrusters' curve."""
    rows = trials[len(trials) // 2]
    timed = Timed(Timing(), [], [])
    for _ in range(_ROUNDS):
        timed = _timing(rows, columns, options.delay, report)
        report("choosing the cut-off")
        before = rows
        rows = _most_informative(trials, columns, timed.timing)
        if rows is before:
            break
    if options.delay is None:
        timed = _resolved(timed, rows.chosen.cutoff)
    if rows.thrusters and options.columns is None:
        report("choosing the thrusters' curve")
        timed = _curved(rows, columns, timed, options.delay, report)
    return rows, timed


def _cost(
    rows: VehicleRows, columns: frozenset[str], timing: Timing
) -> Callable[[frozenset[str], Timing], float]:
    """The cost of the fit, with as many rows per independent row as there are at a timing."""
    first = rows.problem(columns, timing)
    share = inflation(first, minimise(first).theta)

    def cost(columns: frozenset[str], timing: Timing) -> float:
        problem = rows.problem(columns, timing)
        return minimise(problem, tempered(problem, share)).cost

    return cost


def _timing(
    rows: VehicleRows,
    columns: frozenset[str],
    delay: Array | None,
    report: Callable[[str], None],
) -> Timed:
    """The timing for rows; a given `delay` (k,) is kept."""
    if delay is not None:
        return Timed(Timing(delay), [], [])
    cost = _cost(rows, columns, Timing())
    return _searched(rows, lambda x: cost(columns, x), columns, report)


def _resolved(timed: Timed, cutoff: float) -> Timed:
    """The timing, without an offset of clocks far below the period of the rows' cut-off [Hz].

    Where friction or inertia are slightly wrong, commands seem to act that much too early.
    """
    delay = float(timed.timing.delay)  # type: ignore[arg-type]  # of a search, that of all
    if not -_RESOLVED / cutoff < delay < 0:
        return timed
    findings = [finding for finding in timed.findings if finding.code != "clock_offset"]
    plain = timed.timing._replace(delay=0.0)
    return Timed(plain, [*timed.others, timed.timing], findings, (0.0, -delay))


def _searched(
    rows: VehicleRows,
    cost: Callable[[Timing], float],
    columns: frozenset[str],
    report: Callable[[str], None],
) -> Timed:
    """The timing that minimises a cost."""
    free = [0, *([1] if rows.rotors or rows.others else []), *([2, 3] if rows.rotors else [])]

    def offset() -> float | None:
        problem = rows.problem(columns, Timing())
        acting = problem.actuation(problem.prior)
        needed = acting - problem.residual(problem.prior)
        return clock_offset(needed, acting, rows.t, rows.segment)

    period = 1 / rows.recordings.rate
    own = np.abs(np.concatenate([s.log.u[:, rows.rotors] for s in rows.recordings.segments]))
    turning = float(np.quantile(own, _IN_FLIGHT, axis=0).min()) if rows.rotors else 0.0
    return search(cost, rows.robot.joints, free, report, period, offset, turning)


def _curved(
    rows: VehicleRows,
    columns: frozenset[str],
    before: Timed,
    delay: Array | None,
    report: Callable[[str], None],
) -> Timed:
    """The timing with the thrusters' curve; that `before`, of the sheet's, if it is the best.

    A wrong curve bends the delay: the curve is sought at the timing of the sheet's curve and
    without any, then the timing with that curve, then the curve again. A given `delay` is kept.
    """
    timing = before.timing
    cost = _cost(rows, columns, timing)
    starts = [timing] if delay is not None else [timing, Timing()]
    trials = [start._replace(curve=curve) for start in starts for curve in TRIALS]
    costs = [cost(columns, trial) for trial in trials]
    made = trials[int(np.argmin(costs))]
    if not improves(cost(columns, timing), min(costs), NUMBER):
        return before

    def of(timing: Timing) -> Callable[[ThrusterCurve], float]:
        return lambda x: cost(columns, timing._replace(curve=x))

    curve, told = rough_curve(of(made), made.curve)
    if not told:  # the sheet's remains, and intervals allow for the other
        return before._replace(others=[*before.others, timing._replace(curve=curve)])
    if delay is not None:
        curve, near, notes = fitted_curve(of(made), curve)
        others = [made._replace(curve=x) for x in near]
        return Timed(made._replace(curve=curve), others, notes) if notes else before
    cost = _cost(rows, columns, made._replace(curve=curve))
    found = _searched(rows, lambda x: cost(columns, x._replace(curve=curve)), columns, report)
    curve, near, notes = fitted_curve(of(found.timing), curve)
    if not notes:
        return before
    made = found.timing._replace(curve=curve)
    others = [x._replace(curve=curve) for x in found.others]
    others += [made._replace(curve=x) for x in near]
    return Timed(made, others, [*found.findings, *notes], found.delay)


def _with_cutoff(rows: VehicleRows, share: float) -> VehicleRows:
    """The rows of the filter whose cut-off is `share` of that of others."""
    narrower = filter_for(rows.recordings, share * rows.chosen.cutoff)
    return rows.like(rows.recordings, narrower)


def _narrower(rows: VehicleRows) -> list[VehicleRows]:
    """The rows, and those of lower cut-offs that leave enough of them."""
    enough = [share for share in CUTOFF.values if _count(rows, share) >= FEWEST]
    return [rows, *(_with_cutoff(rows, share) for share in enough)]


def _count(rows: VehicleRows, share: float) -> int:
    """How many rows a lower cut-off leaves: of a short log none, as its filter is longer."""
    narrower = filter_for(rows.recordings, share * rows.chosen.cutoff)
    lengths = [len(segment.log.t[:: narrower.every]) for segment in rows.recordings.segments]
    return sum(len(narrower.centres(length)) for length in lengths)


def _most_informative(
    trials: list[VehicleRows], columns: frozenset[str], timing: Timing
) -> VehicleRows:
    """The rows with the most information about θ, of several cut-offs that explain the motion.

    An acceleration's noise grows with its frequency, and biases θ̂ where it exceeds the motion: a
    cut-off is left out if its θ̂ explains the rows of the lowest one clearly less well than others
    do. The information of the fit, by the determinant of its Hessian, is largest without such
    frequencies.
    """
    if len(trials) == 1:
        return trials[0]
    judge = trials[-1].problem(columns, timing)
    scale = judge.space.scale
    uncertainty = []
    errors = []
    for trial in trials:
        fit = tempered_fit(trial.problem(columns, timing))[0]
        uncertainty.append(-float(np.linalg.slogdet(fit.hessian * np.outer(scale, scale))[1]))
        errors.append(np.nanmean(np.log(np.maximum(judge.nrmse(fit.theta), _EXACT))))
    best = int(np.argmin(errors))
    for k, error in enumerate(errors):
        alike = error < min(errors) + _ALIKE
        if alike and improves(uncertainty[best], uncertainty[k], CUTOFF.criterion):
            best = k
    return trials[best]


def _alternatives(
    rows: VehicleRows, columns: frozenset[str], timing: Timing, others: list[Timing]
) -> Iterator[FitProblem]:
    """Other plausible problems: without further columns, at other timings, of a narrower filter."""
    if columns:
        yield rows.problem(frozenset(), timing)
    for other in others:
        yield rows.problem(columns, other)
    yield _with_cutoff(rows, NARROWER).problem(columns, timing)


def _rivals(
    rows: VehicleRows, columns: frozenset[str], timing: Timing, whole: Completed | None
) -> Iterator[FitProblem]:
    """Problems that nothing in the log tells from the one that is fitted.

    Those of a log of a rotation (`whole`) have less of the linear velocities by which it was
    completed. That of a manoeuvring vessel has the mass matrix of its sheet: sway and turning go
    together in a zig-zag and hardly tell inertia from what manoeuvring adds, so that the noise of
    accelerations decides, and takes inertia for smaller than it is.
    """
    own = rows.problem(columns, timing)
    if whole is not None:
        for otherwise in whole.otherwise(own.nrmse(minimise(own).theta)):
            yield rows.like(otherwise, rows.chosen).problem(columns, timing)
    if "manoeuvring" in columns:
        kinds = own.space.geometries
        matrix = (kinds != "positive") & (kinds != "free")
        yield replace(own, known=own.known | matrix)
