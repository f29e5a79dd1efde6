"""Choice of columns, friction speeds and delays by cross-validation inside the training log.

Divided by the gain, each joint's row is linear in its own columns, so that a least-squares fit of a
candidate, joint by joint, takes a millisecond. Candidates are compared by their error in held-out
fifths of the log; the physical fit uses the chosen ones.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg

from ..parameters import Array, Indices
from ..robot.findings import Finding
from .choose.columns import BASIC, SPEEDS, Choice
from .fit import cost_of, gramians, minimise
from .joints import JointRows
from .problem import Problem, folds

_FOLDS = 5
_RIDGE = 1e-3  # of the columns' rms: a prior of 30 times a column's natural size
_WORTH = 0.01  # mean relative gain in held-out error that a change must bring, or its standard
# error over the folds if that is larger
REACH = 0.2  # delays are searched within ± this [s]
_COARSE = 0.004  # spacing of the trial delays [s]
_DELAY_WORTH = 0.04  # mean relative gain that a joint's own delay must bring
_SURE = 2.0  # standard errors over the folds that it must exceed
_PARABOLAS = 5  # steps of the correction of all delays
_LOADED = 0.15  # share of weight in a joint's force that a load column needs


def choose(
    rows: JointRows,
    coupled: tuple[tuple[int, int, int], ...] = (),
    delay: Array | None = None,
    columns: frozenset[str] | None = None,
) -> tuple[Choice, list[Finding]]:
    """The structure of every joint that predicts held-out commands best, and what was tried.

    `coupled` are pairs (i, j, ±1) of joints whose motor turns by v_i ± v_j, delay (k,) known delays
    [s], None to search for them, `columns` those to use on all joints, None to choose.
    """
    k, basic = len(rows.robot.joints), BASIC if columns is None else columns
    shared, findings = np.zeros(k) if delay is None else delay, []
    choice = Choice((basic,) * k, (1,) * k, shared, coupled)
    if delay is None:
        choice, shared, findings = _with_delays(rows, choice)
    for j in rows.driven:  # a passive joint has no command to predict
        own, finding, errors = _choose_joint(rows, choice, j, columns is None)
        if choice.delay[j] != shared[j]:
            delays = choice.delay.copy()
            delays[j] = shared[j]
            alike = _choose_joint(rows, replace(choice, delay=delays), j, columns is None)
            if not _insists(alike[2], errors):  # friction at another speed imitates a delay
                own, finding, _ = alike
        choice = own
        findings.append(finding)
    return choice, findings


def _choose_joint(
    rows: JointRows, choice: Choice, joint: int, free: bool
) -> tuple[Choice, Finding, Array]:
    """The choice with the best speed and columns at one joint, that in words, and its errors."""
    u = rows.commands(choice.delay)[:, joint]
    best = held_out_errors(rows, choice, u, joint)
    first, tried = rms(best), []

    def better(trial: Choice, words: str) -> None:
        nonlocal best, choice
        errors = held_out_errors(rows, trial, u, joint)
        tried.append(f"{words} {rms(errors):.4f}")
        if worthwhile(best, errors, _WORTH):
            best, choice = errors, trial

    def speeds() -> None:
        if {"coulomb", "stribeck", "load"} & choice.columns[joint]:
            for index, speed in enumerate(SPEEDS):
                if index != choice.speed[joint]:
                    better(choice.at(joint, speed=index), f"s = {speed:g}")

    speeds()
    if free:
        # where weight is a small part of the force, `load` imitates other friction and biases gains
        weight, force = rows.diagonal["load"][-1][:, joint], u * rows.gain[joint]
        carries = ["load"] if weight.std() > _LOADED * force.std() else []
        for name in [*carries, "quadratic", "cubic"]:
            better(choice.at(joint, name), f"+ {name}")
        for index, speed in enumerate(SPEEDS):  # a smaller speed imitates it where it is missing
            trial = choice.at(joint, "stribeck", speed=index)
            better(trial, f"+ stribeck with s = {speed:g}")
        speeds()
    used, speed = sorted(choice.columns[joint]), SPEEDS[choice.speed[joint]]
    text = (
        f"friction columns {', '.join(used)} with s = {speed:g}; held-out NRMSE "
        f"{100 * first:.3g} % → {100 * rms(best):.3g} %, the best of {len(tried) + 1} choices"
    )
    data = {"columns": used, "speed": speed, "held_out": rms(best), "tried": tried}
    return choice, Finding("note", "columns", rows.robot.joints[joint], text, data=data), best


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
    X, y = joint_columns(rows, choice, joint)[usable], u[usable]
    spread = y.std() if len(y) else 0.0
    if len(usable) < 10 * _FOLDS or not spread > 0:
        return np.full(_FOLDS, np.inf)
    XX, Xy = X.T @ X, X.T @ y
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


def _with_delays(rows: JointRows, choice: Choice) -> tuple[Choice, Array, list[Finding]]:
    """The choice with delays on a grid: a common one, and individual ones where joints differ.

    Every joint's row is fitted by least squares at every candidate delay. The columns do not depend
    on the delay, so one orthogonal basis of them serves all candidates. Also returns the shared
    delays (k,).
    """
    k = len(rows.robot.joints)
    candidates = np.arange(-REACH, REACH + 1e-9, _COARSE)
    bases = [_basis(rows, choice, j) for j in range(k)]
    errors = np.empty((len(candidates), k))
    for number, delay in enumerate(candidates):
        u = rows.commands(np.full(k, delay))
        errors[number] = [_unexplained(u[:, j], *bases[j]) for j in range(k)]
    best = int(np.argmin(np.log(errors) @ rows.usable.sum(axis=0)))
    found, findings = np.zeros(k), []
    for j in rows.driven:
        at, name = int(np.argmin(errors[:, j])), rows.robot.joints[j]
        if at != best:
            u = [rows.commands(np.full(k, d))[:, j] for d in candidates[[best, at]]]
            if not _insists(*(held_out_errors(rows, choice, x, j) for x in u)):
                at = best  # most delays are shared: they are those of clocks and of the network
        if at in (0, len(candidates) - 1):
            text = (
                f"the best delay of the command, {candidates[at] * 1e3:+.0f} ms, lies at the edge "
                "of the search"
            )
            remedy = "Align the clocks of commands and positions in the map (`offset` of a file)."
            findings.append(Finding("warning", "delay_at_edge", name, text, remedy))
        else:
            found[j] = candidates[at]
            if at != best:
                found[j] += _COARSE * _vertex(errors[at - 1 : at + 2, j] ** 2)
    shared = np.where(found == 0, 0.0, candidates[best])  # 0 at the edge
    return replace(choice, delay=found), shared, findings


def with_constants(
    rows: JointRows, choice: Choice, level: frozenset[str] = frozenset()
) -> tuple[Choice, list[Finding]]:
    """The choice with offsets and springs where they improve the physical fit of all joints.

    In fits joint by joint, each with free link parameters, weight would absorb both. A negative
    stiffness is not a spring but an error that grows with the position, such as a wrong gear ratio;
    it is left in the residuals. `level` are names of joints without an offset of their own, as are
    passive ones.
    """
    (best, fitted), findings = _shared_errors(rows.problem(choice)), []
    for j, name in enumerate(rows.robot.joints):
        for column, words in (("offset", "a constant offset"), ("spring", "a spring")):
            if column == "offset" and (name in level or j not in rows.driven):
                continue
            trial = choice.at(j, "offset", column)
            errors, found = _shared_errors(rows.problem(trial), fitted)
            if found.get(f"stiffness_{j + 1}", 0.0) >= 0 and worthwhile(best, errors, _WORTH):
                fall = 100 * (1 - np.exp(np.log(errors / best).mean()))
                text = f"{words}; held-out errors, all joints multiplied, fall by {fall:.0f} %"
                findings.append(Finding("note", "columns", name, text, data={"columns": [column]}))
                choice, best, fitted = trial, errors, found
    return choice, findings


def with_speeds(rows: JointRows, choice: Choice) -> Choice:
    """The choice with the best s of Coulomb friction at passive joints, by the physical fit."""
    best = _shared_errors(rows.problem(choice))[0]
    for j in set(range(len(rows.robot.joints))) - set(rows.driven):
        for speed in range(len(SPEEDS)):
            trial = choice.at(j, speed=speed)
            errors = _shared_errors(rows.problem(trial))[0]
            if worthwhile(best, errors, _WORTH):
                choice, best = trial, errors
    return choice


def _shared_errors(
    problem: Problem, near: Mapping[str, float] | None = None
) -> tuple[Array, dict[str, float]]:
    """(5,) held-out errors of the physical fit, and its parameters by name.

    The errors are products of the joints' rms over the effort. `near` are those of a similar
    structure, from which the fit starts instead of from the prior, in a quarter of the steps.
    """
    whole, names = gramians(problem), problem.space.names
    first = [(near or {}).get(*each) for each in zip(names, problem.prior, strict=True)]
    start, found = minimise(problem, whole, np.array(first)).theta, []
    for _, part in folds(problem, _FOLDS):
        own = gramians(part)
        theta = minimise(problem, whole - own, start).theta
        level = cost_of(problem, own).levels(theta)
        used = (own.counts > 0) & (level > 0)
        found.append(np.exp(0.5 * np.sum(np.log(level[used]))))
    return np.array(found), dict(zip(names, start.tolist(), strict=True))


def _insists(shared: Array, own: Array) -> bool:
    """Whether held-out errors (folds,) are much smaller with an individual delay."""
    return worthwhile(shared, own, _DELAY_WORTH, _SURE)


def worthwhile(before: Array, after: Array, worth: float, deviations: float = 1.0) -> bool:
    """Whether held-out errors (folds,) fall by a given share, and significantly.

    The errors' mean logarithm must fall by at least `worth`, and by `deviations` standard errors
    over the folds; errors that are not finite never qualify.
    """
    if not np.isfinite([before, after]).all():
        return False
    change = np.log(after / before)
    error = change.std() / np.sqrt(len(change) - 1)
    return bool(change.mean() < -max(worth, deviations * error))


def _vertex(values: Array) -> float:
    """Minimum of the parabola through values at −1, 0, 1, within ±½."""
    bend = values[0] - 2 * values[1] + values[2]
    return float(np.clip(0.5 * (values[0] - values[2]) / bend, -0.5, 0.5)) if bend > 0 else 0.0


def refined(rows: JointRows, choice: Choice) -> tuple[Choice, float, Finding]:
    """The choice with its delays corrected by one that all commands share, from the physical fit.

    Mean squared residuals are parabolas in the correction. A millisecond matters: interpolation of
    held commands advances them by half a sample. Also returns the correction's standard deviation
    [s], and the delays in words.
    """
    h, start, correction, curvature = 0.5 * _COARSE, None, 0.0, 0.0
    for _ in range(_PARABOLAS):
        levels = []
        for step in (-h, 0.0, h):
            problem = rows.problem(replace(choice, delay=choice.delay + correction + step))
            fit = minimise(problem, start=start)
            start = fit.theta
            levels.append(np.maximum(fit.levels, 1e-300))
        # mean squares are parabolas in the delay; their logarithms, in J, only at the very minimum
        weight = problem.usable.sum(axis=0) / np.min(levels, axis=0)
        costs = 0.5 * np.array(levels) @ weight
        slope, curvature = (costs[2] - costs[0]) / (2 * h), np.diff(costs, 2)[0] / h**2
        if curvature <= 0:
            break
        change = float(np.clip(-slope / curvature, -4 * h, 4 * h))
        correction += change
        if abs(change) < 0.5 * h:
            break
    final = replace(choice, delay=choice.delay + correction)
    deviation = float(1 / np.sqrt(curvature)) if curvature > 0 else h
    delays = dict(zip(rows.robot.joints, final.delay.tolist(), strict=True))
    words = ", ".join(f"{name} {_ms(delay)}" for name, delay in delays.items())
    if np.ptp(final.delay) < 1e-9:
        words = f"{_ms(final.delay[0])} for all"
    text = f"delays of the commands relative to the log [ms]: {words}"
    return final, deviation, Finding("note", "delay", "", text, data=dict(delays))


def _ms(delay: float) -> str:
    """A delay [s] in milliseconds with its sign; never −0.0."""
    return f"{round(delay * 1e3, 1) + 0.0:+.1f}"


def _basis(rows: JointRows, choice: Choice, joint: int) -> tuple[Indices, Array]:
    """Indices of a joint's usable rows, and the basis (N, c) of its columns with a ridge."""
    usable = np.flatnonzero(rows.usable[:, joint])
    X = joint_columns(rows, choice, joint)[usable]
    ridge = _RIDGE * np.sqrt(max(len(usable), 1)) * np.eye(X.shape[1])
    return usable, np.linalg.qr(np.vstack([X, ridge]))[0][: len(usable)]


def _unexplained(u: Array, usable: Indices, basis: Array) -> float:
    """Residual (N,) of a command on the columns, over the command's standard deviation."""
    y = u[usable]
    spread = np.linalg.norm(y - y.mean()) if len(y) else 0.0
    if not spread > 0:
        return 1.0
    return float(np.sqrt(max(y @ y - np.sum((basis.T @ y) ** 2), 0.0)) / spread) + 1e-12
