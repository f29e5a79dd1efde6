"""Errors of candidates on parts of the log that are predicted from the rest.

Divided by the gain, each joint's row is linear in its own columns, so that a least-squares fit of a
candidate, joint by joint, takes a millisecond. What all joints share, such as an offset that weight
could imitate, is compared by the physical fit of all of them.
"""

from collections.abc import Mapping

import numpy as np
import scipy.linalg

from ....core import Array, Indices
from ..fit import cost_of, gramians, minimise
from ..joints import JointRows
from ..problem import FitProblem, folds
from .columns import Choice

_FOLDS = 5
_RIDGE = 1e-3  # of the columns' rms: a prior of 30 times a column's natural size


def joint_columns(rows: JointRows, choice: Choice, joint: int) -> Array:
    """(N, c) all columns of a joint's own row, each over its rms."""
    columns = [rows.links[:, joint]]
    columns += [rows.column(name, joint, choice)[:, None] for name in sorted(choice.columns[joint])]
    for i, j, _ in choice.coupled:
        if joint in (i, j):
            other = i if joint == j else j
            columns += [
                rows.diagonal["rotor"][:, other, None],
                rows.diagonal["viscous"][:, other, None],
                rows.slip(i, j, choice.speed[j])[:, None],
            ]
    X = np.hstack(columns)
    size = np.sqrt(np.mean(X**2, axis=0))
    return X[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]


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


def basis_of(rows: JointRows, choice: Choice, joint: int) -> tuple[Indices, Array]:
    """Indices of a joint's usable rows, and the basis (N, c) of its columns with a ridge."""
    usable = np.flatnonzero(rows.usable[:, joint])
    X = joint_columns(rows, choice, joint)[usable]
    ridge = _RIDGE * np.sqrt(max(len(usable), 1)) * np.eye(X.shape[1])
    return usable, np.linalg.qr(np.vstack([X, ridge]))[0][: len(usable)]


def unexplained(u: Array, usable: Indices, basis: Array) -> float:
    """Residual (N,) of a command on the columns, over the command's standard deviation."""
    y = u[usable]
    spread = np.linalg.norm(y - y.mean()) if len(y) else 0.0
    if not spread > 0:
        return 1.0
    return float(np.sqrt(max(y @ y - np.sum((basis.T @ y) ** 2), 0.0)) / spread) + 1e-12
