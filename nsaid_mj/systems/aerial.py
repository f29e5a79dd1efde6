"""Quadrotors: a rigid body under its weight, drag, and four rotors of unknown gain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from ..dynamics.forward import force_law
from ..numerics.spatial import cross, unrotate
from ..parameters import Array, Block, ParameterSpace
from . import actuators
from .rigid_body import RigidBody, inertial_block, of_a_body

GRAVITY = 9.81
"""Acceleration of gravity [m/s²]: known, so that weight is a column of the mass."""

_UP = np.array([0.0, 0.0, 1.0])
_LIFT, _ROTOR_DRAG, _BODY_DRAG, _THRUST, _TORQUE = 10, 11, 13, 16, 20  # first columns


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


class Quadrotor(RigidBody):
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
        lever = actuators.wrenches(self.rotors, np.tile(_UP, (4, 1)))
        law = RotorForces(self.rotors, self.spin, lever)
        super().__init__(space, of_a_body(0, len(space)), 4, mounts, law)
        self._speed = scales.speed

    def random_state(self, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Draws a position within 10 m, any attitude, velocities and rotor speeds of operation."""
        q = self.position(np.r_[rng.uniform(-10, 10, 3), 1.5 * rng.standard_normal(3)])
        return q, self._speed * rng.uniform(-1, 1, 6), rng.uniform(0.1, 1, 4)


class RotorForces(NamedTuple):
    """Weight, drag and rotors, for compiled loops.

    Attributes:
        rotors: (4, 3) positions [m].
        spin: (4,) ±1, the sign of the torque that each rotor makes about z.
        lever: (6, 4) wrench of a unit thrust of each.
    """

    rotors: Array
    spin: Array
    lever: Array


@force_law(RotorForces)
@njit(cache=True)
def _forces(forces, q, v, u, F):
    rotors, spin, lever = forces
    down = -GRAVITY * unrotate(q[3:], _UP)
    for i in range(3):
        F[i, 0] = down[i]
    F[4, 1], F[5, 1] = -down[2], down[1]  # e_j × down, of each component of m c
    F[3, 2], F[5, 2] = down[2], -down[0]
    F[3, 3], F[4, 3] = -down[1], down[0]
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    for i in range(3):
        F[i, _BODY_DRAG + i] = -speed * v[i]
    for k in range(4):
        at = v[:3] + cross(v[3:], rotors[k])
        sliding = at[0] * at[0] + at[1] * at[1]
        square = u[k] * abs(u[k])  # a rotor that turns backwards pulls down
        for i in range(6):
            F[i, _LIFT] += sliding * lever[i, k]
            F[i, _THRUST + k] = square * lever[i, k]
        F[5, _TORQUE + k] = spin[k] * square
        flat, axial = -abs(u[k]) * at, np.zeros(3)
        flat[2], axial[2] = 0.0, -abs(u[k]) * at[2]
        for part, drag in enumerate((flat, axial)):
            turning = cross(rotors[k], drag)
            for i in range(3):
                F[i, _ROTOR_DRAG + part] += drag[i]
                F[3 + i, _ROTOR_DRAG + part] += turning[i]


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
