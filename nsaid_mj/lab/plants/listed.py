"""Vehicles whose data sheet lists their force columns: a new family needs no code."""

from typing import Any, ClassVar, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from ...base import InvalidInput, UnknownName, config
from ...core import (
    Array,
    Block,
    Column,
    Inertia,
    Operation,
    Term,
)
from ..fields import Share
from .world.blueprint import Blueprint, VehiclePlant, VehicleSheet
from .world.body import BodyInertia
from .world.sheet import (
    LARGEST,
    NotNegative,
    Number,
    Positive,
    SheetTable,
    check_inertia,
    one,
    several,
)


class ColumnRow(SheetTable):
    """A table [[column]]; the other keys are the constants of its kind."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False)

    kind: str = one('a kind of column, such as "drag" or "propeller"')
    name: str = one("what it is called; columns of one kind and name share their parameter")
    value: Number = one("a number, the nominal value of the parameter in SI units")
    guess: Positive | None = Field(
        default=None, description="a magnitude > 0 that you expect; it may be left out"
    )
    command: int | None = Field(
        default=None, ge=1, le=1000, description="the number of its command, from 1 to 1000"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        from ...core import KINDS  # compiled

        if self.kind not in KINDS or KINDS[self.kind].number < 100:
            bodily = [name for name, kind in KINDS.items() if kind.number >= 100]
            raise UnknownName("kind of column on a body", self.kind, bodily)
        for key, value in (self.__pydantic_extra__ or {}).items():
            numbers: list[Any] = value if isinstance(value, list) and value else [value]
            if not all(type(x) in (int, float) and abs(x) <= LARGEST for x in numbers):
                raise InvalidInput(
                    f"column {self.name}: {key}",
                    "a number, or several",
                    value,
                    "See docs/your_vehicle.md for the constants of every kind.",
                )
        kind = KINDS[self.kind]
        if kind.geometry == "positive" and not self.value > 0:
            raise InvalidInput(
                f"column {self.name}: value",
                "a number > 0",
                self.value,
                "Turn its direction or point instead.",
            )
        if kind.commanded and self.command is None:
            raise InvalidInput(
                f"column {self.name}: command",
                "the number of a command",
                "none",
                "Commands count from 1.",
            )
        if not self.value and self.guess is None:
            raise InvalidInput(
                f"column {self.name}: guess",
                "a magnitude > 0, as the value is 0",
                "none",
                "Give the order of magnitude that you expect, e.g. 10.",
            )
        return self

    def column(self, parameter: int) -> Column:
        """The column of the structure; `parameter` is its index in the block."""
        from ...core import Column

        constants: dict[str, Any] = dict(self.__pydantic_extra__ or {})
        if "curve" in constants:
            constants["curve"] = Column.polynomial(*constants["curve"])
        number = -1 if self.command is None else self.command - 1
        return Column(self.kind, parameter, body=0, input=number, **constants)


class ListedSheet(VehicleSheet):
    """A data sheet of columns; axes x forward, y left, z up."""

    family: ClassVar[str] = "columns"

    plane: bool = Field(default=False, description="true for a vehicle that moves in the plane")
    mass: Positive = one("a number > 0 [kg]")
    centre: list[Number] = Field(
        default=[0.0, 0.0, 0.0], min_length=3, max_length=3, description="three numbers [m]"
    )
    inertia: list[Positive] = several(3, "three moments about the centre of mass > 0 [kg·m²]")
    added_mass: list[NotNegative] | None = Field(
        default=None, min_length=6, max_length=6, description="six numbers ≥ 0 [kg, kg·m²]"
    )
    gravity: NotNegative = Field(
        default=0.0, description="a number ≥ 0, 0 where weight is a column or borne [m/s²]"
    )
    speed: list[Positive] = several(6, "six velocities of operation > 0 [m/s, rad/s]")
    column: list[ColumnRow] = Field(min_length=1, description="tables [[column]]")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        if self.gravity and (self.plane or self.added_mass):
            raise InvalidInput(
                "gravity",
                "0 in the plane, and with added mass",
                self.gravity,
                'Weight less buoyancy is a column of kind "weight".',
            )
        return self

    def blueprint(self) -> Blueprint:
        """The vehicle; θ = [inertia, then the columns' parameters, kind by kind].

        Without added mass, a body in space has the ten parameters of a rigid one.
        """
        from ...core import SingleBody

        rigid = BodyInertia(self.mass, np.array(self.centre), np.diag(self.inertia)).matrix()
        axes = list(SingleBody.LEVEL if self.plane else range(6))
        added = None
        if self.plane or self.added_mass is not None:
            added = np.diag(self.added_mass or np.zeros(6))
        most = np.ones(max((row.command or 0 for row in self.column), default=0))
        kinds = dict.fromkeys(row.kind for row in self.column)
        return Blueprint(
            self._inertia(rigid, added, axes),
            rigid,
            [_term([row for row in self.column if row.kind == kind]) for kind in kinds],
            Operation.within(np.array(self.speed)[axes], most),
            Inertia(0, 0) if added is None else Inertia.full(tuple(axes)),
            added,
            self.gravity,
            size=self.size,
        )

    def _inertia(self, rigid: Array, added: Array | None, axes: list[int]) -> Block:
        if added is not None:
            return Block.of_mass_matrix(Block.guessed(np.diag(rigid + added)[axes]), axes)
        size = float(np.sqrt(max(self.inertia) / self.mass))
        moments = Block.guessed(np.array(self.inertia))
        return Block.of_body(float(Block.guessed(self.mass)), 0.1 * size, moments)


def _term(rows: list[ColumnRow]) -> Term:
    """The block of all columns of one kind; those of one name share their parameter."""
    from ...core import KINDS  # compiled

    kind = KINDS[rows[0].kind]
    own = {row.name: row for row in rows}
    names = list(own)
    return Term.of(
        [row.column(names.index(row.name)) for row in rows],
        {f"{kind.letter}_{name}".replace(" ", "_"): f"{kind.block} of {name}" for name in names},
        [row.value for row in own.values()],
        np.array([float(row.guess or Block.guessed(row.value)) for row in own.values()]),
        kind.name.replace("_", " "),
    )


@config
class ListedPlant(VehiclePlant):
    """A vehicle of one body whose data sheet lists its forces; see docs/your_vehicle.md.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true parameters of all columns from the sheet's;
            the inertia is as published.
    """

    family: ClassVar[str] = ListedSheet.family
    sheet: ClassVar[type[VehicleSheet]] = ListedSheet
    _refuses: ClassVar[tuple[str, ...]] = ("a vehicle of listed columns", "fluid")
    vehicle: str = "catamaran"
    spread: Share = 0.2
