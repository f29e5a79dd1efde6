"""Rows of a robot that stands and walks: its balance without the forces on its feet.

With J the Jacobian of the feet and E Jᵀ = 0, E W θ = 0 for every contact force (`core`'s
`Elimination`). The base enters by its IMU alone. In axes of the base, with velocity (0, ω, q̇) and
acceleration (f + Rᵀ g, ω̇, q̈), f the specific force at the base's origin, W is that of the robot
in the world, since neither a constant velocity nor a place changes it:

    m (v̇ + ω × v − Rᵀ g) = m f.

Contact forces jump at touch-down. So E is applied to the samples, before the rows' filter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ....base import pin
from ....core import (
    Array,
    Block,
    Column,
    ContactPoint,
    Elimination,
    ParameterSpace,
    Rotor,
    Sums,
    zero_phase,
)
from ....robots import RobotModel
from ...logs.imu import GRAVITY
from ...logs.recordings import LogSegment, Recordings
from ..choose.columns import COLUMNS, SPEEDS, joint_column
from ..joints import FILE, TRUSTED
from ..links import file_links, link_blocks
from ..problem import FitProblem, Mask, Size
from ..rows import Rows, unrolled, with_columns
from ..smoothing import Filter, Smooth, delayed, noise_levels, slope, smooth_commands

BASE = 6
"""Velocities of the base, before those of the joints."""

_STRAIGHT = 30.0  # condition, over its median, from which a leg counts as stretched
_FEW = 50  # rows of a velocity below which its parameters could make them all 0
_WIDE = 2.0  # standard deviation of log θ of frictions and rotors: a factor of 7
FRICTIONS = ("rotor", "viscous", "coulomb")
"""Columns of every joint."""
CONTROLLED = "controller's damping"
"""What viscous friction contains of motors under a PD law: no motion tells the two apart."""
_STAY = 10.0  # weight of J a = 0 beside E M a [kg]
_RIDGE = 1e-12  # of the trace, for legs without a row of their own
BANDS = (5.0, 8.0, 15.0, 30.0)
"""Frequencies up to which velocities may tell how dry friction turns [Hz].

A leg that trots turns faster than one of a biped that shifts its weight, whose joints creep by less
than their velocities' noise.
"""
_WEIGHED = 0.002  # standard deviation of the logarithm of a weighed robot's mass


@dataclass(frozen=True)
class Ground:
    """What a robot's rows on the ground depend on, beside its joints' logs."""

    feet: list[ContactPoint]  # that may touch
    imu: pin.SE3  # pose of the IMU in the base's frame
    clock: float = 0.0  # how late the IMU's readings are, against the joints' [s]
    force: Array = field(default_factory=lambda: np.zeros(3))  # bias of the accelerometer [m/s²]
    # (N, feet) whether each touches, at the samples of every segment; None for all of them
    touching: tuple[Array, ...] | None = None
    law: Array | None = None  # (2, k) gains of a PD law in measured torques; see `feedback_in`
    # share of the base's answer to each step of held targets by which the accelerometer's readings
    # exceed the mean between steps, and that answer, (M, 6) of every segment; None if nothing steps
    at_step: float = 0.0
    answer: tuple[Array, ...] | None = None


class GroundRows(Rows):
    """All columns of a walking robot's segments, without contact forces, filtered once.

    Attributes:
        speed: index of s of tanh(v(t + lead)/s) of Coulomb friction in `SPEEDS`.
        lead: by which dry friction turns before the velocity does [s].
        band: index of the frequency of its velocity in `BANDS`.
        gain: (k,) expected gains.
        spread: (k,) standard deviations of their logarithms.
        system: the robot's, base first, with an angle as the position of every joint.
        space: θ: links, rotors, frictions, gains.
        fixed: (N, n, p) rows of everything but the commands.
        condition: (N,) of every motion's Jacobian; see `Elimination`.
        law: (2, k) gains of measured position and velocity in the commands, of a PD law that the
            log states or the commands show; None without one.
    """

    def __init__(
        self,
        robot: RobotModel,
        recordings: Recordings,
        chosen: Filter,
        ground: Ground,
        speed: int,
    ):
        self.robot = robot
        self.ground = ground
        self.gain = np.abs(robot.gain)
        self.spread = np.ones(len(self.gain))
        self.speed = speed
        self.lead = 0.0
        self.band = len(BANDS) - 1
        self._kept: dict[str, tuple[tuple[object, ...], Array]] = {}
        self._turned: dict[tuple[int, int], Array] = {}
        k = len(robot.joints)
        self.system = unrolled(robot.system)
        super().__init__(recordings, chosen, lambda *each: smooth_ground(ground, *each))
        self.motions = [self._between(k, each, ground) for k, each in enumerate(self.motions)]
        self.driven = recordings.driven(robot)
        self.law = ground.law if recordings.feedback is None else recordings.feedback
        self._commands = [(s, smooth_commands(s, chosen, self.law)) for s in self.segments]
        self.eliminated = [self._eliminated(k, motion) for k, motion in enumerate(self.motions)]
        self.usable &= self._sure()
        self.usable[:, self.usable.sum(axis=0) < _FEW] = False
        self.space = self._space()
        system = with_columns(
            self.system, self.terms(self.space)[0], self._rotors(), len(self.space)
        )
        E = [each.E for each in self.eliminated]
        self.fixed = self.regressor(system, lambda W: W, free=E)
        viscous = [self.space.index(f"{COLUMNS['viscous'].letter}_{j + 1}") for j in range(k)]
        pairs = zip(self.eliminated, self.segments, strict=True)
        self.fixed[:, :, viscous] = np.concatenate(
            [chosen.rows(each.E[:, :, BASE:] * _travelled(s, chosen)[:, None]) for each, s in pairs]
        )

    def expect(self, gain: Array, spread: Array) -> None:
        """Sets expected gains (k,) and the standard deviations of their logarithms (k,)."""
        self.gain = gain
        self.spread = spread
        self.space = self._space()

    def like(
        self,
        recordings: Recordings | None = None,
        ground: Ground | None = None,
        chosen: Filter | None = None,
    ) -> GroundRows:
        """The rows of other recordings, another filter, or other assumptions."""
        other = GroundRows(
            self.robot,
            recordings or self.recordings,
            chosen or self.chosen,
            ground or self.ground,
            self.speed,
        )
        other.expect(self.gain, self.spread)
        other.lead = self.lead
        other.band = self.band
        other.usable[:, :BASE] &= self.usable[:, :BASE].any()
        return other

    def _eliminated(self, number: int, motion: Smooth) -> Elimination:
        bear = self._bear(number)
        return Elimination(self.system.structure, self.ground.feet, motion.q, bear)

    def _bear(self, number: int) -> Mask | None:
        """(M, feet) which feet may bear load along a motion; None for all of them."""
        if self.ground.touching is None:
            return None
        own = self.ground.touching[self.position(number)]
        return own[:: self.chosen.every].astype(bool)

    def position(self, number: int) -> int:
        """The number of a motion's segment among all of the recordings; short ones have no rows."""
        own = self.segments[number]
        return next(k for k, s in enumerate(self.recordings.segments) if s is own)

    def _between(self, number: int, motion: Smooth, ground: Ground) -> Smooth:
        """A motion with the mean specific force between steps of the targets."""
        if ground.answer is None or ground.at_step == 0:
            return motion
        answer = ground.answer[self.position(number)]
        lever = ground.imu.translation  # the gyroscope's slope, too, is the mean between steps
        at_imu = answer[:, :3] + np.cross(answer[:, 3:], lever)
        a = motion.a.copy()
        a[:, :3] -= ground.at_step * at_imu
        return motion._replace(a=a)

    def smoothed(self, number: int, ground: Ground) -> Smooth:
        """A motion under other assumptions about sensors."""
        own = self.motions[number]  # whose joints are the same
        parts = zip(own[1:4], base_motion(ground, self.segments[number], self.chosen), strict=True)
        q, v, a = (np.hstack([base, x[:, base.shape[1] :]]) for x, base in parts)
        return self._between(number, own._replace(q=q, v=v, a=a), ground)

    def answer(self, number: int, theta: Array) -> Array:
        """(M, 6) accelerations of the base right after one row's step of the targets, at θ (p,).

        A held target steps, and with it the motors' force: E M a = E Δτ while feet that bear load
        stay, J a = 0. A target that changes at the rate u̇ steps by u̇ over the rate of the rows.
        """
        motion = self.motions[number]
        rest = motion._replace(v=np.zeros_like(motion.v), a=np.zeros_like(motion.a))
        still = self._moving(rest, theta)
        M = np.empty((*motion.a.shape, motion.a.shape[1]))
        for j, unit in enumerate(np.eye(motion.a.shape[1])):
            M[:, :, j] = self._moving(rest._replace(a=rest.a + unit), theta) - still
        segment, curve = self._commands[number]
        change = curve.derivative()(segment.log.t[:: self.chosen.every]) / self.recordings.rate
        assert self.law is not None
        change = change * np.sign(self.robot.gain) * (self.law[0] > 0)  # other commands do not step
        change = change[:, self.driven] * theta[self.space.actuators]
        E = self.eliminated[number].E
        force = E[:, :, [BASE + j for j in self.driven]] @ change[:, :, None]
        held = self.system.contact_jacobians(self.ground.feet, motion.q)[0]
        bear = self._bear(number)
        if bear is not None:
            rows = [foot.rows for foot in self.ground.feet]
            held = held * np.repeat(bear, rows, axis=1)[:, :, None]
        A = E @ M
        normal = A.transpose(0, 2, 1) @ A + _STAY**2 * (held.transpose(0, 2, 1) @ held)
        normal += _RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(A.shape[2])
        return np.linalg.solve(normal, A.transpose(0, 2, 1) @ force)[:, :BASE, 0]

    def required(
        self, number: int, theta: Array, delay: Array, motion: Smooth | None = None
    ) -> Array:
        """(M, n) W θ along a motion, unfiltered, at θ (p,), delays (k,): contact forces."""
        motion = motion or self.motions[number]
        found = self._moving(motion, theta)
        driving = self.acting(number, delay)[:, self.driven] * theta[self.space.actuators]
        found[:, [BASE + j for j in self.driven]] -= driving
        return found

    def _moving(self, motion: Smooth, theta: Array) -> Array:
        """(M, n) W θ along a motion of everything but the motors."""
        columns, rotors = self.terms(self.space)
        own = [column for column in columns if column.kind != "motor"]
        system = with_columns(self.system, own, rotors, len(self.space))
        return system.torques(theta, motion.q, motion.v, motion.a)

    def _sure(self) -> Mask:
        """(N, n) rows near which no leg is stretched, and in which a velocity's forces appear."""
        found = []
        typical = np.median(np.concatenate([each.condition for each in self.eliminated]))
        half = self.chosen.filter.half
        for each, motion in zip(self.eliminated, self.motions, strict=True):
            centres = self.chosen.centres(len(motion.t))
            bad = each.condition > _STRAIGHT * typical
            near = scipy.ndimage.maximum_filter1d(bad, 2 * half + 1)
            own = np.diagonal(each.E, axis1=1, axis2=2) > 0.5
            own = scipy.ndimage.minimum_filter1d(own, 2 * half + 1, axis=0)
            own[:, :BASE] = True
            found.append(own[centres] & ~near[centres][:, None])
        return np.concatenate(found)

    def _space(self) -> ParameterSpace:
        joints = self.robot.joints
        blocks = link_blocks(self.robot)
        for name in FRICTIONS:
            column = COLUMNS[name]
            kinds = [self._slides(j) for j in range(len(joints))]
            said = column.block
            if name == "viscous" and self.recordings.feedback is not None:
                said = f"{CONTROLLED} and {said}"
            blocks.append(
                Block(
                    column.block,
                    tuple(f"{column.letter}_{j + 1}" for j in range(len(joints))),
                    tuple(column.unit[kind] for kind in kinds),
                    self._guess(name),
                    "positive",
                    labels=tuple(f"{said} of {joint}" for joint in joints),
                )
            )
        units = self.recordings.command_units
        blocks.append(
            Block(
                "motor gain",
                tuple(f"gain_{j + 1}" for j in self.driven),
                tuple(f"{('N·m', 'N')[self._slides(j)]}/{units[j] or 'unit'}" for j in self.driven),
                self.gain[self.driven],
                "positive",
                True,
                labels=tuple(f"gain of {joints[j]}" for j in self.driven),
            )
        )
        return ParameterSpace(tuple(blocks))

    def _guess(self, name: str) -> Array:
        """(k,) guesses of a friction: the file's, or a share of the typical command."""
        robot = self.robot
        given = {"rotor": robot.rotor, "viscous": robot.damping, "coulomb": robot.friction}[name]
        moved = {
            "rotor": self.joined(lambda motion: motion.a[:, BASE:]),
            "viscous": self.joined(lambda motion: motion.v[:, BASE:]),
            "coulomb": np.ones((1, len(given))),
        }[name]
        u = self.commands(np.zeros(len(self.gain))) * self.gain
        force = np.sqrt(np.mean(u**2, axis=0))
        guess = COLUMNS[name].share * force / np.maximum(np.sqrt(np.mean(moved**2, axis=0)), 1e-9)
        guess = np.maximum(guess, 1e-9)
        found = np.where(given > 0, np.minimum(given, guess / COLUMNS[name].share), guess)
        law = self.recordings.feedback
        if name == "viscous" and law is not None:
            found = found + law[1] * self.gain
        return found

    def _slides(self, joint: int) -> bool:
        return self.robot.system.slides[joint]

    def terms(self, space: ParameterSpace) -> tuple[list[Column], list[Rotor]]:
        """Columns of friction, then of motors, and rotors, on the joints' velocities."""
        columns = []
        for joint in range(len(self.robot.joints)):
            for name in ("viscous", "coulomb"):
                at = space.index(f"{COLUMNS[name].letter}_{joint + 1}")
                speeds = SPEEDS[self.speed], 0.0
                columns.append(joint_column(name, at, BASE + joint, speeds, np.zeros(0)))
        pairs = zip(space.actuators.tolist(), self.driven, strict=True)
        columns += [Column("motor", at, dof=BASE + j, input=j) for at, j in pairs]
        return columns, self._rotors()

    def _rotors(self) -> list[Rotor]:
        letter = COLUMNS["rotor"].letter
        joints = range(len(self.robot.joints))
        return [Rotor(BASE + j, self.space.index(f"{letter}_{j + 1}")) for j in joints]

    def acting(self, number: int, delay: Array, lag: float = 0.0) -> Array:
        """(M, k) unfiltered commands of a motion, late by (k,) seconds.

        The part of a PD law that the measured motion makes is not late, but by `lag` [s].
        """
        segment, curve = self._commands[number]
        stated = self.recordings.feedback is not None
        late = delay
        if self.law is not None and not stated:  # the targets in these torques hold for a row
            late = delay + 0.5 / self.recordings.rate * (self.law[0] > 0)
        u = delayed(segment, self.chosen, curve, late)
        motion = self.motions[number]
        if self.law is not None:
            kp, kd = self.law
            u = u - kp * (motion.q[:, BASE + 1 :] - lag * motion.v[:, BASE:])
            u = u + lag * kd * motion.a[:, BASE:]
            if not stated:  # else damping is part of viscous friction
                u = u - kd * motion.v[:, BASE:]
        return u * np.sign(self.robot.gain)

    def commands(self, delay: Array) -> Array:
        """(N, k) filtered commands, delayed by (k,) seconds."""
        return np.concatenate(
            [self.chosen.rows(self.acting(k, delay)) for k in range(len(self.motions))]
        )

    def problem(
        self,
        delay: Array,
        speed: int | None = None,
        lead: float | None = None,
        band: int | None = None,
        lag: float = 0.0,
    ) -> FitProblem:
        """The fit with commands that act late by (k,) seconds; `lag` is that of `acting`.

        Coulomb friction is proportional to tanh(v(t + `lead`)/s), with s of index `speed` in
        `SPEEDS` and v up to the frequency of index `band` in `BANDS`; None for those of the rows.
        """
        space = self.space
        at = space.actuators
        Y = self.fixed.copy()
        Y[:, :, at] = self._driven_rows(delay, lag)
        Y[:, :, self._rubbed] = self._rubbing_rows(
            self.speed if speed is None else speed,
            self.lead if lead is None else lead,
            self.band if band is None else band,
        )
        own = file_links(self.robot.model)
        frictions = np.concatenate([self._guess(name) for name in FRICTIONS])
        prior = np.concatenate([own, frictions, self.gain[self.driven]])
        spread = np.full(len(space), np.inf)
        spread[len(own) : len(own) + len(frictions)] = _WIDE
        spread[at] = self.spread[self.driven]
        none = np.zeros(len(space), dtype=bool)
        stated = none.copy()
        stated[at] = self.spread[self.driven] < TRUSTED
        weights = total_mass(self.robot, len(space))
        limb = np.zeros(len(space), dtype=np.intp)
        deviation = _WEIGHED if self.robot.weighed else FILE
        size = Size(weights[None], limb, deviation, stated)
        whole = np.zeros((self.system.n, len(space)))
        whole[[BASE + j for j in self.driven], at] = self.commands(delay)[:, self.driven].std(
            axis=0
        )
        of_rows = (self.usable, self.t, self.segment)
        return FitProblem(space, Y, *of_rows, prior, spread, none, size, whole=whole)

    def sums(self, delay: Array, speed: int, lead: float, band: int) -> Sums:
        """The Gramians of `problem` with other commands and dry friction, but not its rows."""
        at = np.concatenate([self.space.actuators, self._rubbed])
        varied = [self._driven_rows(delay, 0.0), self._rubbing_rows(speed, lead, band)]
        varied = np.concatenate(varied, axis=2) * self.usable[:, :, None]
        found = self._sums.sums.copy()
        for row, each in enumerate(found):
            each[:, at] = self.fixed[:, row].T @ varied[:, row]
            each[at] = each[:, at].T
            each[np.ix_(at, at)] = varied[:, row].T @ varied[:, row]
        return Sums(found, self._sums.counts)

    @cached_property
    def _sums(self) -> Sums:
        """Gramians of `fixed`."""
        return Sums.of(self.fixed, self.usable)

    @property
    def _rubbed(self) -> list[int]:
        """(k,) indices of Coulomb friction in θ."""
        letter = COLUMNS["coulomb"].letter
        return [self.space.index(f"{letter}_{j + 1}") for j in range(len(self.gain))]

    def _driven_rows(self, delay: Array, lag: float) -> Array:
        """(N, n, d) columns of the motors' gains; see `acting`."""

        def own(number: int) -> Array:
            u = self.acting(number, delay, lag)[:, self.driven]
            E = self.eliminated[number].E[:, :, [BASE + j for j in self.driven]]
            return -E * u[:, None, :]

        return self._columns("driven", (*delay.tolist(), lag), own)

    def _rubbing_rows(self, speed: int, lead: float, band: int) -> Array:
        """(N, n, k) columns of Coulomb friction; see `problem`."""

        def own(number: int) -> Array:
            segment = self.segments[number]
            if (number, band) not in self._turned:
                self._turned[number, band] = turning(segment, self.chosen, BANDS[band])
            ahead = self.motions[number].t + lead
            each = self._turned[number, band].T
            v = np.column_stack([np.interp(ahead, segment.log.t, x) for x in each])
            sign = np.tanh(v / SPEEDS[speed])
            return self.eliminated[number].E[:, :, BASE:] * sign[:, None, :]

        return self._columns("rubbing", (speed, lead, band), own)

    def _columns(self, name: str, key: tuple[object, ...], own: Callable[[int], Array]) -> Array:
        """(N, n, ·) filtered columns of every motion; the last ones of a name are kept.

        Searches vary commands or friction, not both.
        """
        if name not in self._kept or self._kept[name][0] != key:
            parts = [self.chosen.rows(own(number)) for number in range(len(self.motions))]
            self._kept[name] = key, np.concatenate(parts)
        return self._kept[name][1]


def smooth_ground(ground: Ground, segment: LogSegment, chosen: Filter) -> Smooth:
    """The smoothed motion of base and joints of a segment."""
    log = segment.log
    pick = slice(None, None, chosen.every)
    joints = chosen.low_pass(log.q)
    rates = slope(log.t, joints) if chosen.differentiate else chosen.low_pass(log.v)
    each = (joints, rates, slope(log.t, rates))
    pairs = zip(base_motion(ground, segment, chosen), each, strict=True)
    q, v, a = (np.hstack([base, own[pick]]) for base, own in pairs)
    usable = np.repeat(np.all(segment.usable, axis=1, keepdims=True), v.shape[1], axis=1)
    return Smooth(log.t[pick], q, v, a, usable[pick])


def base_motion(ground: Ground, segment: LogSegment, chosen: Filter) -> tuple[Array, Array, Array]:
    """(M, 7) positions, (M, 6) velocities and (M, 6) accelerations of the base of a segment."""
    assert segment.imu is not None
    log = segment.log
    imu = _at_time(log.t, segment.imu, ground.clock)
    turn = ground.imu.rotation
    spin = chosen.low_pass(imu[:, 4:7] @ turn.T)
    spun = slope(log.t, spin)
    lever = ground.imu.translation
    force = chosen.low_pass((imu[:, 7:10] - ground.force) @ turn.T)
    force = force - np.cross(spun, lever) - np.cross(spin, np.cross(spin, lever))
    quaternion = chosen.low_pass(turned(imu[:, :4], turn))
    quaternion /= np.linalg.norm(quaternion, axis=1)[:, None]
    down = -GRAVITY * Rotation.from_quat(quaternion).as_matrix()[:, 2]
    none = np.zeros_like(force)
    found = (
        np.hstack([none, quaternion]),
        np.hstack([none, spin]),
        np.hstack([force + down, spun]),
    )
    q, v, a = (np.asarray(x[:: chosen.every], dtype=np.float64) for x in found)
    return q, v, a


def _travelled(segment: LogSegment, chosen: Filter) -> Array:
    """(M, k) mean velocities of the joints around each sample, from their positions.

    Between samples a stiff loop may move faster than they show: after each step of a held target it
    follows within 1/(kv/J), 3 ms on a light leg. Sampled velocities miss that, always on the same
    side; friction and damping would be those of a velocity that is up to a millisecond late.
    """
    found = slope(segment.log.t, chosen.low_pass(segment.log.q))[:: chosen.every]
    return np.asarray(found, dtype=np.float64)


def turning(segment: LogSegment, chosen: Filter, band: float) -> Array:
    """(N, k) velocities of the joints by which dry friction turns, at the samples of a segment.

    Friction follows the sign of a velocity that is seldom far from 0, so noise flattens it, and
    what then is missing is taken for rotor inertia, or, of a joint that creeps under its load, for
    a larger gain. Measured velocities and slopes of positions, weighted by their noise up to a
    frequency, are the least noisy ones.
    """
    log = segment.log
    if len(log.t) < 8:
        return log.v
    position, velocity = noise_levels(log)
    band = min(band, chosen.smoothing)
    of_slope = (2 * np.pi * band * position) ** 2 / 3  # mean of ω² up to the band's end
    total = of_slope + velocity**2
    share = of_slope / total if total > 0 else 0.5
    v = share * log.v + (1 - share) * slope(log.t, log.q)
    return zero_phase(v, band, chosen.rate)


def total_mass(robot: RobotModel, p: int) -> Array:
    """(p,) w with wᵀθ the mass of all links over that of the model file."""
    own = file_links(robot.model)
    masses = np.zeros(p)
    masses[: len(own) : 10] = 1.0
    return masses / own[::10].sum()


def _at_time(t: Array, x: Array, late: float) -> Array:
    """x (N, k) as it was measured, from readings that are `late` [s]."""
    if late == 0:
        return x
    return np.column_stack([np.interp(t + late, t, column) for column in x.T])


def turned(quaternions: Array, turn: Array) -> Array:
    """(N, 4) orientations of the base, from those of an IMU turned against it by (3, 3)."""
    found = (Rotation.from_quat(quaternions) * Rotation.from_matrix(turn).inv()).as_quat()
    signs = np.cumprod(np.append(1.0, np.where(np.sum(found[1:] * found[:-1], axis=1) < 0, -1, 1)))
    return found * signs[:, None]
