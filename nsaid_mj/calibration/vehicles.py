"""The structure of a vehicle, whose regressor is a system of this package, and its delays.

A vehicle's forces are not linear in its commands, and several actuators act on one velocity. Delays
are therefore chosen by the cost of the fit: first a common one, then one per actuator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from ..baselines.least_squares import smoothed
from ..logs.recordings import Recordings, Segment
from ..parameters import Array, Block, ParameterSpace
from ..robot.findings import Finding
from ..robot.model import RobotModel
from ..structure.columns import fluid, thrust
from ..structure.sensing import rate_labels
from .fit import inflation, minimise, tempered, tempered_fit
from .joints import FILE
from .problem import Problem, Size, size_weights
from .residuals import Suspect
from .result import JointFit, Options, Structured
from .smoothing import Filter, filter_for
from .suspects import command_suspects
from .timing import WORTH, Timing, search

EXTRA = {"damping": "free", "offset": "free"}
"""Further columns of a vehicle, one per velocity: damping −d v, and a constant force."""

_CUTOFFS = (0.7, 0.5, 0.35, 0.25, 0.17, 0.12)  # trial cut-offs, over that of the bandwidth
_ROUNDS = 3  # of choosing timing and cut-off in turn
_FEWEST = 200  # rows per velocity that a lower cut-off must leave
_NARROWER = 0.6  # another plausible cut-off over the chosen one
_FLOWN = {kind.name for kind in (*fluid.KINDS, *thrust.KINDS) if kind.reads == "velocity"}
_FLOW = 0.05  # of a current, for differences [m/s]
_SPREAD = 0.3  # prior spread of positive parameters


class VehicleRows:
    """Rows of a vehicle's segments, through the chosen filters, at any delay of the commands."""

    def __init__(self, robot: RobotModel, recordings: Recordings, chosen: Filter):
        self.robot, self.system, self.filter = robot, robot.system, chosen
        self.recordings = recordings
        self._parts = []
        for number, segment in enumerate(recordings.segments):
            motion = motion_of(self.system, segment, chosen)
            centres = chosen.centres(len(motion[0]))
            if len(centres):
                self._parts.append((number, segment, motion, centres))
        structure = getattr(robot.system, "structure", None)
        columns = () if structure is None else structure.columns
        rotors = {column.input for column in columns if column.kind == "rotor"}
        measured = [unit == "rad/s" for unit in recordings.command_units]  # speeds of rotors
        self.rotors = [k for k in sorted(rotors) if not measured[k]]
        self.others = [k for k in range(len(measured)) if k not in rotors]
        self.t = np.concatenate([m[0][c] for _, _, m, c in self._parts])
        self.segment = np.concatenate([np.full(len(c), number) for number, _, _, c in self._parts])
        self.usable = np.concatenate([s.usable[:: chosen.every][c] for _, s, _, c in self._parts])
        assert robot.prior is not None  # every vehicle has one
        self._prior: Array = robot.prior

    def with_cutoff(self, share: float) -> VehicleRows:
        """The rows of the filter whose cut-off is `share` of this one's."""
        narrower = filter_for(self.recordings, share * self.filter.cutoff)
        return VehicleRows(self.robot, self.recordings, narrower)

    def delays(self, timing: Timing) -> Array:
        """(k,) delays of the actuators [s]."""
        return np.broadcast_to(timing.delay, len(self.robot.joints))

    def _motions(self, timing: Timing) -> Iterator[tuple[Array, Array, Array, Array, Array]]:
        """Times, q, v, v̇ and the commands that act as a timing says, of every segment."""
        for _, segment, (t, q, v, a), _ in self._parts:
            u = self.acting(segment.log.u, self.filter.rate, timing)
            delayed = zip(self.delays(timing), self.filter.low_pass(u).T, strict=True)
            held = [np.interp(t - d, segment.log.t, own) for d, own in delayed]
            yield t, q, v, a, np.column_stack(held)

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
        for t, q, v, a, held in self._motions(timing):
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
            found.append(self.filter.rows(np.stack(forces, axis=2)))
        return np.concatenate(found)

    def problem(self, columns: frozenset[str], timing: Timing) -> Problem:
        """The fit with further columns and commands that act as a timing says."""
        system, Y = self.system, []
        for t, q, v, a, held in self._motions(timing):
            W = [system.regressor(t, np.hstack([q, v]), v, a, held)]
            for name in sorted(columns):
                own = v if name == "damping" else -np.ones_like(v)
                W.append(np.einsum("nk,kl->nkl", own, np.eye(v.shape[1])))
            Y.append(self.filter.rows(np.concatenate(W, axis=2)))
        rows = np.concatenate(Y)
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
        names = rate_labels(self.system)
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


def motion_of(system, segment: Segment, chosen: Filter) -> tuple[Array, Array, Array, Array]:
    """Times, q, v, v̇ of the smoothed motion at the regressors' rate."""
    log = smoothed(system, segment.log, chosen.smoothing)
    a = np.gradient(log.v, 1 / chosen.rate, axis=0)
    pick = slice(None, None, chosen.every)
    return log.t[pick], log.q[pick], log.v[pick], a[pick]


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
        filters = filter_for(validation, rows.filter.cutoff)
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
        rows.filter.cutoff,
        np.zeros(0),
        rows.delays(timing),
        suspects,
        acting=lambda u, rate: rows.acting(u, rate, timing),
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
