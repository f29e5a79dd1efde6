"""Rows of a tree of joints: links, friction of every kind, gains of motors.

The balance of joint j, in the notation of docs/theory.md:

    inertia and weight of the links + rotor + friction + offset + coupling − k_j u_j(t − δ_j) = 0

with the columns of friction chosen by name for each joint. All candidates are columns of one
system, whose regressor is computed and filtered once; a choice takes some of them.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import scipy

from ...core import Array, Block, Column, Indices, ParameterSpace, Rotor
from ...robots import RobotModel
from ..logs.recordings import Recordings
from .choose.columns import (
    COLUMNS,
    COUPLINGS,
    FALLS,
    FASTENED,
    SPEEDS,
    Choice,
    coupling_columns,
    coupling_names,
    joint_column,
    motors,
)
from .links import (
    Load,
    file_links,
    limbs_of,
    link_blocks,
    own_inertia,
    payloads,
    sizes_of_links,
    weight_columns,
)
from .problem import FitProblem, Size, mean_squares
from .rows import Rows, unrolled, with_columns
from .smoothing import Filter, delayed, fed_back, smooth, smooth_commands

TRUSTED = 0.3  # standard deviation of log k below which commands state their forces
FILE = 0.25
WEIGHTLESS = 3.0
"""Standard deviations of the logarithm of the links' weight: of a model file, whose masses omit
cables, covers and oil, or come from CAD with a single density; and of a guess."""

_WIDE = 2.0  # standard deviation of log θ of frictions and rotors: a factor of 7
_FREE = 10.0  # of what may have either sign, over its scale: the rows asked for it

Part = tuple[Block, Array, Array]
"""A block of θ of c parameters, its prior (c,), and the prior's spread."""

Key = tuple[str, int, float | None, int]
"""An entry of a coupling: kind, row, speed s if it has one, and the other joint."""


class Diagonal(dict[str, Array]):
    """Entries of columns on the joints' own rows, each evaluated when it is first asked for."""

    def __init__(self, evaluate: Callable[[str], Array]):
        super().__init__()
        self._evaluate = evaluate

    def __missing__(self, name: str) -> Array:
        found = self._evaluate(name)
        self[name] = found
        return found


class JointRows(Rows):
    """All candidate columns of a robot's segments, filtered once.

    gain (k,) are expected gains [N·m or N per unit of command], spread (k,) the standard deviations
    of their logarithms, 0 until they are known; `loads` are carried in some of the segments;
    `coupled` are pairs (i, j, ±1) of joints whose motor turns by v_i ± v_j.

    Attributes:
        system: the robot's, with an angle as the position of every joint.
        links: (N, n, 10 b) columns of the links.
        diagonal: name of a column → (N, n) entries on the joints' own rows; of those of `FASTENED`
            with a further leading axis for `SPEEDS`, and of `stribeck` one for `FALLS` after it.
        loading: (10 b,) parameters of the links whose weight loads the friction.
        driven: numbers of the d joints with a motor, from 0.
    """

    def __init__(
        self,
        robot: RobotModel,
        recordings: Recordings,
        chosen: Filter,
        gain: Array,
        spread: Array | float = 0.0,
        loads: tuple[Load, ...] = (),
        coupled: tuple[tuple[int, int, int], ...] = (),
    ):
        super().__init__(recordings, chosen, smooth)
        self.robot = robot
        self.loads = loads
        self.coupled = coupled
        self.gain, self.spread = gain, spread + np.zeros(len(gain))
        self.driven = recordings.driven(robot)
        # joints that follow others have no rows, as theirs are part of their leaders'
        self.following = [robot.joints.index(joint) for joint in robot.followers]
        self.usable[:, self.following] = False
        self.system = unrolled(robot.system)
        law = recordings.feedback
        self._commands = [(s, smooth_commands(s, chosen, law)) for s in self.segments]
        self._fed_back = self._feedback()
        self._entries: dict[Key, Array] = {}
        self.diagonal = Diagonal(self._fastened)
        self.loading = file_links(robot.model)
        self.links = self._evaluated()
        self._moving = np.concatenate([m.q[m.usable.any(axis=1)] for m in self.motions])
        weight = weight_columns(self.system, self._moving)
        every = weight.reshape(-1, self.system.n, self.system.p)
        self._weight = self._led(every).reshape(weight.shape)

    def like(self, recordings: Recordings, chosen: Filter) -> JointRows:
        """Rows of other recordings or through other filters, with the same motors and loading."""
        other = JointRows(
            self.robot, recordings, chosen, self.gain, self.spread, self.loads, self.coupled
        )
        other.reweigh(self.loading)
        other.driven = self.driven
        return other

    def _feedback(self) -> Array | float:
        """(N, n) what a PD law takes from the commands; 0 without one."""
        law = self.recordings.feedback
        if law is None:
            return 0.0
        return self.joined(lambda motion: np.asarray(fed_back(law, motion.q, motion.v)))

    def _evaluated(self) -> Array:
        """Columns of the links; keeps those of joints without a friction speed, and couplings."""
        own = [name for name in COLUMNS if name not in FASTENED]
        n = self.system.n
        links = self.system.p
        columns, rotors, end = _on_every_joint(own, n, links)
        pairs: list[Column] = []
        turned: list[Rotor] = []
        last = end
        for i, j, sign in self.coupled:
            turned.append(Rotor(i, last, j))
            speeds = list(enumerate(SPEEDS, start=last + 2))
            pairs += coupling_columns((i, j, sign), last + 1, speeds)
            last += 2 + len(SPEEDS)
        places, keys = _places(pairs, turned)
        rows, parameters = places.T
        system = with_columns(self.system, [*columns, *pairs], [*rotors, *turned], last)

        def pick(W: Array) -> Array:
            return np.hstack([W[:, :, :end].reshape(len(W), -1), W[:, rows, parameters]])

        found = self.regressor(system, pick)
        self._entries = dict(zip(keys, np.ascontiguousarray(found[:, n * end :].T), strict=True))
        shared = found[:, : n * end].reshape(-1, n, end)
        self.diagonal.update(zip(own, np.moveaxis(shared[:, :, links:], 2, 0).copy(), strict=True))
        return self._led(np.ascontiguousarray(shared[:, :, :links]))

    def _fastened(self, name: str) -> Array:
        """The entries of a column of `FASTENED`, at all of its speeds."""
        n = self.system.n
        links = self.system.p
        columns, _, end = _on_every_joint([name], n, links, self.loading)
        system = with_columns(self.system, columns, [], end)
        found = np.moveaxis(self.regressor(system, lambda W: W[:, :, links:]), 2, 0).copy()
        return found.reshape(len(SPEEDS), -1, *found.shape[1:]) if name == "stribeck" else found

    def _led(self, rows: Array) -> Array:
        """Rows (N, n, p) Sᵀ of joints of which some follow others; 0 in the followers' places.

        The forces of a coupling do no work along q = S y, so they are not in Sᵀ W θ = 0.
        """
        coupling = self.robot.coupling
        if coupling is None:
            return rows
        found = np.zeros_like(rows)
        found[:, list(coupling.leaders)] = np.einsum("jk,njp->nkp", coupling.ratio, rows)
        return found

    def turning(self, lead: float = 0.0, slower: float = 1.0) -> JointRows:
        """The rows with dry friction that turns so long [s] before the velocity does, or slower.

        Its speeds are `slower` times those of `SPEEDS`.
        """
        found = copy.copy(self)
        found.motions = [m._replace(v=(m.v + lead * m.a) / slower) for m in self.motions]
        found.diagonal = Diagonal(found._fastened)
        same = [name for name in self.diagonal if name not in FASTENED]
        found.diagonal.update({name: self.diagonal[name] for name in same})
        return found

    def retimed(self, scale: float) -> JointRows:
        """The rows with all times multiplied by a number, as if the log's clock were wrong."""
        found = copy.copy(self)
        found.motions = [m._replace(v=m.v / scale, a=m.a / scale**2) for m in self.motions]
        found._fed_back = found._feedback()
        found.diagonal = Diagonal(found._fastened)
        found.links = found._evaluated()
        return found

    def reweigh(self, links: Array) -> None:
        """Has load-dependent friction computed from the weight of links of parameters (10 b,)."""
        self.loading = links
        self.diagonal.pop("load", None)

    def commands(self, delay: Array) -> Array:
        """(N, k) filtered commands, delayed by (k,) seconds.

        Commands are reversed where the model file has a negative gear: gains are positive.
        """
        filtered = [self.chosen.rows(delayed(s, self.chosen, u, delay)) for s, u in self._commands]
        return (np.concatenate(filtered) - self._fed_back) * np.sign(self.robot.gain)

    def growth(self, delay: Array) -> Array:
        """(k,) size of the commands at delays (k,) [s] over that without a delay.

        Errors relative to the commands are compared between delays by this factor. It is 1, except
        under a PD law: a target that comes later differs more from the measured position.
        """
        if self.recordings.feedback is None:
            return np.ones(len(delay))
        late, own = (self.commands(d).std(axis=0) for d in (delay, np.zeros(len(delay))))
        return np.divide(late, own, out=np.ones(len(delay)), where=own > 0)

    def column(self, name: str, joint: int, choice: Choice) -> Array:
        """(N,) a column of a joint."""
        found = self.diagonal[name]
        if name in FASTENED:
            found = found[choice.speed[joint]]
        if name == "stribeck":
            found = found[choice.fall(joint)]
        return found[:, joint]

    def slip(self, i: int, j: int, speed: int) -> Array:
        """(N,) tanh((v_i ± v_j)/s) of two coupled joints, s by its index in `SPEEDS`."""
        return self._entries["shared_coulomb", i, SPEEDS[speed], j]

    def carried(self) -> Iterator[tuple[Block, Array]]:
        """Every load and its columns (N, n, 10): its link's, in the logs that carry it."""
        for load in payloads(self.robot.model, self.loads):
            logs = np.array([s.source in load.sources for s in self.recordings.segments])
            own = self.links[:, :, load.place] * logs[self.segment, None, None]
            yield load.block, own

    def problem(self, choice: Choice) -> FitProblem:
        """The fit of a structure, with columns and delays of `choice`."""
        model = self.robot.model
        u = self.commands(choice.delay)
        own = file_links(model)
        driven = self.driven
        effort = u * self.gain
        passive = np.delete(np.arange(u.shape[1]), driven)
        effort[:, passive] = self.links[:, passive] @ own
        force = np.maximum(np.sqrt(mean_squares(effort, self.usable)), 1e-9)  # typical
        carried = payloads(model, self.loads)
        parts = [
            *self._on_joints(choice, force),
            *self._couplings(choice, force),
            *((load.block, load.prior, np.full(10, np.inf)) for load in carried),
            (self._gains(), self.gain[driven], self.spread[driven]),
        ]
        blocks, prior, spread = zip(*parts, strict=True)
        space = ParameterSpace((*link_blocks(self.robot), *blocks))
        sizes = sizes_of_links(model, self.links[self.usable], self._weight)
        loaded = {name: load.place.start // 10 for load in carried for name in load.block.names}
        stated = np.zeros(len(space), dtype=bool)
        stated[space.actuators] = self.spread[driven] < TRUSTED
        return FitProblem(
            space,
            self._rows(space, choice, u),
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
                self._by_gain(space),
            ),
            self._inertia(space) if len(passive) else None,
        )

    def _by_gain(self, space: ParameterSpace) -> Indices:
        """(p,) the guessed gain from which a joint's own prior values were guessed, −1 of none."""
        found = np.full(len(space), -1)
        own = {COLUMNS[name].letter: of for name, of in self._nominal().items()}
        letters = {column.letter for column in COLUMNS.values()}
        for joint in np.intersect1d(self.driven, np.flatnonzero(self.spread > TRUSTED)).tolist():
            for letter in letters:
                name = f"{letter}_{joint + 1}"
                if name in space.names and not (letter in own and own[letter][joint] > 0):
                    found[space.index(name)] = space.index(f"gain_{joint + 1}")
        return found

    def _nominal(self) -> dict[str, Array]:
        """(n,) values of the model file of columns that it may have."""
        robot = self.robot
        return {"rotor": robot.rotor, "viscous": robot.damping, "coulomb": robot.friction}

    def terms(self, space: ParameterSpace, choice: Choice) -> tuple[list[Column], list[Rotor]]:
        """The columns and rotors that a choice adds to the robot's links, motors included."""
        columns, rotors = choice.terms(space, self.loading)
        return [*columns, *motors(space, self.driven)], rotors

    def _rows(self, space: ParameterSpace, choice: Choice, u: Array) -> Array:
        """(N, n, p) W of the robot with the columns of a choice, for filtered commands u (N, k)."""
        Y = np.zeros((*self.usable.shape, len(space)))
        Y[:, :, : self.links.shape[2]] = self.links
        for joint, names in enumerate(choice.columns):
            for name in names:
                at = space.index(f"{COLUMNS[name].letter}_{joint + 1}")
                Y[:, joint, at] = self.column(name, joint, choice)
        places, keys = _places(*choice.coupling_terms(space))
        for (row, parameter), key in zip(places, keys, strict=True):
            Y[:, row, parameter] = self._entries[key]
        for block, own in self.carried():
            Y[:, :, space[block.name]] = own
        # motors are linear in their commands: the rows of their columns are those of the commands'
        driving = with_columns(self.system, motors(space, self.driven), [], len(space))
        at = space.actuators
        still = np.zeros((len(u), 2 * self.system.n))
        Y[:, :, at] = -driving.F(0.0, still, u)[:, :, at]
        return Y

    def _inertia(self, space: ParameterSpace) -> Array:
        """(n, p) forces of inertia of each joint at its rms acceleration, see `Problem.inertia`."""
        found = np.zeros((len(self.gain), len(space)))
        moving = self.diagonal["rotor"]
        found[:, : self.links.shape[2]] = own_inertia(self.system, self._moving)
        for parameter in space.names:
            if parameter.startswith("rotor"):
                found[joint_of(parameter), space.index(parameter)] = 1.0
        usable = self.usable.copy()
        usable[:, self.following] = True  # they have no rows, but a size
        return found * np.sqrt(mean_squares(moving, usable))[:, None]

    def _slides(self, joint: int) -> bool:
        return self.robot.system.slides[joint]

    def _on_joints(self, choice: Choice, force: Array) -> Iterator[Part]:
        """Rotors, friction, springs and offsets; force (k,) is typical of each joint."""
        robot = self.robot
        n = len(self.robot.joints)
        nominal = self._nominal()
        for name, column in COLUMNS.items():
            joints = [j for j in range(n) if name in choice.columns[j]]
            if not joints:
                continue
            own = [self.column(name, j, choice) for j in joints]
            size = [mean_squares(x, self.usable[:, j]) for x, j in zip(own, joints, strict=True)]
            guess = column.share * force[joints] / np.maximum(np.sqrt(size), 1e-9)
            if column.geometry == "free":
                prior = np.zeros(len(joints))
                spread = _FREE * guess
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
            yield block, prior, spread

    def _couplings(self, choice: Choice, force: Array) -> Iterator[Part]:
        """Parameters of coupled joints; force (k,) is typical of the actuators."""
        for i, j, _ in choice.coupled:
            both = [self.diagonal[name][:, [i, j]] for name in ("rotor", "viscous")]
            both.append(np.tile(self.slip(i, j, choice.speed[j])[:, None], 2))
            size = np.sqrt([np.sum(entries**2) / self.usable.size for entries in both])
            guess = 0.1 * np.sqrt(force[i] * force[j]) / np.maximum(size, 1e-9)
            pair = f"{self.robot.joints[i]} and {self.robot.joints[j]}"
            block = Block(
                f"coupling of {pair}",
                tuple(coupling_names(i, j)),
                ("kg·m²", "N·m·s/rad", "N·m"),
                guess,
                "free",
                labels=tuple(f"coupling's {kind} of {pair}" for kind in COUPLINGS),
            )
            yield block, np.zeros(3), _FREE * guess

    def _gains(self) -> Block:
        units = self.recordings.command_units
        driven = self.driven
        return Block(
            "motor gain",
            tuple(f"gain_{j + 1}" for j in driven),
            tuple(f"{('N·m', 'N')[self._slides(j)]}/{units[j] or 'unit'}" for j in driven),
            self.gain[driven],
            "positive",
            True,
            labels=tuple(f"gain of {self.robot.joints[j]}" for j in driven),
        )


# -- entries of candidates in W --------------------------------------------------------------------


def _places(columns: Sequence[Column], rotors: Sequence[Rotor]) -> tuple[Indices, list[Key]]:
    """(z, 2) rows and parameters of entries of couplings' columns and rotors, and their keys."""
    places: list[tuple[int, int]] = []
    keys: list[Key] = []
    for column in columns:
        constants: dict[str, Any] = dict(column.constants)
        places.append((column.dof, column.parameter))
        keys.append((column.kind, column.dof, constants.get("speed"), constants["other"]))
    for rotor in rotors:
        pair = rotor.dof, rotor.other
        places += [(row, rotor.parameter) for row in pair]
        keys += [("rotor", one, None, other) for one, other in (pair, pair[::-1])]
    return np.array(places, dtype=np.intp).reshape(-1, 2), keys


def _on_every_joint(
    names: Sequence[str], n: int, first: int, links: Array | None = None
) -> tuple[list[Column], list[Rotor], int]:
    """Columns of `COLUMNS` and rotors on n joints, at every speed, and the parameter after them.

    All joints have one parameter, from `first`, since their entries stand in rows of their own.
    """
    loading = np.zeros(0) if links is None else links
    columns = []
    rotors = []
    at = first
    for name in names:
        falls = FALLS if name == "stribeck" else FALLS[:1]
        speeds = SPEEDS if name in FASTENED else SPEEDS[:1]
        for pair in itertools.product(speeds, falls):
            for joint in range(n):
                if name == "rotor":
                    rotors.append(Rotor(joint, at))
                else:
                    columns.append(joint_column(name, at, joint, pair, loading))
            at += 1
    return columns, rotors, at


def joint_of(parameter: str) -> int:
    """Number of the joint, from 0, of a parameter such as `gain_3`."""
    return int(parameter.rpartition("_")[2]) - 1


def nearest_friction(problem: FitProblem, theta: Array, count: int) -> tuple[Array, Array]:
    """(k,) viscous and (k,) Coulomb friction that approximate all friction of k = count joints.

    theta (p,) are the parameters. A joint that follows another one has none.
    """
    space = problem.space
    kinds = [COLUMNS[name].block for name in COLUMNS if name not in ("rotor", "spring", "offset")]
    used = [space[block.name] for block in space.blocks if block.name in kinds]
    pairs = [COLUMNS[name] for name in ("viscous", "coulomb")]
    if not {block.name for block in space.blocks}.issuperset(pair.block for pair in pairs):
        return np.zeros(0), np.zeros(0)
    base = problem.Y.shape[1] - count  # velocities of a floating base come first
    found = np.zeros((count, 2))
    for j in range(count):
        own = [f"{pair.letter}_{j + 1}" for pair in pairs]
        if not {*own} <= {*space.names}:
            continue
        places = [space.index(name) for name in own]
        found[j] = theta[places]
        rows = problem.Y[problem.usable[:, base + j], base + j]
        if len(used) > len(pairs) and len(rows):
            whole = sum(rows[:, place] @ theta[place] for place in used)
            found[j] = scipy.optimize.nnls(rows[:, places], whole)[0]
    viscous, coulomb = found.T
    return viscous, coulomb
