"""The single-track model of a car in the plane, of cars and of the rover's rivals."""

import numpy as np

from ...core import Array, Block, Inertia, Operation, Term
from .world.blueprint import Blueprint

CREEP = 0.1
"""Speed scale of rolling resistance, which is continuous where u changes sign [m/s]."""
_SLIP = 0.1
"""Slip angle in operation [rad]."""


def single_track(
    rigid: Array,
    forces: Array,
    scale: Array,
    wheelbase: float,
    operating: Operation,
) -> Blueprint:
    """The single-track model, linear in θ = [m, h, I, C_f, C_r, k_d, k_v, c_0, c_D].

    M = [[m, 0, 0], [0, m, h], [0, h, I]] about mid-wheelbase, where x is forward and y left; the
    command is u = (drive d in [−1, 1], steering angle δ [rad]). Forces, with ν = [u, v, r]:

        along x   (k_d − k_v u) d − c_0 tanh(u/0.1 m/s) − c_D |u| u
        front     −C_f α_f across the steered wheel,  α_f = atan2(v + l r, u) − δ
        rear      −C_r α_r along y,                   α_r = atan2(v − l r, u)

    with l half the wheelbase [m]. The model is for driving forwards: at standstill slip angles are
    undefined (Rajamani, Vehicle Dynamics and Control, 2012, chapter 2).

    rigid (6, 6) is from `planar_mass`, `operating` from `operation`; forces (6,) are θ from C_f on,
    scale (9,) guesses of θ.
    """
    half = wheelbase / 2
    place = (-wheelbase / 2, 0.0, 0.0)
    air = "air drag"
    mass = Block(
        "mass matrix",
        ("m", "h", "I_z"),
        ("kg", "kg·m", "kg·m²"),
        scale[:3],
        "spd",
        labels=("mass", "first moment m·cx", "yaw inertia"),
    )
    tyres = {"C_f": "cornering stiffness in front", "C_r": "cornering stiffness at the rear"}
    return Blueprint(
        mass,
        rigid,
        [
            Term.of("tyre", tyres, forces[:2], scale[3:5], input=[1, -1], arm=[half, -half]),
            Term.of("drive", {"k_d": "drive gain"}, forces[2], scale[5], input=[0], point=[place]),
            Term.of("drive_loss", {"k_v": "drive loss"}, forces[3], scale[6], input=[0]),
            Term.of("rolling", {"c_0": "rolling resistance"}, forces[4], scale[7], speed=[CREEP]),
            Term.of("drag", {"c_D": air}, forces[5], scale[8], air, "positive", axes=np.eye(6)[:1]),
        ],
        operating,
        Inertia.tied([(0, 0, 0, 1.0), (1, 1, 0, 1.0), (1, 5, 1, 1.0), (5, 5, 2, 1.0)]),
    )


def operation(speed: float, grip: float, steering: float, wheelbase: float) -> Operation:
    """A car's ranges: 0.4 to 1.6 times the cruising speed, slip and yaw rate within the grip.

    Speed is in m/s, grip (lateral acceleration) in m/s², the largest steering angle in rad, the
    wheelbase in m.
    """
    most = np.array([1.0, steering])

    def state(rng: np.random.Generator) -> tuple[Array, Array, Array]:
        u = speed * rng.uniform(0.4, 1.6)
        slip, bend = rng.uniform(-1, 1, 2)
        v = np.array([u, _SLIP * u * slip, grip / u * bend])
        limit = min(steering, wheelbase * grip / u**2 + 0.5 * _SLIP)
        command = rng.uniform(-1, 1, 2) * [1.0, limit]
        return rng.uniform(-1, 1, 3) * [100.0, 100.0, 3.0], v, command

    aside = np.array([_SLIP * speed, grip / speed])
    velocities = np.r_[0.4 * speed, -aside], np.r_[1.6 * speed, aside]
    return Operation(velocities, (-most, most), state=state)


def planar_mass(mass: float, centre: float, inertia: float) -> Array:
    """(6, 6) mass matrix in the plane of a body with its centre of mass at x = centre [m].

    `inertia` is about the vertical through the centre of mass [kg·m²].
    """
    M = np.zeros((6, 6))
    M[0, 0] = M[1, 1] = mass
    M[1, 5] = M[5, 1] = mass * centre
    M[5, 5] = inertia + mass * centre * centre
    return M
