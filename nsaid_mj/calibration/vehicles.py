"""The structure of a vehicle, whose regressor is a system of this package, and its delays.

A vehicle's forces are not linear in its commands, and several actuators act on one velocity. A
delay is therefore judged by the fit itself: first one that all actuators share, then each one's.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..baselines.filters import smoothed
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

_COARSE, _FINE = 0.02, 0.002  # spacing of the delays that are tried [s]
_WORTH = 6.0  # fall of the cost that a delay or a set of columns must bring: a likelihood ratio
_TWIST = ("surge", "sway", "heave", "roll rate", "pitch rate", "yaw rate")
_SPREAD = 0.3  # of positive parameters beforehand


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
        self.t = np.concatenate([m[0][c] for _, _, m, c in self._parts])
        self.segment = np.concatenate([np.full(len(c), number) for number, _, _, c in self._parts])
        self.usable = np.concatenate([s.usable[:: chosen.every][c] for _, s, _, c in self._parts])
        assert robot.prior is not None  # every vehicle has one
        self._prior: Array = robot.prior

    def problem(self, delay: Array, columns: frozenset[str]) -> Problem:
        """The fit with commands delayed by (k,) seconds and further columns."""
        system, space = self.system, self.system.space
        Y = []
        for _, segment, (t, q, v, a, u), _ in self._parts:
            times = segment.log.t
            held = np.column_stack(
                [np.interp(t - delay[k], times, u[:, k]) for k in range(u.shape[1])]
            )
            W = system.regressor(t, np.hstack([q, v]), v, a, held)
            more = [
                np.einsum(
                    "nk,kl->nkl", v if name == "damping" else -np.ones_like(v), np.eye(len(v[0]))
                )
                for name in sorted(columns)
            ]
            Y.append(self._filter.rows(np.concatenate([W, *more], axis=2)))
        rows = np.concatenate(Y)
        blocks = list(space.blocks)
        for name in sorted(columns):
            blocks.append(self._extra(name, rows))
        whole = ParameterSpace(tuple(blocks))
        extra = len(whole) - len(space)
        prior = np.concatenate([self._prior, np.zeros(extra)])
        spread = np.concatenate([_spreads(space), whole.scale[len(space) :]])
        known = np.zeros(len(whole), dtype=bool)
        size = Size(_size(whole, rows[self.usable], prior), FILE, np.zeros(len(whole), dtype=bool))
        return Problem(whole, rows, self.usable, self.t, self.segment, prior, spread, known, size)

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

    Of a vehicle without matrices it is the mean of all positive parameters over these values.
    """
    matrix, positive = (
        np.concatenate(kinds)
        for kinds in zip(
            *(
                (
                    np.full(len(b), b.geometry not in ("positive", "free")),
                    np.full(len(b), b.geometry == "positive"),
                )
                for b in space.blocks
            ),
            strict=True,
        )
    )
    if matrix.any():
        return size_weights(columns * matrix, prior)
    return np.where(positive, 1 / np.where(positive, prior, 1.0), 0.0) / positive.sum()


def _spreads(space: ParameterSpace) -> Array:
    """(p,) spread of every parameter beforehand: relative for positive ones, scales for free."""
    parts = [
        np.full(len(b), _SPREAD) if b.geometry == "positive" else np.asarray(b.scale)
        for b in space.blocks
    ]
    return np.concatenate(parts)


def velocity_names(robot: RobotModel) -> tuple[str, ...]:
    """Names of a vehicle's velocities."""
    system = robot.system
    twist = _TWIST[: system.group] if system.group == 6 else ()
    rest = tuple(f"velocity {i + 1}" for i in range(len(twist), system.n))
    return twist + rest


def motion_of(system, segment: Segment, chosen: Filter) -> tuple[Array, Array, Array, Array, Array]:
    """Times, q, v, v̇ of the smoothed motion at the regressors' rate, and all smoothed commands."""
    log = smoothed(system, segment.log, chosen.smoothing)
    a = np.gradient(log.v, 1 / chosen.rate, axis=0)
    pick = slice(None, None, chosen.every)
    u = chosen.low_pass(segment.log.u)
    return log.t[pick], log.q[pick], log.v[pick], a[pick], u


def structured_vehicle(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    told: Callable[[str], None],
) -> Structured:
    """Chooses delays and further columns of a vehicle and makes the rows of the fit.

    Args:
        robot: a vehicle.
        recordings: training logs.
        validation: a log that takes no part in the fit, or None.
        options: of the structure.
        told: called with the name of every stage.
    """
    told("filtering")
    chosen = filter_for(recordings, options.cutoff)
    rows = VehicleRows(robot, recordings, chosen)
    k, findings = len(robot.joints), []
    columns = (options.columns or frozenset()) & frozenset(EXTRA)
    delay = np.zeros(k) if options.delay is None else options.delay
    share = inflation(rows.problem(delay, columns), minimise(rows.problem(delay, columns)).theta)

    def cost(delay: Array, columns: frozenset[str]) -> float:
        problem = rows.problem(delay, columns)
        return minimise(problem, tempered(problem, share)).cost

    if options.delay is None:
        told("searching for delays")
        delay, notes = _search(cost, columns, k, robot.joints)
        findings += notes
    if options.columns is None:
        told("choosing columns")
        best = cost(delay, columns)
        for name in EXTRA:
            trial = cost(delay, columns | {name})
            worth = best - trial
            if worth > _WORTH * 2:
                columns, best = columns | {name}, trial
                findings.append(
                    Finding("note", "columns", "", f"a column of {name} per velocity lowers the "
                            f"cost by {worth:.0f}", data={"columns": sorted(columns)})
                )  # fmt: skip
    problem = rows.problem(delay, columns)
    others = (rows.problem(delay, frozenset()),) if columns else ()
    checked = None
    if validation is not None:
        at = filter_for(validation, chosen.cutoff)
        checked = VehicleRows(robot, validation, at).problem(delay, columns)
    at = problem.space.actuators
    labels = [problem.space.labels[i] for i in at]
    common = float(np.median(delay))
    return Structured(
        problem,
        problem.prior[at],
        np.full(len(at), _SPREAD),
        others,
        checked,
        tuple(Velocity(n, tuple(sorted(columns)), np.nan, common) for n in velocity_names(robot)),
        tuple(findings),
        chosen.cutoff,
        np.zeros(0),
        delay,
        lambda theta: list(command_suspects(problem.Y[:, :, at] * theta[at], labels)),
    )


def _search(
    cost: Callable[[Array, frozenset[str]], float],
    columns: frozenset[str],
    k: int,
    names: tuple[str, ...],
) -> tuple[Array, list[Finding]]:
    """(k,) delays: one shared by all actuators, then one actuator at a time."""
    grid = np.arange(-REACH, REACH + 1e-9, _COARSE)
    costs = np.array([cost(np.full(k, d), columns) for d in grid])
    at, zero = int(np.argmin(costs)), int(np.argmin(np.abs(grid)))
    if costs[at] > costs[zero] - _WORTH:
        return np.zeros(k), []
    if at in (0, len(grid) - 1):
        return np.zeros(k), [
            Finding("warning", "delay_at_edge", "", "the best delay of the commands, "
                    f"{grid[at] * 1e3:+.0f} ms, lies at the edge of the search",
                    "Align the clocks of commands and positions in the map.")
        ]  # fmt: skip
    shared = _narrowed(lambda d: cost(np.full(k, d), columns), grid[at - 1], grid[at + 1])
    delay = np.full(k, shared)
    words = f"commands act {shared * 1e3:.1f} ms after they were recorded"
    return delay, [Finding("note", "delay", "", words, data={name: shared for name in names})]


def _narrowed(cost: Callable[[float], float], low: float, high: float) -> float:
    """The minimum of a cost between two delays, by golden sections and a parabola."""
    ratio = (np.sqrt(5) - 1) / 2
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = cost(a), cost(b)
    while high - low > _FINE:
        if at_a < at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = cost(a)
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = cost(b)
    return float(a if at_a < at_b else b)
