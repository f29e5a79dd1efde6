"""Checks that need a fit: reversed and swapped commands, wrong units, a structure that is wrong."""

from __future__ import annotations

import numpy as np
import scipy.optimize

from ..parameters import Array
from .data import RobotModel
from .findings import Finding
from .joints import Choice, JointRows
from .selection import held_out_errors, joint_columns

_SWAPPED = 0.7  # ratio of held-out errors below which another command fits a joint better
_POOR = 0.5  # NRMSE above which a joint's motion is not explained
_UNIT = 100.0  # ratio of an identified to an expected gain that suggests another unit
_ROWS = 3.0  # usable rows per column that a joint needs


def fit_checks(rows: JointRows, choice: Choice) -> list[Finding]:
    """Faults of single commands, by least squares of each joint's own row."""
    names, u = rows.robot.joints, rows.commands(choice.delay)
    findings = [f for j, name in enumerate(names) for f in _short(rows, choice, j, name)]
    if findings:
        return findings
    return [*_swapped(rows, choice, u, names), *_reversed(rows, choice, u, names)]


def _short(rows: JointRows, choice: Choice, joint: int, name: str) -> list[Finding]:
    """Whether a joint has too few usable rows."""
    count = int(rows.usable[:, joint].sum())
    needed = int(_ROWS * (10 + len(choice.columns[joint])))
    if count >= needed:
        return []
    return [
        Finding(
            "refusal",
            "short_log",
            name,
            f"only {count} independent rows in which it moves; at least {needed} are needed",
            "Record a longer motion of this joint, or lock it (`--lock`).",
            {"rows": count, "needed": needed},
        )
    ]


def _swapped(rows: JointRows, choice: Choice, u: Array, names: tuple[str, ...]) -> list[Finding]:
    """Commands that explain another joint's motion much better than their own."""
    k = len(names)
    errors = np.array(
        [[_mean(held_out_errors(rows, choice, u[:, c], j)) for c in range(k)] for j in range(k)]
    )
    own = np.diag(errors)
    _, best = scipy.optimize.linear_sum_assignment(np.log(np.minimum(errors, 2.0) + 1e-9))
    moved = [j for j in range(k) if best[j] != j]
    if not moved or np.mean(np.log(errors[moved, best[moved]] / own[moved])) > np.log(_SWAPPED):
        return []
    words = ", ".join(f"{names[j]} by the command of {names[best[j]]}" for j in moved)
    return [
        Finding(
            "refusal",
            "swapped",
            ", ".join(names[j] for j in moved),
            f"commands seem to be swapped: the motion is explained better for {words} "
            f"(held-out NRMSE {_figures(own[moved])} → {_figures(errors[moved, best[moved]])})",
            "Correct the columns of u in the map.",
            {"columns": {names[j]: names[best[j]] for j in moved}},
        )
    ]


def _reversed(rows: JointRows, choice: Choice, u: Array, names: tuple[str, ...]) -> list[Finding]:
    """Commands against which friction would do positive work."""
    findings = []
    for j, name in enumerate(names):
        usable = rows.usable[:, j]
        X, y = joint_columns(rows, choice, j)[usable], u[usable, j]
        friction = np.column_stack(
            [rows.column(c, j, choice)[usable] for c in ("viscous", "coulomb")]
        )
        friction = friction / np.maximum(np.sqrt(np.mean(friction**2, axis=0)), 1e-300)
        # the part of the command along friction, with everything else free to take its share
        others = X - friction @ np.linalg.lstsq(friction, X, rcond=None)[0]
        keep = np.linalg.norm(others, axis=0) > 1e-6 * np.sqrt(len(y))
        A = np.hstack([friction, others[:, keep]])
        ridge = 1e-3 * np.sqrt(len(y)) * np.eye(A.shape[1])
        beta = np.linalg.lstsq(
            np.vstack([A, ridge]), np.concatenate([y, np.zeros(len(ridge))]), rcond=None
        )[0]
        speed = rows.diagonal["viscous"][usable, j]
        work = float(np.mean((friction @ beta[:2]) * np.sign(speed)))
        residual = float(np.std(y - A @ beta))
        if work < 0 and -work > 0.05 * float(np.std(y)) and -work > 0.5 * residual:
            findings.append(
                Finding(
                    "refusal",
                    "reversed_sign",
                    name,
                    "friction would drive the motion: the command seems to be reversed (it fits "
                    "with −u)",
                    f"Set `sign = -1` for the command of {name} in the map.",
                    {"work": work},
                )
            )
    return findings


def gain_checks(robot: RobotModel, gain: Array, expected: Array, units: tuple[str, ...]):
    """Gains that suggest another unit of the command.

    Args:
        robot: the model.
        gain: (k,) identified gains.
        expected: (k,) expected gains where the unit is stated.
        units: of the commands; "" where unknown.
    """
    findings = []
    for j, name in enumerate(robot.joints):
        ratio = gain[j] / expected[j]
        if units[j] and not 1 / _UNIT < ratio < _UNIT:
            findings.append(
                Finding(
                    "refusal",
                    "unit",
                    name,
                    f"the identified gain is {ratio:.2g} times what a command in {units[j]} "
                    "suggests",
                    "Check the command's unit in the map (mA instead of A, % or raw counts).",
                    {"ratio": float(ratio)},
                )
            )
    return findings


def structure_checks(names: tuple[str, ...], held_out: Array) -> list[Finding]:
    """Joints whose motion the structure does not explain."""
    return [
        Finding(
            "warning",
            "unexplained",
            name,
            f"the structure does not explain this joint's motion: held-out NRMSE {value:.2f}, "
            "where predicting the mean has 1",
            "Its parameters are not to be trusted. Check the model's axis, the joint's columns in "
            "the map, contacts, and couplings.",
            {"nrmse": float(value)},
        )
        for name, value in zip(names, held_out, strict=True)
        if not value < _POOR
    ]


def _mean(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _figures(values: Array) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
