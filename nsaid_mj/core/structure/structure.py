"""A robot's equations as data: checked, and packed for the kernels."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ...base import InvalidInput, UnknownName
from . import arrays as layout
from .acting import Acting
from .arrays import Array, Slopes, StructureArrays, Workspace
from .columns import KINDS, fluid, joint, thrust
from .columns.kind import CURVE, LISTED, Kind
from .forces import BODY_KINDS
from .parts import KINDS_OF_JOINT, Body, Column, ContactPoint, Inertia, Rotor

_BASES = (layout.FREE, layout.PLANAR)
_READS = ("", "velocity", "pose")


@dataclass(frozen=True, eq=False)
class Structure:
    """M(x, θ) v̇ + C(x, θ) v = F(t, x, u) θ of any robot, without parameter values.

    Args:
        bodies: a tree; parents come before their children. A free flyer or a pose in the plane can
            only be the first body, on which all others then hang.
        inertias: the parts of M, beside `rotors`.
        columns: the terms of F θ, beside the weight of rigid bodies.
        p: number of parameters.
        n_u: number of commands.
        rotors: inertias of joints.
        gravity: (3,) in the world's axes [m/s²].
        contacts: where the robot touches its surroundings, by forces that nobody measures.

    Raises:
        UnknownName: a kind of joint or column does not exist.
        InvalidInput: a part refers to something that does not exist, or a constant is wrong.
    """

    bodies: Sequence[Body]
    inertias: Sequence[Inertia]
    columns: Sequence[Column]
    p: int
    n_u: int
    rotors: Sequence[Rotor] = ()
    gravity: ArrayLike = (0.0, 0.0, -9.81)
    contacts: Sequence[ContactPoint] = ()

    def __post_init__(self) -> None:
        for number, body in enumerate(self.bodies):
            self._check_body(number, body)
        for number, inertia in enumerate(self.inertias):
            what = f"inertias[{number}]"
            size = 10 if inertia.tensor is None else inertia.tensor.shape[-1]
            _within(f"{what}.body", inertia.body, len(self.bodies))
            _within(f"{what}.start", inertia.start, self.p - size + 1)
            if inertia.tensor is not None:
                self._check_tensor(what, inertia)
        rigid = sorted(i.body for i in self.inertias if i.tensor is None)
        if doubled := [one for one, other in pairwise(rigid) if one == other]:
            raise InvalidInput(
                "inertias",
                "at most one rigid body on each body",
                f"two on {doubled[0]}",
                "Add the second as a tensor.",
            )
        for number, rotor in enumerate(self.rotors):
            _within(f"rotors[{number}].dof", rotor.dof, self.n)
            _within(f"rotors[{number}].other", rotor.other, self.n, first=-1)
            _within(f"rotors[{number}].parameter", rotor.parameter, self.p)
        for number, column in enumerate(self.columns):
            self._check_column(f"columns[{number}]", column)
        for number, contact in enumerate(self.contacts):
            _within(f"contacts[{number}].body", contact.body, len(self.bodies))

    @cached_property
    def drag_and_lift(self) -> list[int]:
        """The parameters of forces that a flow exerts on the moving bodies, one for each column."""
        flowing = {k.name for k in (*fluid.KINDS, *thrust.KINDS) if k.reads == "velocity"}
        return [column.parameter for column in self.columns if column.kind in flowing]

    # -- sizes -------------------------------------------------------------------------------------

    @cached_property
    def kinds(self) -> list[int]:
        """The number of every body's kind of joint."""
        return [KINDS_OF_JOINT[body.joint] for body in self.bodies]

    @cached_property
    def starts(self) -> Array:
        """(b + 1, 2) first position and first velocity of every body's joint, then m and n."""
        sizes = [(layout.POSITIONS[k], layout.VELOCITIES[k]) for k in self.kinds]
        return np.vstack([np.zeros((1, 2), dtype=int), np.cumsum(sizes, axis=0)])

    @property
    def m(self) -> int:
        """Number of positions."""
        return int(self.starts[-1, 0])

    @property
    def n(self) -> int:
        """Number of velocities."""
        return int(self.starts[-1, 1])

    @property
    def group(self) -> int:
        """Number of leading velocities that form a body twist: 6, 3 or 0."""
        return layout.VELOCITIES[self.kinds[0]] if self.kinds[0] in _BASES else 0

    def path(self, body: int) -> list[int]:
        """The velocities that move a body: its own joint's first, then those of its ancestors."""
        found: list[int] = []
        while body >= 0:
            found += range(int(self.starts[body, 1]), int(self.starts[body + 1, 1]))
            body = self.bodies[body].parent
        return found

    # -- memory ------------------------------------------------------------------------------------

    def memory(self) -> tuple[Workspace, Slopes]:
        """Workspaces of a stage and for derivatives, with a state, see `arrays.POSITION`."""
        return layout.memory_of(self.arrays, self.n)

    @cached_property
    def arrays(self) -> StructureArrays:
        """The data as kernels read them."""
        entries, values, terms, ranges = self._entries()
        columns, constants, nonzeros = self._columns()
        return StructureArrays(
            self._bodies(ranges),
            np.concatenate([_joint(body) for body in self.bodies]),
            np.array(self.gravity, dtype=np.float64),
            _integers([(*_pair(rotor), rotor.parameter) for rotor in self.rotors], 3),
            entries,
            values,
            terms,
            columns,
            constants,
            nonzeros,
        )

    # -- packing -----------------------------------------------------------------------------------

    # -- what acts at some θ -----------------------------------------------------------------------

    def has_added_inertia(self, theta: Array) -> bool:
        """Whether θ (p,) has inertia beyond that of rigid bodies."""
        parts = ((i.start, i.tensor) for i in self.inertias)
        return any(
            theta[start : start + tensor.shape[2]].any()
            for start, tensor in parts
            if tensor is not None
        )

    def acts_on_bodies(self, theta: Array) -> bool:
        """Whether any force at θ (p,) depends on the bodies' poses, or there is added inertia."""
        near = {kind.name for kind in joint.KINDS if kind.name != "load"}
        acting = (column for column in self.columns if theta[column.parameter])
        return self.has_added_inertia(theta) or any(c.kind not in near for c in acting)

    def acting(self, theta: Array) -> Acting:
        """What acts at θ (p,), for a plant; without rigid bodies if θ has none."""
        arrays = self.arrays
        tens = [i.start for i in self.inertias if i.tensor is None]
        if not any(theta[k : k + 10].any() for k in tens):
            bodies = arrays.bodies.copy()
            bodies[:, layout.TEN] = -1
            bodies[:, layout.RIGID] = 0
            arrays = arrays._replace(bodies=bodies)
        work, slopes = self.memory()
        own = np.array(theta, dtype=np.float64)
        return Acting(*arrays, own, *work, slopes.state, slopes.F)

    def gains_of_commands(self) -> list[list[int]]:
        """For every command, the indices of the parameters that scale it."""
        acting = [c for c in self.columns if KINDS[c.kind].actuator]
        commands = range(self.n_u)
        return [sorted({c.parameter for c in acting if c.input == k}) for k in commands]

    # -- packing -----------------------------------------------------------------------------------

    def _bodies(self, ranges: list[tuple[int, ...]]) -> layout.Integers:
        rows = np.zeros((len(self.bodies), layout.BODY), dtype=np.int64)
        ten = {i.body: i.start for i in self.inertias if i.tensor is None}
        busy = {c.body for c in self.columns if KINDS[c.kind].number >= BODY_KINDS}
        for b, body in enumerate(self.bodies):
            kind = self.kinds[b]
            at_q, at_v = self.starts[b]
            count = layout.VELOCITIES[kind]
            own = ten.get(b, -1)
            general = ranges[b][1] > ranges[b][0]
            dense = general or b in busy
            flags = own >= 0, general, dense
            rows[b] = (body.parent, kind, at_q, at_v, count, own, *ranges[b], *flags)
        for b in range(len(rows) - 1, 0, -1):
            if (parent := rows[b, layout.PARENT]) >= 0:
                for flag in (layout.RIGID, layout.GENERAL, layout.DENSE):
                    rows[parent, flag] |= rows[b, flag]
        return rows

    def _entries(self) -> tuple[layout.Integers, Array, layout.Integers, list[tuple[int, ...]]]:
        """Entries and their values, terms, and the ranges of both for every body."""
        entries = []
        values = []
        terms = []
        ranges = []
        for b in range(len(self.bodies)):
            start = len(entries)
            first = len(terms)
            for inertia in self.inertias:
                if inertia.body != b or inertia.tensor is None:
                    continue
                for k in range(inertia.tensor.shape[2]):
                    begin = len(entries)
                    parameter = inertia.start + k
                    for i, j in np.argwhere(np.triu(inertia.tensor[:, :, k])).tolist():
                        entries.append((i, j, parameter))
                        values.append(inertia.tensor[i, j, k])
                    if self.kinds[b] not in _BASES and len(entries) > begin:
                        terms.append((parameter, begin, len(entries), b))
            ranges.append((start, len(entries), first, len(terms)))
        return (
            _integers(entries, 3),
            np.array(values, dtype=np.float64),
            _integers(terms, 4),
            ranges,
        )

    def _columns(self) -> tuple[layout.Integers, Array, layout.Integers]:
        rows = []
        constants = []
        nonzeros = []
        for column in self.columns:
            kind = KINDS[column.kind]
            body = column.body if kind.number >= BODY_KINDS else self._moved(column.dof)
            moved = self.path(body) if kind.number >= BODY_KINDS else [column.dof]
            if self.kinds[body] == layout.FREE:
                moved = _touched(kind, column)
            places = len(constants), len(nonzeros), column.parameter
            rows.append((kind.number, body, column.input, *places, _READS.index(kind.reads)))
            constants += packed(kind, column)
            nonzeros += [(velocity, column.parameter) for velocity in moved]
        return (
            _integers(rows, layout.COLUMN),
            np.array(constants, dtype=np.float64),
            _integers(nonzeros, 2),
        )

    def _moved(self, dof: int) -> int:
        """The body that a velocity moves directly."""
        return int(np.searchsorted(self.starts[:, 1], dof, side="right")) - 1

    # -- checks ------------------------------------------------------------------------------------

    def _check_body(self, number: int, body: Body) -> None:
        what = f"bodies[{number}]"
        if body.joint not in KINDS_OF_JOINT:
            raise UnknownName("kind of joint", body.joint, KINDS_OF_JOINT)
        base = self.bodies[0].joint in ("free", "planar")
        if number and (body.joint in ("free", "planar") or (base and body.parent < 0)):
            raise InvalidInput(
                f"{what}.joint",
                "a free flyer or plane as the only base",
                body.joint,
                "Make it the first body, and let all others hang on it.",
            )
        if not -1 <= body.parent < number:
            raise InvalidInput(
                f"{what}.parent", f"−1 … {number - 1}", body.parent, "Parents come first."
            )
        turned = np.asarray(body.rotation, dtype=float)
        if turned.shape != (3, 3) or not np.allclose(turned @ turned.T, np.eye(3), atol=1e-9):
            raise InvalidInput(f"{what}.rotation", "a (3, 3) rotation", turned.tolist(), "")
        moves = body.joint in ("hinge", "slide", "circle")
        axis = np.asarray(body.axis, dtype=float)
        if axis.shape != (3,) or (moves and not np.isclose(np.linalg.norm(axis), 1, atol=1e-9)):
            raise InvalidInput(f"{what}.axis", "a unit vector (3,)", axis.tolist(), "Divide by |a|")

    def _check_tensor(self, what: str, inertia: Inertia) -> None:
        tensor = np.asarray(inertia.tensor)
        if tensor.shape[:2] != (6, 6) or not (tensor == tensor.swapaxes(0, 1)).all():
            raise InvalidInput(
                f"{what}.tensor", "(6, 6, s), symmetric", tensor.shape, "See `Inertia.tied`."
            )

    def _check_column(self, what: str, column: Column) -> None:
        if column.kind not in KINDS:
            raise UnknownName("kind of column", column.kind, KINDS)
        kind = KINDS[column.kind]
        _within(f"{what}.parameter", column.parameter, self.p)
        if kind.number >= BODY_KINDS:
            _within(f"{what}.body", column.body, len(self.bodies))
        else:
            _within(f"{what}.dof", column.dof, self.n)
            if self.kinds[self._moved(column.dof)] in _BASES:
                raise InvalidInput(
                    f"{what}.dof", "the velocity of a joint", column.dof, "Use a kind on a body."
                )
        if kind.commanded or column.input >= 0:
            _within(f"{what}.input", column.input, self.n_u)
        if unknown := set(column.constants) - set(kind.constants):
            raise UnknownName(f"constant of {kind.name}", unknown.pop(), kind.constants)
        packed(kind, column)
        if "other" in column.constants:
            _within(f"{what}.other", int(np.asarray(column.constants["other"])), self.n)


def packed(kind: Kind, column: Column) -> list[float]:
    """A column's constants, in the order of its kind's."""
    numbers: list[float] = []
    for name, (size, default) in kind.constants.items():
        given = column.constants.get(name)
        if given is None and default is None:
            raise InvalidInput(
                f"{kind.name}.{name}", "a value", "none", f"Give the column {name}=…"
            )
        if size == CURVE and given is None:
            power = int(default or 1)
            numbers += [power, *np.eye(power)[-1]]
            continue
        value = np.asarray(default if given is None else given, dtype=float).ravel()
        if given is None:
            value = np.repeat(value, size)
        if size >= 0 and len(value) != size:
            raise InvalidInput(f"{kind.name}.{name}", f"{size} numbers", f"{len(value)}", "")
        if size == CURVE and len(value) != 1 + (value[0] if value[0] > 0 else -2 * value[0]):
            raise InvalidInput(
                f"{kind.name}.{name}", "a curve", value.tolist(), "See `Column.polynomial`."
            )
        if not (np.isfinite(value) | (default is not None and default == np.inf)).all():
            raise InvalidInput(f"{kind.name}.{name}", "finite numbers", value.tolist(), "")
        numbers += [*([float(len(value))] if size == LISTED else []), *value.tolist()]
    return numbers


def _touched(kind: Kind, column: Column) -> list[int]:
    """The components of a column's wrench on a free base that can differ from 0."""
    known = {name: np.asarray(value, dtype=float) for name, value in column.constants.items()}
    wrench = np.ones(6)
    if "axes" in known:
        wrench = known["axes"]
    elif not kind.reads and "direction" in known:
        along = known["direction"]
        none = np.zeros(3)
        wrench = np.r_[none, along]
        if "point" in known:
            wrench = np.r_[along, np.cross(known["point"], along)]
    return [int(i) for i in np.flatnonzero(wrench)]


def _joint(body: Body) -> Array:
    """(JOINT,) a body's joint, see `arrays.COSINE`."""
    row = np.zeros(layout.JOINT)
    R = np.asarray(body.rotation, dtype=float)
    axis = np.asarray(body.axis, dtype=float)
    turns = body.joint in ("hinge", "circle")
    held = np.outer(axis, axis) if turns else np.eye(3)
    across = np.cross(axis, np.eye(3)).T if turns else np.zeros((3, 3))
    row[: layout.COSINE] = (R @ held).ravel()
    row[layout.COSINE : layout.SINE] = (R @ (np.eye(3) - held)).ravel()
    row[layout.SINE : layout.PLACE] = (R @ across).ravel()
    row[layout.PLACE : layout.AXIS] = body.position
    if body.joint in ("hinge", "circle", "slide"):
        row[layout.AXIS :] = axis
    return row


def _pair(rotor: Rotor) -> tuple[int, int]:
    """The velocities of a rotor's entry of M, in its lower triangle."""
    other = rotor.dof if rotor.other < 0 else rotor.other
    return max(rotor.dof, other), min(rotor.dof, other)


def _within(name: str, value: int, end: int, first: int = 0) -> None:
    if not first <= value < end:
        raise InvalidInput(name, f"{first} … {end - 1}", value, "Indices count from 0.")


def _integers(rows: list[tuple[int, ...]], width: int) -> layout.Integers:
    return np.array(rows, dtype=np.int64).reshape(-1, width)
