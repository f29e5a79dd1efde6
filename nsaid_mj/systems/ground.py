"""Ground vehicles in the plane (6): drive, rolling resistance, air drag and linear tyres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Body, Column, Inertia, tied
from ..structure.structure import Structure
from .structured import StructuredSystem

CREEP = 0.1  # speed scale of rolling resistance, which is continuous where u changes sign [m/s]


@dataclass(frozen=True)
class GroundScales:
    """An engineer's guesses for a ground vehicle, which become the scale of θ.

    Attributes:
        mass: [kg].
        moment: first moment of mass about mid-wheelbase, mass times x of the centre [kg·m].
        inertia: about the vertical through mid-wheelbase [kg·m²].
        stiffness: (2,) cornering stiffness of the front and of the rear axle [N/rad].
        drive: drive force at full command and standstill [N].
        loss: decrease of the drive force at full command per m/s of speed [N·s/m].
        rolling: rolling resistance [N].
        drag: aerodynamic drag [N·s²/m²].
        speed: cruising speed [m/s], for random probes of the structure.
        grip: lateral acceleration of operation [m/s²], for random probes of the structure.
    """

    mass: float
    moment: float
    inertia: float
    stiffness: Array
    drive: float
    loss: float
    rolling: float
    drag: float
    speed: float
    grip: float


class GroundVehicle(StructuredSystem):
    """The single-track model, linear in θ = [m, h, I, C_f, C_r, k_d, k_v, c_0, c_D].

    M = [[m, 0, 0], [0, m, h], [0, h, I]] about mid-wheelbase, where x is forward and y left; the
    command is u = (drive d in [−1, 1], steering angle δ [rad]). Forces, with ν = [u, v, r]:

        along x   (k_d − k_v u) d − c_0 tanh(u/0.1 m/s) − c_D |u| u
        front     −C_f α_f across the steered wheel,  α_f = atan2(v + l r, u) − δ
        rear      −C_r α_r along y,                   α_r = atan2(v − l r, u)

    with l half the wheelbase. The model is for driving forwards: at standstill slip angles are
    undefined (Rajamani, Vehicle Dynamics and Control, 2012, chapter 2).

    Args:
        scales: guesses.
        wheelbase: [m], known.
        steering: largest steering angle [rad], known.
    """

    def __init__(self, scales: GroundScales, wheelbase: float, steering: float):
        space = _space(scales)
        columns = [
            Column("tyre", 3, body=0, input=1, arm=wheelbase / 2),
            Column("tyre", 4, body=0, arm=-wheelbase / 2),
            Column("drive", 5, body=0, input=0),
            Column("drive_loss", 6, body=0, input=0),
            Column("rolling", 7, body=0, speed=CREEP),
            Column("drag", 8, body=0, axes=(1, 0, 0, 0, 0, 0)),
        ]
        mass = tied([(0, 0, 0, 1.0), (1, 1, 0, 1.0), (1, 5, 1, 1.0), (5, 5, 2, 1.0)])
        robot = Structure([Body("planar")], [Inertia(0, 0, mass)], columns, len(space), 2)
        mounts = np.array([[-wheelbase / 2, 0.0, 0.0], [np.nan] * 3])
        super().__init__(robot, space, mounts)
        self.wheelbase, self.steering = wheelbase, steering
        self.speed, self.grip = scales.speed, scales.grip

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a pose, 0.4 to 1.6 times the cruising speed, slip and yaw rate within the grip."""
        speed = self.speed * rng.uniform(0.4, 1.6)
        slip, bend = rng.uniform(-1, 1, 2)
        v = np.array([speed, 0.1 * speed * slip, self.grip / speed * bend])
        limit = min(self.steering, self.wheelbase * self.grip / speed**2 + 0.05)
        u = rng.uniform(-1, 1, 2) * [1.0, limit]
        return rng.uniform(-1, 1, 3) * [100.0, 100.0, 3.0], v, u


def _space(s: GroundScales) -> ParameterSpace:
    def one(name: str, symbol: str, unit: str, scale: float, actuator: bool = False) -> Block:
        scales = np.array([scale])
        return Block(name, (symbol,), (unit,), scales, "positive", actuator, labels=(name,))

    inertia = np.array([s.mass, s.moment, s.inertia])
    return ParameterSpace(
        (
            Block(
                "mass matrix",
                ("m", "h", "I_z"),
                ("kg", "kg·m", "kg·m²"),
                inertia,
                "spd",
                labels=("mass", "first moment m·cx", "yaw inertia"),
            ),
            Block(
                "cornering stiffness",
                ("C_f", "C_r"),
                ("N/rad",) * 2,
                s.stiffness,
                "positive",
                labels=("cornering stiffness in front", "cornering stiffness at the rear"),
            ),
            one("drive gain", "k_d", "N", s.drive, actuator=True),
            one("drive loss", "k_v", "N·s/m", s.loss, actuator=True),
            one("rolling resistance", "c_0", "N", s.rolling),
            one("air drag", "c_D", "N·s²/m²", s.drag),
        )
    )
