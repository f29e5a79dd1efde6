"""Free-flyers: a rigid body without weight and drag, moved by nozzles of unknown gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Body, Inertia, columns_at
from ..structure.structure import Structure
from .inertial import inertial_block
from .structured import StructuredSystem


@dataclass(frozen=True)
class FreeFlyerScales:
    """An engineer's guesses for a free-flyer, which become the scale of θ.

    Attributes:
        mass: [kg].
        offset: of the centre of mass from the body's origin [m].
        inertia: (3,) moments of inertia [kg·m²].
        thrust: (k,) thrust of each nozzle, fully open [N].
        speed: (6,) velocities of operation [m/s, rad/s], for random probes of the structure.
    """

    mass: float
    offset: float
    inertia: Array
    thrust: Array
    speed: Array


class FreeFlyer(StructuredSystem):
    """M ν̇ + C(ν) ν = Σ k_i u_i w_i: mass, centre of mass and inertia, and k nozzles.

    θ = [m, m c (3), inertia (6), thrust (k)], about the body's origin. Nozzles open with
    u_i ∈ [0, 1]. Axes are x forward, y left, z up.

    Args:
        scales: guesses.
        positions: (k, 3) of the nozzles [m].
        directions: (k, 3) unit vectors along which they push.
    """

    def __init__(self, scales: FreeFlyerScales, positions: Array, directions: Array):
        k = len(positions)
        thrust = Block(
            "nozzle gain",
            tuple(f"nozzle_{i + 1}" for i in range(k)),
            ("N",) * k,
            scales.thrust,
            "positive",
            actuator=True,
            labels=tuple(f"thrust of nozzle {i + 1}" for i in range(k)),
        )
        body = inertial_block("body", scales.mass, scales.offset, scales.inertia)
        space = ParameterSpace((body, thrust))
        columns = columns_at("nozzle", 10, positions, directions)
        robot = Structure([Body("free")], [Inertia(0, 0)], columns, len(space), k, (), np.zeros(3))
        super().__init__(robot, space, positions)
        self._speed = scales.speed

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a position within 1 m, any attitude, velocities and commands of operation."""
        q = self.position(np.r_[rng.uniform(-1, 1, 3), 1.5 * rng.standard_normal(3)])
        return q, self._speed * rng.uniform(-1, 1, 6), rng.uniform(0, 1, self.n_u)
