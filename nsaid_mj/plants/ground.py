"""Cars in the plane: exact linear tyres, drive, rolling resistance and air drag in MuJoCo."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from ..bounds import Name, Share, config
from ..parameters import Array, Block
from ..structure.blocks import guessed, term
from ..structure.parts import Operation, tied
from .world.blueprint import Blueprint, VehiclePlant, VehicleSheet
from .world.body import hidden
from .world.sheet import Positive, Table, one, several

CREEP = 0.1
"""Speed scale of rolling resistance, which is continuous where u changes sign [m/s]."""
_SLIP = 0.1
"""Slip angle in operation [rad]."""


class Guess(Table):
    """An engineer's guesses before any measurement."""

    off_centre: Positive = one("distance of the centre of mass from the middle, of the wheelbase")
    top_speed: Positive = one("speed at which the drive force drops to zero > 0 [m/s]")
    speed: Positive = one("a cruising speed > 0 [m/s]")
    grip: Positive = one("a lateral acceleration of operation > 0 [m/s²]")


class CarSheet(VehicleSheet):
    """A car's data sheet; axes x forward, y left, z up."""

    family: ClassVar[str] = "car"

    mass: Positive = one("a number > 0 [kg]")
    inertia: Positive = one("a number > 0, about the vertical through the centre of mass [kg·m²]")
    front: Positive = one("distance from the centre of mass to the front axle > 0 [m]")
    rear: Positive = one("distance from the centre of mass to the rear axle > 0 [m]")
    friction: Positive = one("a coefficient > 0 of tyre on ground")
    stiffness: list[Positive] = several(2, "two numbers > 0, front and rear [1/rad]")
    gravity: Positive = one("a number > 0 [m/s²]")
    steering: Positive = one("a largest steering angle > 0 [rad]")
    drive: Positive = one("a force > 0 at full command and standstill [N]")
    loss: Positive = one("a number > 0 [N·s/m]")
    rolling: Positive = one("a force > 0 [N]")
    drag: Positive = one("a number > 0 [N·s²/m²]")
    guess: Guess

    def blueprint(self) -> Blueprint:
        """The car by the single-track model; the axle loads follow from the lever rule."""
        wheelbase, guess = self.front + self.rear, self.guess
        grip = self.friction * self.mass * self.gravity / wheelbase
        stiffness = grip * np.array(self.stiffness) * [self.rear, self.front]
        forces = np.array([*stiffness, self.drive, self.loss, self.rolling, self.drag])
        scale = guessed(np.array([self.mass, 1.0, self.inertia, *forces]))
        scale[1] = guess.off_centre * self.mass * wheelbase
        scale[6] = scale[5] / guess.top_speed
        car = single_track(
            planar_mass(self.mass, wheelbase / 2 - self.front, self.inertia),
            forces,
            scale,
            wheelbase,
            operation(guess.speed, guess.grip, self.steering, wheelbase),
        )
        return replace(car, size=self.size, hidden_body=self._hidden_body)

    def _hidden_body(self, spread: float, rng: np.random.Generator) -> Array:
        centre = (self.rear - self.front) / 2
        return planar_mass(*hidden(np.array([self.mass, centre, self.inertia]), spread, rng))


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
    half, place, air = wheelbase / 2, (-wheelbase / 2, 0.0, 0.0), "air drag"
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
            term("tyre", tyres, forces[:2], scale[3:5], input=[1, -1], arm=[half, -half]),
            term("drive", {"k_d": "drive gain"}, forces[2], scale[5], input=[0], point=[place]),
            term("drive_loss", {"k_v": "drive loss"}, forces[3], scale[6], input=[0]),
            term("rolling", {"c_0": "rolling resistance"}, forces[4], scale[7], speed=[CREEP]),
            term("drag", {"c_D": air}, forces[5], scale[8], air, "positive", axes=np.eye(6)[:1]),
        ],
        operating,
        tied([(0, 0, 0, 1.0), (1, 1, 0, 1.0), (1, 5, 1, 1.0), (5, 5, 2, 1.0)]),
    )


def operation(speed: float, grip: float, steering: float, wheelbase: float) -> Operation:
    """A car's ranges: 0.4 to 1.6 times the cruising speed, slip and yaw rate within the grip.

    Speed is in m/s, grip (lateral acceleration) in m/s², the largest steering angle in rad, the
    wheelbase in m.
    """
    most = np.array([1.0, steering])

    def state(rng: np.random.Generator) -> tuple[Array, Array, Array]:
        u, (slip, bend) = speed * rng.uniform(0.4, 1.6), rng.uniform(-1, 1, 2)
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


@config
class CarPlant(VehiclePlant):
    """A car that drives forwards on level ground.

    Attributes:
        vehicle: an included vehicle's name, or the path of a vehicle.toml or of its folder.
        spread: largest relative deviation of the true load, tyres, drive and resistances from the
            nominal values.
    """

    sheet: ClassVar[type[VehicleSheet]] = CarSheet
    _refuses: ClassVar[tuple[str, ...]] = ("a car in the plane", "fluid", "level")
    vehicle: Name = "f1tenth"
    spread: Share = 0.2


@config
class F1TenthPlant(CarPlant):
    """An F1TENTH, a race car at one tenth scale; parameters and sources in assets/f1tenth.

    Its attributes are those of `CarPlant`.
    """


@config
class BMW320iPlant(CarPlant):
    """A BMW 320i; parameters and sources in assets/bmw320i.

    Its attributes are those of `CarPlant`.
    """

    vehicle: Name = "bmw320i"
