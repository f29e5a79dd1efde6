"""Choice of a tree's columns, friction speeds and delays by cross-validation inside the log.

Divided by the gain, each joint's row is linear in its own columns, so that a least-squares fit of a
candidate, joint by joint, takes a millisecond. Candidates are compared by their error in held-out
fifths of the log; the physical fit uses the chosen ones.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ....base import Finding, refused
from ....core import Array, check_consistency
from ....robots import RobotModel
from ...logs.recordings import Recordings
from ..fit import minimise
from ..joint_checks import (
    GUESSED,
    NOMINAL,
    expected_gains,
    fit_checks,
    rate_checks,
    reversed_commands,
    weighed_links,
)
from ..joints import JointRows
from ..links import file_links
from ..problem import FitProblem
from ..residuals import Suspect
from ..result import JointStructure, Options, Structured
from ..smoothing import refined as finer
from ..smoothing import twice_as_noisy
from ..unmodelled_effects import arm_suspects
from .columns import BASIC, FASTENED, SPEEDS, Choice
from .cutoff import NARROWER, filter_for
from .held_out import basis_of, held_out_errors, rms, shared_errors, unexplained
from .options import (
    COLUMN,
    CONSTANTS,
    CURVES,
    FALLING,
    JOINT_DELAY,
    JOINT_SPACING,
    OWN_DELAY,
    SPEED,
    improves,
)

_PARABOLAS = 5  # steps of the correction of all delays
_LOADED = 0.15  # share of weight in a joint's force that a load column needs
_BETWEEN = 0.1  # of the time between two rows: doubt of when a held target of a PD law acts
_DOUBT = 4.0  # formal deviations of the delays that count as one: residuals are correlated


def structured_arm(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    report: Callable[[str], None],
) -> Structured:
    """Chooses columns and delays of every joint and makes the rows of the fit.

    `robot` is a tree of joints, `recordings` are training logs, `validation` is a log excluded from
    the fit, or None; `report` is called with the name of every stage.
    """
    check_consistency(robot.system)
    report("filtering")
    slow = rate_checks(recordings.rate)
    measured = recordings
    recordings = finer(recordings)
    chosen = filter_for(recordings, options.cutoff)
    unknown = np.ones(len(robot.joints))
    rows = JointRows(
        robot, recordings, chosen, unknown, loads=options.loads, coupled=options.coupled
    )
    if robot.weightless:
        rows.robot = robot = weighed_links(rows)
        rows.loading = file_links(robot.model)
    rows.gain, rows.spread, faults = expected_gains(rows)
    report("choosing columns and delays")
    choice, notes = choose(rows, options.coupled, options.delay, options.columns)
    rows.gain = expected_gains(rows, choice)[0]
    problem = rows.problem(choice)
    others = iter(())
    faults += fit_checks(rows, choice)
    if not refused(faults):
        faults += reversed_commands(rows, choice, problem)
    if not refused(faults):
        report("fitting delays")
        choice, doubt, said = _finished(rows, choice, problem, options)
        if doubt is not None and recordings.feedback is not None:
            doubt = max(doubt, _BETWEEN / (_DOUBT * measured.rate))
        others = _alternatives(rows, choice, doubt)
        notes = [*notes, *said]
        problem = rows.problem(choice)
    checked = None
    if validation is not None:
        validation = finer(validation)
        checked = rows.like(validation, filter_for(validation, chosen.cutoff)).problem(choice)

    def noisier(theta: Array) -> tuple[FitProblem, Iterator[Suspect]]:
        other = rows.like(finer(twice_as_noisy(measured)), chosen)
        again = other.problem(choice)
        return again, arm_suspects(other, choice, again, theta)

    columns, rotors = rows.terms(problem.space, choice)
    return Structured(
        problem,
        others,
        checked,
        _chosen(robot, choice),
        (*notes, *slow, *faults),
        chosen.cutoff,
        choice.delay,
        lambda theta: arm_suspects(rows, choice, problem, theta),
        noisier,
        coupled=options.coupled,
        columns=columns,
        rotors=rotors,
    )


def _chosen(robot: RobotModel, choice: Choice) -> tuple[JointStructure, ...]:
    """What was chosen for every joint."""
    parts = zip(robot.joints, choice.columns, choice.speed, choice.delay.tolist(), strict=True)
    return tuple(
        JointStructure(name, columns=tuple(sorted(own)), friction_speed=SPEEDS[s], delay=d)
        for name, own, s, d in parts
    )


def _finished(
    rows: JointRows, choice: Choice, problem: FitProblem, options: Options
) -> tuple[Choice, float | None, list[Finding]]:
    """The choice completed by fits of the whole structure, the deviation of its delays, and notes.

    `problem` is that of the choice so far. The deviation [s] is None for given delays.
    """
    notes = []
    doubt = None
    if any("load" in columns for columns in choice.columns):
        rows.reweigh(minimise(problem).theta[: rows.links.shape[2]])
    if options.delay is None:
        choice, doubt, note = with_common_delay(rows, choice)
        notes.append(note)
    if len(rows.driven) < len(rows.robot.joints):
        choice = with_speeds(rows, choice)
    if options.columns is None:
        choice, said = with_constants(rows, choice, options.level)
        notes += said
    return choice, doubt, notes


def _alternatives(rows: JointRows, choice: Choice, doubt: float | None) -> Iterator[FitProblem]:
    """Other plausible problems; `doubt` is the standard deviation of the delays [s], if any."""
    trials = []
    last = len(SPEEDS) - 1
    if doubt is not None:
        trials.append(replace(choice, delay=choice.delay + _DOUBT * doubt))
    if any(columns != BASIC for columns in choice.columns):
        trials.append(replace(choice, columns=_on_leaders(rows, BASIC)))
    for step in (-1, 1):
        speeds = tuple(min(max(s + step, 0), last) for s in choice.speed)
        trials.append(replace(choice, speed=speeds))
    yield from map(rows.problem, trials)
    if (rows.spread[rows.driven] == NOMINAL).any():  # masses may contradict the file's gains
        own = rows.problem(choice)
        at = own.space.actuators
        spread = own.spread.copy()
        spread[at] = np.where(spread[at] == NOMINAL, GUESSED, spread[at])
        yield replace(own, spread=spread)
    narrow = filter_for(rows.recordings, NARROWER * rows.chosen.cutoff)
    yield rows.like(rows.recordings, narrow).problem(choice)


def choose(
    rows: JointRows,
    coupled: tuple[tuple[int, int, int], ...] = (),
    delay: Array | None = None,
    columns: frozenset[str] | None = None,
) -> tuple[Choice, list[Finding]]:
    """The structure of every joint that predicts held-out commands best, and what was tried.

    `coupled` are pairs (i, j, ±1) of joints whose motor turns by v_i ± v_j, delay (k,) known delays
    [s], None to search for them, `columns` those to use on all joints, None to choose.
    """
    k = len(rows.robot.joints)
    basic = BASIC if columns is None else columns
    shared = np.zeros(k) if delay is None else delay
    findings = []
    choice = Choice(_on_leaders(rows, basic), (1,) * k, shared, coupled)
    if delay is None:
        choice, shared, findings = _with_delays(rows, choice)
    for j in rows.driven:  # a passive joint has no command to predict
        own, finding, errors = _choose_joint(rows, choice, j, columns is None)
        if choice.delay[j] != shared[j]:
            delays = choice.delay.copy()
            delays[j] = shared[j]
            alike = _choose_joint(rows, replace(choice, delay=delays), j, columns is None)
            # friction at another speed imitates a delay
            if not improves(alike[2], errors, OWN_DELAY):
                own, finding, _ = alike
        choice = own
        findings.append(finding)
    return choice, findings


def _on_leaders(rows: JointRows, names: frozenset[str]) -> tuple[frozenset[str], ...]:
    """Columns of all joints: those of `names`, and none of joints that follow others."""
    count = len(rows.robot.joints)
    return tuple(frozenset[str]() if j in rows.following else names for j in range(count))


def _choose_joint(
    rows: JointRows, choice: Choice, joint: int, free: bool
) -> tuple[Choice, Finding, Array]:
    """The choice with the best speed and columns at one joint, that in words, and its errors."""
    u = rows.commands(choice.delay)[:, joint]
    best = held_out_errors(rows, choice, u, joint)
    first = rms(best)
    tried = []

    def better(trial: Choice, words: str) -> None:
        nonlocal best, choice
        errors = held_out_errors(rows, trial, u, joint)
        tried.append(f"{words} {rms(errors):.4f}")
        if improves(best, errors, COLUMN):
            best, choice = errors, trial

    def speeds() -> None:
        if FASTENED & choice.columns[joint]:
            for index, speed in enumerate(SPEED.values):
                if index != choice.speed[joint]:
                    better(choice.at(joint, speed=index), f"s = {speed:g}")

    speeds()
    if free:
        # where weight is a small part of the force, `load` imitates other friction and biases gains
        weight = rows.diagonal["load"][-1][:, joint]
        force = u * rows.gain[joint]
        for option in CURVES:
            if option.name != "load" or weight.std() > _LOADED * force.std():
                better(choice.at(joint, option.name), f"+ {option.name}")
        for index, speed in enumerate(FALLING.values):  # a smaller one imitates it where it lacks
            trial = choice.at(joint, FALLING.name, speed=index)
            better(trial, f"+ {FALLING.name} with s = {speed:g}")
        speeds()
    used = sorted(choice.columns[joint])
    speed = SPEEDS[choice.speed[joint]]
    text = (
        f"friction columns {', '.join(used)} with s = {speed:g}; held-out NRMSE "
        f"{100 * first:.3g} % → {100 * rms(best):.3g} %, the best of {len(tried) + 1} choices"
    )
    data = {"columns": used, "speed": speed, "held_out": rms(best), "tried": tried}
    return choice, Finding("note", "columns", rows.robot.joints[joint], text, data=data), best


def _with_delays(rows: JointRows, choice: Choice) -> tuple[Choice, Array, list[Finding]]:
    """The choice with delays on a grid: a common one, and individual ones where joints differ.

    Every joint's row is fitted by least squares at every candidate delay. The columns do not depend
    on the delay, so one orthogonal basis of them serves all candidates. Also returns the shared
    delays (k,).
    """
    k = len(rows.robot.joints)
    candidates = np.array(JOINT_DELAY.values)
    bases = [basis_of(rows, choice, j) for j in range(k)]
    errors = np.empty((len(candidates), k))
    for number, delay in enumerate(candidates):
        u = rows.commands(np.full(k, delay))
        own = [unexplained(u[:, j], *bases[j]) for j in range(k)]
        errors[number] = own * rows.growth(np.full(k, delay))
    best = int(np.argmin(np.log(errors) @ rows.usable.sum(axis=0)))
    found = np.zeros(k)
    findings = []
    # under a PD law a later target is less viscous friction, so a joint's own delay is not tried
    one = rows.recordings.feedback is not None
    for j in rows.driven:
        at = best if one else int(np.argmin(errors[:, j]))
        name = rows.robot.joints[j]
        if at != best:
            u = [rows.commands(np.full(k, d))[:, j] for d in candidates[[best, at]]]
            if not improves(*(held_out_errors(rows, choice, x, j) for x in u), OWN_DELAY):
                at = best  # most delays are shared: they are those of clocks and of the network
        if at in (0, len(candidates) - 1):
            text = (
                f"the best delay of the command, {candidates[at] * 1e3:+.0f} ms, lies at the edge "
                "of the search"
            )
            remedy = "Align the clocks of commands and positions in the map (`offset` of a file)."
            findings.append(Finding("warning", "delay_at_edge", name, text, remedy))
        else:
            found[j] = candidates[at]
            if at != best:
                found[j] += JOINT_SPACING * _vertex(errors[at - 1 : at + 2, j] ** 2)
    shared = np.where(found == 0, 0.0, candidates[best])  # 0 at the edge
    return replace(choice, delay=found), shared, findings


def with_constants(
    rows: JointRows, choice: Choice, level: frozenset[str] = frozenset()
) -> tuple[Choice, list[Finding]]:
    """The choice with offsets and springs where they improve the physical fit of all joints.

    In fits joint by joint, each with free link parameters, weight would absorb both. A negative
    stiffness is not a spring but an error that grows with the position, such as a wrong gear ratio;
    it is left in the residuals. `level` are names of joints without an offset of their own, as are
    passive ones.
    """
    (best, fitted), findings = shared_errors(rows.problem(choice)), []
    for j, name in enumerate(rows.robot.joints):
        if j in rows.following:
            continue
        for option, words in zip(CONSTANTS, ("a constant offset", "a spring"), strict=True):
            column = option.name
            if column == "offset" and (name in level or j not in rows.driven):
                continue
            trial = choice.at(j, "offset", column)
            errors, found = shared_errors(rows.problem(trial), fitted)
            possible = found.get(f"stiffness_{j + 1}", 0.0) >= 0
            if possible and improves(best, errors, option.criterion):
                fall = 100 * (1 - np.exp(np.log(errors / best).mean()))
                text = f"{words}; held-out errors, all joints multiplied, fall by {fall:.0f} %"
                findings.append(Finding("note", "columns", name, text, data={"columns": [column]}))
                choice, best, fitted = trial, errors, found
    return choice, findings


def with_speeds(rows: JointRows, choice: Choice) -> Choice:
    """The choice with the best s of Coulomb friction at passive joints, by the physical fit."""
    best = shared_errors(rows.problem(choice))[0]
    for j in set(range(len(rows.robot.joints))) - {*rows.driven, *rows.following}:
        for speed in range(len(SPEED.values)):
            trial = choice.at(j, speed=speed)
            errors = shared_errors(rows.problem(trial))[0]
            if improves(best, errors, SPEED.criterion):
                choice, best = trial, errors
    return choice


def _vertex(values: Array) -> float:
    """Minimum of the parabola through values at −1, 0, 1, within ±½."""
    bend = values[0] - 2 * values[1] + values[2]
    return float(np.clip(0.5 * (values[0] - values[2]) / bend, -0.5, 0.5)) if bend > 0 else 0.0


def with_common_delay(rows: JointRows, choice: Choice) -> tuple[Choice, float, Finding]:
    """The choice with its delays corrected by one that all commands share, from the physical fit.

    Mean squared residuals are parabolas in the correction. A millisecond matters: interpolation of
    held commands advances them by half a sample. Also returns the correction's standard deviation
    [s], and the delays in words.
    """
    h = 0.5 * JOINT_SPACING
    start = None
    correction = 0.0
    curvature = 0.0
    for _ in range(_PARABOLAS):
        levels = []
        for step in (-h, 0.0, h):
            problem = rows.problem(replace(choice, delay=choice.delay + correction + step))
            fit = minimise(problem, start=start)
            start = fit.theta
            grown = rows.growth(choice.delay + correction + step)
            levels.append(np.maximum(fit.levels * grown**2, 1e-300))
        # mean squares are parabolas in the delay; their logarithms, in J, only at the very minimum
        weight = problem.usable.sum(axis=0) / np.min(levels, axis=0)
        costs = 0.5 * np.array(levels) @ weight
        slope = (costs[2] - costs[0]) / (2 * h)
        curvature = np.diff(costs, 2)[0] / h**2
        if curvature <= 0:
            break
        change = float(np.clip(-slope / curvature, -4 * h, 4 * h))
        correction += change
        if abs(change) < 0.5 * h:
            break
    final = replace(choice, delay=choice.delay + correction)
    deviation = float(1 / np.sqrt(curvature)) if curvature > 0 else h
    delays = dict(zip(rows.robot.joints, final.delay.tolist(), strict=True))
    words = ", ".join(f"{name} {_ms(delay)}" for name, delay in delays.items())
    if np.ptp(final.delay) < 1e-9:
        words = f"{_ms(final.delay[0])} for all"
    text = f"delays of the commands relative to the log [ms]: {words}"
    return final, deviation, Finding("note", "delay", "", text, data=dict(delays))


def _ms(delay: float) -> str:
    """A delay [s] in milliseconds with its sign; never −0.0."""
    return f"{round(delay * 1e3, 1) + 0.0:+.1f}"
