"""The structure of a tree of joints, chosen from its log."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..parameters import Array
from .checks import fit_checks
from .data import Recordings, RobotModel
from .joints import BASIC, SPEEDS, JointRows
from .selection import choose
from .smoothing import filter_for
from .structure import Options, Structured, Velocity

_STATED, _GUESSED, _NOMINAL = 0.15, 2.0, 0.3
# standard deviations of log k: of a command stated in N or N·m (tolerance of torque constants and
# losses of gears), of one in unknown units, of a gain from the model file
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
    chosen = filter_for(recordings, options.cutoff)
    rows = JointRows(robot, recordings, chosen, np.ones(len(robot.joints)))
    gain, spread = expected_gains(robot, rows, recordings.command_units)
    rows.gain = gain
    told("choosing columns and delays")
    choice, notes = choose(rows, options.coupled, options.delay, options.columns)
    faults = fit_checks(rows, choice)
    checked = None
    if validation is not None:
        at = filter_for(validation, chosen.cutoff)
        checked = JointRows(robot, validation, at, gain).problem(choice, gain, spread)
    basic = None
    if any(columns != BASIC for columns in choice.columns):
        simple = replace(choice, columns=(BASIC,) * len(robot.joints))
        basic = rows.problem(simple, gain, spread)
    return Structured(
        rows.problem(choice, gain, spread),
        gain,
        spread,
        basic,
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
    )


def expected_gains(
    robot: RobotModel, rows: JointRows, units: tuple[str, ...]
) -> tuple[Array, Array]:
    """(k,) gains expected beforehand, and (k,) standard deviations of their logarithms.

    A command in N or N·m has the gain of the model file, usually 1. In any other unit the gain is
    guessed from the torque that the model's inertias need for the motion; as a wrist's friction may
    be far larger than that, no joint's guess is below a tenth of the largest.
    """
    inertial = np.concatenate(
        [robot.model.inertias[i].toDynamicParameters() for i in range(1, robot.model.njoints)]
    )
    counts = np.maximum(rows.usable.sum(axis=0), 1)

    def rms(x: Array) -> Array:
        return np.sqrt(np.sum((x * rows.usable) ** 2, axis=0) / counts)

    u = rms(rows.commands(np.zeros(len(robot.joints))))
    guess = rms(rows.links @ inertial) / np.maximum(u, 1e-12)
    guess = np.maximum(guess, _WEAKER * guess.max())
    stated = np.array([unit in ("N·m", "N") for unit in units])
    nominal = ~stated & (robot.gain != 1)
    gain = np.where(stated | nominal, robot.gain, guess)
    return gain, np.where(stated, _STATED, np.where(nominal, _NOMINAL, _GUESSED))
