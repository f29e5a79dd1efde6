"""Names, units, scale and geometry of θ.

A `ParameterSpace` is an ordered tuple of blocks. `scale` is an engineer's guess of each parameter's
magnitude before any measurement; every norm, rank and projection in this package is taken in
θ_s = θ/scale, so that kilograms and newton-metres are comparable.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import InvalidInput, UnknownName

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Geometry = Literal["free", "positive", "pseudo_inertia", "spd", "tied"]

_SIZES = {"pseudo_inertia": 10}

_INVERTED = 1e-12  # share of the mean diagonal that is added where a matrix is inverted

INERTIAL = ("m", "hx", "hy", "hz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Names of the inertial parameters of a rigid body about its origin, in Pinocchio's order."""
_LABELS = ("mass", "m·cx", "m·cy", "m·cz", *INERTIAL[4:])

ABSENT = "–"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LEAST = 1e-3  # numbers outside are written as powers of ten,
_MOST = 1e5
_FINEST = 1e-4  # unless they are rounded to this or more
_SMALLEST = -307  # power of ten whose half is still positive


def finite(name: str, value: ArrayLike, shape: tuple[int, ...], remedy: str) -> Array:
    """Converts a value to a float array of the given shape; `name` and `remedy` are for messages.

    Raises:
        InvalidInput: the shape differs, or an entry is NaN or infinite.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape != shape:
        raise InvalidInput(name, f"an array of shape {shape}", f"shape {array.shape}", remedy)
    if not np.isfinite(array).all():
        where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InvalidInput(name, "finite values", f"{array[where]} at index {where}", remedy)
    return array


def phrase(labels: Iterable[str]) -> str:
    """Joins labels, grouped by the part they belong to.

    For example "mass of link 1", "Ixx of link 1" and "gain of elbow" become "mass and Ixx of
    link 1, gain of elbow".
    """
    parts: dict[str, list[str]] = {}
    for label in labels:
        what, _, part = label.partition(" of ")
        parts.setdefault(part, []).append(what)
    return ", ".join(
        f"{' and '.join(filter(None, (', '.join(what[:-1]), what[-1])))} of {part}"
        if part
        else ", ".join(what)
        for part, what in parts.items()
    )


def number(value: float, quantum: float | None = None, significant: int = 4) -> str:
    """A number with so many digits, or rounded to a quantum: 0.031, −12.5, 3.2·10⁻⁵."""
    if not math.isfinite(value):
        return ABSENT if math.isnan(value) else ("∞" if value > 0 else "−∞")
    size = abs(value)
    if quantum is None or not 0 < quantum < math.inf:
        power = math.floor(math.log10(size)) + 1 - significant if size else 0
        quantum = 10.0 ** max(power, _SMALLEST)
        trim = True
    else:
        quantum = 10.0 ** math.floor(math.log10(quantum) + 1e-9)
        trim = False
    if size < quantum / 2:
        text = "0"
    elif (_LEAST <= size < _MOST or quantum >= _FINEST) and quantum < 1e3:
        digits = max(0, -round(math.log10(quantum)))
        text = f"{round(size / quantum) * quantum:.{digits}f}"
        text = text.rstrip("0").rstrip(".") if trim and "." in text else text
    else:
        digits = max(0, math.floor(math.log10(size)) - round(math.log10(quantum)))
        factor, _, power = f"{size:.{min(digits, 3)}e}".partition("e")
        factor = factor.rstrip("0").rstrip(".") if trim and "." in factor else factor
        text = f"{factor}·10{str(int(power)).translate(_SUPERSCRIPTS)}"
    return f"−{text}" if value < 0 and text != "0" else text


def rounded(value: float, digits: int = 3) -> str:
    """A number in few digits, a power of ten only below 1e-4 and from 1e5: 0.00021, 1.8·10⁻⁶."""
    text = f"{value:.{digits}g}"
    return number(value, significant=digits) if "e" in text else text


@dataclass(frozen=True)
class Block:
    """Consecutive parameters of one kind.

    Attributes:
        name: the kind in a roboticist's words ("motor gain"); unique in a space.
        names: one name for each of the k parameters.
        units: one SI unit for each parameter.
        scale: (k,) an engineer's guess of the magnitudes, in these units, > 0.
        geometry: the set of physical values: `free` any, `positive` > 0, `pseudo_inertia` the ten
            inertial parameters of one link, `spd` the upper triangle of a symmetric positive
            definite matrix, `tied` the numbers from which `entries` make such a matrix.
        actuator: whether the block scales commands (motors, thrusters, fins, nozzles, wheels).
        entries: for the geometry `tied`, rows (i, j, l, value), i ≥ j: the matrix has value · θ_l
            at (i, j) and (j, i), and 0 elsewhere. Each θ_l appears either on the diagonal, with
            values > 0, or off it.
        labels: readable descriptions, such as "mass of upper_arm_link"; by default the names.
        AXES: names of motions along and about the axes of a body, as in names of parameters.
    """

    AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    scale: Array
    geometry: Geometry = "free"
    actuator: bool = False
    entries: tuple[tuple[int, int, int, float], ...] = ()
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        k = len(self.names)
        remedy = f"Give block {self.name!r} one entry for each of its {k} names."
        if len(self.units) != k:
            raise InvalidInput("units", f"{k} units", f"{len(self.units)}", remedy)
        labels = tuple(self.labels) or self.names
        if len(labels) != k:
            raise InvalidInput("labels", f"{k} labels, or none", f"{len(labels)}", remedy)
        object.__setattr__(self, "labels", labels)
        scale = finite("scale", self.scale, (k,), remedy).copy()
        if not (scale > 0).all():
            raise InvalidInput("scale", "values > 0", f"{scale.min()}", remedy)
        if self.geometry not in get_args(Geometry):
            raise UnknownName("geometry", self.geometry, get_args(Geometry))
        if self.geometry == "spd" and (order := round((2 * k) ** 0.5)) * (order + 1) != 2 * k:
            raise InvalidInput("names", "1, 3, 6, 10, 15, 21 … names for spd", k, remedy)
        if k != _SIZES.get(self.geometry, k):
            raise InvalidInput(
                "names", f"{_SIZES[self.geometry]} names for {self.geometry}", k, remedy
            )
        if (self.geometry == "tied" or self.entries) and (wrong := self._entries_problem()):
            raise InvalidInput(
                "entries", "a symmetric matrix of all parameters, if tied", wrong, remedy
            )
        scale.flags.writeable = False
        object.__setattr__(self, "scale", scale)

    def __len__(self) -> int:
        return len(self.names)

    @staticmethod
    def guessed(value: ArrayLike) -> Array:
        """The nearest powers of two of |value|: a scale by order of magnitude."""
        exponent = np.round(np.log2(np.abs(np.asarray(value, dtype=np.float64))))
        return np.exp2(exponent).astype(np.float64)

    @classmethod
    def of_body(cls, mass: float, offset: float, inertia: Array) -> Self:
        """The ten inertial parameters of the body of a vehicle: m, m c (3), Ixx, Ixy, Iyy, Ixz ….

        Guesses are the mass [kg], the largest distance `offset` of the centre of mass from the
        origin [m], and moments of inertia (3,) [kg·m²], of which products are a quarter.
        """
        x, y, z = inertia
        products = 0.25 * np.sqrt([x * y, x * z, y * z])
        moments = [x, products[0], y, products[1], products[2], z]
        return cls._inertial("body", "body", "", np.array([mass, *[mass * offset] * 3, *moments]))

    @classmethod
    def of_link(cls, number: int, name: str, mass: float, length: float) -> Self:
        """The ten inertial parameters of link `name`, body `number` (0 is a floating base).

        `mass` [kg] and `length` [m] are guesses.
        """
        scale = mass * np.repeat([1.0, length, length**2], [1, 3, 6])
        return cls._inertial(f"link {number}" if number else "base", name, f"_{number}", scale)

    @classmethod
    def _inertial(cls, block: str, body: str, end: str, scale: Array) -> Self:
        names = (f"{x}{end}" for x in INERTIAL)
        labels = (f"{x} of {body}" for x in _LABELS)
        units = ("kg",) + ("kg·m",) * 3 + ("kg·m²",) * 6
        return cls(block, tuple(names), units, scale, "pseudo_inertia", labels=tuple(labels))

    @classmethod
    def of_mass_matrix(cls, diagonal: Array, axes: Sequence[int] = range(6)) -> Self:
        """The entries of a symmetric M (n, n), upper triangle row by row.

        diagonal (n,) is a guess of M's diagonal [kg, kg·m²], and off it a quarter of the geometric
        mean; `axes` are those along and about which the body moves, of the six.
        """
        rows, columns = np.triu_indices(len(axes))
        share = np.where(rows == columns, 1.0, 0.25)
        scale = share * np.sqrt(diagonal[rows] * diagonal[columns])
        rows = np.asarray(axes)[rows]
        columns = np.asarray(axes)[columns]
        pairs = list(zip(rows.tolist(), columns.tolist(), strict=True))
        units = np.array(["kg", "kg·m", "kg·m²"])[(rows >= 3).astype(int) + (columns >= 3)]
        return cls(
            "mass matrix",
            tuple(f"M_{i + 1}{j + 1}" for i, j in pairs),
            tuple(units.tolist()),
            scale,
            "spd",
            labels=tuple(_mass_label(i, j) for i, j in pairs),
        )

    def _entries_problem(self) -> str:
        """What is wrong with `entries`; empty if they are valid."""
        if self.geometry != "tied":
            return f"entries for {self.geometry}"
        if any(len(entry) != 4 for entry in self.entries):
            return "a row that is not (i, j, l, value)"
        places = [(i, j) for i, j, _, _ in self.entries]
        on = {at for i, j, at, _ in self.entries if i == j}
        off = {at for i, j, at, _ in self.entries if i != j}
        for entry in self.entries:
            i, j, at, value = entry
            whole = 0 <= j <= i and 0 <= at < len(self) and places.count((i, j)) == 1
            if not (whole and np.isfinite(value) and (value > 0 if i == j else value != 0)):
                return f"{entry}"
        for at, name in enumerate(self.names):
            if (at in on) == (at in off):
                return f"{name} on the diagonal and off it" if at in on else f"none for {name}"
        order = 1 + max(i for i, _ in places)
        return "" if sum(i == j for i, j in places) == order else "a gap in the diagonal"


def _mass_label(i: int, j: int) -> str:
    """The label of entry (i, j) of M; "effective" because it includes added mass."""
    if i == j:
        return f"effective {Block.AXES[i]} {'mass' if i < 3 else 'inertia'}"
    return f"{Block.AXES[i]}–{Block.AXES[j]} coupling of M"


@dataclass(frozen=True)
class ParameterSpace:
    """The space of θ (p,): blocks in order.

    Attributes:
        blocks: the blocks; names of blocks and names of parameters are unique.
    """

    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        for kind, names in (("block", [b.name for b in self.blocks]), ("parameter", self.names)):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise InvalidInput(
                    f"{kind} names", "unique names", f"{twice[0]!r} twice", "Rename one."
                )

    def __len__(self) -> int:
        return len(self.scale)

    def __iter__(self) -> Iterator[tuple[Block, slice]]:
        """Yields every block with its slice of θ."""
        start = 0
        for block in self.blocks:
            yield block, slice(start, start + len(block))
            start += len(block)

    @cached_property
    def names(self) -> list[str]:
        """The p parameter names, in order."""
        return [name for block in self.blocks for name in block.names]

    @cached_property
    def labels(self) -> list[str]:
        """Readable descriptions of the p parameters, in order."""
        return [label for block in self.blocks for label in block.labels]

    @cached_property
    def units(self) -> list[str]:
        """The p SI units, in order."""
        return [unit for block in self.blocks for unit in block.units]

    @cached_property
    def scale(self) -> Array:
        """(p,) an engineer's guess of every parameter's magnitude, read-only."""
        scale = np.concatenate([block.scale for block in self.blocks])
        scale.flags.writeable = False
        return scale

    @cached_property
    def geometries(self) -> NDArray[np.str_]:
        """(p,) the geometry of every parameter's block."""
        return np.repeat([block.geometry for block in self.blocks], [*map(len, self.blocks)])

    @cached_property
    def actuators(self) -> Indices:
        """The indices of all actuator parameters."""
        parts = [np.arange(s.start, s.stop) for block, s in self if block.actuator]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)

    def __getitem__(self, name: str) -> slice:
        """The slice of θ that belongs to the block called `name`.

        Raises:
            UnknownName: there is no such block.
        """
        for block, place in self:
            if block.name == name:
                return place
        raise UnknownName("parameter block", name, [block.name for block in self.blocks])

    def index(self, name: str) -> int:
        """The index in θ of the parameter called `name`.

        Raises:
            UnknownName: there is no such parameter.
        """
        if name not in self.names:
            raise UnknownName("parameter", name, self.names)
        return self.names.index(name)

    def inverse(self, hessian: Array, free: Indices) -> Array:
        """(p, p) inverse of H ⪰ 0 (p, p) among the parameters `free`, and 0 for all others.

        H is of θ; it is inverted as that of θ/scale.
        """
        import scipy.linalg  # arguments are checked without it

        found = np.zeros_like(hessian)
        unit = np.outer(self.scale[free], self.scale[free])
        inner = hessian[np.ix_(free, free)] * unit
        inner[np.diag_indices_from(inner)] += _INVERTED * np.trace(inner) / len(inner)
        found[np.ix_(free, free)] = scipy.linalg.inv(inner) * unit
        return found

    def check(self, theta: ArrayLike, name: str = "theta") -> Array:
        """Converts θ to a float array of shape (p,).

        Args:
            theta: the parameters.
            name: name of θ, for messages.

        Raises:
            InvalidInput: the shape differs, or an entry is NaN or infinite.
        """
        return finite(name, theta, (len(self),), f"θ has {len(self)} parameters: see `names`.")
