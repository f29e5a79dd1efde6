"""Columns without names, told apart by their values.

A file without a header often has its columns in blocks, one column for each joint: positions,
velocities, torques. A block whose integrals over time are another block is its velocities; blocks
that are neither may be the commands.
"""

import re
from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from ...core import Array
from .mapping import Quantity
from .tables import LogTable

_UNNAMED = re.compile(r"column_(\d+)")  # what the reader calls the columns of such a file
_INTEGRAL = 0.98  # share of a position's variance that the integral of its velocity explains
_MOST = 4000  # rows that are compared, at most

Groups = dict[str, dict[str, str]]
"""Columns by joint, of every block that could be a quantity; by the block's first and last."""


def unnamed(tables: Sequence[LogTable], joints: Sequence[str]) -> dict[Quantity, Groups]:
    """For each quantity the blocks of unnamed columns that could be it, in the order of the joints.

    Empty where columns have names, and where no block is the velocity of another.
    """
    table = tables[0]
    names = list(table.channels)
    numbers = [_UNNAMED.fullmatch(name) for name in names]
    if not all(numbers):
        return {}
    k = len(joints)
    at = [int(number[1]) for number in numbers if number]
    starts = [i for i in range(len(at) - k + 1) if at[i + k - 1] - at[i] == k - 1]
    pairs = list(_moving(table, names, k, starts))
    rates = {j for _, j in pairs}
    pairs = [(i, j) for i, j in pairs if i not in rates]  # not a velocity and its acceleration
    if not pairs:
        return {}
    taken = {i + m for pair in pairs for i in pair for m in range(k)}
    taken |= {j + m for j in rates for m in range(k)}
    free = [i for i in range(len(names)) if i not in taken]
    blocks: dict[Quantity, list[int]] = {
        "position": list(dict.fromkeys(i for i, _ in pairs)),
        "velocity": list(dict.fromkeys(j for _, j in pairs)),
        "command": [i for i in free[::k] if i in starts and {*range(i, i + k)} <= {*free}],
    }
    return {quantity: _groups(names, own, joints) for quantity, own in blocks.items()}


def _moving(
    table: LogTable, names: Sequence[str], k: int, starts: Sequence[int]
) -> Iterator[tuple[int, int]]:
    """Pairs of blocks, by their first columns, the second of which is the first one's velocity."""
    channel = table.channels[names[0]]
    order = np.argsort(channel.t, kind="stable")
    X = np.column_stack([table.channels[name].values for name in names])[order]
    t = channel.t[order]
    whole = np.isfinite(X).all(axis=1) & np.isfinite(t)
    X = X[whole]
    t = t[whole]
    if len(t) < 10:
        return
    thin = slice(None, None, max(1, len(t) // _MOST))
    line = np.column_stack([np.ones_like(t), t])[thin]
    integrals = _without(line, scipy.integrate.cumulative_trapezoid(X, t, axis=0, initial=0)[thin])
    values = _without(line, X[thin])
    size = np.linalg.norm(values, axis=0)
    moves = X.std(axis=0) > 0
    unit = np.linalg.norm(integrals, axis=0)
    scale = np.maximum(size[:, None] * unit[None, :], 1e-300)
    alike = values.T @ integrals / scale  # [i, j]: correlation of column i with the integral of j
    for i in starts:
        for j in starts:
            columns = [m for m in range(k) if moves[i + m] or moves[j + m]]
            if abs(i - j) < k or not columns:
                continue
            if all(alike[i + m, j + m] > np.sqrt(_INTEGRAL) for m in columns):
                yield i, j


def _without(line: Array, x: Array) -> Array:
    """x (N, c) without what the columns of `line` (N, 2) explain: an offset, and a drift."""
    return x - line @ np.linalg.lstsq(line, x, rcond=None)[0]


def _groups(names: Sequence[str], starts: Sequence[int], joints: Sequence[str]) -> Groups:
    found = {}
    for i in starts:
        own = names[i : i + len(joints)]
        found[f"{own[0]} to {own[-1]}"] = dict(zip(joints, own, strict=True))
    return found


def unnamed_in_words(found: dict[Quantity, Groups]) -> str:
    """What the columns' values tell, in a sentence."""
    position = " or ".join(found["position"])
    velocity = " or ".join(found["velocity"])
    text = f"The columns have no names. Integrated over time, {velocity} are {position}, so these "
    text += "are taken for velocities and positions, in the order of the joints"
    if found["command"]:
        text += f"; the torque or current may be {' or '.join(found['command'])}"
    return text + "."
