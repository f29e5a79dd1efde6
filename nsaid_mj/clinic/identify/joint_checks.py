"""A tree of joints: its gains guessed from the log, and checks that need a fit.

These find swapped commands, wrong units, and too few rows.
"""

from dataclasses import replace

import numpy as np
import scipy

from ...base import Finding
from ...core import Array
from ...robots import RobotModel, with_inertias
from .choose.columns import BROAD, Choice
from .choose.held_out import held_out_errors, rms
from .joints import JointRows
from .links import file_links
from .problem import mean_squares

STATED = 0.15
GUESSED = 2.0
NOMINAL = 0.3
# standard deviations of log k: of a command stated in N or N·m (tolerance of torque constants and
# losses of gears), of one in unknown units, of a gain from the model file
_SHARE = 0.05  # share of a command below which the torque of the model's links is not visible in it
_WEAKER = 0.1  # least guess of such a joint's gain, relative to the largest


def weighed_links(rows: JointRows) -> RobotModel:
    """A robot without masses, its guessed inertias scaled to the forces that the log states."""
    robot = rows.robot
    torque, u = _sizes(rows)
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
    own = np.abs(rows.robot.gain)
    units = rows.recordings.command_units
    torque, u = _sizes(rows)
    guess = _guessed(rows, rows.commands(np.zeros(len(own)) if choice is None else choice.delay))
    stated = np.array([unit in ("N·m", "N") for unit in units])
    nominal = ~stated & (own != 1)
    gain = np.where(stated | nominal, own, guess)
    spread = np.where(stated, STATED, np.where(nominal, NOMINAL, GUESSED))
    found = []
    checkable = stated.any() and (torque > 0).any()
    ratio = np.linalg.norm((gain * u)[stated]) / np.linalg.norm(torque[stated]) if checkable else 1
    if not 1 / _UNIT < ratio < _UNIT:
        text = (
            f"the commands, stated in {units[int(np.argmax(stated))]}, are {ratio:.2g} times the "
            "forces that the model needs for this motion"
        )
        remedy = "Check the command's unit in the map (mA, %, or raw counts?), and the model's "
        remedy += "masses."
        found.append(Finding("refusal", "unit", "", text, remedy, {"ratio": float(ratio)}))
    return gain, spread, found


def _guessed(rows: JointRows, commands: Array) -> Array:
    """(k,) gains of commands (N, k), from the share of the model's link torques in each command.

    A command is regressed on this torque, acceleration, viscous and Coulomb friction, and a
    constant of either sign, none of them negative. If a joint stands still, or its command does not
    depend on the torque of its links, their share is taken as a twentieth, and its gain as at least
    a tenth of the largest.
    """
    force = rows.links @ file_links(rows.robot.model)
    k = commands.shape[1]
    found = np.full(k, 1e-12)
    unseen = np.ones(k, dtype=bool)
    for j in range(k):
        use = rows.usable[:, j]
        one = np.ones(len(commands))
        columns = [
            force[:, j],
            rows.diagonal["rotor"][:, j],
            rows.diagonal["viscous"][:, j],
            rows.diagonal["coulomb"][BROAD][:, j],
            one,
            -one,
        ]
        X = np.column_stack(columns)[use]
        y = commands[use, j]
        if not len(y) or not y.std() > 0:
            continue
        size = np.maximum(np.sqrt(np.mean(X**2, axis=0)), 1e-12)
        share = float(scipy.optimize.nnls(X / size, y / y.std())[0][0])
        unseen[j] = share < _SHARE
        found[j] = size[0] / y.std() / max(share, _SHARE)
    return np.where(unseen, np.maximum(found, _WEAKER * found.max()), found)


_SWAPPED = 0.7  # ratio of held-out errors below which another command fits a joint better
_UNIT = 20.0  # ratio of stated to needed forces that suggests another unit
_ENOUGH = 50.0  # rows per second from which stated intervals hold
_DEPENDENT = 1e-6  # singular value, over the largest, of a combination that does not act
_ROWS = 3.0  # usable rows per column that a joint needs


def rate_checks(rate: float) -> list[Finding]:
    """Checks the sampling rate; limits were measured on simulated arms (docs/results.md)."""
    if rate >= _ENOUGH:
        return []
    text = f"the log has only {rate:.3g} rows per second; friction and commands change in between"
    remedy = f"Record at {_ENOUGH:.0f} Hz or more, preferably at 100 Hz."
    return [Finding("warning", "low_rate", "", text, remedy, {"rate": rate})]


def fit_checks(rows: JointRows, choice: Choice) -> list[Finding]:
    """Finds too few rows, and swapped commands, by least squares of each joint's own row."""
    names = rows.robot.joints
    counts = rows.usable.sum(axis=0).tolist()
    needed = [
        int(_ROWS * (min(10, _rank(rows, j)) + len(columns)))
        for j, columns in enumerate(choice.columns)
    ]
    own = rows.robot.independent
    short = [j for j in own if counts[j] < needed[j]]
    level = "warning" if len(short) < len(own) else "refusal"
    remedy = "Record a longer motion of this joint; until then its parameters are guesses."
    found = []
    for j in short:
        text = f"it moves in only {counts[j]} independent rows; {needed[j]} are needed"
        data = {"rows": counts[j], "needed": needed[j]}
        found.append(Finding(level, "short_log", names[j], text, remedy, data))
    return [*found, *_swapped(rows, choice, rows.commands(choice.delay), names, short)]


def _rank(rows: JointRows, joint: int) -> int:
    """How many combinations of the links' parameters act on a joint: 3 on a pendulum."""
    own = rows.links[rows.usable[:, joint], joint]
    return int(np.linalg.matrix_rank(own, rtol=_DEPENDENT)) if len(own) else 10


def _swapped(
    rows: JointRows, choice: Choice, u: Array, names: tuple[str, ...], short: list[int]
) -> list[Finding]:
    """Commands that explain another joint's motion much better than their own."""
    driven = rows.driven
    errors = np.array(
        [[rms(held_out_errors(rows, choice, u[:, c], j)) for c in driven] for j in driven]
    )
    names = tuple(names[j] for j in driven)
    short = [place for place, j in enumerate(driven) if j in short]
    errors[short] = np.where(np.eye(len(driven), dtype=bool)[short], 1e-3, 2.0)
    own = np.diag(errors)
    _, best = scipy.optimize.linear_sum_assignment(np.log(np.minimum(errors, 2.0) + 1e-9))
    moved = [j for j in range(len(driven)) if best[j] != j]
    change = np.log(errors[moved, best[moved]] / own[moved])
    if not moved or change.mean() > np.log(_SWAPPED) or change.max() >= 0:
        return []  # a swap helps both
    better = {names[j]: names[best[j]] for j in moved}
    words = ", ".join(f"{joint} the command of {other}" for joint, other in better.items())
    before, after = (
        ", ".join(f"{100 * value:.0f} %" for value in values)
        for values in (own[moved], errors[moved, best[moved]])
    )
    text = (
        f"the commands seem to be swapped: a better fit gives {words} "
        f"(held-out NRMSE {before} → {after})"
    )
    remedy = "Correct the columns of u in the map."
    return [Finding("refusal", "swapped", ", ".join(better), text, remedy, {"columns": better})]
