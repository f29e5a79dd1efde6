"""Torpedo-shaped vehicles (6): a body of revolution, independent fins and a propeller astern."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Body, Column, Inertia, columns_at, tied
from ..structure.structure import Structure
from .structured import StructuredSystem

_X = (1.0, 0.0, 0.0)
_DRAG = ((1, 0, 0, 0, 0, 0), (0, 1, 1, 0, 0, 0), (0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 1))
"""Axes of the drag along, across, in roll and turning."""

_MASS = (
    (0, 0, 0, 1.0), (1, 1, 1, 1.0), (2, 2, 1, 1.0), (3, 3, 2, 1.0), (4, 4, 3, 1.0), (5, 5, 3, 1.0),
    (5, 1, 4, 1.0), (4, 2, 4, -1.0), (4, 0, 5, 1.0), (3, 1, 5, -1.0),
)  # fmt: skip
"""Rows (i, j, l, value), i ≥ j: M of a body of revolution about x has value · θ_l at i, j."""


@dataclass(frozen=True)
class TorpedoScales:
    """An engineer's guesses for a torpedo-shaped vehicle, which become the scale of θ.

    Attributes:
        inertia: (4,) M_11, M_22 [kg], M_44, M_55 [kg·m²], added mass included.
        coupling: (2,) M_26, M_15 [kg·m].
        drag: (4,) along, across [N·s²/m²], rolling, turning [N·m·s²/rad²].
        lift: (2,) of the body: force [N·s²/m²], moment [N·s²/m].
        net_weight: weight minus buoyancy [N].
        righting: moment of weight and buoyancy [N·m].
        propeller: (2,) thrust [N] and torque [N·m] at full command at rest.
        fin_lift: (k,) [N·s²/m² for each rad].
        fin_drag: (k,) [N·s²/m² for each rad²].
        speed: (6,) velocities of operation [m/s, rad/s]; the first is that under way.
        limit: largest deflection of a fin [rad], for random probes of the structure.
    """

    inertia: Array
    coupling: Array
    drag: Array
    lift: Array
    net_weight: float
    righting: float
    propeller: Array
    fin_lift: Array
    fin_drag: Array
    speed: Array
    limit: float


class TorpedoVehicle(StructuredSystem):
    """M ν̇ + C(ν) ν = −D_q |ν| ν − L(ν) − g(q) + propeller + Σ fins (6).

    θ = [M_11, M_22 = M_33, M_44, M_55 = M_66, M_26 = −M_35, M_15 = −M_24, drag (4), body lift,
    its moment, net weight, righting moment, propeller (2), fin lift (k), fin drag (k)]: a body of
    revolution about x with its centre of gravity on its z axis. Axes are x forward, y left, z up.

    Commands are the fins' deflections [rad], then the propeller's speed in [−1, 1]. The propeller's
    curve is known, its gains are not. Lift and drag go by the vehicle's own u, as in Prestero
    (2001); stall is not modelled.

    Args:
        scales: guesses.
        positions: (k, 3) of the fins [m].
        lifts: (k, 3) unit vectors along which positive deflections lift.
        propeller: (3,) position of the propeller [m].
        slip: relative loss of full thrust per m/s of advance at full shaft speed [s/m].
    """

    def __init__(
        self,
        scales: TorpedoScales,
        positions: Array,
        lifts: Array,
        propeller: Array,
        slip: float,
    ):
        space, k = _space(scales), len(positions)
        nowhere = np.full(3, np.nan)  # a torque acts at no point
        mounts = np.vstack([propeller, nowhere, positions, positions])
        self.lever = np.cross(positions, lifts)
        columns = [
            *(Column("drag", 6 + i, body=0, axes=axes) for i, axes in enumerate(_DRAG)),
            Column("lift", 10, body=0),
            Column("lift_moment", 11, body=0),
            Column("weight", 12, body=0),
            Column("righting", 13, body=0, axis=[0, 0, 1]),
            Column("propeller", 14, body=0, input=k, direction=_X, point=np.zeros(3), slip=slip),
            Column("propeller_torque", 15, body=0, input=k, direction=_X),
            *columns_at("fin", 16, positions, lifts),
            *columns_at("fin_drag", 16 + k, positions),
        ]
        inertia = Inertia(0, 0, mass_tensor())
        robot = Structure([Body("free")], [inertia], columns, len(space), k + 1)
        super().__init__(robot, space, mounts)
        self.speed, self.limit, self.slip = scales.speed, scales.limit, slip

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a position within 10 m, attitude near upright, forward motion and commands."""
        q = self.position(np.r_[rng.uniform(-10, 10, 3), 0.5 * rng.standard_normal(3)])
        v = self.speed * np.r_[rng.uniform(0.4, 1.2), rng.uniform(-1, 1, 5)]
        fins = self.limit * rng.uniform(-1, 1, self.n_u - 1)
        return q, v, np.r_[fins, rng.uniform(0.2, 1)]


def mass_tensor() -> Array:
    """(6, 6, 6) mass tensor of a body of revolution about x, whose M has six parameters."""
    return tied([(i, j, k, value) for i, j, k, value in _MASS])


def _space(s: TorpedoScales) -> ParameterSpace:
    fins = range(1, len(s.fin_lift) + 1)
    lift = "N·s²/m²"
    return ParameterSpace(
        (
            Block(
                "mass matrix",
                ("M_11", "M_22", "M_44", "M_55", "M_26", "M_15"),
                ("kg", "kg", "kg·m²", "kg·m²", "kg·m", "kg·m"),
                np.concatenate([s.inertia, s.coupling]),
                "tied",
                entries=_MASS,
                labels=(
                    "effective surge mass",
                    "effective sway and heave mass",
                    "effective roll inertia",
                    "effective pitch and yaw inertia",
                    "sway–yaw and heave–pitch coupling of M",
                    "surge–pitch and sway–roll coupling of M",
                ),
            ),
            Block(
                "quadratic drag",
                ("dq_along", "dq_across", "dq_roll", "dq_turn"),
                ("N·s²/m²", "N·s²/m²", "N·m·s²/rad²", "N·m·s²/rad²"),
                s.drag,
                "positive",
                labels=(
                    "quadratic drag along the hull",
                    "quadratic drag across the hull",
                    "quadratic drag in roll",
                    "quadratic drag in pitch and yaw",
                ),
            ),
            Block(
                "body lift",
                ("lift_body", "lift moment_body"),
                (lift, "N·s²/m"),
                s.lift,
                labels=("body lift", "body lift moment"),
            ),
            Block("net weight", ("net weight",), ("N",), np.array([s.net_weight])),
            Block(
                "righting moment",
                ("righting_z",),
                ("N·m",),
                np.array([s.righting]),
                labels=("righting moment",),
            ),
            Block(
                "propeller gain",
                ("thrust", "torque"),
                ("N", "N·m"),
                s.propeller,
                "positive",
                actuator=True,
                labels=("propeller thrust", "propeller torque"),
            ),
            Block(
                "fin lift",
                tuple(f"fin lift_{i}" for i in fins),
                (f"{lift}/rad",) * len(fins),
                s.fin_lift,
                "positive",
                actuator=True,
                labels=tuple(f"lift of fin {i}" for i in fins),
            ),
            Block(
                "fin drag",
                tuple(f"fin drag_{i}" for i in fins),
                (f"{lift}/rad²",) * len(fins),
                s.fin_drag,
                "positive",
                actuator=True,
                labels=tuple(f"drag of fin {i}" for i in fins),
            ),
        )
    )
