"""The structure of a tree of joints, chosen from its log."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import scipy

from ..logs.recordings import Recordings
from ..parameters import Array
from ..robot.findings import Finding, refused
from ..robot.identified import with_inertias
from ..robot.model import RobotModel
from .checks import fit_checks, rate_checks, reversed_commands, unit_checks
from .fit import minimise
from .joints import BASIC, BROAD, SPEEDS, Choice, JointRows
from .links import file_links
from .problem import Problem, mean_squares
from .residuals import Suspect
from .selection import choose, refined, with_constants, with_speeds
from .smoothing import filter_for, twice_as_noisy
from .smoothing import refined as finer
from .structure import Options, Structured, Velocity
from .suspects import arm_suspects

STATED, _GUESSED, _NOMINAL = 0.15, 2.0, 0.3
# standard deviations of log k: of a command stated in N or N·m (tolerance of torque constants and
# losses of gears), of one in unknown units, of a gain from the model file
_DOUBT = 4.0  # formal deviations of the delays that count as one: residuals are correlated
_NARROWER = 0.6  # another plausible cut-off over the chosen one
_SHARE = 0.05  # share of a command below which the torque of the model's links is not visible in it
_WEAKER = 0.1  # least guess of such a joint's gain, relative to the largest


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
    report("filtering")
    slow, measured, recordings = rate_checks(recordings.rate), recordings, finer(recordings)
    chosen, unknown = filter_for(recordings, options.cutoff), np.ones(len(robot.joints))
    rows = JointRows(robot, recordings, chosen, unknown, loads=options.loads)
    if robot.weightless:
        rows.robot = robot = _weighed(rows)
        rows.loading = file_links(robot.model)
    rows.gain, rows.spread, faults = expected_gains(rows)
    report("choosing columns and delays")
    choice, notes = choose(rows, options.coupled, options.delay, options.columns)
    rows.gain = expected_gains(rows, choice)[0]
    problem, others = rows.problem(choice), iter(())
    faults += fit_checks(rows, choice)
    if not refused(faults):
        faults += reversed_commands(rows, choice, problem)
    if not refused(faults):
        report("fitting delays")
        choice, doubt, said = _finished(rows, choice, problem, options)
        others = _alternatives(rows, choice, doubt)
        notes, problem = [*notes, *said], rows.problem(choice)
    checked = None
    if validation is not None:
        validation = finer(validation)
        checked = rows.like(validation, filter_for(validation, chosen.cutoff)).problem(choice)

    def noisier(theta: Array) -> tuple[Problem, Iterator[Suspect]]:
        other = rows.like(finer(twice_as_noisy(measured)), chosen)
        again = other.problem(choice)
        return again, arm_suspects(other, choice, again, theta)

    parts = zip(robot.joints, choice.columns, choice.speed, choice.delay.tolist(), strict=True)
    return Structured(
        problem,
        others,
        checked,
        tuple(Velocity(name, tuple(sorted(own)), SPEEDS[s], d) for name, own, s, d in parts),
        (*notes, *slow, *faults),
        chosen.cutoff,
        rows.loading,
        choice.delay,
        lambda theta: arm_suspects(rows, choice, problem, theta),
        noisier,
    )


def _finished(
    rows: JointRows, choice: Choice, problem: Problem, options: Options
) -> tuple[Choice, float | None, list[Finding]]:
    """The choice completed by fits of the whole structure, the deviation of its delays, and notes.

    `problem` is that of the choice so far. The deviation [s] is None for given delays.
    """
    notes, doubt = [], None
    if any("load" in columns for columns in choice.columns):
        rows.reweigh(minimise(problem).theta[: rows.links.shape[2]])
    if options.delay is None:
        choice, doubt, note = refined(rows, choice)
        notes.append(note)
    if len(rows.driven) < len(rows.robot.joints):
        choice = with_speeds(rows, choice)
    if options.columns is None:
        choice, said = with_constants(rows, choice, options.level)
        notes += said
    return choice, doubt, notes


def _alternatives(rows: JointRows, choice: Choice, doubt: float | None) -> Iterator[Problem]:
    """Other plausible problems; `doubt` is the standard deviation of the delays [s], if any."""
    trials, last = [], len(SPEEDS) - 1
    if doubt is not None:
        trials.append(replace(choice, delay=choice.delay + _DOUBT * doubt))
    if any(columns != BASIC for columns in choice.columns):
        trials.append(replace(choice, columns=(BASIC,) * len(choice.columns)))
    for step in (-1, 1):
        speeds = tuple(min(max(s + step, 0), last) for s in choice.speed)
        trials.append(replace(choice, speed=speeds))
    yield from map(rows.problem, trials)
    if (rows.spread[rows.driven] == _NOMINAL).any():  # masses may contradict the file's gains
        own = rows.problem(choice)
        at, spread = own.space.actuators, own.spread.copy()
        spread[at] = np.where(spread[at] == _NOMINAL, _GUESSED, spread[at])
        yield replace(own, spread=spread)
    narrow = filter_for(rows.recordings, _NARROWER * rows.chosen.cutoff)
    yield rows.like(rows.recordings, narrow).problem(choice)


def _weighed(rows: JointRows) -> RobotModel:
    """A robot without masses, its guessed inertias scaled to the forces that the log states."""
    robot, (torque, u) = rows.robot, _sizes(rows)
    stated = np.array([unit in ("N·m", "N") for unit in rows.recordings.command_units])
    if not (stated & (torque > 0)).any():
        return robot
    needed = np.abs(robot.gain[stated]) * u[stated]
    ratio = float(np.linalg.norm(needed) / np.linalg.norm(torque[stated]))
    model = robot.model
    return replace(robot, model=with_inertias(model, ratio * file_links(model), model.armature))


def _sizes(rows: JointRows) -> tuple[Array, Array]:
    """(k,) rms of the forces of the model's inertias and weight, and (k,) of the commands."""
    own = rows.links @ file_links(rows.robot.model), rows.commands(np.zeros(len(rows.gain)))
    torque, command = (np.sqrt(mean_squares(x, rows.usable)) for x in own)
    return torque, command


def expected_gains(
    rows: JointRows, choice: Choice | None = None
) -> tuple[Array, Array, list[Finding]]:
    """(k,) expected gains, (k,) standard deviations of their logarithms, and findings on units.

    A command in N or N·m has the gain of the model file, usually 1. In any other unit it is
    guessed: the motor drives the model's links, its rotor and friction, of which a wrist's may be
    ten times what its link needs; see `_guessed`. The commands' delays are those of `choice`.
    """
    own, units = np.abs(rows.robot.gain), rows.recordings.command_units
    torque, u = _sizes(rows)
    guess = _guessed(rows, rows.commands(np.zeros(len(own)) if choice is None else choice.delay))
    stated = np.array([unit in ("N·m", "N") for unit in units])
    nominal = ~stated & (own != 1)
    gain = np.where(stated | nominal, own, guess)
    spread = np.where(stated, STATED, np.where(nominal, _NOMINAL, _GUESSED))
    return gain, spread, unit_checks(torque, gain * u, units)


def _guessed(rows: JointRows, commands: Array) -> Array:
    """(k,) gains of commands (N, k), from the share of the model's link torques in each command.

    A command is regressed on this torque, acceleration, viscous and Coulomb friction, and a
    constant of either sign, none of them negative. If a joint stands still, or its command does not
    depend on the torque of its links, their share is taken as a twentieth, and its gain as at least
    a tenth of the largest.
    """
    force, k = rows.links @ file_links(rows.robot.model), commands.shape[1]
    found, unseen = np.full(k, 1e-12), np.ones(k, dtype=bool)
    for j in range(k):
        use, one = rows.usable[:, j], np.ones(len(commands))
        columns = [force[:, j], rows.diagonal["rotor"][:, j], rows.diagonal["viscous"][:, j],
                   rows.diagonal["coulomb"][BROAD][:, j], one, -one]  # fmt: skip
        X, y = np.column_stack(columns)[use], commands[use, j]
        if not len(y) or not y.std() > 0:
            continue
        size = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-12)
        share = float(scipy.optimize.nnls(X / size, y / y.std())[0][0])
        unseen[j] = share < _SHARE
        found[j] = size[0] / y.std() / max(share, _SHARE)
    return np.where(unseen, np.maximum(found, _WEAKER * found.max()), found)
