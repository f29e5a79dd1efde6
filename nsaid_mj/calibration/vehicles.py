"""The structure of a vehicle, whose regressor is a system of this package, and its delays.

A vehicle's forces are not linear in its commands, and several actuators act on one velocity. A
delay is therefore judged by the fit itself: first one that all actuators share, then each one's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from ..baselines.least_squares import smoothed
from ..parameters import Array, Block, ParameterSpace
from .data import Recordings, RobotModel, Segment
from .findings import Finding
from .fit import minimise
from .joints import FILE
from .precision import inflation, tempered
from .problem import Problem, Size, size_weights
from .selection import REACH
from .smoothing import Filter, filter_for
from .structure import Options, Structured, Velocity
from .suspects import command_suspects

EXTRA = {"damping": "free", "offset": "free"}
"""Further columns of a vehicle, one per velocity: damping −d v, and a constant force."""

_COARSE, _FINE = 0.02, 0.002  # spacing of the trial delays [s]
_MIXES = (1.0, 0.0, 0.3, 0.6, 0.8, 0.9)  # trial shares of the square
_LAGS = (0.0, 0.01, 0.02, 0.05, 0.1)  # trial lags of rotors [s]
_WORTH = 6.0  # fall of the cost that a delay or a set of columns must bring: a likelihood ratio
_TWIST = ("surge", "sway", "heave", "roll rate", "pitch rate", "yaw rate")
_SPREAD = 0.3  # prior spread of positive parameters


class Drive(NamedTuple):
    """How the rotors of a vehicle follow their commands.

    Attributes:
        mix: share m of the square in the force m u² + (1 − m) u of a command u held for long: 1
            where the command is the rotor's speed, 0 where it is its thrust.
        lag: time constant of the rotor's speed [s].
    """

    mix: float = 1.0
    lag: float = 0.0

    def speeds(self, u: Array, rate: float) -> Array:
        """(N, k) relative speeds of rotors under commands u (N, k); force grows with their square.

        `rate` is in samples per second [Hz].
        """
        size = np.abs(u)
        speed = np.sign(u) * np.sqrt(self.mix * size**2 + (1 - self.mix) * size)
        if self.lag == 0:
            return speed
        r = 1 / (rate * self.lag)  # exact for a course that is linear between samples
        kept, mean = np.exp(-r), -np.expm1(-r) / r
        taps, start = [1 - mean, mean - kept], mean * speed[:1]
        return np.asarray(scipy.signal.lfilter(taps, [1, -kept], speed, axis=0, zi=start)[0])


_SPEED = Drive()


class VehicleRows:
    """Rows of a vehicle's segments at any delay of the commands.

    Args:
        robot: a vehicle.
        recordings: the segments.
        chosen: filters.
    """

    def __init__(self, robot: RobotModel, recordings: Recordings, chosen: Filter):
        self.robot, self.system, self._filter = robot, robot.system, chosen
        self._parts = []
        for number, segment in enumerate(recordings.segments):
            motion = motion_of(self.system, segment, chosen)
            centres = chosen.centres(len(motion[0]))
            if len(centres):
                self._parts.append((number, segment, motion, centres))
        structure = getattr(robot.system, "structure", None)
        columns = () if structure is None else structure.columns
        self.rotors = sorted({column.input for column in columns if column.kind == "rotor"})
        self.t = np.concatenate([m[0][c] for _, _, m, c in self._parts])
        self.segment = np.concatenate([np.full(len(c), number) for number, _, _, c in self._parts])
        self.usable = np.concatenate([s.usable[:: chosen.every][c] for _, s, _, c in self._parts])
        assert robot.prior is not None  # every vehicle has one
        self._prior: Array = robot.prior

    def problem(self, delay: Array, columns: frozenset[str], drive: Drive = _SPEED) -> Problem:
        """The fit with commands delayed by (k,) seconds, further columns, and rotors' drives."""
        system, rotors, Y = self.system, self.rotors, []
        for _, segment, (t, q, v, a), _ in self._parts:
            times, u = segment.log.t, segment.log.u.copy()
            if rotors:  # their commands become relative speeds
                u[:, rotors] = drive.speeds(u[:, rotors], self._filter.rate)
            delayed = zip(delay, self._filter.low_pass(u).T, strict=True)
            held = np.column_stack([np.interp(t - d, times, own) for d, own in delayed])
            W = [system.regressor(t, np.hstack([q, v]), v, a, held)]
            for name in sorted(columns):
                own = v if name == "damping" else -np.ones_like(v)
                W.append(np.einsum("nk,kl->nkl", own, np.eye(v.shape[1])))
            Y.append(self._filter.rows(np.concatenate(W, axis=2)))
        rows = np.concatenate(Y)
        more = [self._extra(name, rows) for name in sorted(columns)]
        space = ParameterSpace((*system.space.blocks, *more))
        none = np.zeros(len(space), dtype=bool)
        prior = np.append(self._prior, np.zeros(len(space) - len(self._prior)))
        spread = np.where(space.geometries == "positive", _SPREAD, space.scale)
        size = Size(_size(space, rows[self.usable], prior), FILE, none)
        return Problem(space, rows, self.usable, self.t, self.segment, prior, spread, none, size)

    def _extra(self, name: str, rows: Array) -> Block:
        """A block of one further parameter per velocity."""
        units = self.system.velocity_units
        force = ["N" if unit == "m/s" else "N·m" for unit in units]
        names = velocity_names(self.robot)
        at = self.system.space.actuators
        size = np.sqrt(np.mean((rows[:, :, at] @ self._prior[at]) ** 2, axis=0))
        size = np.maximum(size, 1e-3 * max(float(size.max()), 1e-9))
        return Block(
            f"further {name}",
            tuple(f"{name}_{i + 1}" for i in range(len(units))),
            tuple(
                f"{f}/({u})" if name == "damping" else f for f, u in zip(force, units, strict=True)
            ),
            0.3 * size,
            "free",
            labels=tuple(f"further {name} of {n}" for n in names),
        )


def _size(space: ParameterSpace, columns: Array, prior: Array) -> Array:
    """(p,) w with wᵀθ the forces of inertia and weight over those of the published values.

    For a vehicle without matrices it is the mean of all positive parameters over these values.
    """
    positive = space.geometries == "positive"
    matrix = ~positive & (space.geometries != "free")
    if matrix.any():
        return size_weights(columns * matrix, prior)
    return np.where(positive, 1 / np.where(positive, prior, 1.0), 0.0) / positive.sum()


def velocity_names(robot: RobotModel) -> tuple[str, ...]:
    """Names of a vehicle's velocities."""
    system = robot.system
    twist = _TWIST[: system.group] if system.group == 6 else ()
    rest = tuple(f"velocity {i + 1}" for i in range(len(twist), system.n))
    return twist + rest


def motion_of(system, segment: Segment, chosen: Filter) -> tuple[Array, Array, Array, Array]:
    """Times, q, v, v̇ of the smoothed motion at the regressors' rate."""
    log = smoothed(system, segment.log, chosen.smoothing)
    a = np.gradient(log.v, 1 / chosen.rate, axis=0)
    pick = slice(None, None, chosen.every)
    return log.t[pick], log.q[pick], log.v[pick], a[pick]


def structured_vehicle(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    told: Callable[[str], None],
) -> Structured:
    """Chooses delays and further columns of a vehicle and makes the rows of the fit.

    `recordings` are training logs, `validation` is a log that takes no part in the fit, or None;
    `told` is called with the name of every stage.
    """
    told("filtering")
    chosen = filter_for(recordings, options.cutoff)
    rows = VehicleRows(robot, recordings, chosen)
    delay, drive, findings = options.delay, _SPEED, []
    columns = (options.columns or frozenset()) & frozenset(EXTRA)
    first = rows.problem(np.zeros(len(robot.joints)) if delay is None else delay, columns)
    share = inflation(first, minimise(first).theta)

    def cost(delay: Array, columns: frozenset[str], drive: Drive) -> float:
        problem = rows.problem(delay, columns, drive)
        return minimise(problem, tempered(problem, share)).cost

    if delay is None:
        told("searching for delays")
        delay, drive, findings = _timing(lambda d, x: cost(d, columns, x), rows, told)
    if options.columns is None:
        told("choosing columns")
        best = cost(delay, columns, drive)
        for name in EXTRA:
            trial = cost(delay, columns | {name}, drive)
            worth = best - trial
            if worth > _WORTH * 2:
                columns, best = columns | {name}, trial
                text = f"a column of {name} per velocity lowers the cost by {worth:.0f}"
                data: dict[str, object] = {"columns": sorted(columns)}
                findings.append(Finding("note", "columns", "", text, data=data))
    problem = rows.problem(delay, columns, drive)
    others = [frozenset[str]()] if columns else []
    checked = None
    if validation is not None:
        filters = filter_for(validation, chosen.cutoff)
        checked = VehicleRows(robot, validation, filters).problem(delay, columns, drive)
    at = problem.space.actuators
    labels = [problem.space.labels[i] for i in at]
    own = tuple(sorted(columns)), np.nan, float(np.median(delay))
    return Structured(
        problem,
        (rows.problem(delay, other, drive) for other in others),
        checked,
        tuple(Velocity(name, *own) for name in velocity_names(robot)),
        tuple(findings),
        chosen.cutoff,
        np.zeros(0),
        delay,
        lambda theta: command_suspects(problem.Y[:, :, at] * theta[at], labels),
    )


def _timing(
    cost: Callable[[Array, Drive], float], rows: VehicleRows, told: Callable[[str], None]
) -> tuple[Array, Drive, list[Finding]]:
    """(k,) the delay that all actuators share [s], the rotors' drives, and notes on both.

    `cost` is a function of delays (k,) and drives.
    """
    names, drive = rows.robot.joints, _SPEED
    grid, k = np.arange(-REACH, REACH + 1e-9, _COARSE), len(names)
    costs = np.array([cost(np.full(k, d), drive) for d in grid])
    at, zero = int(np.argmin(costs)), int(np.argmin(np.abs(grid)))
    delay, there = 0.0, costs[at] <= costs[zero] - _WORTH
    edge = at in (0, len(grid) - 1)
    if there and not edge:
        ends = grid[at - 1], grid[at + 1]
        least = scipy.optimize.minimize_scalar(
            lambda d: cost(np.full(k, d), drive), bounds=ends, options={"xatol": _FINE}
        )
        delay = float(least.x)
    if rows.rotors:
        told("choosing the rotors' curve and lag")
        delay, drive = _rotor_drive(lambda d, x: cost(np.full(k, d), x), delay)
    notes = []
    if there and edge and not rows.rotors:
        text = (
            f"the best delay of the commands, {grid[at] * 1e3:+.0f} ms, lies at the edge of the "
            "search"
        )
        remedy = "Align the clocks of commands and positions in the map."
        notes.append(Finding("warning", "delay_at_edge", "", text, remedy))
    elif there:
        text = f"commands act {delay * 1e3:.1f} ms after they were recorded"
        notes.append(Finding("note", "delay", "", text, data=dict.fromkeys(names, delay)))
    return np.full(k, delay), drive, [*notes, *_drive_notes(drive)]


def _rotor_drive(cost: Callable[[float, Drive], float], delay: float) -> tuple[float, Drive]:
    """The delay [s] and the drive of rotors that minimise a cost: a grid search, then a simplex.

    The search starts from the `delay` that suits rotors whose commands are their speeds, without a
    lag. A mix near 1 or 0, or a lag, that lowers the cost by less than `_WORTH` is taken as 1 or 0.
    """

    def along(x: Array) -> float:
        """The cost at a sum of delay and lag, which affects slow motion, a lag and a mix."""
        total, lag, mix = x
        inside = lag >= 0 and 0 <= mix <= 1
        return cost(total - lag, Drive(float(mix), float(lag))) if inside else np.inf

    mixes = [np.array([delay, 0.0, mix]) for mix in _MIXES]
    lags = [np.array([delay, lag, min(mixes, key=along)[2]]) for lag in _LAGS]
    start = min(lags, key=along)
    if along(mixes[0]) < along(start) + _WORTH:
        return delay, _SPEED
    corners = start + np.vstack([np.zeros(3), np.diag([0.01, 0.01, 0.1 - 0.2 * (start[2] > 0.5)])])
    options = {"initial_simplex": corners, "xatol": 2e-3, "fatol": 1.0, "maxfev": 90}
    least = scipy.optimize.minimize(along, start, method="Nelder-Mead", options=options)
    found = np.asarray(least.x)
    for k, plain in ((1, 0.0), (2, 0.0), (2, 1.0)):
        simpler = np.where(np.arange(3) == k, plain, found)
        if along(simpler) < along(found) + _WORTH:
            found = simpler
    return float(found[0] - found[1]), Drive(float(found[2]), float(found[1]))


def _drive_notes(drive: Drive) -> list[Finding]:
    """Describes the rotors' drives, unless their commands are their speeds at once."""
    found = []
    if drive.mix != 1.0:
        text = f"the rotors' thrust is {drive.mix:.2f} u² + {1 - drive.mix:.2f} u of the command u"
        found.append(Finding("note", "curve", "", text, data={"mix": drive.mix}))
    if drive.lag:
        text = f"the rotors' speeds lag behind their commands by {drive.lag * 1e3:.0f} ms"
        found.append(Finding("note", "lag", "", text, data={"seconds": drive.lag}))
    return found
