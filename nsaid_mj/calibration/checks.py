"""Checks that need a fit: reversed and swapped commands, wrong units, a wrong structure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from ..parameters import Array
from .findings import Finding
from .fit import minimise
from .joints import Choice, JointRows
from .problem import Problem
from .selection import held_out_errors, joint_columns

_SWAPPED = 0.7  # ratio of held-out errors below which another command fits a joint better
_POOR = 0.5  # NRMSE above which a joint's motion is not explained
_NOTHING = 0.9  # NRMSE above which a command hardly affects the motion, whatever its sign
_LIKELIER = 10.0  # fall of the cost that convicts a reversed command
_UNIT = 20.0  # ratio of stated to needed forces that suggests another unit
_FRICTION = frozenset({"viscous", "coulomb", "load", "quadratic", "cubic"})
_ENOUGH = 50.0  # rows per second from which stated intervals hold
_ROWS = 3.0  # usable rows per column that a joint needs


def rate_checks(rate: float) -> list[Finding]:
    """Whether rows come often enough, as measured on simulated arms (docs/results.md)."""
    if rate >= _ENOUGH:
        return []
    return [
        Finding(
            "warning",
            "low_rate",
            "",
            f"the log has only {rate:.3g} rows per second; friction and commands change in between",
            f"Record at {_ENOUGH:.0f} Hz or more, preferably at 100 Hz.",
            {"rate": rate},
        )
    ]


def fit_checks(rows: JointRows, choice: Choice) -> list[Finding]:
    """Finds too few rows, and swapped commands, by least squares of each joint's own row."""
    names, u = rows.robot.joints, rows.commands(choice.delay)
    short = [j for j in range(len(names)) if rows.usable[:, j].sum() < _needed(choice, j)]
    return [*_short(rows, choice, short), *_swapped(rows, choice, u, names, short)]


def _needed(choice: Choice, joint: int) -> int:
    """Usable rows that a joint needs."""
    return int(_ROWS * (10 + len(choice.columns[joint])))


def _short(rows: JointRows, choice: Choice, short: list[int]) -> list[Finding]:
    """Joints with too few usable rows: a warning each, a refusal if there are no others."""
    return [
        Finding(
            "warning" if len(short) < len(rows.robot.joints) else "refusal",
            "short_log",
            rows.robot.joints[j],
            f"it moves in only {rows.usable[:, j].sum()} independent rows; "
            f"{_needed(choice, j)} are needed",
            "Record a longer motion of this joint; until then its parameters are guesses.",
            {"rows": int(rows.usable[:, j].sum()), "needed": _needed(choice, j)},
        )
        for j in short
    ]


def _swapped(
    rows: JointRows, choice: Choice, u: Array, names: tuple[str, ...], short: list[int]
) -> list[Finding]:
    """Commands that explain another joint's motion much better than their own."""
    k = len(names)
    errors = np.array(
        [[_mean(held_out_errors(rows, choice, u[:, c], j)) for c in range(k)] for j in range(k)]
    )
    errors[short] = np.where(np.eye(k, dtype=bool)[short], 1e-3, 2.0)
    own = np.diag(errors)
    _, best = scipy.optimize.linear_sum_assignment(np.log(np.minimum(errors, 2.0) + 1e-9))
    moved = [j for j in range(k) if best[j] != j]
    change = np.log(errors[moved, best[moved]] / own[moved])
    if not moved or change.mean() > np.log(_SWAPPED) or change.max() >= 0:
        return []  # a swap helps both
    words = ", ".join(f"{names[j]} the command of {names[best[j]]}" for j in moved)
    return [
        Finding(
            "refusal",
            "swapped",
            ", ".join(names[j] for j in moved),
            f"the commands seem to be swapped: a better fit gives {words} "
            f"(held-out NRMSE {_figures(own[moved])} → {_figures(errors[moved, best[moved]])})",
            "Correct the columns of u in the map.",
            {"columns": {names[j]: names[best[j]] for j in moved}},
        )
    ]


def reversed_commands(rows: JointRows, choice: Choice, problem: Problem) -> list[Finding]:
    """Commands against which friction would do positive work.

    Joints are suspected by least squares of their own row, and convicted if the physical fit, whose
    structure is `choice`, is better with −u.
    """
    u, names = rows.commands(choice.delay), rows.robot.joints
    suspects = [j for j in range(len(names)) if _driven_by_friction(rows, choice, u[:, j], j)]
    if not suspects:
        return []
    findings, own = [], minimise(problem).cost
    for j in suspects:
        at = problem.space.actuators[j]
        Y = problem.Y.copy()
        Y[:, :, at] *= -1
        turned = replace(problem, Y=Y)
        fit = minimise(turned)
        explained = turned.nrmse(fit.theta)[j] < _NOTHING
        if explained and fit.cost < own - _LIKELIER:
            findings.append(
                Finding(
                    "refusal",
                    "reversed_sign",
                    names[j],
                    "the sign of its command seems to be reversed: as it is, friction would have "
                    "to drive the motion, and −u fits",
                    f"Set `sign = -1` for the command of {names[j]} in the map.",
                    {"cost": own, "cost_reversed": fit.cost},
                )
            )
    return findings


def _driven_by_friction(rows: JointRows, choice: Choice, u: Array, joint: int) -> bool:
    """Whether least squares of a joint's row yields friction that accelerates."""
    usable = rows.usable[:, joint]
    if not usable.any():
        return False
    kinds = sorted(choice.columns[joint] & _FRICTION)
    friction = np.column_stack([rows.column(c, joint, choice)[usable] for c in kinds])
    friction = friction / np.maximum(np.sqrt(np.mean(friction**2, axis=0)), 1e-300)
    others = joint_columns(rows, replace_columns(choice, joint), joint)[usable]
    A = np.hstack([friction, others])
    ridge = 1e-2 * np.sqrt(len(A)) * np.eye(A.shape[1])
    target = np.concatenate([u[usable], np.zeros(len(ridge))])
    beta = np.linalg.lstsq(np.vstack([A, ridge]), target, rcond=None)[0]
    speed = rows.diagonal["viscous"][usable, joint]
    return float(np.mean((friction @ beta[: len(kinds)]) * np.sign(speed))) < 0


def replace_columns(choice: Choice, joint: int) -> Choice:
    """The choice without friction columns at one joint."""
    columns = list(choice.columns)
    columns[joint] = columns[joint] - _FRICTION
    return replace(choice, columns=tuple(columns))


def unit_checks(torque: Array, force: Array, units: tuple[str, ...]) -> list[Finding]:
    """Compares commands stated in N or N·m with the forces that the model needs.

    `torque` (k,) is the rms of the forces of the model's inertias and weight along the motion,
    `force` (k,) that of the stated forces.
    """
    stated = [j for j, unit in enumerate(units) if unit in ("N·m", "N")]
    if not stated or not (torque > 0).any():
        return []
    ratio = float(np.linalg.norm(force[stated]) / np.linalg.norm(torque[stated]))
    if 1 / _UNIT < ratio < _UNIT:
        return []
    return [
        Finding(
            "refusal",
            "unit",
            "",
            f"the commands, stated in {units[stated[0]]}, are {ratio:.2g} times the forces that "
            "the model needs for this motion",
            "Check the command's unit in the map (mA, %, or raw counts?), and the model's masses.",
            {"ratio": ratio},
        )
    ]


def structure_checks(names: tuple[str, ...], held_out: Array) -> list[Finding]:
    """Joints whose motion the structure does not explain."""
    return [
        Finding(
            "warning",
            "unexplained",
            name,
            f"the structure does not explain this motion: held-out NRMSE {value:.2f}, "
            "where predicting the mean gives 1",
            "Do not trust its parameters. Check the model's axis, the joint's columns in "
            "the map, contacts, and couplings.",
            {"nrmse": float(value)},
        )
        for name, value in zip(names, held_out, strict=True)
        if value >= _POOR
    ]


def _mean(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _figures(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
