"""Rows of a tree of joints: links, friction of every kind, gains of motors.

The balance of joint j, in the notation of docs/theory.md:

    inertia and weight of the links + rotor + friction + offset + coupling − k_j u_j(t − δ_j) = 0

with the columns of friction chosen by name for each joint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..logs.recordings import Recordings
from ..parameters import Array, Block, ParameterSpace
from ..robot.identified import with_inertias
from ..robot.model import RobotModel
from ..structure.columns import KINDS, Kind
from ..structure.joints import slides
from .links import (
    Load,
    file_links,
    limbs_of,
    link_blocks,
    own_inertia,
    payloads,
    sizes_of_links,
    torque_rows,
    weight_columns,
    weight_of,
)
from .problem import Problem, Size, mean_squares
from .smoothing import Filter, Smooth, delayed, smooth, smooth_commands

SPEEDS = (0.005, 0.02, 0.05, 0.1, 0.2)
"""Candidate speeds s [rad/s or m/s] at which tanh(v/s) of Coulomb friction saturates."""
BROAD = 1  # index of the first that is tried


_ROTOR = Kind(-1, "rotor", "rotor inertia", "rotor", ("kg·m²", "kg"))  # a column of M
_NAMES = ("viscous", "coulomb", "stribeck", "load", "quadratic", "cubic", "spring", "offset")
COLUMNS = {"rotor": _ROTOR} | {name: KINDS[name] for name in _NAMES}
COLUMNS["spring"] = replace(KINDS["spring"], geometry="free", share=0.3)  # or a counterweight
"""Columns of a joint by name: rotor v̇, viscous v, Coulomb tanh(v/s), Stribeck tanh(v/s)
exp(−(v/0.1)²), load tanh(v/s)·|weight's torque|, quadratic v|v|, cubic v³, spring q, offset 1."""

STRIBECK = 0.1  # speed at which Stribeck friction has fallen to 1/e [rad/s or m/s]

COUPLINGS = ("inertia", "viscous", "coulomb")
"""Columns of coupled joints i, j: the motor of one turns by v_i ± v_j. Rows i and j have v̇_j and
v̇_i, v_j and v_i, tanh((v_i ± v_j)/s) and ± the same."""

TRUSTED = 0.3  # standard deviation of log k below which commands state their forces
FILE, WEIGHTLESS = 0.25, 3.0
"""Standard deviations of the logarithm of the links' weight: of a model file, whose masses omit
cables, covers and oil, or come from CAD with a single density; and of a guess."""

_BLOCK = 2000  # rows whose regressors are computed at once

BASIC = frozenset({"rotor", "viscous", "coulomb"})

_WIDE = 2.0  # standard deviation of log θ of frictions and rotors: a factor of 7
_FREE = 10.0  # of what may have either sign, over its scale: the rows asked for it

Part = tuple[Block, Array, Array, Array]
"""A block of θ of c parameters: its columns (N, n, c), its prior (c,), and the prior's spread."""


@dataclass(frozen=True)
class Choice:
    """The structure of a robot's joints."""

    columns: tuple[frozenset[str], ...]  # for each joint, names of `COLUMNS`
    speed: tuple[int, ...]  # for each joint, index of its s in `SPEEDS`
    delay: Array  # (k,) delay of each command [s]
    coupled: tuple[tuple[int, int, int], ...] = ()  # pairs (i, j, ±1): the motor turns by v_i ± v_j

    def at(self, joint: int, *names: str, speed: int | None = None) -> Choice:
        """A copy with further columns, or another speed, at one joint."""
        columns, speeds = list(self.columns), list(self.speed)
        columns[joint] = columns[joint] | set(names)
        speeds[joint] = speeds[joint] if speed is None else speed
        return replace(self, columns=tuple(columns), speed=tuple(speeds))


class JointRows:
    """All candidate columns of a robot's segments, filtered once.

    gain (k,) are expected gains [N·m or N per unit of command], spread (k,) the standard deviations
    of their logarithms, 0 until they are known; `loads` are carried in some of the segments.

    Attributes:
        motions: the smoothed motion of every segment.
        links: (N, n, 10 b) columns of the links.
        diagonal: name of a column → (N, n) entries on the joints' own rows; "coulomb", "stribeck"
            and "load" have a further leading axis for `SPEEDS`.
        loading: (10 b,) parameters of the links whose weight loads the friction.
        driven: numbers of the d joints with a motor, from 0.
        usable: (N, n) whether a row may be used.
        t: (N,) times of the rows [s].
        segment: (N,) number of the segment of each row.
    """

    def __init__(
        self,
        robot: RobotModel,
        recordings: Recordings,
        chosen: Filter,
        gain: Array,
        spread: Array | float = 0.0,
        loads: tuple[Load, ...] = (),
    ):
        self.robot, self.recordings, self.chosen, self.loads = robot, recordings, chosen, loads
        self.gain, self.spread, parts = gain, spread + np.zeros(len(gain)), []
        self.driven = recordings.driven(robot)
        for number, segment in enumerate(recordings.segments):
            motion = smooth(segment, chosen)
            centres = chosen.centres(len(motion.t))
            if len(centres):
                parts.append((number, segment, centres, motion))
        self._commands = [(s, smooth_commands(s, chosen)) for _, s, _, _ in parts]
        self.motions = [motion for *_, motion in parts]
        self.links = np.concatenate([self._links(motion) for motion in self.motions])
        self.diagonal = {
            "rotor": self.joined(lambda m: m.a),
            "viscous": self.joined(lambda m: m.v),
            "quadratic": self.joined(lambda m: m.v * np.abs(m.v)),
            "cubic": self.joined(lambda m: m.v**3),
            "spring": self.joined(lambda m: m.q),
            "offset": self.joined(lambda m: np.ones_like(m.v)),
            "coulomb": self._at_speeds(lambda _, slip: slip),
            "stribeck": self._at_speeds(lambda m, slip: slip * np.exp(-((m.v / STRIBECK) ** 2))),
        }
        self._moving = np.concatenate([m.q[m.usable.any(axis=1)] for m in self.motions])
        self._weight = weight_columns(robot.model, self._moving)
        self.reweigh(file_links(robot.model))
        self.usable = np.concatenate([m.usable[c] for _, _, c, m in parts])
        self.t = np.concatenate([m.t[c] for _, _, c, m in parts])
        self.segment = np.concatenate([np.full(len(c), number) for number, _, c, _ in parts])

    def like(self, recordings: Recordings, chosen: Filter) -> JointRows:
        """Rows of other recordings or through other filters, with the same motors and loading."""
        other = JointRows(self.robot, recordings, chosen, self.gain, self.spread, self.loads)
        other.reweigh(self.loading)
        other.driven = self.driven
        return other

    def joined(self, function: Callable[[Smooth], Array]) -> Array:
        """(N, ...) rows of a function of the smoothed motion."""
        return np.concatenate([self.chosen.rows(function(m)) for m in self.motions])

    def _links(self, motion: Smooth) -> Array:
        """(N, n, 10 b) rows of the links' columns, in blocks: an hour of them would fill memory."""
        half, found = len(self.chosen.kernel) // 2, []
        centres = self.chosen.centres(len(motion.t))
        for first in range(0, len(centres), _BLOCK):
            some = centres[first : first + _BLOCK]
            q, v, a = (x[some[0] - half : some[-1] + half + 1] for x in motion[1:4])
            found.append(self.chosen.rows(torque_rows(self.robot.model, q, v, a)))
        return np.concatenate(found)

    def _at_speeds(self, function: Callable[[Smooth, Array], Array]) -> Array:
        """(speeds, N, n) rows of a function of the motion and of tanh(v/s), s in `SPEEDS`."""
        return np.stack([self.joined(lambda m, s=s: function(m, np.tanh(m.v / s))) for s in SPEEDS])

    def reweigh(self, links: Array) -> None:
        """Computes load-dependent friction from the weight of links with parameters (10 b,)."""
        model, self.loading = self.robot.model, links
        heavy, s = with_inertias(model, links, np.zeros(model.nv)), np.array(SPEEDS)[:, None]
        of_speeds = self.joined(
            lambda m: np.tanh(m.v[:, None] / s) * np.abs(weight_of(heavy, m.q))[:, None]
        )
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

    def slip(self, i: int, j: int, sign: int, speed: int) -> Array:
        """(N,) tanh((v_i ± v_j)/s) of two coupled joints, s by its index in `SPEEDS`."""
        s = SPEEDS[speed]
        return self.joined(lambda m: np.tanh((m.v[:, [i]] + sign * m.v[:, [j]]) / s))[:, 0]

    def problem(self, choice: Choice) -> Problem:
        """The fit of a structure, with columns and delays of `choice`."""
        model, u = self.robot.model, self.commands(choice.delay)
        own, driven, effort = file_links(model), self.driven, u * self.gain
        passive = np.delete(np.arange(u.shape[1]), driven)
        effort[:, passive] = self.links[:, passive] @ own
        force = np.maximum(np.sqrt(mean_squares(effort, self.usable)), 1e-9)  # typical
        commands = -u[:, :, None] * np.eye(u.shape[1])[:, driven]
        parts = [
            *self._on_joints(choice, force), *self._couplings(choice, force), *self._payloads(),
            (self._gains(), commands, self.gain[driven], self.spread[driven]),
        ]  # fmt: skip
        blocks, columns, prior, spread = zip(*parts, strict=True)
        space = ParameterSpace((*link_blocks(model), *blocks))
        sizes = sizes_of_links(model, self.links[self.usable], self._weight)
        carried = payloads(model, self.loads)
        loaded = {name: load.place.start // 10 for load in carried for name in load.block.names}
        stated = np.zeros(len(space), dtype=bool)
        stated[space.actuators] = self.spread[driven] < TRUSTED
        return Problem(
            space,
            np.concatenate([self.links, *columns], axis=2),
            self.usable,
            self.t,
            self.segment,
            np.concatenate([own, *prior]),
            np.concatenate([np.full(len(own), np.inf), *spread]),
            np.zeros(len(space), dtype=bool),
            Size(
                np.pad(sizes, ((0, 0), (0, len(space) - len(own)))),
                limbs_of(model)[[loaded.get(name, joint_of(name)) for name in space.names]],
                WEIGHTLESS if self.robot.weightless else FILE,
                stated,
            ),
            self._inertia(space) if len(passive) else None,
        )

    def _inertia(self, space: ParameterSpace) -> Array:
        """(n, p) forces of inertia of each joint at its rms acceleration, see `Problem.inertia`."""
        found, moving = np.zeros((len(self.gain), len(space))), self.diagonal["rotor"]
        found[:, : self.links.shape[2]] = own_inertia(self.robot.model, self._moving)
        for parameter in space.names:
            if parameter.startswith("rotor"):
                found[joint_of(parameter), space.index(parameter)] = 1.0
        return found * np.sqrt(mean_squares(moving, self.usable))[:, None]

    def _slides(self, joint: int) -> bool:
        return slides(self.robot.model.joints[joint + 1])

    def _on_joints(self, choice: Choice, force: Array) -> Iterator[Part]:
        """Rotors, friction, springs and offsets; force (k,) is typical of each joint."""
        robot, n = self.robot, len(self.robot.joints)
        nominal = {"rotor": robot.rotor, "viscous": robot.damping, "coulomb": robot.friction}
        for name, column in COLUMNS.items():
            joints = [j for j in range(n) if name in choice.columns[j]]
            if not joints:
                continue
            own = [self.column(name, j, choice) for j in joints]
            entries = np.zeros((len(self.t), n, len(joints)))
            entries[:, joints, np.arange(len(joints))] = np.column_stack(own)
            size = [mean_squares(x, self.usable[:, j]) for x, j in zip(own, joints, strict=True)]
            guess = column.share * force[joints] / np.maximum(np.sqrt(size), 1e-9)
            if column.geometry == "free":
                prior, spread = np.zeros(len(joints)), _FREE * guess
            else:  # a file's friction cannot take more than all of the force
                given = nominal.get(name, np.zeros(n))[joints]
                prior = np.where(given > 0, np.minimum(given, guess / column.share), guess)
                spread = np.full(len(joints), _WIDE)
            block = Block(
                column.block,
                tuple(f"{column.letter}_{j + 1}" for j in joints),
                tuple(column.unit[self._slides(j)] for j in joints),
                guess,
                column.geometry,
                labels=tuple(f"{column.block} of {robot.joints[j]}" for j in joints),
            )
            yield block, entries, prior, spread

    def _couplings(self, choice: Choice, force: Array) -> Iterator[Part]:
        """Columns of coupled joints; force (k,) is typical of the actuators."""
        for i, j, sign in choice.coupled:
            slip = self.slip(i, j, sign, choice.speed[j])
            entries = np.zeros((*self.usable.shape, 3))
            for one, other, side in ((i, j, 1), (j, i, sign)):
                entries[:, one, 0] = self.diagonal["rotor"][:, other]
                entries[:, one, 1] = self.diagonal["viscous"][:, other]
                entries[:, one, 2] = side * slip
            size = np.sqrt(np.mean(entries**2, axis=(0, 1)))
            guess = 0.1 * np.sqrt(force[i] * force[j]) / np.maximum(size, 1e-9)
            pair = f"{self.robot.joints[i]} and {self.robot.joints[j]}"
            block = Block(
                f"coupling of {pair}",
                tuple(f"coupling_{kind}_{i + 1}_{j + 1}" for kind in COUPLINGS),
                ("kg·m²", "N·m·s/rad", "N·m"),
                guess,
                "free",
                labels=tuple(f"coupling's {kind} of {pair}" for kind in COUPLINGS),
            )
            yield block, entries, np.zeros(3), _FREE * guess

    def _payloads(self) -> Iterator[Part]:
        """Known payloads: the columns of the links that carry them, in the loaded logs."""
        for payload in payloads(self.robot.model, self.loads):
            carried = [s.source in payload.sources for s in self.recordings.segments]
            columns = self.links[:, :, payload.place]
            columns = columns * np.array(carried)[self.segment, None, None]
            yield payload.block, columns, payload.prior, np.full(10, np.inf)

    def _gains(self) -> Block:
        units, driven = self.recordings.command_units, self.driven
        return Block(
            "motor gain",
            tuple(f"gain_{j + 1}" for j in driven),
            tuple(f"{('N·m', 'N')[self._slides(j)]}/{units[j] or 'unit'}" for j in driven),
            self.gain[driven],
            "positive",
            True,
            labels=tuple(f"gain of {self.robot.joints[j]}" for j in driven),
        )


def joint_of(parameter: str) -> int:
    """Number of the joint, from 0, of a parameter such as `gain_3`."""
    return int(parameter.rpartition("_")[2]) - 1


def nearest_friction(problem: Problem, theta: Array) -> tuple[Array, Array]:
    """(k,) viscous and (k,) Coulomb friction that approximate all friction of a joint at θ (p,)."""
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
