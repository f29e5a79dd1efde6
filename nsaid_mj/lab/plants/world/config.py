"""A plant's parameters as part of a scenario; whatever simulates is imported when it is built."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from pydantic import model_validator

from ....base import Config, InvalidInput, config
from .faults.text import Faults
from .mismatch import Mismatch

if TYPE_CHECKING:
    from ....core import Array, JointTree
    from .plant import Plant
    from .simulated import SimulatedRobot


@config
class PlantConfig(Config, ABC):
    """A plant's parameters, as part of a scenario; `build` makes the plant.

    Attributes:
        mismatch: effects that the identifier's structure does not model.
        faults: faults of actuators, sensors or the plant during the run, such as `loss 0.4 of 2 at
            5 s; payload 1 kg at 10 s until 15 s`.
        _refuses: the plant's kind in words, and the effects of `mismatch` that it lacks; for a
            plant in the plane, `level` for a vertical flow.
    """

    _path = "plant"
    _refuses: ClassVar[tuple[str, ...]] = ()

    mismatch: Mismatch = field(default_factory=Mismatch, kw_only=True)
    faults: Faults = field(default=(), kw_only=True)

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        if self._refuses:
            self.mismatch.refuse(*self._refuses)
        return self

    @abstractmethod
    def build(self, dt: float, seed: int) -> Plant:
        """Makes the plant with time step dt [s] and hidden parameters drawn from the seed."""

    def published(self, dt: float) -> tuple[Plant, Array]:
        """The plant with its published θ, and this θ (p,).

        Raises:
            InvalidInput: the plant cannot be made with a given θ.
        """
        if not isinstance(self, ParametricPlantConfig):
            raise InvalidInput(
                "prior",
                f"`drawn`, for {type(self).__name__}",
                "nominal",
                "Leave it out: this plant cannot be made with a given θ; see "
                "ParametricPlantConfig.",
            )
        plant = self.simulating(dt)
        return plant, plant.truth


@config
class ParametricPlantConfig(PlantConfig, ABC):
    """A plant that can be made with any physical θ of its system."""

    @abstractmethod
    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with time step dt [s] and the true θ (p,), or the published values."""


class PublishedRobot(NamedTuple):
    """What is published of a tree of joints."""

    source: Any  # the description from which plants are made
    system: JointTree  # the structure that an identifier may know
    theta: Array  # (p,) published or nominal θ
    # blocks of θ whose true values differ, in the order in which they are drawn, each with the
    # share of the plant's spread; blocks that θ lacks are skipped
    unsure: Sequence[tuple[str, float]]

    def drawn(self, spread: float, rng: np.random.Generator) -> Array:
        """(p,) random true θ; each value is multiplied by its own factor within 1 ± spread."""
        from .body import hidden

        theta = self.theta.copy()
        space = self.system.space
        for name, share in self.unsure:
            if name in {block.name for block in space.blocks}:
                theta[space[name]] = hidden(theta[space[name]], share * spread, rng)
        return theta


@config
class KnownPlant(ParametricPlantConfig, ABC):
    """A plant with a published θ, about which its field `spread` says how far the truth may be."""

    @abstractmethod
    def _published(self) -> Any:
        """A `Known` or a `Blueprint`."""

    @abstractmethod
    def _made(self, known: Any, dt: float, theta: Array) -> SimulatedRobot:
        """Makes the plant of what `_published` returns, with the true θ (p,)."""

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden parameters and makes the plant."""
        known = self._published()
        theta = known.drawn(self.spread, np.random.default_rng(seed))
        return self._made(known, dt, theta).failing(self.faults, self)

    def simulating(self, dt: float, theta: Array | None = None) -> Plant:
        """Makes the plant with the true parameters θ (p,), or the published ones."""
        known = self._published()
        true = known.theta if theta is None else theta
        return self._made(known, dt, true).failing(self.faults, self)
