"""Choice of a tree's columns, friction speeds and delays by cross-validation inside the log.

Divided by the gain, each joint's row is linear in its own columns, so that a least-squares fit of a
candidate, joint by joint, takes a millisecond. Candidates are compared by their error in held-out
fifths of the log; the physical fit uses the chosen ones.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ....base import Finding
from ....core import Array, Indices
from ....robots import RobotModel
from ...logs.command_causes import UNCHECKED
from ...logs.recordings import Recordings
from ..fit import Fit, gramians, information, minimise
from ..joint_checks import (
    GUESSED,
    NOMINAL,
    expected_gains,
    fit_checks,
    rate_checks,
    weighed_links,
)
from ..joints import JointRows, joint_of
from ..links import file_links
from ..problem import FitProblem, Mask, mean_squares
from ..residuals import Suspect
from ..result import JointStructure, Options, Structured
from ..smoothing import Filter, twice_as_noisy
from ..smoothing import refined as finer
from ..unmodelled_effects import arm_suspects
from .clocks import at_edge, clock_offset
from .columns import BASIC, BROAD, COLUMNS, FALLS, HELD, SPEEDS, Choice
from .cutoff import NARROWER, filter_for, flat_range, middle_of, trials
from .held_out import (
    SHAPES,
    Contest,
    FrictionShape,
    errors_at_cutoffs,
    rms,
    shapes,
    shared_errors,
)
from .options import (
    CERTAIN,
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

_POOR = 0.3  # held-out error above which clocks may be farther apart than a delay
_UNTIMED = ("delay_at_edge", "clock_offset")  # findings where no delay is used
_LOADED = 0.15  # share of weight in a joint's force that a load column needs
_BETWEEN = 0.05  # of the time between two rows: doubt of when a held target of a PD law acts
_LEAD = (
    0.01  # by which MuJoCo's `frictionloss` turns before the velocity, with its usual solref [s]
)
_SHAKEN = 4.0  # speed over which friction turns, at most, over the widest of `SPEEDS`
_STEPS = 5  # of the correction of delays by the physical fit
_EXACT = 2e-5  # least change of a delay that is worth another step [s]
_LONGEST = 0.008  # step [s]
_BLOCKS = 20  # of the log, over which scores are summed
_CLOCK = 0.01  # of a sample: no log's clock and interpolation are more exact
_QUANTILE = 2.09  # half-width of a 95 % interval over a deviation from that many parts


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
    robot.system.check_consistency()
    report("filtering")
    slow = rate_checks(recordings.rate)
    measured = recordings
    rows, others_at = _filtered(robot, recordings, options)
    recordings = rows.recordings
    chosen = rows.chosen
    if robot.weightless:
        rows.robot = robot = weighed_links(rows)
        rows.loading = file_links(robot.model)
    rows.gain, rows.spread, faults = expected_gains(rows)
    k = len(robot.joints)
    report("choosing columns and delays")
    found = choose(rows, options.coupled, options.delay, options.columns)
    choice = found.choice
    rows.gain = expected_gains(rows, choice)[0]
    problem = rows.problem(choice)
    others = rivals = iter(())
    faults += fit_checks(rows, replace(choice, delay=np.full(k, np.median(choice.delay))))
    if not Finding.refused(faults):
        report("fitting delays")
        beside = [rows.like(recordings, other) for other in others_at]
        found = _finished(rows, found, problem, options, beside)
        if found.delays is not None and recordings.feedback is not None:
            least = _BETWEEN / measured.rate
            found = found._replace(delays=Delays(np.maximum(found.delays.deviation, least)))
        choice = found.choice
        others = _alternatives(rows, found)
        rivals = _rival_problems(rows, found, beside)
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
        _chosen(robot, found),
        (*found.findings, *slow, *faults),
        chosen.cutoff,
        choice.delay,
        lambda theta: arm_suspects(rows, choice, problem, theta),
        rivals,
        noisier,
        coupled=options.coupled,
        loaded=frozenset(load.source for load in options.loads),
        columns=columns,
        rotors=rotors,
    )


def _filtered(
    robot: RobotModel, recordings: Recordings, options: Options
) -> tuple[JointRows, list[Filter]]:
    """Rows through the filter that is chosen, and other filters that are as plausible."""
    fine = finer(recordings)

    def rows_at(cutoff: float) -> JointRows:
        unknown = np.ones(len(robot.joints))
        more = {"loads": options.loads, "coupled": options.coupled}
        return JointRows(robot, fine, filter_for(fine, cutoff), unknown, **more)

    if options.cutoff is not None:
        rows = rows_at(options.cutoff)
        return rows, [filter_for(fine, NARROWER * rows.chosen.cutoff)]
    cutoffs = trials(recordings)
    tried = [rows_at(cutoff) for cutoff in cutoffs]
    k = len(robot.joints)
    delay = np.zeros(k) if options.delay is None else options.delay
    names = on_leaders(tried[0], BASIC | {"quadratic"})
    choice = Choice(names, (BROAD,) * k, delay, options.coupled)
    if options.delay is None:
        choice = _with_delays(tried[0], choice, free=False)[0]
    gain, spread, _ = expected_gains(tried[0], choice)
    for rows in tried:
        rows.gain = gain
        rows.spread = spread
    flat = flat_range(errors_at_cutoffs(tried, choice))
    middle = middle_of(flat, len(tried) - 2)
    ends = dict.fromkeys((flat[0], flat[-1]))
    return tried[middle], [tried[k].chosen for k in ends if k != middle]


def _chosen(robot: RobotModel, found: Chosen) -> tuple[JointStructure, ...]:
    """What was chosen for every joint."""
    choice = found.choice
    parts = zip(robot.joints, choice.columns, choice.speed, choice.delay.tolist(), strict=True)
    ends = [None] * len(robot.joints) if found.delays is None else found.delays.ends(choice.delay)
    return tuple(
        JointStructure(
            name,
            columns=tuple(sorted(own)),
            friction_speed=SPEEDS[s],
            delay=d,
            delay_interval=interval,
        )
        for (name, own, s, d), interval in zip(parts, ends, strict=True)
    )


def _finished(
    rows: JointRows,
    found: Chosen,
    problem: FitProblem,
    options: Options,
    beside: Sequence[JointRows],
) -> Chosen:
    """The choice completed by fits of the whole structure.

    `problem` is that of the choice so far; `beside` are rows through other filters.
    """
    choice = found.choice
    notes = found.findings
    delays = None
    free = options.columns is None
    searched = options.delay is None and not any(f.code in _UNTIMED and not f.where for f in notes)
    if any("load" in columns for columns in choice.columns):
        rows.reweigh(minimise(problem).theta[: rows.links.shape[2]])
    if searched:
        choice, delays = with_exact_delays(rows, choice)
        edges = [f for f in notes if f.code in _UNTIMED]
        found = with_friction(rows, choice, free, edges)
        choice = found.choice
        notes = found.findings
    if len(rows.driven) < len(rows.robot.joints):
        choice = with_speeds(rows, choice)
    if free:
        choice, said = with_constants(rows, choice, options.level)
        notes = [*notes, *said]
    if searched:
        choice, delays = with_exact_delays(rows, choice)
        apart = [with_exact_delays(other, choice)[0].delay - choice.delay for other in beside]
        delays = Delays(np.linalg.norm([delays.deviation, *apart], axis=0))
        choice, said = causal(rows, choice, delays)
        notes = [*notes, *said]
    if free:
        choice, said = _without_holding(rows, choice)
        notes = [*notes, *said]
    rivals = [_with_constants_of(choice, other) for other in found.rivals]
    return Chosen(choice, notes, rivals, delays)


def _without_holding(rows: JointRows, choice: Choice) -> tuple[Choice, list[Finding]]:
    """The choice without load friction whose fitted value is `HELD` or more, and what was left."""
    said = []
    while any("load" in columns for columns in choice.columns):
        problem = rows.problem(choice)
        at = problem.space[COLUMNS["load"].block]
        theta = minimise(problem).theta[at]
        if theta.max() < HELD:
            break
        joint = joint_of(problem.space.names[at][int(np.argmax(theta))])
        names = choice.columns[joint] - {"load"}
        choice = choice.with_joint(joint, names, choice.speed[joint], choice.fall(joint))
        text = f"friction of {theta.max():.2g} times the load would hold the joint by its load "
        text += "alone, so the column load is left out"
        where = rows.robot.joints[joint]
        said.append(Finding("note", "columns", where, text, data={"columns": sorted(names)}))
    return choice, said


def _with_constants_of(choice: Choice, other: Choice) -> Choice:
    """Another choice with the delays, offsets and springs of a choice."""
    names = {option.name for option in CONSTANTS}
    pairs = zip(other.columns, choice.columns, strict=True)
    columns = tuple((theirs - names) | (own & names) for theirs, own in pairs)
    return replace(other, columns=columns, delay=choice.delay)


def _alternatives(rows: JointRows, found: Chosen) -> Iterator[FitProblem]:
    """Other plausible problems: later commands, and friction next to the chosen one."""
    choice = found.choice
    if found.delays is not None:
        yield rows.problem(replace(choice, delay=choice.delay + found.delays.deviation))
    for other in neighbours(choice):
        yield rows.problem(other)
    if (rows.spread[rows.driven] == NOMINAL).any():  # masses may contradict the file's gains
        own = rows.problem(choice)
        at = own.space.actuators
        spread = own.spread.copy()
        spread[at] = np.where(spread[at] == NOMINAL, GUESSED, spread[at])
        yield replace(own, spread=spread)


def _rival_problems(
    rows: JointRows, found: Chosen, beside: Sequence[JointRows]
) -> Iterator[FitProblem]:
    """Problems that predict the log as well: with other friction, through other filters."""
    yield from map(rows.problem, found.rivals)
    for other in beside:
        yield other.problem(found.choice)
    for finding in rows.recordings.findings:
        if finding.code == UNCHECKED and finding.level == "warning":
            # data of findings may be anything; these are numbers, see `command_causes`
            ends = [float(finding.data[end]) for end in ("low", "high")]  # type: ignore[arg-type]
            # the range is one of 95 %, its root one of a standard deviation
            factor = float(np.sqrt(max(1 / ends[0], ends[1])))
            yield rows.retimed(factor).problem(found.choice)
            yield rows.retimed(1 / factor).problem(found.choice)
    if rows.recordings.feedback is not None and found.delays is not None:
        # rows do not show how a joint moves while its target holds, which looks like a delay
        late = found.choice.delay + found.delays.deviation
        yield rows.problem(replace(found.choice, delay=late))
        # jerky targets shake a light joint, whose friction acts like damping the more it is shaken
        yield rows.turning(lead=_LEAD).problem(found.choice)
        shaken = rows.turning(slower=_SHAKEN)
        yield shaken.problem(_with_dry_friction(shaken, found.choice))


def _with_dry_friction(rows: JointRows, choice: Choice) -> Choice:
    """The choice with the friction of `BASIC` alone, at each joint's best speed."""
    u = rows.commands(choice.delay)
    dry = BASIC & set(SHAPES)
    for j in rows.driven:
        tried = shapes(dry, FrictionShape(dry, choice.speed[j], choice.fall(j)))
        errors = Contest(rows, choice, j, u[:, [j]]).errors(tried)[:, 0]
        best = tried[int(np.argmin(np.log(errors).mean(axis=1)))]
        choice = choice.with_joint(
            j, (choice.columns[j] - set(SHAPES)) | dry, best.speed, best.fall
        )
    return choice


def neighbours(choice: Choice) -> Iterator[Choice]:
    """The choice with the next speeds of friction at all joints."""
    joints = range(len(choice.columns))
    falls = [choice.fall(j) for j in joints]
    for step in (-1, 1):
        speeds = tuple(int(np.clip(s + step, 0, len(SPEEDS) - 1)) for s in choice.speed)
        yield replace(choice, speed=speeds)
        if any("stribeck" in names for names in choice.columns):
            other = tuple(int(np.clip(f + step, 0, len(FALLS) - 1)) for f in falls)
            yield replace(choice, falls=other)


# -- friction and delays, chosen together ----------------------------------------------------------

_RICH = (frozenset({"coulomb", "quadratic"}), frozenset({"coulomb", "stribeck", "quadratic"}))
_FINE = 0.002  # spacing of delays about the best of the grid [s]


class Chosen(NamedTuple):
    """What the search found."""

    choice: Choice
    findings: list[Finding]
    rivals: Sequence[Choice] = ()  # whose friction predicts nearly as well
    delays: Delays | None = None  # how exact they are; None where they were given


def choose(
    rows: JointRows,
    coupled: tuple[tuple[int, int, int], ...] = (),
    delay: Array | None = None,
    columns: frozenset[str] | None = None,
) -> Chosen:
    """The friction and delays of all joints that predict held-out commands best.

    At every delay of the grid each joint has the best friction for it; the delay that all commands
    share is the one with the least product of the joints' errors, and friction is chosen again
    there. Chosen one after the other, each would imitate the other.

    `coupled` are pairs (i, j, ±1) of joints whose motor turns by v_i ± v_j, delay (k,) known delays
    [s], None to search for them, `columns` those to use on all joints, None to choose.
    """
    k = len(rows.robot.joints)
    basic = BASIC if columns is None else columns
    start = np.zeros(k) if delay is None else delay
    choice = Choice(on_leaders(rows, basic), (BROAD,) * k, start, coupled)
    findings = []
    if delay is None:
        choice, findings = _with_delays(rows, choice, columns is None)
    return with_friction(rows, choice, columns is None, findings)


def on_leaders(rows: JointRows, names: frozenset[str]) -> tuple[frozenset[str], ...]:
    """Columns of all joints: those of `names`, and none of joints that follow others."""
    count = len(rows.robot.joints)
    return tuple(frozenset[str]() if j in rows.following else names for j in range(count))


def with_friction(
    rows: JointRows, choice: Choice, free: bool, findings: Sequence[Finding] = ()
) -> Chosen:
    """The choice with the best friction at its delays; with its own columns unless `free`."""
    said = list(findings)
    found: dict[int, list[FrictionShape]] = {}
    u = rows.commands(choice.delay)
    for j in rows.driven:  # a passive joint has no command to predict
        own = choice.columns[j]
        tried = _candidates(rows, choice, j, free)
        errors = Contest(rows, choice, j, u[:, [j]]).errors(tried)[:, 0]
        best = _simplest(tried, errors, free)
        if best is None:
            continue
        shape = tried[best]
        used = (own - set(SHAPES)) | shape.names
        choice = choice.with_joint(j, used, shape.speed, shape.fall)
        found[j] = _rivals(tried, errors, best) if free else []
        said.append(_friction_in_words(rows, j, used, shape, errors[[0, best]], len(tried)))
    rivals = []
    for number in range(max(map(len, found.values()), default=0)):
        other = choice
        for j, own in found.items():
            if number < len(own):
                used = (choice.columns[j] - set(SHAPES)) | own[number].names
                other = other.with_joint(j, used, own[number].speed, own[number].fall)
        rivals.append(other)
    return Chosen(choice, said, rivals)


def _candidates(rows: JointRows, choice: Choice, joint: int, free: bool) -> list[FrictionShape]:
    """The friction that is tried at a joint, the simplest first."""
    own = choice.columns[joint] & set(SHAPES)
    usual = FrictionShape(own, choice.speed[joint], choice.fall(joint))
    if not free:
        return [usual, *shapes(own, usual)]
    # where weight is a small part of the force, `load` imitates other friction and biases gains
    weight = rows.diagonal["load"][BROAD][:, joint]
    force = rows.commands(choice.delay)[:, joint] * rows.gain[joint]
    further = [option.name for option in (*CURVES, FALLING)]
    if not weight.std() > _LOADED * force.std():
        further.remove("load")
    found = [FrictionShape(BASIC & set(SHAPES), BROAD, choice.fall(joint))]
    for count in range(len(further) + 1):
        for names in itertools.combinations(further, count):
            found += shapes((BASIC & set(SHAPES)) | set(names), found[0])
    return found


def _simplest(tried: Sequence[FrictionShape], errors: Array, free: bool) -> int | None:
    """Index of the simplest shape that no other clearly improves on; None if none is judged.

    Its dry friction has the usual speed unless another has errors lower by a percent, or is clearly
    better where columns are not `free`: a wide tanh would stand for a column that was not asked
    for. errors (S, 5) are held out.
    """
    level = np.log(errors).mean(axis=1)
    if not np.isfinite(level).any():
        return None
    least = int(np.argmin(level))
    near = [
        k for k in _best_of_each(tried, level) if not improves(errors[k], errors[least], COLUMN)
    ]
    best = min(near, key=lambda k: (len(tried[k].names), level[k]))
    alike = [k for k, s in enumerate(tried) if s.names == tried[best].names and s.speed == BROAD]
    usual = min(alike, key=lambda k: level[k], default=best)
    lower = level[best] < level[usual] - COLUMN.worth
    return best if lower and (free or improves(errors[usual], errors[best], COLUMN)) else usual


def _rivals(tried: Sequence[FrictionShape], errors: Array, chosen: int) -> list[FrictionShape]:
    """The best shapes without one of the chosen one's columns, unless it certainly needs it.

    What a rival lacks is not told by the log: one law of friction stands for another.
    """
    level = np.log(errors).mean(axis=1)
    best = _best_of_each(tried, level)
    found: list[FrictionShape] = []
    for name in sorted(tried[chosen].names - BASIC):
        without = [k for k in best if name not in tried[k].names]
        rival = min(without, key=lambda k: level[k])
        if not improves(errors[rival], errors[chosen], CERTAIN) and tried[rival] not in found:
            found.append(tried[rival])
    return found


def _best_of_each(tried: Sequence[FrictionShape], level: Array) -> list[int]:
    """Indices of the best shapes of each set of columns, by mean logarithms of errors (S,)."""
    best: dict[frozenset[str], int] = {}
    for k in np.argsort(level, kind="stable").tolist():
        best.setdefault(tried[k].names, k)
    return [k for k in best.values() if np.isfinite(level[k])]


def _friction_in_words(
    rows: JointRows,
    joint: int,
    used: frozenset[str],
    shape: FrictionShape,
    errors: Array,
    tried: int,
) -> Finding:
    """The friction chosen for a joint; errors (2, 5) are those before and with it."""
    names = sorted(used)
    speed = SPEEDS[shape.speed]
    before, after = map(rms, errors)
    unit = f"{rows.robot.units[joint]}/s"
    fall = f", Stribeck velocity {FALLS[shape.fall]:g} {unit}" if "stribeck" in used else ""
    text = (
        f"the columns {', '.join(names)} are used, with Coulomb friction smoothed over {speed:g} "
        f"{unit}{fall}: held-out error {100 * after:.3g} % (before: {100 * before:.3g} %), the "
        f"best of {tried} choices"
    )
    data = {"columns": names, "speed": speed, "held_out": after}
    return Finding("note", "columns", rows.robot.joints[joint], text, data=data)


def _with_delays(rows: JointRows, choice: Choice, free: bool) -> tuple[Choice, list[Finding]]:
    """The choice with the delay that all commands share, and others where joints insist on them."""
    grid = np.array(JOINT_DELAY.values)
    coarse = _errors_at(rows, choice, grid, free)
    counts = rows.usable.sum(axis=0)[rows.driven]
    judged: Mask = np.asarray(np.isfinite(coarse).all(axis=(1, 2)))
    if not judged.any():
        return choice, []

    def common(errors: Array) -> Array:
        """(D,) weighted mean logarithms of errors (J, D, 5)."""
        return counts[judged] @ np.log(errors[judged]).mean(axis=2)

    best = int(np.argmin(common(coarse)))
    findings = []
    edge = best in (0, len(grid) - 1)
    if edge or common(coarse)[best] > np.log(_POOR) * counts[judged].sum():
        needed = rows.links @ rows.loading
        acting = rows.commands(np.zeros(len(choice.delay))) * rows.gain
        offset = clock_offset(needed, acting, rows.t, rows.segment)
        if edge or offset is not None:
            return choice, [at_edge(grid[best], offset=offset)]
    fine = np.arange(-JOINT_SPACING, JOINT_SPACING + 1e-9, _FINE)
    errors = _errors_at(rows, choice, grid[best] + fine, free)
    at = int(np.clip(np.argmin(common(errors)), 1, len(fine) - 2))
    square = np.mean(errors[judged] ** 2, axis=2)
    level = counts[judged] @ (square / square.min(axis=1, keepdims=True))
    shared = grid[best] + fine[at] + _FINE * _vertex(level[at - 1 : at + 2])
    delays = np.full(len(choice.delay), shared)
    # under a PD law a later target is less viscous friction, so a joint's own delay is not tried
    one = rows.recordings.feedback is not None
    for row, j in enumerate(rows.driven):
        if one or not judged[row]:
            continue
        # one clock stamps all joints: none of them has its command after it acted
        level = np.log(coarse[row]).mean(axis=1)
        own = int(np.argmin(np.where(grid < min(grid[best], 0.0) - 1e-9, np.inf, level)))
        if abs(own - best) < 2:
            continue
        insists = improves(errors[row, at], coarse[row, own], OWN_DELAY)
        if insists and own in (0, len(grid) - 1):
            findings.append(at_edge(grid[own], rows.robot.joints[j]))
        elif insists:
            near = np.mean(coarse[row, own - 1 : own + 2] ** 2, axis=1)
            delays[j] = grid[own] + JOINT_SPACING * _vertex(near)
    return replace(choice, delay=delays), findings


def _errors_at(rows: JointRows, choice: Choice, grid: Array, free: bool) -> Array:
    """(J, D, 5) held-out errors of J driven joints at delays (D,), each with its best friction."""
    k = len(rows.robot.joints)
    u = np.stack([rows.commands(np.full(k, delay)) for delay in grid], axis=2)
    growth = np.array([rows.growth(np.full(k, delay)) for delay in grid])
    found = []
    for j in rows.driven:
        own = choice.columns[j] & set(SHAPES)
        usual = FrictionShape(own, choice.speed[j], choice.fall(j))
        tried = [usual, *(s for names in (_RICH if free else (own,)) for s in shapes(names, usual))]
        errors = Contest(rows, choice, j, u[:, j]).errors(tried)
        best = np.argmin(np.log(errors).mean(axis=2), axis=0)
        found.append(errors[best, np.arange(errors.shape[1])] * growth[:, [j]])
    if not found:
        return np.full((0, len(grid), 1), np.inf)
    return np.stack([np.broadcast_to(one, (len(grid), one.shape[1])) for one in found])


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
                text = f"added {words}; the geometric mean of the held-out errors falls by "
                text += f"{fall:.0f} %"
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


class Delays(NamedTuple):
    """How exact the delays are."""

    deviation: Array  # (k,) standard deviations [s]; joints with one delay share it

    def ends(self, delay: Array) -> list[tuple[float, float]]:
        """The 95 % interval of every delay (k,) [s]; of one that is not negative it is causal."""
        half = _QUANTILE * self.deviation
        low = np.where(delay >= 0, np.maximum(delay - half, 0.0), delay - half)
        return list(zip(low.tolist(), (delay + half).tolist(), strict=True))


def with_exact_delays(rows: JointRows, choice: Choice) -> tuple[Choice, Delays]:
    """The choice with delays corrected by the physical fit of all joints, and how exact they are.

    A delay acts on the rows as one more parameter, whose column is the command's rate. Joints with
    one delay keep it together. Residuals are correlated: the variance comes from the scores summed
    over parts of the log, as in `inflation`.
    """
    values, group = np.unique(choice.delay, return_inverse=True)
    group = group.reshape(-1)
    start = None
    deviation = np.full(len(values), np.inf)
    for _ in range(_STEPS):
        problem = rows.problem(replace(choice, delay=values[group]))
        fit = minimise(problem, start=start)
        start = fit.theta
        step, deviation = _delay_step(rows, problem, fit, values, group)
        values = values + np.clip(step, -_LONGEST, _LONGEST)
        if np.abs(step).max() < _EXACT:
            break
    return replace(choice, delay=values[group]), Delays(deviation[group])


def causal(rows: JointRows, choice: Choice, delays: Delays) -> tuple[Choice, list[Finding]]:
    """The choice with no command that acts before it was recorded, and the delays in words.

    A delay that may be 0 is 0 where it came out negative. One that cannot be is the offset between
    the clocks, or the latency, of two measurements, and is called so.
    """
    low, high = np.array(delays.ends(choice.delay)).T
    delay = np.where((choice.delay < 0) & (high >= 0), 0.0, choice.delay)
    choice = replace(choice, delay=delay)
    found = []
    driven = rows.recordings.driven(rows.robot)  # others have no command
    names = [rows.robot.joints[j] for j in driven]
    low = low[driven]
    high = high[driven]
    delay = delay[driven]
    early = delay < 0
    data = dict(zip(names, delay.tolist(), strict=True))
    ends = f"95 %: {_ms(low[0], 2)} to {_ms(high[0], 2)} ms"
    alike = np.ptp(delay) < 1e-9
    if early.any():
        who = "all commands" if early.all() else "commands"
        size = f"{-1e3 * delay[early].min():.3g} ms"
        text = (
            f"{who} act {size} before they were recorded ({ends}), which is no delay but an offset "
            "between the clocks of commands and positions, or a filter of measured commands; it "
            "was used"
        )
        remedy = (
            f"Set `offset = {delay[early].min():.4g}` for the file of the commands in the map, or "
            "record commands that no filter delays."
        )
        where = "" if early.all() else ", ".join(np.array(names)[early].tolist())
        found.append(Finding("warning", "clock_offset", where, text, remedy, dict(data)))
    text = f"commands act {_ms(delay[0])} ms after they were recorded ({ends})"
    if not alike or early.any():
        each = ", ".join(f"{name} {_ms(d)}" for name, d in data.items())
        text = f"delays of the commands relative to the log [ms]: {each}"
    found.append(Finding("note", "delay", "", text, data=dict(data)))
    return choice, found


def _delay_step(
    rows: JointRows, problem: FitProblem, fit: Fit, values: Array, group: Indices
) -> tuple[Array, Array]:
    """(G,) Gauss–Newton step of G groups' delays [s] about a fit, and their standard deviations.

    values (G,) are the delays at which the problem was made, group (k,) that of each joint.
    """
    delay = values[group]
    late, early = (rows.commands(delay + h) for h in (_FINE, -_FINE))
    rate = (early - late) / (2 * _FINE)  # of the command after its delay
    at = problem.space.actuators
    residual = np.where(problem.usable, problem.residual(fit.theta), 0.0)
    size = np.sqrt(np.maximum(mean_squares(residual, problem.usable), 1e-300))
    Z = np.zeros((*residual.shape, len(values)))
    for gain, j in zip(fit.theta[at], rows.driven, strict=True):
        Z[:, j, group[j]] = gain * rate[:, j] / size[j]
    Z *= problem.usable[:, :, None]
    Y = problem.Y.copy()
    for gain, index, j in zip(fit.theta[at], at, rows.driven, strict=True):
        Y[:, j, index] -= residual[:, j] / gain  # errors are relative to the command, see `fit`
    Y *= (problem.usable / size)[:, :, None]
    free = np.flatnonzero(~problem.known)
    Y = Y[:, :, free]
    prior = information(problem, gramians(problem), fit.theta)[1][np.ix_(free, free)]
    hessian = np.einsum("nip,niq->pq", Y, Y, optimize=True) + prior
    unit = 1 / np.sqrt(np.diag(hessian))
    across = unit[:, None] * np.einsum("nip,nig->pg", Y, Z)
    inner = np.linalg.lstsq(hessian * np.outer(unit, unit), across, rcond=None)[0]
    moved = unit[:, None] * inner
    Z = Z - np.einsum("nip,pg->nig", Y, moved)
    told = np.einsum("nig,nih->gh", Z, Z)
    scores = np.einsum("nig,ni->ng", Z, residual / size)
    starts = np.arange(0, len(scores), -(-len(scores) // _BLOCKS))
    blocks = np.add.reduceat(scores, starts, axis=0)
    inverse = np.linalg.pinv(told, hermitian=True)
    step = -inverse @ scores.sum(axis=0)
    blocks = blocks - blocks.mean(axis=0)
    spread = blocks.T @ blocks * len(starts) / max(len(starts) - 1, 1)
    variance = np.diag(inverse @ spread @ inverse)
    least = _CLOCK / rows.recordings.rate
    return step, np.hypot(np.sqrt(np.maximum(variance, np.diag(inverse))), least)


def _ms(delay: float, digits: int = 1) -> str:
    """A delay [s] in milliseconds; never −0.0."""
    return f"{round(delay * 1e3, digits) + 0.0:.{digits}f}"
