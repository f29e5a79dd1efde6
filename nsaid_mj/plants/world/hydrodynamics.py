"""Parameters of a body in water, and how its mass is divided into rigid-body and added mass."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.linalg import eigh

from ...parameters import Array

POWERS = 5
"""Number of odd powers of the command in the thrusters' curve: u, u³, u⁵, u⁷, u⁹."""


@dataclass(frozen=True)
class Hydrodynamics:
    """Parameters of a body in water; axes x forward, y left, z up.

    Attributes:
        rigid: (6, 6) M_RB about the body's origin [kg, kg·m, kg·m²].
        added: (6, 6) M_A, symmetric [kg, kg·m, kg·m²].
        linear: (6,) linear drag [N·s/m, N·m·s/rad].
        quadratic: (6,) quadratic drag [N·s²/m², N·m·s²/rad²].
        net_weight: weight less buoyancy [N].
        righting: (3,) r_B B − r_G W [N·m].
        positions: (k, 3) of the thrusters [m].
        directions: (k, 3) unit vectors of the thrusts.
        thrust: (k,) at full command [N].
        curve: (5,) coefficients of u, u³, u⁵, u⁷, u⁹ in the command curve.
    """

    rigid: Array
    added: Array
    linear: Array
    quadratic: Array
    net_weight: float
    righting: Array
    positions: Array
    directions: Array
    thrust: Array
    curve: Array


def split_mass(M: Array, rigid: Array, added: Array) -> tuple[Array, Array]:
    """Divides a mass matrix into rigid-body and added mass; only their sum can be identified.

    The rigid body is the nominal one, times the largest factor for which the added mass exceeds the
    nominal one times this factor: both are then physical.

    Args:
        M: (6, 6) the sum, positive definite.
        rigid: (6, 6) nominal M_RB.
        added: (6, 6) nominal M_A.
    """
    share = eigh(M, rigid + added, eigvals_only=True)[0]
    return share * rigid, M - share * rigid
