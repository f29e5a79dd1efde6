"""The 1-DOF vehicle of the paper, (16)."""

from __future__ import annotations

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Body, Column, Inertia, tied
from ..structure.structure import Structure
from .structured import StructuredSystem


class ScalarVehicle(StructuredSystem):
    """m v̇ = −d v|v| − g + a u (16), θ = [m, d, g, a].

    x = (height z [m], upward velocity v [m/s]); u is the thruster command in [−1, 1]; g is the
    weight minus buoyancy [N]. M does not depend on x, so C = 0. Normalising by m gives the reduced
    form (17): hold `mass` at 1 with `ConventionalAID(known=("mass",))`.

    Args:
        scale: (4,) guess of m [kg], d [N·s²/m²], g [N], a [N].
        speed: speed of operation [m/s], for random probes of the structure.
    """

    def __init__(self, scale: Array, speed: float = 1.0):
        m, d, g, a = np.asarray(scale, dtype=np.float64)[:, None]
        self.speed = speed
        space = ParameterSpace(
            (
                Block("mass", ("mass",), ("kg",), m, "positive"),
                Block("drag", ("drag",), ("N·s²/m²",), d, "positive"),
                Block("net weight", ("net weight",), ("N",), g),
                Block("thruster gain", ("thruster gain",), ("N",), a, "positive", actuator=True),
            )
        )
        columns = [
            Column("quadratic", 1, dof=0),
            Column("weight", 2, body=0),
            Column("motor", 3, dof=0, input=0),
        ]
        mass = Inertia(0, 0, tied([(2, 2, 0, 1.0)]))
        super().__init__(Structure([Body("slide")], [mass], columns, 4, 1), space, np.zeros((1, 3)))

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws height within 10 m, velocity within twice the speed, command within its range."""
        return rng.uniform(-10, 10, 1), self.speed * rng.uniform(-2, 2, 1), rng.uniform(-1, 1, 1)
