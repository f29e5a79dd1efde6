"""Rows of a vehicle, whose forces need not be linear in its commands, at any timing of these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ...core import (
    Array,
    Block,
    Column,
    ParameterSpace,
    SecondOrderSystem,
)
from ...robots import RobotModel
from ..logs.recordings import LogSegment, Recordings
from .choose.columns import MANOEUVRES, further_columns, further_names, offered
from .choose.thruster_curve import ThrusterCurve, sheet_curve
from .choose.timing import Timing
from .dry_mass import scale_deviation
from .joints import FILE
from .links import CarriedLoads
from .loads import Load
from .problem import FitProblem, Size, size_weights
from .rows import Rows, with_columns
from .smoothing import Filter, Smooth
from .translation import acceleration
from .vehicle_loads import BUOYANCY_SPREAD, carried_by, pulled_by

_FLOW = 0.05  # of a current, for differences [m/s]
_SPREAD = 0.3  # prior spread of positive parameters


class VehicleRows(Rows):
    """Rows of a vehicle's segments, through the chosen filters, at any delay of the commands.

    Attributes:
        steady: (p,) whether a parameter is that of actuators whose commands never change.
        thrusters: columns of the thrusters whose commands change.
        coasts: whether it is a vessel of which no command that changes drives surge: its rows are
            not used, as drag by sway and turning moves it, of which no sheet tells.
    """

    def __init__(
        self,
        robot: RobotModel,
        recordings: Recordings,
        chosen: Filter,
        loads: Sequence[Load] = (),
    ):
        self.robot = robot
        self.loads = loads
        self.system = robot.system
        chosen = chosen._replace(quiet=0.0)  # of joints, whose dry friction changes fast
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
        self._only = replace(own, inertias=(), rotors=(), columns=acting)
        self._driven = {ThrusterCurve(): self.system.rebuilt(self._only, self.system.space)}
        ends = [(s.log.u.min(axis=0), s.log.u.max(axis=0)) for s in recordings.segments]
        low, high = (np.array(x) for x in zip(*ends, strict=True))
        moving = np.flatnonzero(high.max(axis=0) > low.min(axis=0))
        moved = {c.parameter for c in acting if c.input in moving}
        self.thrusters = [c for c in acting if c.kind == "thruster" and c.input in moving]
        self.steady = np.array([p in self._commanded and p not in moved for p in range(own.p)])
        self._without_commands: dict[frozenset[str], Array] = {}
        self.coasts = offered(self.system, "manoeuvring") and not self._driven_ahead()
        if self.coasts:
            self.usable[:, 0] = False
        self._carried = [(load, self._columns_of(load)) for load in carried_by(robot, loads)]

    def like(self, recordings: Recordings, chosen: Filter) -> VehicleRows:
        """Rows of other recordings or through another filter."""
        return VehicleRows(self.robot, recordings, chosen, self.loads)

    def _columns_of(self, carried: CarriedLoads) -> Array:
        """(N, n, c) forces of a load per unit of its parameters, in the logs that carry it."""
        own = self.regressor(pulled_by(self.system, carried), lambda W: W)
        logs = np.array([s.source in carried.sources for s in self.recordings.segments])
        return own * logs[self.segment, None, None]

    def _driven_ahead(self) -> bool:
        """Whether a command that changes drives surge."""
        moving = [p for p in self._commanded if not self.steady[p]]
        rows = self.regressor(self._acting(ThrusterCurve()), lambda W: W, self._held(Timing()))
        return bool(rows[:, 0, moving].any())

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
        found[:, self.others] = timing._replace(mix=1.0, dead=0.0).speeds(u[:, self.others], rate)
        return found

    def _acting(self, curve: ThrusterCurve) -> SecondOrderSystem:
        """The actuators alone, with a curve of the thrusters."""
        if curve not in self._driven:
            columns = [curve.column(c) if c.kind == "thruster" else c for c in self._only.columns]
            only = replace(self._only, columns=columns)
            self._driven = {curve: self.system.rebuilt(only, self.system.space)}
        return self._driven[curve]

    def acting_on_sheet(self, u: Array, rate: float, timing: Timing) -> Array:
        """Commands (N, k) at a rate [Hz] with an equal effect under the sheet's thruster curve."""
        found = self.acting(u, rate, timing)
        if timing.curve != ThrusterCurve():
            for column in self.thrusters:
                own = sheet_curve(column)
                found[:, column.input] = timing.curve.as_sheets(found[:, column.input], own)
        return found

    def flow(self, theta: Array, timing: Timing) -> Array:
        """(N, n, k) forces per m/s of a steady current or wind along the world's axes, at θ̂ (p,).

        k is 0 for vehicles on which neither water nor air acts, or of several bodies, and for logs
        without their translation.
        """
        system = self.system
        acting = np.zeros(len(self.system.space))
        at = system.structure.drag_and_lift
        acting[at] = theta[at]
        moved = (system.m, system.n) in ((7, 6), (3, 3)) and not self.recordings.turns_only
        if not acting.any() or not moved:
            return np.zeros((len(self.t), system.n, 0))
        count, found = (3, []) if system.m == 7 else (2, [])
        for motion, held in zip(self.motions, self._held(timing), strict=True):
            t, q, v, a, _ = motion
            heading = q[:, 2:3] * [0.0, 0.0, 1.0]
            turns = Rotation.from_quat(q[:, 3:]) if count == 3 else Rotation.from_rotvec(heading)
            own = turns.inv().as_matrix()
            forces = []
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
            last = max((column.parameter for column in further), default=self.system.p - 1)
            whole = with_columns(self.system, further, [], last + 1)
            self._without_commands[columns] = self.regressor(whole, lambda W: W)
        return self._without_commands[columns]

    def problem(self, columns: frozenset[str], timing: Timing) -> FitProblem:
        """The fit with further columns and commands that act as a timing says."""
        system = self.system
        rows = self._fixed(columns).copy()
        at = self._commanded
        acting = self._acting(timing.curve)
        rows[:, :, at] = self.regressor(acting, lambda W: W[:, :, at], self._held(timing))
        more = [self._extra(name, rows) for name in sorted(columns)]
        carried = [load.block for load, _ in self._carried]
        space = ParameterSpace((*system.space.blocks, *more, *carried))
        rows = np.concatenate([rows, *(own for _, own in self._carried)], axis=2)
        none = np.zeros(len(space), dtype=bool)
        steady = np.append(self.steady, none[len(self.steady) :])
        prior = np.append(self._prior, np.zeros(len(space) - len(self._prior)))
        spread = np.where(space.geometries == "positive", _SPREAD, space.scale)
        stated = none.copy()
        for block in carried:
            prior[space[block.name]] = block.scale
            spread[space[block.name]] = BUOYANCY_SPREAD
            stated[space[block.name]] = True
        weights = _size(space, rows[self.usable], prior)
        weighed = self.robot.weighed and bool(self.usable[:, :3].any())  # no mass acts in a turn
        deviation = scale_deviation(self.robot) if weighed else FILE
        size = Size(weights[None], np.zeros(len(space), dtype=np.intp), deviation, stated)
        # relative to its own drag, noise of a velocity without an actuator would pass for drag
        inertia = np.tile(weights, (rows.shape[1], 1))
        of_rows = (self.usable, self.t, self.segment)
        return FitProblem(space, rows, *of_rows, prior, spread, none, size, inertia, steady)

    def _manoeuvring(self, force: Array) -> Block:
        """The block of what manoeuvring adds to a vessel under actuators' forces (n,)."""
        v = np.concatenate([motion.v for motion in self.motions])
        speed = dict(zip("uvr", np.sqrt(np.mean(v**2, axis=0)).tolist(), strict=True))
        scales = []
        for product, _, row, _ in MANOEUVRES:
            first, second = product.split()
            scales.append(float(force[row]) / max(speed[first] * speed[second], 1e-9))
        names = ("surge", "sway", "yaw")
        return Block(
            "further manoeuvring",
            tuple(further_names(self.system, "manoeuvring")),
            tuple(unit for _, unit, _, _ in MANOEUVRES),
            np.array(scales),
            "free",
            labels=tuple(f"further {x} in {names[row]}" for x, _, row, _ in MANOEUVRES),
        )

    def _extra(self, name: str, rows: Array) -> Block:
        """A block of one further parameter per velocity, or of those of manoeuvring."""
        units = self.system.velocity_units
        force = ["N" if unit == "m/s" else "N·m" for unit in units]
        labels = self.system.rate_labels
        at = self.system.space.actuators
        size = np.sqrt(np.mean((rows[:, :, at] @ self._prior[at]) ** 2, axis=0))
        size = np.maximum(size, 1e-3 * max(float(size.max()), 1e-9))
        if name == "manoeuvring":
            return self._manoeuvring(size)
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


def smooth_pose(system: SecondOrderSystem, segment: LogSegment, chosen: Filter) -> Smooth:
    """The smoothed motion of a segment, whose positions may be poses."""
    log = system.smoothed(segment.log, chosen.smoothing)
    a = np.gradient(log.v, 1 / chosen.rate, axis=0)
    if segment.specific is not None:
        a[:, :3] = chosen.low_pass(acceleration(segment, log.q, log.v))
    pick = slice(None, None, chosen.every)
    return Smooth(log.t[pick], log.q[pick], log.v[pick], a[pick], segment.usable[pick])
