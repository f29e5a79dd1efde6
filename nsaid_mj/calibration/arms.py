"""The structure of a tree of joints, chosen from its log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from ..parameters import Array
from ..structure.optional import pin
from .checks import fit_checks, rate_checks, reversed_commands, unit_checks
from .data import Recordings, RobotModel
from .findings import Finding
from .fit import minimise
from .joints import BASIC, BROAD, SPEEDS, Choice, JointRows
from .links import file_links
from .problem import Problem
from .residuals import Suspect
from .selection import choose, refined, with_constants
from .smoothing import Filter, filter_for, twice_as_noisy
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
    told: Callable[[str], None],
) -> Structured:
    """Chooses columns and delays of every joint and makes the rows of the fit.

    `robot` is a tree of joints with a motor on each, `recordings` are training logs, `validation`
    is a log that takes no part in the fit, or None; `told` is called with the name of every stage.
    """
    told("filtering")
    slow, measured, recordings = rate_checks(recordings.rate), recordings, finer(recordings)
    validation = None if validation is None else finer(validation)
    chosen = filter_for(recordings, options.cutoff)
    rows = JointRows(robot, recordings, chosen, np.ones(len(robot.joints)), options.loads)
    if robot.weightless:
        rows.robot = robot = _weighed(robot, rows, recordings.command_units)
    gain, spread, doubts = expected_gains(robot, rows, recordings.command_units)
    rows.gain = gain
    told("choosing columns and delays")
    choice, notes = choose(rows, options.coupled, options.delay, options.columns)
    rows.gain = gain = expected_gains(robot, rows, recordings.command_units, choice)[0]

    def problem_of(choice: Choice) -> Problem:
        return rows.problem(choice, gain, spread)

    def alike(logs: Recordings, filters: Filter) -> tuple[JointRows, Problem]:
        """Another log's rows, with the same structure and weight for load friction."""
        other = JointRows(robot, logs, filters, gain, options.loads)
        other.reweigh(links)
        return other, other.problem(choice, gain, spread)

    def noisier(theta: Array) -> tuple[Problem, list[Suspect]]:
        other, again = alike(finer(twice_as_noisy(measured)), chosen)
        return again, arm_suspects(other, choice, again, theta)

    links = file_links(rows.robot.model)
    problem, faults = problem_of(choice), fit_checks(rows, choice)
    faults = [*doubts, *faults]
    if not _refused(faults):
        faults += reversed_commands(rows, choice, problem)
    others: list[Problem] = []
    if not _refused(faults):
        told("fitting delays")
        if any("load" in columns for columns in choice.columns):
            links = minimise(problem).theta[: 10 * (robot.model.njoints - 1)]
            rows.reweigh(links)
        doubt = 0.0
        if options.delay is None:
            choice, doubt, note = refined(choice, problem_of, robot.joints)
            notes.append(note)
        if options.columns is None:
            choice, said = with_constants(choice, problem_of, robot.joints, options.level)
            notes += said
        if options.delay is None:
            others.append(problem_of(replace(choice, delay=choice.delay + _DOUBT * doubt)))
        problem = problem_of(choice)
        others += [problem_of(other) for other in _others(choice)]
        narrow = filter_for(recordings, _NARROWER * chosen.cutoff)
        others.append(alike(recordings, narrow)[1])
    checked = None
    if validation is not None:
        checked = alike(validation, filter_for(validation, chosen.cutoff))[1]
    return Structured(
        problem,
        gain,
        spread,
        tuple(others),
        checked,
        tuple(
            Velocity(
                name,
                tuple(sorted(choice.columns[j])),
                SPEEDS[choice.speed[j]],
                float(choice.delay[j]),
            )
            for j, name in enumerate(robot.joints)
        ),
        (*notes, *slow, *faults),
        chosen.cutoff,
        links,
        choice.delay,
        lambda theta: arm_suspects(rows, choice, problem, theta),
        noisier,
    )


def _refused(findings: list[Finding]) -> bool:
    return any(finding.level == "refusal" for finding in findings)


def _others(choice: Choice) -> list[Choice]:
    """Other plausible structures: without further columns, and with other friction speeds."""
    found, last = [], len(SPEEDS) - 1
    if any(columns != BASIC for columns in choice.columns):
        found.append(replace(choice, columns=(BASIC,) * len(choice.columns)))
    for step in (-1, 1):
        speeds = tuple(min(max(s + step, 0), last) for s in choice.speed)
        found.append(replace(choice, speed=speeds))
    return found


def _weighed(robot: RobotModel, rows: JointRows, units: tuple[str, ...]) -> RobotModel:
    """A robot without masses, its guessed inertias scaled to the forces that the log states."""
    torque, u = _sizes(robot, rows)
    stated = np.array([unit in ("N·m", "N") for unit in units])
    if not (stated & (torque > 0)).any():
        return robot
    needed = np.abs(robot.gain[stated]) * u[stated]
    ratio = float(np.linalg.norm(needed) / np.linalg.norm(torque[stated]))
    model = pin.Model(robot.model)
    for i in range(1, model.njoints):
        own = model.inertias[i]
        model.inertias[i] = pin.Inertia(ratio * own.mass, own.lever, ratio * own.inertia)
    return replace(robot, model=model)


def _sizes(robot: RobotModel, rows: JointRows) -> tuple[Array, Array]:
    """(k,) rms of the forces of the model's inertias and weight, and (k,) of the commands."""
    counts = np.maximum(rows.usable.sum(axis=0), 1)

    def rms(x: Array) -> Array:
        return np.sqrt(np.sum((x * rows.usable) ** 2, axis=0) / counts)

    return rms(rows.links @ file_links(robot.model)), rms(
        rows.commands(np.zeros(len(robot.joints)))
    )


def expected_gains(
    robot: RobotModel, rows: JointRows, units: tuple[str, ...], choice: Choice | None = None
) -> tuple[Array, Array, list[Finding]]:
    """(k,) expected gains, (k,) deviations of their logarithms, and doubts about the units.

    A command in N or N·m has the gain of the model file, usually 1. In any other unit it is
    guessed: the motor carries the model's links, its own rotor and friction, of which a wrist's may
    be ten times what its link needs; see `_guessed`. The commands' delays are those of `choice`.
    """
    torque, u = _sizes(robot, rows)
    delay = np.zeros(len(robot.joints)) if choice is None else choice.delay
    guess = _guessed(robot, rows, rows.commands(delay))
    stated = np.array([unit in ("N·m", "N") for unit in units])
    nominal = ~stated & (np.abs(robot.gain) != 1)
    gain = np.where(stated | nominal, np.abs(robot.gain), guess)
    spread = np.where(stated, STATED, np.where(nominal, _NOMINAL, _GUESSED))
    return gain, spread, unit_checks(torque, gain * u, units)


def _guessed(robot: RobotModel, rows: JointRows, commands: Array) -> Array:
    """(k,) gains of commands (N, k), from the share of the model's link torques in them.

    A command is regressed on this torque, acceleration, viscous and Coulomb friction, and a
    constant of either sign, none of them negative. A joint whose command does not show its links
    counts them as a twentieth of it, and its gain as at least a tenth of the largest.
    """
    force = rows.links @ file_links(robot.model)
    found, unseen = np.full(len(robot.joints), 1e-12), np.zeros(len(robot.joints), dtype=bool)
    for j in range(len(robot.joints)):
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
