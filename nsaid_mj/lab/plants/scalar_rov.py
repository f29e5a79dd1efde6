"""The 1-DOF vehicle (16): the heave axis of an ROV."""

from typing import ClassVar, Self

import numpy as np
from pydantic import model_validator

from ...base import InvalidInput, Number, Positive, config
from ...core import Array, Block, Column, Inertia, Operation, Term
from ...robots import VehicleFiles, asset
from ..fields import Share
from .world.blueprint import Blueprint, BodyPlant
from .world.body import hidden


@config
class ScalarRovPlant(BodyPlant):
    """The heave axis of a BlueROV2 Heavy; parameters and sources in assets/scalar_rov.

    Attributes:
        mass: nominal mass, including added mass [kg].
        drag: nominal quadratic drag [N·s²/m²].
        net_weight: nominal weight minus buoyancy [N].
        gain: nominal thrust at full command [N].
        spread: largest relative deviation of the true values from the nominal ones.
    """

    _refuses: ClassVar[tuple[str, ...]] = ("the heave axis alone", "flow", "fluid")

    mass: Positive = 32.18
    drag: Positive = 190.0
    net_weight: Number = 20.0
    gain: Positive = 160.0
    spread: Share = 0.2

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.net_weight == 0:
            raise InvalidInput(
                "plant.net_weight",
                "a number that is not 0",
                self.net_weight,
                "A neutral vehicle has no net weight to identify.",
            )
        return self

    @property
    def _files(self) -> VehicleFiles:
        return VehicleFiles(*(asset("scalar_rov", name) for name in ("SOURCE.md", "model.xml")))

    def _published(self) -> Blueprint:
        nominal = np.array([self.mass, self.drag, self.net_weight, self.gain])
        speed = float(np.sqrt(self.gain / self.drag))  # where drag balances full thrust
        return heaving(nominal, speed)


def heaving(nominal: Array, speed: float = 1.0) -> Blueprint:
    """m v̇ = −d v|v| − g + a u (16), θ = [m, d, g, a].

    x = (height z [m], upward velocity v [m/s]); u is the thruster command in [−1, 1]; g is the
    weight minus buoyancy [N]. M does not depend on x, so C = 0. Normalising by m gives the reduced
    form (17): hold `mass` at 1 with `ConventionalAID(known=("mass",))`. `nominal` (4,) are the
    published m [kg], d [N·s²/m²], g [N], a [N], whose magnitudes are the scale; `speed` [m/s] is
    that of operation, for random probes of the structure.
    """
    m, d, g, a = np.abs(nominal)[:, None]
    drag = {"drag": "drag"}
    gain = "thruster gain"
    mass = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    return Blueprint(
        Block("mass", ("mass",), ("kg",), m, "positive"),
        nominal[0] * mass,
        [
            Term.of("quadratic", drag, nominal[1], d, "drag", "positive", sliding=[True], dof=[0]),
            Term.of("weight", {"net weight": "net weight"}, nominal[2], g),
            Term(
                Block(gain, (gain,), ("N",), a, "positive", actuator=True),
                [Column("motor", 0, dof=0, input=0)],
                nominal[3:],
            ),
        ],
        Operation.within([2 * speed], np.ones(1)),
        Inertia.tied([(i, i, 0, 1.0) for i in range(3)]),
        hidden_body=lambda spread, rng: hidden(nominal[0], spread, rng) * mass,
    )
