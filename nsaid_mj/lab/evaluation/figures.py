"""Figures of merit of an estimate from any method, and the forces that it predicts."""

from typing import NamedTuple

import numpy as np
import scipy.linalg

from ...core import (
    Array,
    Indices,
    Log,
    Nullspace,
    SecondOrderSystem,
    SensorLevels,
)
from ..contacts import without_contacts
from ..loop import Run
from ..source import Source
from .confidence import INTERVAL, known
from .statistics import Accuracy, finite
from .truth import Truth, nullspace_of

NUMBERS = 20_000_000
"""Largest number of regressor entries in memory at once."""

_ROWS = 2000  # of a trajectory, at most, at which regressors are formed
_STRETCHES = 500  # of a measured log, at most, over which they are averaged
_STRETCH = 0.1  # length of each [s]
_DRAWS = 200  # estimates whose median figures are those of the bound


def stride_of(length: int, system: SecondOrderSystem) -> int:
    """The stride through a log of `length` rows that keeps its regressors within `NUMBERS`."""
    rows = min(_ROWS, max(50, NUMBERS // (system.n * system.p)))
    return max(1, length // rows)


def states(log: Log, stride: int) -> tuple[Array, Array, Array, Array]:
    """t (k,), x (k, m + n), v (k, n) and u (k, n_u) of every stride-th row."""
    k = slice(None, None, stride)
    v = log.v[k]
    return log.t[k], np.hstack([log.q[k], v]), v, log.u[k]


def midpoints(
    log: Log, system: SecondOrderSystem, stride: int
) -> tuple[Array, Array, Array, Array, Array]:
    """t, x, v, u and v̇ half-way between a row and its successor, for every stride-th row.

    v̇ is the finite difference of the measured velocities, so it needs no truth. The command must
    be constant between rows.
    """
    k = np.arange(0, len(log.t) - 1, stride)
    t = log.t
    q = log.q
    v = log.v
    u = log.u[k]
    steps = 0.5 * system.moves(q)[k]
    middle = np.array([system.integrate(q[i], step) for i, step in zip(k, steps, strict=True)])
    mean = 0.5 * (v[k] + v[k + 1])
    rate = (v[k + 1] - v[k]) / (t[k + 1] - t[k])[:, None]
    return 0.5 * (t[k] + t[k + 1]), np.hstack([middle, mean]), mean, u, rate


class Judge:
    """Computes the figures of estimates of one plant, from any method."""

    def __init__(self, truth: Truth):
        self._truth = truth
        self._rows = held_out_rows(truth.system, truth.held_out, truth.exact)

    def __call__(self, theta_hat: Array) -> dict[str, float | None]:
        """Distance to the true set, error of the actuators' shares, and force residual."""
        truth = self._truth
        system = self._truth.system
        return {
            "theta_perp_ratio": float(truth.nullspace.ratio(theta_hat / system.space.scale)),
            "actuator_ratio_error": truth.gain_ratio_error(theta_hat),
            "force_residual_ratio": residual_ratio(system, self._rows, theta_hat),
        }

    def bound(self, log: Log, levels: SensorLevels) -> dict[str, float | None]:
        """Median figures of estimates that attain the bound of a log; raises as `cramer_rao`."""
        from .bound import cramer_rao

        truth = self._truth
        covariance = cramer_rao(truth, log, levels)
        basis = truth.nullspace.P_perp
        scale = truth.system.space.scale
        values, vectors = scipy.linalg.eigh(basis.T @ covariance @ basis)
        root = basis @ (vectors * np.sqrt(np.maximum(values, 0.0)))
        draws = np.random.default_rng(0).standard_normal((_DRAWS, root.shape[1])) @ root.T
        found = [self(truth.theta + scale * draw) for draw in draws]
        columns = {key: [figures[key] for figures in found] for key in found[0]}
        return {
            key: None if None in column else float(np.median(np.array(column, dtype=np.float64)))
            for key, column in columns.items()
        }


def judge(run: Run, name: str, truth: Truth | None) -> Accuracy:
    """How good one identifier's last estimate is.

    The force residual is that on a held-out trajectory or, without the truth, that over the last
    tenth of the run itself.

    The identifier "" is the scenario's own.
    """
    suffix = f"_{name}" if name else ""
    record = run.record
    system = run.system
    theta = record.rows(f"theta_hat{suffix}", np.array([0, -1]))
    dv = record[f"v_hat{suffix}"] - record["v"]
    error = finite(float(np.sqrt(np.mean(last_tenth(dv) ** 2))))
    if truth is None:
        residual = None
        if run.scenario.record_every == 1:  # else some commands are not in the record
            late = record.log.last(max(2, len(record) // 10)) if len(record) > 1 else None
            W = None if late is None else averaged_rows(system, late)[1]
            residual = residual_ratio(system, W, theta[-1])
            residual = np.nan if residual is None else residual
        return Accuracy(force_residual_ratio_measured=residual, velocity_error_rms=error)
    ratio = truth.distance(record["t"][[0, -1]], theta)
    direction_error = plant_direction_error(system, theta[-1], truth.theta)
    held_out = held_out_rows(system, truth.held_out, truth.exact)
    return Accuracy(
        theta_perp_ratio=finite(float(ratio[1])),
        theta_perp_ratio_initial=finite(float(ratio[0])),
        plant_direction_error=finite(direction_error),
        actuator_ratio_error=finite(truth.gain_ratio_error(theta[-1])),
        force_residual_ratio=finite(residual_ratio(system, held_out, theta[-1])),
        velocity_error_rms=error,
    )


def last_tenth(rows: Array) -> Array:
    """The last tenth of rows (N, …), at least one."""
    return rows[-max(1, len(rows) // 10) :]


def plant_direction_error(system: SecondOrderSystem, theta_hat: Array, truth: Array) -> float:
    """Sine of the angle between the estimated and the true plant parameters, observable part only.

    The plant parameters are θ/scale without those of the actuators. Their observable part, given
    the actuator forces, is orthogonal to the nullspace of the plant's columns of W. 0 means exact
    up to a common scale, 1 orthogonal.
    """
    plant = np.setdiff1d(np.arange(system.p), system.space.actuators)
    rng = np.random.default_rng(0)
    W = Nullspace.stack(system, truth, rng)[:, plant]
    basis = Nullspace.of(W).P_perp
    estimated, true = ((theta / system.space.scale)[plant] @ basis for theta in (theta_hat, truth))
    cosine = estimated @ true / (np.linalg.norm(estimated) * np.linalg.norm(true))
    return float(np.sqrt(max(0.0, 1 - cosine**2)))


def held_out_rows(
    system: SecondOrderSystem, later: Log | None, truth: Array | None
) -> Array | None:
    """(k, n, p) W(t, x, v, v̇) along a trajectory that the estimate has not seen; None without one.

    The arguments are those of `timed_rows`.
    """
    return None if later is None else timed_rows(system, later, truth)[1]


def timed_rows(system: SecondOrderSystem, log: Log, truth: Array | None) -> tuple[Array, Array]:
    """(k,) times and (k, n, p) W(t, x, v, v̇) along a log, with the true v̇.

    `truth` (p,) is θ for v̇ by (29). It is None if no θ gives the plant's v̇: it is then the finite
    difference of measured velocities, half-way between samples.
    """
    stride = stride_of(len(log.t), system)
    if truth is not None:
        t, x, v, u = states(log, stride)
        return t, system.evaluate(t, x, v, u, truth)[1]
    t, x, v, u, a = midpoints(log, system, stride)
    return t, without_contacts(system, x[:, : log.q.shape[1]], system.regressor(t, x, v, a, u))


def averaged_rows(system: SecondOrderSystem, log: Log) -> tuple[Array, Array]:
    """(k,) times and (k, n, p) means of W over stretches of 0.1 s of a measured log.

    v̇ are the differences of neighbouring measured velocities, so that all but the noise of a
    stretch's two ends cancels in the mean. Stretches with a gap are left out if there are others.
    """
    steps = np.diff(log.t)
    usual = float(np.median(steps))
    size = min(max(1, round(_STRETCH / usual)), len(steps))
    every = range(0, len(log.t) - size, max(1, (len(log.t) - size) // _STRETCHES))
    starts = [i for i in every if steps[i : i + size].max() <= Source.LONGEST_STEP * usual] or every
    times = np.empty(len(starts))
    rows = np.empty((len(starts), system.n, system.p))
    for i, start in enumerate(starts):
        part = log.part(start, start + size + 1)
        q, v = system.midpoints(part, hermite=False)
        a = np.diff(part.v, axis=0) / np.diff(part.t)[:, None]
        W = system.regressor(part.t[:-1], np.hstack([q, v]), v, a, part.u[:-1])
        W = without_contacts(system, q, W)
        times[i], rows[i] = 0.5 * (part.t[0] + part.t[-1]), W.mean(axis=0)
    return times, rows


def residual_ratio(system: SecondOrderSystem, W: Array | None, theta_hat: Array) -> float | None:
    """rms of W θ̂ with W (k, n, p), over rms of the actuator forces; None if these are zero."""
    if W is None:
        return None
    actuators = system.space.actuators  # in F only: their columns of W give the actuator forces
    force = W[..., actuators] @ theta_hat[actuators]
    if not force.any():
        return None
    return float(np.sqrt(np.mean((W @ theta_hat) ** 2) / np.mean(force**2)))


def residual_floor(system: SecondOrderSystem, W: Array | None) -> float | None:
    """The smallest force residual ratio of any θ on regressors W (k, n, p).

    It is the square root of the smallest generalised eigenvalue of WᵀW with respect to that of the
    actuator columns: the part of the actuator forces that remains when plant and gains are fitted
    to this motion. None if there is no motion, or if the actuators exert no force along it.
    """
    if W is None:
        return None
    actuators = system.space.actuators
    plant = np.setdiff1d(np.arange(system.p), actuators)
    rows = (W * system.space.scale).reshape(-1, system.p)
    forces = rows[:, actuators]
    forces = forces[:, forces.any(axis=0)]
    if not forces.size:
        return None
    u, s, _ = np.linalg.svd(rows[:, plant], full_matrices=False)
    u = u[:, s > 1e-10 * s[0]]
    left = forces - u @ (u.T @ forces)  # residual of the best fit of the plant's parameters
    _, R = np.linalg.qr(forces)
    return float(np.linalg.svd(np.linalg.solve(R.T, left.T), compute_uv=False)[-1])


class ForceBalance(NamedTuple):
    """The two sides of W θ̂ = 0 along k samples of a trajectory."""

    t: Array  # (k,) times [s]
    # (k, n) forces of the actuators under their estimated gains, in the units of
    # `evaluation.force_units`
    measured: Array
    predicted: Array  # (k, n) forces that the motion requires under the estimated plant
    # (k, n) half width of the prediction's 95 % interval; None if the law states none, or if the
    # run was read from its record
    half: Array | None

    @property
    def nrmse(self) -> Array:
        """(n,) rms error over rms of the measured force; NaN where that is zero."""
        rms = np.sqrt(np.mean(self.measured**2, axis=0))
        error = np.sqrt(np.mean((self.predicted - self.measured) ** 2, axis=0))
        return error / np.where(rms > 0, rms, np.nan)


def common_factor(theta: Array, true: Array, scale: Array, actuators: Indices) -> Array:
    """(…) factors that bring estimates (…, p) to the common scale of truths (…, p).

    That scale is unobservable. The factors make the mean of the actuators' gains exact; without an
    actuator, or with one of the wrong sign, they minimise the distance in θ/scale.
    """
    theta_s = theta / scale
    true_s = true / scale
    found = np.sum(theta_s * true_s, axis=-1) / np.sum(theta_s**2, axis=-1)
    own = theta_s[..., actuators]
    gains = true_s[..., actuators]
    working = gains != 0
    ratio = own / np.where(working, gains, 1.0)
    count = working.sum(axis=-1)
    usual = (count > 0) & ((ratio > 0) | ~working).all(axis=-1)
    mean = np.sum(np.where(working, ratio, 0.0), axis=-1) / np.maximum(count, 1)
    return np.where(usual, 1 / np.where(usual, mean, 1.0), found)


def forces_of(run: Run, truth: Truth | None) -> ForceBalance | None:
    """The forces on the held-out trajectory or, without a truth, over the run's last tenth.

    With a truth, θ̂ is multiplied by the `common_factor`. None if there is no such trajectory, or if
    commands are missing in the record.
    """
    system = run.system
    theta = np.array(run.record.rows("theta_hat", -1))
    later = None if truth is None else truth.held_out
    exact = None if truth is None else truth.exact
    if later is None and (run.scenario.record_every != 1 or len(run.record) < 20):
        return None
    if later is None:
        log = run.record.log
        t, W = averaged_rows(system, log.last(max(2, len(log.t) // 10)))
    else:
        t, W = timed_rows(system, later, exact)
    scale = system.space.scale
    k = system.space.actuators
    factor = 1.0
    if truth is not None:
        factor = float(common_factor(theta, truth.theta, scale, k))
    given = W[..., k] @ theta[k]
    half = None
    stated = run.identifiers[""].confidence(run.states[""]) if "" in run.states else None
    if stated is not None:
        found = known(stated, theta, nullspace_of(run, None), system.space)
        spread = (W * scale) @ (found.directions.T * found.deviation)
        half = INTERVAL * np.linalg.norm(spread, axis=-1) * float(np.linalg.norm(theta / scale))
        half *= abs(factor)
    return ForceBalance(t, -factor * given, factor * (W @ theta - given), half)
