"""Checks that need a fit: reversed and swapped commands, wrong units, a wrong structure."""

from dataclasses import replace

import numpy as np
import scipy

from ..parameters import Array
from ..robot.findings import Finding
from .fit import minimise
from .joints import Choice, JointRows
from .problem import Problem
from .selection import held_out_errors, joint_columns, rms

_SWAPPED = 0.7  # ratio of held-out errors below which another command fits a joint better
_POOR = 0.5  # NRMSE above which a joint's motion is not explained
_NOTHING = 0.9  # NRMSE above which a command hardly affects the motion, whatever its sign
_LIKELIER = 10.0  # fall of the cost that convicts a reversed command
_UNIT = 20.0  # ratio of stated to needed forces that suggests another unit
_FRICTION = frozenset({"viscous", "coulomb", "load", "quadratic", "cubic"})
_ENOUGH = 50.0  # rows per second from which stated intervals hold
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
    names, counts = rows.robot.joints, rows.usable.sum(axis=0).tolist()
    needed = [int(_ROWS * (10 + len(columns))) for columns in choice.columns]
    short = [j for j in range(len(names)) if counts[j] < needed[j]]
    level = "warning" if len(short) < len(names) else "refusal"
    remedy = "Record a longer motion of this joint; until then its parameters are guesses."
    found = []
    for j in short:
        text = f"it moves in only {counts[j]} independent rows; {needed[j]} are needed"
        data = {"rows": counts[j], "needed": needed[j]}
        found.append(Finding(level, "short_log", names[j], text, remedy, data))
    return [*found, *_swapped(rows, choice, rows.commands(choice.delay), names, short)]


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


def reversed_commands(rows: JointRows, choice: Choice, problem: Problem) -> list[Finding]:
    """Commands against which friction would do positive work.

    Candidates come from least squares of each joint's own row; a command is reported if the
    physical fit, with structure `choice`, is better with −u.
    """
    u, names = rows.commands(choice.delay), rows.robot.joints
    gains = zip(rows.driven, problem.space.actuators, strict=True)
    suspects = [(j, at) for j, at in gains if _driven_by_friction(rows, choice, u[:, j], j)]
    if not suspects:
        return []
    findings, own = [], minimise(problem).cost
    for j, at in suspects:
        Y = problem.Y.copy()
        Y[:, :, at] *= -1
        turned = replace(problem, Y=Y)
        fit = minimise(turned)
        explained = turned.nrmse(fit.theta)[j] < _NOTHING
        if explained and fit.cost < own - _LIKELIER:
            text = (
                "the sign of its command seems to be reversed: as it is, friction would have to "
                "drive the motion, and −u fits"
            )
            remedy = f"Set `sign = -1` for the command of {names[j]} in the map."
            data = {"cost": own, "cost_reversed": fit.cost}
            findings.append(Finding("refusal", "reversed_sign", names[j], text, remedy, data))
    return findings


def _driven_by_friction(rows: JointRows, choice: Choice, u: Array, joint: int) -> bool:
    """Whether least squares of a joint's row yields friction that accelerates."""
    usable = rows.usable[:, joint]
    if not usable.any():
        return False
    kinds = sorted(choice.columns[joint] & _FRICTION)
    friction = np.column_stack([rows.column(c, joint, choice)[usable] for c in kinds])
    friction = friction / np.maximum(np.sqrt(np.mean(friction**2, axis=0)), 1e-300)
    without = replace(choice, columns=tuple(columns - _FRICTION for columns in choice.columns))
    others = joint_columns(rows, without, joint)[usable]
    A = np.hstack([friction, others])
    ridge = 1e-2 * np.sqrt(len(A)) * np.eye(A.shape[1])
    target = np.concatenate([u[usable], np.zeros(len(ridge))])
    beta = np.linalg.lstsq(np.vstack([A, ridge]), target, rcond=None)[0]
    speed = rows.diagonal["viscous"][usable, joint]
    return float(np.mean((friction @ beta[: len(kinds)]) * np.sign(speed))) < 0


def unit_checks(torque: Array, force: Array, units: tuple[str, ...]) -> list[Finding]:
    """Compares commands stated in N or N·m with the model's inverse dynamics.

    `torque` (k,) is the rms of the forces of the model's inertias and weight along the motion,
    `force` (k,) that of the stated forces.
    """
    stated = [j for j, unit in enumerate(units) if unit in ("N·m", "N")]
    if not stated or not (torque > 0).any():
        return []
    ratio = float(np.linalg.norm(force[stated]) / np.linalg.norm(torque[stated]))
    if 1 / _UNIT < ratio < _UNIT:
        return []
    text = (
        f"the commands, stated in {units[stated[0]]}, are {ratio:.2g} times the forces that the "
        "model needs for this motion"
    )
    remedy = "Check the command's unit in the map (mA, %, or raw counts?), and the model's masses."
    return [Finding("refusal", "unit", "", text, remedy, {"ratio": ratio})]


def structure_checks(names: tuple[str, ...], held_out: Array) -> list[Finding]:
    """Joints whose motion the structure does not explain."""
    text = (
        "the structure does not explain this motion: held-out NRMSE {:.0f} %, where predicting the "
        "mean gives 100 %"
    )
    remedy = (
        "Do not trust its parameters. Check the model's axis, the joint's columns in the map, "
        "contacts, and couplings."
    )
    pairs = zip(names, held_out.tolist(), strict=True)
    return [
        Finding("warning", "unexplained", name, text.format(100 * x), remedy, {"nrmse": x})
        for name, x in pairs
        if x >= _POOR
    ]
