"""The structure of a vehicle, whose regressor is a system of this package, and its delays.

A vehicle's forces are not linear in its commands, and several actuators act on one velocity. Delays
are therefore chosen by the cost of the fit: first a common one, then one per actuator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..baselines.least_squares import smoothed
from ..logs.recordings import Recordings, Segment
from ..parameters import Array, Block, ParameterSpace
from ..robot.findings import Finding
from ..robot.model import RobotModel
from ..structure.columns import fluid, thrust
from ..structure.parts import Column
from ..structure.sensing import rate_labels
from ..structure.system import SecondOrderSystem, rebuilt
from .choose.columns import EXTRA, further_columns, further_names
from .fit import inflation, minimise, tempered, tempered_fit
from .joints import FILE
from .problem import Problem, Size, size_weights
from .residuals import Suspect
from .result import JointFit, Options, Structured
from .rows import Rows, with_columns
from .smoothing import Filter, Smooth, filter_for
from .suspects import command_suspects
from .timing import WORTH, Timing, search

_CUTOFFS = (0.7, 0.5, 0.35, 0.25, 0.17, 0.12)  # trial cut-offs, over that of the bandwidth
_ROUNDS = 3  # of choosing timing and cut-off in turn
_FEWEST = 200  # rows per velocity that a lower cut-off must leave
_NARROWER = 0.6  # another plausible cut-off over the chosen one
_FLOWN = {kind.name for kind in (*fluid.KINDS, *thrust.KINDS) if kind.reads == "velocity"}
_FLOW = 0.05  # of a current, for differences [m/s]
_SPREAD = 0.3  # prior spread of positive parameters


class VehicleRows(Rows):
    """Rows of a vehicle's segments, through the chosen filters, at any delay of the commands."""

    def __init__(self, robot: RobotModel, recordings: Recordings, chosen: Filter):
        self.robot, self.system = robot, robot.system
        super().__init__(recordings, chosen, lambda *each: smooth_pose(robot.system, *each))
        rotors = {column.input for column in self.system.columns("rotor")}
        measured = [unit == "rad/s" for unit in recordings.command_units]  # speeds of rotors
        self.rotors = [k for k in sorted(rotors) if not measured[k]]
        self.others = [k for k in range(len(measured)) if k not in rotors]
        assert robot.prior is not None  # every vehicle has one
        self._prior: Array = robot.prior
        own = self.system.structure
        self._commanded = sorted({c.parameter for c in own.columns if c.input >= 0})
        acting = [c for c in own.columns if c.parameter in self._commanded]
        only = replace(own, inertias=(), rotors=(), columns=acting)
        self._acting = rebuilt(self.system, only, self.system.space)
        self._without_commands: dict[frozenset[str], Array] = {}

    def with_cutoff(self, share: float) -> VehicleRows:
        """The rows of the filter whose cut-off is `share` of this one's."""
        narrower = filter_for(self.recordings, share * self.chosen.cutoff)
        return VehicleRows(self.robot, self.recordings, narrower)

    def delays(self, timing: Timing) -> Array:
        """(k,) delays of the actuators [s]."""
        return np.broadcast_to(timing.delay, len(self.robot.joints))

    def _held(self, timing: Timing) -> list[Array]:
        """(M, k) commands of every motion that act as a timing says, at its times."""
        found = []
        for segment, motion in zip(self.segments, self.motions, strict=True):
            u = self.acting(segment.log.u, self.chosen.rate, timing)
            delayed = zip(self.delays(timing), self.chosen.low_pass(u).T, strict=True)
            held = [np.interp(motion.t - d, segment.log.t, own) for d, own in delayed]
            found.append(np.column_stack(held))
        return found

    def acting(self, u: Array, rate: float, timing: Timing) -> Array:
        """Commands (N, k) at a rate [Hz] as they act, apart from the delay."""
        found = u.copy()
        found[:, self.rotors] = timing.speeds(u[:, self.rotors], rate)
        found[:, self.others] = timing._replace(mix=1.0).speeds(u[:, self.others], rate)
        return found

    def flow(self, theta: Array, timing: Timing) -> Array:
        """(N, n, k) forces per m/s of a steady current or wind along the world's axes, at θ̂ (p,).

        k is 0 for vehicles on which neither water nor air acts, or of several bodies.
        """
        system, acting = self.system, np.zeros(len(self.system.space))
        at = [c.parameter for c in system.structure.columns if c.kind in _FLOWN]
        acting[at] = theta[at]
        if not acting.any() or (system.m, system.n) not in ((7, 6), (3, 3)):
            return np.zeros((len(self.t), system.n, 0))
        count, found = (3, []) if system.m == 7 else (2, [])
        for motion, held in zip(self.motions, self._held(timing), strict=True):
            t, q, v, a, _ = motion
            heading = q[:, 2:3] * [0.0, 0.0, 1.0]
            turns = Rotation.from_quat(q[:, 3:]) if count == 3 else Rotation.from_rotvec(heading)
            own, forces = turns.inv().as_matrix(), []
            for axis in range(count):
                along = np.zeros_like(v)
                along[:, :count] = _FLOW * own[:, :count, axis]
                slower, faster = (
                    system.regressor(t, np.hstack([q, v + side * along]), v, a, held) @ acting
                    for side in (-1, 1)
                )
                forces.append((slower - faster) / (2 * _FLOW))
            found.append(self.chosen.rows(np.stack(forces, axis=2)))
        return np.concatenate(found)

    def further(self, columns: frozenset[str]) -> list[Column]:
        """The further columns, whose parameters follow the vehicle's own."""
        names = [name for each in sorted(columns) for name in further_names(self.system, each)]
        places = {name: self.system.p + k for k, name in enumerate(names)}
        return list(further_columns(self.system, columns, places))

    def _fixed(self, columns: frozenset[str]) -> Array:
        """(N, n, p) rows with further columns, of commands of 0: computed once for all timings."""
        if columns not in self._without_commands:
            further = self.further(columns)
            whole = with_columns(self.system, further, [], self.system.p + len(further))
            self._without_commands[columns] = self.regressor(whole, lambda W: W)
        return self._without_commands[columns]

    def problem(self, columns: frozenset[str], timing: Timing) -> Problem:
        """The fit with further columns and commands that act as a timing says."""
        system = self.system
        rows, at = self._fixed(columns).copy(), self._commanded
        rows[:, :, at] = self.regressor(self._acting, lambda W: W[:, :, at], self._held(timing))
        more = [self._extra(name, rows) for name in sorted(columns)]
        space = ParameterSpace((*system.space.blocks, *more))
        none = np.zeros(len(space), dtype=bool)
        prior = np.append(self._prior, np.zeros(len(space) - len(self._prior)))
        spread = np.where(space.geometries == "positive", _SPREAD, space.scale)
        weights = _size(space, rows[self.usable], prior)
        size = Size(weights[None], np.zeros(len(space), dtype=np.intp), FILE, none)
        # relative to its own drag, noise of a velocity without an actuator would pass for drag
        inertia = np.tile(weights, (rows.shape[1], 1))
        return Problem(
            space, rows, self.usable, self.t, self.segment, prior, spread, none, size, inertia
        )

    def _extra(self, name: str, rows: Array) -> Block:
        """A block of one further parameter per velocity."""
        units = self.system.velocity_units
        force = ["N" if unit == "m/s" else "N·m" for unit in units]
        labels = rate_labels(self.system)
        at = self.system.space.actuators
        size = np.sqrt(np.mean((rows[:, :, at] @ self._prior[at]) ** 2, axis=0))
        size = np.maximum(size, 1e-3 * max(float(size.max()), 1e-9))
        return Block(
            f"further {name}",
            tuple(further_names(self.system, name)),
            tuple(
                f"{f}/({u})" if name == "damping" else f for f, u in zip(force, units, strict=True)
            ),
            0.3 * size,
            "free",
            labels=tuple(f"further {name} of {label}" for label in labels),
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


def smooth_pose(system: SecondOrderSystem, segment: Segment, chosen: Filter) -> Smooth:
    """The smoothed motion of a segment, whose positions may be poses."""
    log = smoothed(system, segment.log, chosen.smoothing)
    a = np.gradient(log.v, 1 / chosen.rate, axis=0)
    pick = slice(None, None, chosen.every)
    return Smooth(log.t[pick], log.q[pick], log.v[pick], a[pick], segment.usable[pick])


def _richer(rows: VehicleRows, timing: Timing) -> tuple[frozenset[str], list[Finding]]:
    """The further columns that significantly lower the cost, and notes about them."""
    columns, notes, cost = frozenset[str](), [], _cost(rows, frozenset(), timing)
    best = cost(columns, timing)
    for name in EXTRA:
        trial = cost(columns | {name}, timing)
        worth = best - trial
        if worth > WORTH * 2:
            columns, best = columns | {name}, trial
            text = f"a column of {name} per velocity lowers the cost by {worth:.0f}"
            data = {"columns": sorted(columns)}
            notes.append(Finding("note", "columns", "", text, data=data))
    return columns, notes


def structured_vehicle(
    robot: RobotModel,
    recordings: Recordings,
    validation: Recordings | None,
    options: Options,
    report: Callable[[str], None],
) -> Structured:
    """Chooses delays and further columns of a vehicle and makes the rows of the fit.

    `recordings` are training logs, `validation` is a log excluded from the fit, or None; `report`
    is called with the name of every stage.
    """
    report("filtering")
    rows = VehicleRows(robot, recordings, filter_for(recordings, options.cutoff))
    columns = (options.columns or frozenset()) & frozenset(EXTRA)
    trials = [rows] if options.cutoff is not None else _narrower(rows)
    rows = trials[len(trials) // 2]
    for _ in range(_ROUNDS):
        timing, others, findings = _timing(rows, columns, options.delay, report)
        report("choosing the cut-off")
        before, rows = rows, _most_informative(trials, columns, timing)
        if rows is before:
            break
    if options.columns is None:
        report("choosing columns")
        columns, notes = _richer(rows, timing)
        findings.extend(notes)
    problem = rows.problem(columns, timing)
    checked = None
    if validation is not None:
        filters = filter_for(validation, rows.chosen.cutoff)
        checked = VehicleRows(robot, validation, filters).problem(columns, timing)
    at = problem.space.actuators
    labels = [problem.space.labels[i] for i in at]

    def suspects(theta: Array) -> Iterator[Suspect]:
        yield from command_suspects(problem.t, problem.Y[:, :, at] * theta[at], labels)
        flow = rows.flow(theta, timing)
        if flow.shape[2]:
            remedy = "Record in still water or air, or with the speed relative to it as `linear`."
            yield Suspect("a steady current or wind", "", flow, remedy)

    own, late = tuple(sorted(columns)), float(np.median(rows.delays(timing)))
    return Structured(
        problem,
        _alternatives(rows, columns, timing, others),
        checked,
        tuple(JointFit(name, columns=own, delay=late) for name in rate_labels(rows.system)),
        tuple(findings),
        rows.chosen.cutoff,
        rows.delays(timing),
        suspects,
        acting=lambda u, rate: rows.acting(u, rate, timing),
        columns=rows.further(columns),
    )


def _cost(
    rows: VehicleRows, columns: frozenset[str], timing: Timing
) -> Callable[[frozenset[str], Timing], float]:
    """The cost of the fit, with as many rows per independent row as there are at a timing."""
    first = rows.problem(columns, timing)
    share = inflation(first, minimise(first).theta)

    def cost(columns: frozenset[str], timing: Timing) -> float:
        problem = rows.problem(columns, timing)
        return minimise(problem, tempered(problem, share)).cost

    return cost


def _timing(
    rows: VehicleRows,
    columns: frozenset[str],
    delay: Array | None,
    report: Callable[[str], None],
) -> tuple[Timing, list[Timing], list[Finding]]:
    """The timing for rows, equally plausible ones, and notes; a given `delay` (k,) is kept."""
    if delay is not None:
        return Timing(delay), [], []
    cost = _cost(rows, columns, Timing())
    free = [0, *([1] if rows.rotors or rows.others else []), *([2] if rows.rotors else [])]
    return search(lambda x: cost(columns, x), rows.robot.joints, free, report)


def _narrower(rows: VehicleRows) -> list[VehicleRows]:
    """The rows, and those of lower cut-offs that leave enough of them."""
    others = [rows.with_cutoff(share) for share in _CUTOFFS]
    return [rows, *(other for other in others if len(other.t) >= _FEWEST)]


def _most_informative(
    trials: list[VehicleRows], columns: frozenset[str], timing: Timing
) -> VehicleRows:
    """The rows with the most information about θ, of several cut-offs.

    An acceleration's noise grows with its frequency, and biases θ̂ where it exceeds the motion. The
    information of the fit, by the determinant of its Hessian, is largest without such frequencies.
    """

    def information(rows: VehicleRows) -> float:
        problem = rows.problem(columns, timing)
        hessian, scale = tempered_fit(problem)[0].hessian, problem.space.scale
        return float(np.linalg.slogdet(hessian * np.outer(scale, scale))[1])

    return trials[0] if len(trials) == 1 else max(trials, key=information)


def _alternatives(
    rows: VehicleRows, columns: frozenset[str], timing: Timing, others: list[Timing]
) -> Iterator[Problem]:
    """Other plausible problems: without further columns, at other timings, of a narrower filter."""
    if columns:
        yield rows.problem(frozenset(), timing)
    for other in others:
        yield rows.problem(columns, other)
    yield rows.with_cutoff(_NARROWER).problem(columns, timing)
