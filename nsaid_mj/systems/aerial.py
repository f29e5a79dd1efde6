"""Quadrotors: a rigid body under its weight, drag, and four rotors of unknown gain."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parameters import Array, Block, ParameterSpace
from ..structure.parts import Body, Column, Inertia
from ..structure.structure import Structure
from .inertial import inertial_block
from .structured import StructuredSystem

GRAVITY = 9.81
"""Acceleration of gravity [m/s²]: known, so that weight is a column of the mass."""

_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class AerialScales:
    """An engineer's guesses for a quadrotor, which become the scale of θ.

    Attributes:
        mass: [kg].
        offset: of the centre of mass from the body's origin [m].
        inertia: (3,) moments of inertia [kg·m²].
        lift: translational lift of a rotor [N·s²/m²].
        rotor_drag: (2,) drag of a rotor at full speed, in and across its plane [N·s/m].
        body_drag: (3,) quadratic drag of the body [N·s²/m²].
        thrust: (4,) thrust of each rotor at full speed [N].
        torque: (4,) torque of each rotor about its axis at full speed [N·m].
        speed: (6,) velocities of operation [m/s, rad/s], for random probes of the structure.
    """

    mass: float
    offset: float
    inertia: Array
    lift: float
    rotor_drag: Array
    body_drag: Array
    thrust: Array
    torque: Array
    speed: Array


class Quadrotor(StructuredSystem):
    """M ν̇ + C(ν) ν = weight + drag + rotors, in still air.

    θ = [m, m c (3), inertia (6), lift, rotor drag (2), body drag (3), thrust (4), torque (4)], all
    about the body's origin; axes are x forward, y left, z up. The command u_i ∈ [0, 1] is a rotor's
    speed relative to its maximum, negative if it turns backwards. With v_i the velocity of rotor i
    in the body's axes, it produces

        thrust along z   k_i u_i abs(u_i) + lift (v_ix² + v_iy²)
        torque about z   s_i κ_i u_i abs(u_i)
        drag             −abs(u_i) diag(d_h, d_h, d_z) v_i

    and the body −|v| diag(c) v at its origin. The drag on the rotors grows with their speed, but is
    not an actuator's gain: it exerts no force on a vehicle at rest.

    Args:
        scales: guesses.
        positions: (4, 3) of the rotors [m].
        spin: (4,) ±1, the sign s_i of the torque that each rotor makes about z.
    """

    def __init__(self, scales: AerialScales, positions: Array, spin: Array):
        space = _space(scales)
        mounts = np.vstack([positions, np.full((4, 3), np.nan)])  # a torque acts at no point
        self.rotors = np.ascontiguousarray(positions, dtype=np.float64)
        self.spin = np.asarray(spin, dtype=np.float64)
        columns = [
            Column("speed_drag", 13 + i, body=0, axes=e) for i, e in enumerate(np.eye(6)[:3])
        ]
        for k, (point, sign) in enumerate(zip(self.rotors, self.spin, strict=True)):
            there, up = {"body": 0, "input": k}, {"point": point, "direction": _UP}
            columns += [
                Column("rotor", 16 + k, **there, **up),
                Column("rotor_torque", 20 + k, **there, direction=sign * _UP),
                Column("rotor_inflow", 10, body=0, **up),
                Column("rotor_drag", 11, **there, **up),
                Column("rotor_damping", 12, **there, **up),
            ]
        gravity = -GRAVITY * _UP
        robot = Structure([Body("free")], [Inertia(0, 0)], columns, len(space), 4, (), gravity)
        super().__init__(robot, space, mounts)
        self._speed = scales.speed

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a position within 10 m, any attitude, velocities and rotor speeds of operation."""
        q = self.position(np.r_[rng.uniform(-10, 10, 3), 1.5 * rng.standard_normal(3)])
        return q, self._speed * rng.uniform(-1, 1, 6), rng.uniform(0.1, 1, 4)


def _space(s: AerialScales) -> ParameterSpace:
    def positive(
        name: str, labels: dict[str, str], unit: str, scale: Array, actuator: bool = False
    ) -> Block:
        names, units = tuple(labels), (unit,) * len(labels)
        return Block(name, names, units, scale, "positive", actuator, labels=tuple(labels.values()))

    rotors = range(1, 5)
    rotor = {"rotor_drag_h": "rotor drag across its axis", "rotor_drag_z": "rotor drag along it"}
    drag = {f"drag_{axis}": f"body drag along {axis}" for axis in "xyz"}
    thrust = {f"thrust_{i}": f"thrust of rotor {i}" for i in rotors}
    torque = {f"torque_{i}": f"torque of rotor {i}" for i in rotors}
    return ParameterSpace(
        (
            inertial_block("body", s.mass, s.offset, s.inertia),
            Block(
                "translational lift",
                ("lift",),
                ("N·s²/m²",),
                np.array([s.lift]),
                labels=("translational lift",),
            ),
            positive("rotor drag", rotor, "N·s/m", s.rotor_drag),
            positive("body drag", drag, "N·s²/m²", s.body_drag),
            positive("rotor thrust gain", thrust, "N", s.thrust, True),
            positive("rotor torque gain", torque, "N·m", s.torque, True),
        )
    )
