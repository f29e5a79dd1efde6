"""The structure of a tree of joints, chosen from its log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..parameters import Array
from ..systems.optional import pin
from .checks import fit_checks, reversed_commands, unit_checks
from .data import Recordings, RobotModel
from .findings import Finding
from .fit import minimise
from .joints import BASIC, SPEEDS, Choice, JointRows
from .problem import Problem
from .selection import choose, refined
from .smoothing import filter_for
from .smoothing import refined as finer
from .structure import Options, Structured, Velocity
from .suspects import arm_suspects

_STATED, _GUESSED, _NOMINAL = 0.15, 2.0, 0.3
# standard deviations of log k: of a command stated in N or N·m (tolerance of torque constants and
# losses of gears), of one in unknown units, of a gain from the model file
_DOUBT = 4.0  # formal deviations of the delays that count as one: residuals are correlated
_NARROWER = 0.6  # another plausible cut-off over the chosen one
_WEAKER = 0.1  # least guess of a joint's gain over the largest


def structured_arm(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    told: Callable[[str], None],
) -> Structured:
    """Chooses columns and delays of every joint and makes the rows of the fit.

    Args:
        robot: a tree of joints with a motor on each.
        recordings: training logs.
        validation: a log that takes no part in the fit, or None.
        options: of the structure.
        told: called with the name of every stage.
    """
    told("filtering")
    recordings = finer(recordings)
    validation = None if validation is None else finer(validation)
    chosen = filter_for(recordings, options.cutoff)
    rows = JointRows(robot, recordings, chosen, np.ones(len(robot.joints)))
    if robot.weightless:
        rows.robot = robot = _weighed(robot, rows, recordings.command_units)
    gain, spread, doubts = expected_gains(robot, rows, recordings.command_units)
    rows.gain = gain
    told("choosing columns and delays")
    choice, notes = choose(rows, options.coupled, options.delay, options.columns)

    def problem_of(choice: Choice) -> Problem:
        return rows.problem(choice, gain, spread)

    problem, faults = problem_of(choice), fit_checks(rows, choice)
    faults = [*doubts, *faults]
    if not _refused(faults):
        faults += reversed_commands(rows, choice, problem)
    others: list[Problem] = []
    if not _refused(faults):
        told("fitting delays")
        if any("load" in columns for columns in choice.columns):
            rows.reweigh(minimise(problem).theta[: 10 * (robot.model.njoints - 1)])
        if options.delay is None:
            choice, doubt, note = refined(choice, problem_of, robot.joints)
            notes.append(note)
            others.append(problem_of(replace(choice, delay=choice.delay + _DOUBT * doubt)))
        problem = problem_of(choice)
        others += [problem_of(other) for other in _others(choice)]
        narrow = filter_for(recordings, _NARROWER * chosen.cutoff)
        others.append(JointRows(robot, recordings, narrow, gain).problem(choice, gain, spread))
    checked = None
    if validation is not None:
        at = filter_for(validation, chosen.cutoff)
        checked = JointRows(robot, validation, at, gain).problem(choice, gain, spread)
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
        (*notes, *faults),
        chosen.cutoff,
        lambda theta: arm_suspects(rows, choice, problem, theta),
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
    inertial = np.concatenate(
        [robot.model.inertias[i].toDynamicParameters() for i in range(1, robot.model.njoints)]
    )
    counts = np.maximum(rows.usable.sum(axis=0), 1)

    def rms(x: Array) -> Array:
        return np.sqrt(np.sum((x * rows.usable) ** 2, axis=0) / counts)

    return rms(rows.links @ inertial), rms(rows.commands(np.zeros(len(robot.joints))))


def expected_gains(
    robot: RobotModel, rows: JointRows, units: tuple[str, ...]
) -> tuple[Array, Array, list[Finding]]:
    """(k,) gains expected beforehand, (k,) deviations of their logarithms, and doubts of the units.

    A command in N or N·m has the gain of the model file, usually 1. In any other unit the gain is
    guessed from the torque that the model's inertias need for the motion; as a wrist's friction may
    be far larger than that, no joint's guess is below a tenth of the largest.
    """
    torque, u = _sizes(robot, rows)
    guess = torque / np.maximum(u, 1e-12)
    guess = np.maximum(guess, _WEAKER * guess.max())
    stated = np.array([unit in ("N·m", "N") for unit in units])
    nominal = ~stated & (np.abs(robot.gain) != 1)
    gain = np.where(stated | nominal, np.abs(robot.gain), guess)
    spread = np.where(stated, _STATED, np.where(nominal, _NOMINAL, _GUESSED))
    return gain, spread, unit_checks(torque, gain * u, units)
