"""A vehicle of one body as its data sheet describes it, and its plant for any true θ."""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.util import module_from_spec, spec_from_file_location
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from ....base import InvalidInput, config
from ....core import Array, Block, Inertia, Operation, Term
from ....robots import VehicleFiles, asset
from ...fields import Share
from .body import BODY, JOINTS, BodyInertia, command_inputs, hidden, vehicle_spec
from .config import KnownPlant
from .mismatch import Mismatch
from .sheet import Sheet

if TYPE_CHECKING:
    from ....core import SingleBody
    from .simulated import SimulatedRobot

_NOTHING = np.zeros((6, 6))


class Fluid(NamedTuple):
    """MuJoCo's own fluid forces, for the mismatch `ellipsoid`."""

    density: float  # density of the medium [kg/m³]
    viscosity: float  # viscosity of the medium [Pa·s]
    # whether the geom of this name is an ellipsoid in the flow; no other feels it
    solid: Callable[[str], bool]
    # blocks of θ whose forces they replace; with the first block, M's, added mass
    replaced: tuple[str, ...]

    def apply(self, spec: Any, mismatch: Mismatch) -> None:
        """Enables them in MuJoCo's specification."""
        spec.option.density = self.density
        spec.option.viscosity = self.viscosity
        spec.option.wind = mismatch.flow
        for geom in spec.body(BODY).geoms:
            geom.fluid_ellipsoid = int(self.solid(geom.name))


@dataclass(frozen=True, eq=False)
class Blueprint:
    """A vehicle of one body as published: its structure, and nominal values of θ.

    Matrices are about the body's origin; axes are x forward, y left, z up.
    """

    body: Block  # block of θ of the inertia
    rigid: Array  # (6, 6) nominal mass matrix of the rigid body [kg, kg·m, kg·m²]
    terms: Sequence[Term]  # the forces, with their nominal parameters
    operation: Operation  # ranges of velocities and commands
    # M in `body`; by default the ten parameters of a rigid body
    inertia: Inertia = field(default_factory=lambda: Inertia(0, 0))
    added: Array | None = None  # (6, 6) nominal added mass, symmetric; None for a body without
    gravity: float = 0.0  # [m/s²], 0 where weight is a column, or borne
    fluid: Fluid | None = None  # MuJoCo's fluid forces
    size: Sequence[float] | None = None  # (3,) size of the box drawn without a model.xml [m]
    # draws the true `rigid`, as a function of the plant's spread and a generator; None if the
    # published inertia is the true one
    hidden_body: Callable[[float, np.random.Generator], Array] | None = field(default=None)

    @cached_property
    def system(self) -> SingleBody:
        """The structure that an identifier may know."""
        from ....core import SingleBody

        return SingleBody(self.body, self.inertia, self.terms, self.operation, self.gravity)

    @cached_property
    def theta(self) -> Array:
        """(p,) nominal θ."""
        added = _NOTHING if self.added is None else self.added
        forces = [term.nominal for term in self.terms]
        return np.concatenate([self._parameters(self.rigid + added), *forces])

    def drawn(self, spread: float, rng: np.random.Generator) -> Array:
        """(p,) random true θ; each value is multiplied by its own factor within 1 ± spread."""
        theta = self.theta.copy()
        start = len(self.body)
        if self.hidden_body is not None:
            theta[:start] = self._parameters(self.hidden_body(spread, rng))
        shares = [np.full(len(term.block), term.spread) for term in self.terms]
        theta[start:] = hidden(theta[start:], spread * np.concatenate(shares), rng)
        return theta

    def split(self, theta: Array) -> tuple[BodyInertia, Array]:
        """Divides θ (p,) into a rigid body and (p,) θ of forces on it, added mass among them.

        Only the sum of both parts of M can be identified. The rigid-body part is the nominal one
        times the largest factor for which the added mass is at least the nominal one times this
        factor, so that both are physical.
        """
        acting = theta.copy()
        size = len(self.body)
        M = self.inertia.whole @ theta[:size]
        if self.added is None:
            acting[:size] = 0.0
            rigid = M
        else:
            from scipy.linalg import eigh

            at = np.ix_(*2 * [np.flatnonzero(np.diag(M))])
            share = eigh(M[at], (self.rigid + self.added)[at], eigvals_only=True)[0]
            rigid = share * self.rigid
            acting[:size] = self._parameters(M - rigid)
        if self.system.n < 6:  # in the plane only yaw matters, along the vertical no rotation
            rigid = rigid.copy()
            np.fill_diagonal(rigid[3:, 3:], rigid[5, 5] or rigid[0, 0])
        return BodyInertia.of_matrix(rigid), acting

    def _parameters(self, M: Array) -> Array:
        """(k,) parameters of a mass matrix of this form."""
        tensor = self.inertia.whole
        places = [np.argwhere(layer)[0] for layer in np.moveaxis(tensor, 2, 0)]
        return np.array([M[i, j] / tensor[i, j, k] for k, (i, j) in enumerate(places)])


@config
class BodyPlant(KnownPlant, ABC):
    """A vehicle of one body."""

    @property
    @abstractmethod
    def _files(self) -> VehicleFiles:
        """The files of its shapes."""

    def _made(self, known: Blueprint, dt: float, theta: Array) -> SimulatedRobot:
        """See `Blueprint.split` for how M is divided into rigid-body and added mass."""
        from .simulated import SimulatedRobot

        system = known.system
        files = self._files
        fluid = known.fluid
        try:
            body, acting = known.split(theta)
        except ValueError as error:
            raise _unphysical(files.sheet.parent.name, error) from error
        spec = vehicle_spec(files, dt, body, known.size, system.n)
        spec.option.gravity = [0, 0, -known.gravity]
        command_inputs(spec, system.n_u)
        if self.mismatch.fluid == "ellipsoid" and fluid is not None:
            fluid.apply(spec, self.mismatch)
            for name in fluid.replaced:
                acting[system.space[name]] = 0.0
        try:
            return SimulatedRobot(system, theta, acting, spec, JOINTS[system.n], self.mismatch)
        except InvalidInput:
            raise
        except ValueError as error:
            raise _unphysical(spec.modelname, error) from error


def _unphysical(name: str, error: ValueError) -> InvalidInput:
    expected = "a body that MuJoCo can simulate"
    remedy = "Check mass, inertia and added mass in its vehicle.toml."
    return InvalidInput(f"vehicle {name}", expected, error, remedy)


@cache
def sheet_of(family: str) -> type[VehicleSheet]:
    """The type of the sheets of a family, from its converter in assets/families."""
    path = asset("families", f"{family.replace('-', '_')}.py")
    spec = spec_from_file_location(f"nsaid_mj_family_{path.stem}", path)
    assert spec is not None and spec.loader is not None
    module = sys.modules[spec.name] = module_from_spec(spec)  # where pydantic looks names up
    spec.loader.exec_module(module)
    own = [v for v in vars(module).values() if getattr(v, "__module__", "") == spec.name]
    (sheet,) = (v for v in own if isinstance(v, type) and issubclass(v, VehicleSheet))
    return sheet


class _SheetOfFamily:
    """The sheet of a plant's family, loaded when it is first used."""

    def __get__(self, _plant: object, owner: Any) -> type[VehicleSheet]:
        return sheet_of(owner.family)


@config
class VehiclePlant(BodyPlant, ABC):
    """A vehicle of one body, made from a data sheet.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true parameters from the published values.
    """

    sheet: ClassVar[Any] = _SheetOfFamily()
    """The type of its data sheet."""

    vehicle: str
    spread: Share = 0.2

    @property
    @abstractmethod
    def family(self) -> str:
        """Name of the family, the `kind` of its sheets; an attribute of the class."""

    @property
    def _files(self) -> VehicleFiles:
        return VehicleFiles.of(self.vehicle)

    def _published(self) -> Blueprint:
        return self.sheet.of(self.vehicle).blueprint()


class VehicleSheet(Sheet, ABC):
    """The data sheet of a vehicle of one body."""

    @abstractmethod
    def blueprint(self) -> Blueprint:
        """The sheet's vehicle, in SI units, x forward, y left, z up."""
