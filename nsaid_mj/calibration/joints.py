"""Rows of a tree of joints with a motor on each: links, friction of every kind, gains.

The balance of joint j, in the notation of docs/theory.md:

    inertia and weight of the links + rotor + friction + offset + coupling − k_j u_j(t − δ_j) = 0

with the columns of friction chosen by name for each joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy

from ..parameters import Array, Block, Indices, ParameterSpace
from .data import Recordings, RobotModel
from .links import file_links, link_blocks, link_columns, size_of_links, weight_columns, weight_of
from .logs.signals import noise
from .payloads import Load, payloads
from .problem import Mask, Problem, Size
from .smoothing import Filter, delayed, smooth, smooth_commands

SPEEDS = (0.005, 0.02, 0.05, 0.1, 0.2)
"""Candidate speeds s [rad/s or m/s] at which tanh(v/s) of Coulomb friction saturates."""
BROAD = 1  # index of the first that is tried


class Column(NamedTuple):
    """A kind of force column on a joint.

    Attributes:
        block: name of its block of θ.
        letter: prefix of its parameters' names.
        units: for revolute and prismatic joints.
        geometry: `positive` or `free`.
    """

    block: str
    letter: str
    units: tuple[str, str]
    geometry: str


COLUMNS = {
    "rotor": Column("rotor inertia", "rotor", ("kg·m²", "kg"), "positive"),
    "viscous": Column("viscous friction", "viscous", ("N·m·s/rad", "N·s/m"), "positive"),
    "coulomb": Column("Coulomb friction", "coulomb", ("N·m", "N"), "positive"),
    "stribeck": Column("Stribeck friction", "stribeck", ("N·m", "N"), "positive"),
    "load": Column("load-dependent friction", "load", ("1", "1"), "positive"),
    "quadratic": Column("quadratic friction", "quadratic", ("N·m·s²/rad²", "N·s²/m²"), "free"),
    "cubic": Column("cubic friction", "cubic", ("N·m·s³/rad³", "N·s³/m³"), "free"),
    "spring": Column("stiffness", "stiffness", ("N·m/rad", "N/m"), "free"),
    "offset": Column("offset", "offset", ("N·m", "N"), "free"),
}
"""Columns of a joint by name: rotor v̇, viscous v, Coulomb tanh(v/s), Stribeck tanh(v/s)
exp(−(v/0.1)²), load tanh(v/s)·|weight's torque|, quadratic v|v|, cubic v³, spring q, offset 1."""

STRIBECK = 0.1  # speed at which Stribeck friction has fallen to 1/e [rad/s or m/s]

COUPLINGS = ("inertia", "viscous", "coulomb")
"""Columns of coupled joints i, j: the motor of one turns by v_i ± v_j. Rows i and j have v̇_j and
v̇_i, v_j and v_i, tanh((v_i ± v_j)/s) and ± the same."""

TRUSTED = 0.3  # standard deviation of log k below which commands state their forces
FILE, WEIGHTLESS = 0.25, 3.0
"""Standard deviations of the logarithm of the links' weight: for a model file, whose masses omit
cables, covers and oil, or come from CAD with one density; and for a mere guess."""

BASIC = frozenset({"rotor", "viscous", "coulomb"})


@dataclass(frozen=True)
class Choice:
    """The structure of a robot's joints.

    Attributes:
        columns: for each joint, names of `COLUMNS`.
        speed: for each joint, index of its s in `SPEEDS`.
        delay: (k,) delay of each command [s].
        coupled: pairs (i, j, ±1) of joints whose motor turns by v_i ± v_j.
    """

    columns: tuple[frozenset[str], ...]
    speed: tuple[int, ...]
    delay: Array
    coupled: tuple[tuple[int, int, int], ...] = ()

    def at(self, joint: int, *, add: str | None = None, speed: int | None = None) -> Choice:
        """A copy with another column or speed at one joint."""
        columns, speeds = list(self.columns), list(self.speed)
        if add is not None:
            columns[joint] = columns[joint] | {add}
        if speed is not None:
            speeds[joint] = speed
        return replace(self, columns=tuple(columns), speed=tuple(speeds))


@dataclass
class JointRows:
    """All candidate columns of a robot's segments, filtered once.

    Args:
        robot: the model.
        recordings: the segments.
        chosen: filters.
        gain: (k,) expected gains [N·m or N per unit of command].
        loads: carried in some of the segments.

    Attributes:
        links: (N, n, 10 b) columns of the links.
        diagonal: name of a column → (N, n) entries on the joints' own rows; "coulomb", "stribeck"
            and "load" have a further leading axis for `SPEEDS`.
        weight: (K n, 10 b) columns of the links' weight at poses along the log.
        usable: (N, n) whether a row may be used.
        t: (N,) times of the rows [s].
        segment: (N,) number of the segment of each row.
    """

    robot: RobotModel
    recordings: Recordings
    chosen: Filter
    gain: Array
    loads: tuple[Load, ...] = ()
    links: Array = field(init=False)
    diagonal: dict[str, Array] = field(init=False)
    weight: Array = field(init=False)
    usable: Mask = field(init=False)
    t: Array = field(init=False)
    segment: Indices = field(init=False)

    def __post_init__(self) -> None:
        differentiate = differentiates(self.recordings, self.chosen.cutoff)
        parts = []
        for number, segment in enumerate(self.recordings.segments):
            motion = smooth(segment, self.chosen, differentiate)
            centres = self.chosen.centres(len(motion.t))
            if len(centres):
                parts.append((number, centres, motion))
        segments = [self.recordings.segments[number] for number, _, _ in parts]
        self._commands = [(s, smooth_commands(s, self.chosen)) for s in segments]
        rows = self.chosen.rows

        def joined(function) -> Array:  # of each segment's motion
            return np.concatenate([rows(function(motion)) for _, _, motion in parts])

        self.links = joined(lambda m: link_columns(self.robot.model, m))
        self.diagonal = {
            "rotor": joined(lambda m: m.a),
            "viscous": joined(lambda m: m.v),
            "quadratic": joined(lambda m: m.v * np.abs(m.v)),
            "cubic": joined(lambda m: m.v**3),
            "spring": joined(lambda m: m.q),
            "offset": joined(lambda m: np.ones_like(m.v)),
            "coulomb": np.stack([joined(lambda m, s=s: np.tanh(m.v / s)) for s in SPEEDS]),
            "stribeck": np.stack([joined(lambda m, s=s: _stribeck(m.v, s)) for s in SPEEDS]),
        }
        self.joined = joined
        self.weight = weight_columns(
            self.robot.model, np.concatenate([m.q[m.usable.any(axis=1)] for _, _, m in parts])
        )
        self.reweigh(None)
        self.usable = np.concatenate([m.usable[c] for _, c, m in parts])
        self.t = np.concatenate([m.t[c] for _, c, m in parts])
        self.segment = np.concatenate([np.full(len(c), number) for number, c, _ in parts])

    def reweigh(self, theta_links: Array | None) -> None:
        """Computes load-dependent friction from the weight under link parameters (10 k,).

        None selects those of the model file.
        """
        weight, s = weight_of(self.robot.model, theta_links), np.array(SPEEDS)[:, None]
        of_speeds = self.joined(lambda m: np.tanh(m.v[:, None] / s) * np.abs(weight(m.q))[:, None])
        self.diagonal["load"] = np.ascontiguousarray(np.moveaxis(of_speeds, 1, 0))

    def commands(self, delay: Array) -> Array:
        """(N, k) filtered commands, delayed by (k,) seconds.

        Commands are reversed where the model file has a negative gear: gains are positive.
        """
        filtered = [self.chosen.rows(delayed(s, self.chosen, u, delay)) for s, u in self._commands]
        return np.concatenate(filtered) * np.sign(self.robot.gain)

    def column(self, name: str, joint: int, choice: Choice) -> Array:
        """(N,) a column of a joint."""
        found = self.diagonal[name]
        return (found[choice.speed[joint]] if found.ndim == 3 else found)[:, joint]

    def problem(self, choice: Choice, gain: Array, gain_spread: Array) -> Problem:
        """The fit of a structure, with columns and delays of `choice`.

        gain (k,) are expected gains [N·m or N per unit of command], gain_spread (k,) the standard
        deviations of their logarithms.
        """
        robot, n = self.robot, len(self.robot.joints)
        u = self.commands(choice.delay)
        model = robot.model
        slides = [model.joints[j + 1].shortname().startswith("JointModelP") for j in range(n)]
        inertial = file_links(model)
        force = np.maximum(gain * _rms(u, self.usable), 1e-9)  # typical force of each actuator
        blocks = link_blocks(model)
        Y, prior, spread = [self.links], [inertial], [np.full(len(inertial), np.inf)]
        nominal = {"rotor": robot.rotor, "viscous": robot.damping, "coulomb": robot.friction}
        for name, column in COLUMNS.items():
            joints = [j for j in range(n) if name in choice.columns[j]]
            if not joints:
                continue
            entries = np.zeros((len(self.t), n, len(joints)))
            for at, j in enumerate(joints):
                entries[:, j, at] = self.column(name, j, choice)
            size = np.array([_rms(self.column(name, j, choice), self.usable[:, j]) for j in joints])
            guess = _SHARES[name] * force[joints] / np.maximum(size, 1e-9)
            given = nominal.get(name, np.zeros(n))[joints]
            most = guess / _SHARES[name]  # a file's friction cannot take more than all of the force
            start = np.where(given > 0, np.minimum(given, most), guess)
            if column.geometry == "free":
                start = np.zeros(len(joints))
            blocks.append(_joint_block(column, joints, robot.joints, slides, guess))
            Y.append(entries)
            prior.append(start)
            free = column.geometry == "free"
            spread.append(_FREE * guess if free else np.full(len(joints), _WIDE))
        for i, j, sign in choice.coupled:
            entries, block, size = self._coupling(i, j, sign, choice)
            guess = 0.1 * np.sqrt(force[i] * force[j]) / np.maximum(size, 1e-9)
            blocks.append(replace(block, scale=guess))
            Y.append(entries)
            prior.append(np.zeros(3))
            spread.append(_FREE * guess)
        for payload in payloads(model, self.loads):
            carried = [s.source in payload.sources for s in self.recordings.segments]
            blocks.append(payload.block)
            Y.append(self.links[:, :, payload.place] * np.array(carried)[self.segment, None, None])
            prior.append(payload.prior)
            spread.append(np.full(10, np.inf))
        entries = np.zeros((len(self.t), n, n))
        entries[:, np.arange(n), np.arange(n)] = -u
        blocks.append(_gain_block(robot.joints, slides, gain, self.recordings.command_units))
        Y.append(entries)
        prior.append(gain)
        spread.append(gain_spread)
        space = ParameterSpace(tuple(blocks))
        stated, rest = np.zeros(len(space), dtype=bool), np.zeros(len(space) - len(inertial))
        stated[space.actuators] = gain_spread < TRUSTED
        return Problem(
            space,
            np.concatenate(Y, axis=2),
            self.usable,
            self.t,
            self.segment,
            np.concatenate(prior),
            np.concatenate(spread),
            np.zeros(len(space), dtype=bool),
            Size(
                np.append(size_of_links(model, self.links[self.usable], self.weight), rest),
                WEIGHTLESS if robot.weightless else FILE,
                stated,
            ),
        )

    def slip(self, i: int, j: int, sign: int, speed: int) -> Array:
        """(N,) tanh((v_i ± v_j)/s) of two coupled joints, s by its index in `SPEEDS`."""
        s = SPEEDS[speed]
        return self.joined(lambda m: np.tanh((m.v[:, [i]] + sign * m.v[:, [j]]) / s))[:, 0]

    def _coupling(self, i: int, j: int, sign: int, choice: Choice) -> tuple[Array, Block, Array]:
        """(N, n, 3) columns of the coupling of joints i and j, their block and their rms."""
        slip = self.slip(i, j, sign, choice.speed[j])
        entries = np.zeros((len(self.t), len(self.robot.joints), 3))
        for one, other, side in ((i, j, 1), (j, i, sign)):
            entries[:, one, 0] = self.diagonal["rotor"][:, other]
            entries[:, one, 1] = self.diagonal["viscous"][:, other]
            entries[:, one, 2] = side * slip
        names = self.robot.joints
        pair = f"{names[i]} and {names[j]}"
        block = Block(
            f"coupling of {pair}",
            tuple(f"coupling_{kind}_{i + 1}_{j + 1}" for kind in COUPLINGS),
            ("kg·m²", "N·m·s/rad", "N·m"),
            np.ones(3),
            "free",
            labels=tuple(f"coupling's {kind} of {pair}" for kind in COUPLINGS),
        )
        return entries, block, np.sqrt(np.mean(entries**2, axis=(0, 1)))


def nearest_friction(problem: Problem, theta: Array) -> tuple[Array, Array]:
    """(k,) viscous and (k,) Coulomb friction nearest to all of a joint's friction under θ (p,)."""
    space = problem.space
    kinds = [COLUMNS[name].block for name in COLUMNS if name not in ("rotor", "spring", "offset")]
    used = [space[block.name] for block in space.blocks if block.name in kinds]
    pairs = [COLUMNS[name].block for name in ("viscous", "coulomb")]
    if not {block.name for block in space.blocks}.issuperset(pairs):
        return np.zeros(0), np.zeros(0)
    found = []
    for j in range(problem.Y.shape[1]):
        rows = problem.Y[problem.usable[:, j], j]
        whole = sum(rows[:, place] @ theta[place] for place in used)
        basis = np.column_stack([rows[:, space[name].start + j] for name in pairs])
        found.append(scipy.optimize.nnls(basis, whole)[0] if len(rows) else np.zeros(2))
    viscous, coulomb = np.array(found).T
    return viscous, coulomb


_WIDE = 2.0  # standard deviation of log θ of frictions and rotors: a factor of 7
_FREE = 10.0  # of what may have either sign, over its scale: the rows asked for it
_SHARES = {
    "rotor": 0.1,
    "viscous": 0.2,
    "coulomb": 0.2,
    "stribeck": 0.1,
    "load": 0.05,
    "quadratic": 0.1,
    "cubic": 0.1,
    "spring": 0.3,
    "offset": 0.05,
}  # guessed share of an actuator's force that a column explains


def _stribeck(v: Array, s: float) -> Array:
    """Excess of dry friction over Coulomb's at low speed, relative to its value at 0."""
    return np.tanh(v / s) * np.exp(-((v / STRIBECK) ** 2))


def differentiates(recordings: Recordings, cutoff: float) -> bool:
    """Whether positions are smooth enough that their derivative replaces the measured velocity.

    Drives often report velocities that are filtered, and so delayed relative to the positions. They
    are used only where the derivative would have three times more noise.
    """
    log = max(recordings.segments, key=lambda s: len(s.log.t)).log
    if log.q.shape[1] != log.v.shape[1]:
        return False
    positions, velocities = ([noise(x) for x in part.T] for part in (log.q, log.v))
    derivative = np.median(positions) * 2 * np.pi * cutoff / np.sqrt(3)
    return bool(derivative <= 3 * np.median(velocities) + 1e-12)


def _rms(x: Array, usable: Mask) -> Array:
    """rms along the first axis over the usable rows."""
    return np.sqrt(np.sum(np.where(usable, x, 0.0) ** 2, axis=0) / np.maximum(usable.sum(0), 1))


def _joint_block(
    column: Column, joints: Sequence[int], names: Sequence[str], slides: list[bool], scale: Array
) -> Block:
    return Block(
        column.block,
        tuple(f"{column.letter}_{j + 1}" for j in joints),
        tuple(column.units[slides[j]] for j in joints),
        scale,
        column.geometry,  # pyright: ignore[reportArgumentType]
        labels=tuple(f"{column.block} of {names[j]}" for j in joints),
    )


def _gain_block(
    names: Sequence[str], slides: list[bool], gain: Array, units: Sequence[str]
) -> Block:
    force = [("N·m", "N")[slide] for slide in slides]
    return Block(
        "motor gain",
        tuple(f"gain_{j + 1}" for j in range(len(names))),
        tuple(f"{f}/{unit or 'unit'}" for f, unit in zip(force, units, strict=True)),
        gain,
        "positive",
        True,
        labels=tuple(f"gain of {name}" for name in names),
    )
