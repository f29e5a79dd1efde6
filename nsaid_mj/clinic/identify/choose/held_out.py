"""Errors of candidates on parts of the log that are predicted from the rest.

Divided by the gain, each joint's row is linear in its own columns. Those that no candidate changes,
such as the links', are eliminated once (`Contest`), after which thousands of candidates take some
milliseconds. What all joints share, such as an offset that weight could imitate, is compared by the
physical fit of all of them.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.linalg

from ....core import Array
from ..fit import cost_of, gramians, minimise
from ..joints import JointRows
from ..problem import FitProblem, folds
from .columns import FALLS, HELD, SPEEDS, Choice

_FOLDS = 5
_RIDGE = 1e-3  # of the columns' rms: a prior of 30 times a column's natural size


SHAPES = ("coulomb", "stribeck", "load", "quadratic", "cubic")
"""The columns of a joint's friction that compete with each other, and with its delay."""


class FrictionShape(NamedTuple):
    """Friction of a joint."""

    names: frozenset[str]  # of `SHAPES`
    speed: int  # index of s in `SPEEDS`
    fall: int  # index of f in `FALLS`


def shapes(names: frozenset[str], usual: FrictionShape) -> list[FrictionShape]:
    """Friction of these columns at all speeds on which they depend, else at those of `usual`.

    Stribeck friction falls at a higher speed than that at which dry friction changes its sign;
    otherwise both are viscous friction of slow motion.
    """
    fastened = bool(names & {"coulomb", "stribeck", "load"})
    speeds = range(len(SPEEDS)) if fastened else [usual.speed]
    falls = range(len(FALLS)) if "stribeck" in names else [usual.fall]
    pairs = itertools.product(speeds, falls)
    slow = "stribeck" in names
    return [FrictionShape(names, s, f) for s, f in pairs if not slow or FALLS[f] > SPEEDS[s]]


class Contest:
    """Held-out errors of one joint's friction and delays, which compete.

    All other columns of its row are eliminated once, in each fold, from the columns of every shape
    and from the command at every delay; of a candidate a system of a few columns remains.

    commands (N, D) are the joint's at D trial delays. Columns that a choice gives the joint, and
    that are none of `SHAPES`, are eliminated with the links'.
    """

    def __init__(self, rows: JointRows, choice: Choice, joint: int, commands: Array):
        usable = np.flatnonzero(rows.usable[:, joint])
        plain = choice.with_joint(
            joint, choice.columns[joint] - set(SHAPES), choice.speed[joint], choice.fall(joint)
        )
        columns, self._at = _shape_columns(rows, joint)
        columns = columns[usable]
        self._size = np.sqrt(np.mean(columns**2, axis=0)) if len(usable) else np.ones(1)
        # the least gain that is expected
        self._gain = float(rows.gain[joint] * np.exp(-rows.spread[joint]))
        base = joint_columns(rows, plain, joint)[usable]
        y = commands[usable]
        spread = y.std(axis=0) if len(y) else np.zeros(1)
        self._spread = spread
        self.judged = len(usable) >= 10 * _FOLDS and bool((spread > 0).all())
        if not self.judged:
            return
        moving = np.hstack([columns / np.maximum(self._size, 1e-300), y / spread])
        self._parts = []
        whole = base.T @ base
        mixed = base.T @ moving
        total = moving.T @ moving
        ridge = _RIDGE**2 * len(y)
        for part in np.array_split(np.arange(len(y)), _FOLDS):
            own = base[part]
            theirs = moving[part]
            A = whole - own.T @ own
            A[np.diag_indices_from(A)] += ridge
            b = mixed - own.T @ theirs
            solved = scipy.linalg.solve(A, b, assume_a="pos")
            left = total - theirs.T @ theirs - b.T @ solved
            left[np.diag_indices_from(left)] += ridge
            off = theirs - own @ solved
            self._parts.append((left, off.T @ off / len(part)))

    def errors(self, tried: Sequence[FrictionShape]) -> Array:
        """(S, D, 5) held-out rms of the command over its standard deviation, of S shapes.

        Infinite for shapes that would have to decrease dry friction, or to hold the joint by its
        load alone, and for a joint that hardly moves.
        """
        first = self._at["end",]
        members = [self._members(shape) for shape in tried]
        if not self.judged:
            return np.full((len(tried), 1, _FOLDS), np.inf)
        D = len(self._parts[0][0]) - first
        found = np.empty((len(tried), D, _FOLDS))
        for count in set(map(len, members)):
            own = [k for k, m in enumerate(members) if len(m) == count]
            at = np.array([members[k] for k in own], dtype=np.intp).reshape(len(own), count)
            pairs = at[:, :, None], at[:, None, :]
            mean = np.zeros((len(own), count, found.shape[1]))
            for fold, (left, off) in enumerate(self._parts):
                beta = np.linalg.solve(left[pairs], left[:, first:][at])
                square = np.diag(off)[first:] - 2 * np.einsum(
                    "skd,skd->sd", beta, off[:, first:][at]
                )
                square = square + np.einsum("skd,skl,sld->sd", beta, off[pairs], beta)
                found[own, :, fold] = np.sqrt(np.maximum(square, 1e-24))
                mean = mean + beta
            found[own] = np.where(self._possible(tried, own, mean)[:, :, None], found[own], np.inf)
        return found

    def _members(self, shape: FrictionShape) -> list[int]:
        """Places of a shape's columns, the first that of Coulomb friction if it has it."""
        keys: list[tuple[str | int, ...]] = []
        for name in SHAPES:
            if name in shape.names:
                one = (shape.speed,) if name in ("coulomb", "stribeck", "load") else ()
                two = (shape.fall,) if name == "stribeck" else ()
                keys.append((name, *one, *two))
        return [self._at[key] for key in keys]

    def _possible(self, tried: Sequence[FrictionShape], own: list[int], beta: Array) -> Array:
        """(S', D) whether friction is physical, at sums β (S', k, D) over the folds.

        Stribeck and load friction have Coulomb's sign; the latter is below its bound.
        """
        found = np.ones((beta.shape[0], beta.shape[2]), dtype=bool)
        for row, k in enumerate(own):
            used = [name for name in SHAPES if name in tried[k].names]
            if "load" in used:
                place = used.index("load")
                share = np.abs(beta[row, place]) / _FOLDS * self._spread * self._gain
                found[row] &= share < HELD * self._size[self._members(tried[k])[place]]
            if "coulomb" in used:
                for name in {"stribeck", "load"} & set(used):
                    found[row] &= beta[row, used.index(name)] * beta[row, 0] >= 0
        return found


def _shape_columns(rows: JointRows, joint: int) -> tuple[Array, dict[tuple[str | int, ...], int]]:
    """(N, c) columns of all shapes of a joint's friction, and the place of each."""
    found = []
    at: dict[tuple[str | int, ...], int] = {}
    for name in SHAPES:
        entries = rows.diagonal[name][..., joint]
        for index in np.ndindex(entries.shape[:-1]):
            at[name, *index] = len(found)
            found.append(entries[index])
    at["end",] = len(found)
    return np.column_stack(found), at


def joint_columns(rows: JointRows, choice: Choice, joint: int) -> Array:
    """(N, c) all columns of a joint's own row, each over its rms."""
    X = _columns(rows, choice, joint)
    size = np.sqrt(np.mean(X**2, axis=0))
    return X[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]


def _columns(rows: JointRows, choice: Choice, joint: int) -> Array:
    """(N, c) all columns of a joint's own row."""
    columns = [rows.links[:, joint]]
    columns += [own[:, joint] for _, own in rows.carried()]
    columns += [rows.column(name, joint, choice)[:, None] for name in sorted(choice.columns[joint])]
    for i, j, _ in choice.coupled:
        if joint in (i, j):
            other = i if joint == j else j
            columns += [
                rows.diagonal["rotor"][:, other, None],
                rows.diagonal["viscous"][:, other, None],
                rows.slip(i, j, choice.speed[j])[:, None],
            ]
    return np.hstack(columns)


def held_out_errors(rows: JointRows, choice: Choice, u: Array, joint: int) -> Array:
    """(5,) held-out rms of u over its standard deviation, by ridge regression on other fifths."""
    usable = np.flatnonzero(rows.usable[:, joint])
    X = joint_columns(rows, choice, joint)[usable]
    y = u[usable]
    spread = y.std() if len(y) else 0.0
    if len(usable) < 10 * _FOLDS or not spread > 0:
        return np.full(_FOLDS, np.inf)
    XX = X.T @ X
    Xy = X.T @ y
    errors = []
    for part in np.array_split(np.arange(len(y)), _FOLDS):
        A = XX - X[part].T @ X[part]
        A[np.diag_indices_from(A)] += _RIDGE**2 * len(y)
        beta = scipy.linalg.solve(A, Xy - X[part].T @ y[part], assume_a="pos")
        errors.append(np.sqrt(np.mean((y[part] - X[part] @ beta) ** 2)) / spread)
    return np.array(errors)


def rms(errors: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def shared_errors(
    problem: FitProblem, near: Mapping[str, float] | None = None
) -> tuple[Array, dict[str, float]]:
    """(5,) held-out errors of the physical fit, and its parameters by name.

    The errors are products of the joints' rms over the effort. `near` are those of a similar
    structure, from which the fit starts instead of from the prior, in a quarter of the steps.
    """
    whole = gramians(problem)
    names = problem.space.names
    first = [(near or {}).get(*each) for each in zip(names, problem.prior, strict=True)]
    start = minimise(problem, whole, np.array(first)).theta
    found = []
    for _, part in folds(problem, _FOLDS):
        own = gramians(part)
        theta = minimise(problem, whole - own, start).theta
        level = cost_of(problem, own).levels(theta)
        used = (own.counts > 0) & (level > 0)
        found.append(np.exp(0.5 * np.sum(np.log(level[used]))))
    return np.array(found), dict(zip(names, start.tolist(), strict=True))


def errors_at_cutoffs(trials: Sequence[JointRows], choice: Choice) -> Array:
    """(C, 5) held-out errors of fits to the rows of C filters, all on the rows of the first.

    They are geometric means over the joints, of the rms over the effort.
    """
    judge = trials[0].problem(choice)
    parts = list(folds(judge, _FOLDS))
    order = _order(trials[0])
    found = np.ones((len(trials), _FOLDS))
    start = None
    for number, rows in enumerate(trials):
        problem = rows.problem(choice)
        whole = gramians(problem)
        start = minimise(problem, whole, start).theta
        when = _order(rows)
        for fold, (rest, own) in enumerate(parts):
            held = np.zeros_like(problem.usable)
            for i, at in enumerate((judge.usable & ~rest.usable).T):
                if at.any():
                    held[:, i] = (when >= order[at].min()) & (when <= order[at].max())
            kept = whole - gramians(replace(problem, usable=problem.usable & held))
            theta = minimise(problem, kept, start).theta if kept.counts.any() else start
            judged = gramians(own)
            level = cost_of(judge, judged).levels(theta)
            used = (judged.counts > 0) & (level > 0)
            found[number, fold] = np.exp(0.5 * np.mean(np.log(level[used]))) if used.any() else 1.0
    return found


def _order(rows: JointRows) -> Array:
    """(N,) numbers that increase with segment and time."""
    return rows.segment * (1 + float(np.ptp(rows.t))) + rows.t - rows.t.min()
