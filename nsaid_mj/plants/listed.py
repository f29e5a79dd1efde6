"""Vehicles whose data sheet lists their forces, column by column: a new family needs no code."""

from __future__ import annotations

from typing import Any, ClassVar, Self

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from ..bounds import Name, Share, config
from ..errors import InvalidInput, UnknownName
from ..parameters import Array, Block
from ..structure.columns import KINDS, curve
from ..structure.parts import Column
from ..systems.inertial import inertial_block
from ..systems.listed import LEVEL, ListedVehicle, Row
from ..systems.underwater import mass_block
from .world.body import Inertia, Vehicle, guessed, hidden, vehicle_spec
from .world.hydrodynamics import split_mass
from .world.plant import ParametricPlantConfig, Plant
from .world.sheet import (
    LARGEST,
    NotNegative,
    Number,
    Positive,
    Sheet,
    Table,
    check_inertia,
    one,
    several,
)


class ColumnRow(Table):
    """A table [[column]]; the other keys are the constants of its kind."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True, allow_inf_nan=False)

    kind: str = one('a kind of column, such as "drag" or "propeller"')
    name: str = one("what it is called; columns of one kind and name share their parameter")
    value: Number = one("a number, the nominal value of the parameter in SI units")
    guess: Positive | None = Field(
        default=None, description="a magnitude > 0 that you expect; it may be left out"
    )
    command: int | None = Field(
        default=None, ge=1, description="the number of the command it reads, from 1"
    )

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.kind not in KINDS or KINDS[self.kind].number < 100:
            bodily = [name for name, kind in KINDS.items() if kind.number >= 100]
            raise UnknownName("kind of column on a body", self.kind, bodily)
        for key, value in (self.__pydantic_extra__ or {}).items():
            numbers: list[Any] = value if isinstance(value, list) and value else [value]
            if not all(type(x) in (int, float) and abs(x) <= LARGEST for x in numbers):
                raise InvalidInput(
                    f"column {self.name}: {key}", "a number, or several", value,
                    "See docs/your_vehicle.md for the constants of every kind.",
                )  # fmt: skip
        kind = KINDS[self.kind]
        if kind.geometry == "positive" and not self.value > 0:
            raise InvalidInput(
                f"column {self.name}: value", "a number > 0", self.value,
                "Turn its direction or point instead.",
            )  # fmt: skip
        if kind.commanded and self.command is None:
            raise InvalidInput(
                f"column {self.name}: command", "the number of a command", "none",
                "Commands count from 1.",
            )  # fmt: skip
        if not self.value and self.guess is None:
            raise InvalidInput(
                f"column {self.name}: guess", "a magnitude > 0, as the value is 0", "none",
                "Say what you would expect before any measurement.",
            )  # fmt: skip
        return self

    def row(self) -> Row:
        """The column of the structure, and the guess of its parameter."""
        constants: dict[str, Any] = dict(self.__pydantic_extra__ or {})
        if "curve" in constants:
            constants["curve"] = curve.polynomial(*constants["curve"])
        number = -1 if self.command is None else self.command - 1
        column = Column(self.kind, 0, body=0, input=number, **constants)
        return Row(column, self.name, float(self.guess or guessed(self.value)))


class ListedSheet(Sheet):
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
                "gravity", "0 in the plane, and with added mass", self.gravity,
                'Weight less buoyancy is a column of kind "weight".',
            )  # fmt: skip
        return self

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes along and about which it moves."""
        return LEVEL if self.plane else tuple(range(6))

    @property
    def rigid(self) -> bool:
        """Whether θ has the ten parameters of a rigid body, not the entries of M."""
        return not self.plane and self.added_mass is None

    def masses(self) -> tuple[Array, Array]:
        """(n, n) nominal rigid-body and added mass about the origin."""
        m, (x, y, z) = self.mass, self.centre
        S = m * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        M = np.block([[m * np.eye(3), -S], [S, np.diag(self.inertia) - S @ S / m]])
        at = np.ix_(self.axes, self.axes)
        return M[at], np.diag(self.added_mass or np.zeros(6))[at]

    def theta(self) -> Array:
        """(p,) nominal θ."""
        system, (rigid, added) = self.system(), self.masses()
        inertia = (rigid + added)[np.triu_indices(len(rigid))]
        if self.rigid:
            inertia = Inertia(self.mass, np.array(self.centre), np.diag(self.inertia)).theta()
        labels = {label: i for i, label in enumerate(system.space.labels)}
        theta = np.zeros(len(system.space))
        theta[: len(inertia)] = inertia
        for row in self.column:
            theta[labels[f"{KINDS[row.kind].block} of {row.name}"]] = row.value
        return theta

    def system(self) -> ListedVehicle:
        """The structure."""
        rows = [row.row() for row in self.column]
        speed = np.array(self.speed)[list(self.axes)]
        return ListedVehicle(rows, self._inertia(), speed, self.gravity)

    def _inertia(self) -> Block:
        if self.rigid:
            size = float(np.sqrt(max(self.inertia) / self.mass))
            moments = guessed(np.array(self.inertia))
            return inertial_block("body", float(guessed(self.mass)), 0.1 * size, moments)
        rigid, added = self.masses()
        return mass_block(guessed(np.diag(rigid + added)), self.axes)


@config
class ListedPlant(ParametricPlantConfig):
    """A vehicle of one body whose data sheet lists its forces; see docs/your_vehicle.md.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true parameters of all columns from the sheet's;
            the inertia is as published.
    """

    sheet: ClassVar[type[Sheet]] = ListedSheet
    vehicle: Name = "catamaran"
    spread: Share = 0.2

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        sheet = ListedSheet.of(self.vehicle)
        theta, inertia = sheet.theta(), len(sheet.system().space.blocks[0])
        theta[inertia:] = hidden(theta[inertia:], self.spread, np.random.default_rng(seed))
        return self.simulating(dt, theta)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or those of the sheet.

        See `split_mass` for how M is divided into rigid-body and added mass.
        """
        sheet = ListedSheet.of(self.vehicle)
        self.mismatch.refuse("a vehicle of listed columns", "fluid")
        theta = sheet.theta() if theta is None else theta
        acting, count = theta.copy(), len(sheet.axes)
        if sheet.rigid:
            body = Inertia.of(theta[:10])
            acting[:10] = 0.0
        else:
            upper = np.triu_indices(count)
            M = np.zeros((count, count))
            M[upper] = theta[: len(upper[0])]
            nominal, added = sheet.masses()
            rigid, added = split_mass(M + np.triu(M, 1).T, nominal, added)
            acting[: len(upper[0])] = added[upper]
            share = rigid[0, 0] / nominal[0, 0]
            about = share * np.diag(sheet.inertia)
            body = Inertia(share * sheet.mass, np.array(sheet.centre), about)
        spec = vehicle_spec(self.vehicle, dt, *body, sheet.size, planar=sheet.plane)
        spec.option.gravity = [0, 0, -sheet.gravity]
        vehicle = Vehicle(sheet.system(), theta, spec, acting, self.mismatch)
        return vehicle.failing(self.faults, self)
