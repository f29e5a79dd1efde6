"""Cars in the plane: linear tyres, drive, rolling resistance and air drag, exactly, in MuJoCo."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple, Self

import numpy as np
from numba import carray, cfunc
from pydantic import model_validator

from ..bounds import Share, config
from ..errors import InvalidInput
from ..parameters import Array
from ..resources import numbers
from ..systems.ground import CREEP, GroundScales, GroundVehicle
from .world.body import Vehicle, command_inputs, guessed, hidden, vehicle_spec
from .world.callbacks import WORDS, as_pointer, field_offsets
from .world.mismatch import Mismatch
from .world.plant import Plant, PlantConfig


@config
class CarPlant(PlantConfig):
    """A car that rolls forwards on level ground.

    Attributes:
        spread: largest relative deviation of the true load, tyres, drive and resistances from the
            published numbers.
    """

    spread: Share = 0.2

    @model_validator(mode="after")
    def _check_mismatch(self) -> Self:
        check_wind(self.mismatch, "a car in the plane")
        return self


@config
class F1TenthPlant(CarPlant):
    """An F1TENTH, a race car of a tenth of the size; numbers and sources in assets/f1tenth."""

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden numbers and makes the plant."""
        return car("f1tenth", self, dt, seed)


@config
class BMW320iPlant(CarPlant):
    """A BMW 320i; numbers and sources in assets/bmw320i."""

    def build(self, dt: float, seed: int) -> Plant:
        """Draws the hidden numbers and makes the plant."""
        return car("bmw320i", self, dt, seed)


class Car(NamedTuple):
    """A car's numbers; x forward, y left, the origin half-way between the axles.

    Attributes:
        mass: [kg].
        centre: the centre of mass, forwards [m].
        inertia: about the vertical through the centre of mass [kg·m²].
        front: cornering stiffness of the front axle [N/rad].
        rear: cornering stiffness of the rear axle [N/rad].
        drive: drive force at full command and standstill [N].
        loss: what is lost of it for each metre per second [N·s/m].
        rolling: rolling resistance [N].
        drag: aerodynamic drag [N·s²/m²].
    """

    mass: float
    centre: float
    inertia: float
    front: float
    rear: float
    drive: float
    loss: float
    rolling: float
    drag: float

    @property
    def theta(self) -> Array:
        """(9,) θ of a `GroundVehicle` with these numbers."""
        moment = self.mass * self.centre
        return np.array([self.mass, moment, self.inertia + moment * self.centre, *self[3:]])


def car(name: str, config: CarPlant, dt: float, seed: int) -> Vehicle:
    """A car with hidden numbers about the published ones of assets/<name>."""
    d, nominal = numbers(name), published(name)
    wheelbase = d["front"] + d["rear"]
    true = Car(*hidden(np.array(nominal), config.spread, np.random.default_rng(seed)).tolist())
    guess, flow = d["guess"], config.mismatch.flow
    system = GroundVehicle(scales(nominal, wheelbase, guess), wheelbase, d["steering"])
    spec = vehicle_spec(
        name, dt, true.mass, np.array([true.centre, 0.0, 0.0]), true.inertia * np.eye(3)
    )
    command_inputs(spec, system.n_u)
    lagged = float(config.mismatch.lag > 0)
    told = np.array([lagged, wheelbase / 2, *true[3:], flow[0], flow[1]])
    vehicle = Vehicle(system, true.theta, spec, told, single_track(), config.mismatch, GAIN_PLACES)
    return vehicle.failing(config.fault)


def published(name: str) -> Car:
    """The published car of assets/<name>; its load stands on both axles by the lever rule."""
    d = numbers(name)
    front, rear, wheelbase = d["front"], d["rear"], d["front"] + d["rear"]
    grip = d["friction"] * d["mass"] * d["gravity"] / wheelbase
    return Car(
        mass=d["mass"],
        centre=wheelbase / 2 - front,
        inertia=d["inertia"],
        front=d["stiffness"][0] * grip * rear,
        rear=d["stiffness"][1] * grip * front,
        drive=d["drive"],
        loss=d["loss"],
        rolling=d["rolling"],
        drag=d["drag"],
    )


def scales(nominal: Car, wheelbase: float, guess: dict[str, float]) -> GroundScales:
    """What one guesses of a car from its data sheet: powers of two of the published numbers."""
    return GroundScales(
        mass=float(guessed(nominal.mass)),
        moment=guess["off_centre"] * nominal.mass * wheelbase,
        inertia=float(guessed(nominal.inertia)),
        stiffness=guessed(np.array([nominal.front, nominal.rear])),
        drive=float(guessed(nominal.drive)),
        loss=float(guessed(nominal.drive)) / guess["top_speed"],
        rolling=float(guessed(nominal.rolling)),
        drag=float(guessed(nominal.drag)),
        speed=guess["speed"],
        grip=guess["grip"],
    )


def check_wind(mismatch: Mismatch, plant: str) -> None:
    """Accepts lag, delay and a level wind.

    Raises:
        InvalidInput: another switch is on.
    """
    mismatch.refuse(plant, "fluid")
    if mismatch.flow[2]:
        raise InvalidInput(
            "mismatch.flow", f"a level wind, for {plant}", mismatch.flow, "Make the third one 0."
        )


SIZE = 10
"""How many numbers `single_track` reads."""

GAIN_PLACES = ((4, 5), ())
"""Where among them the drive's gains are; steering has none."""


@cache
def single_track() -> Any:
    """The callback for two slides and a hinge: every wheel's force in the wheel's own axes.

    `userdata` holds [lagged, half the wheelbase, C_f, C_r, k_d, k_v, c_0, c_D, wind x, wind y].
    """
    offsets = field_offsets()
    at_qpos, at_qvel, at_force = offsets["qpos"], offsets["qvel"], offsets["qfrc_passive"]
    at_user, at_ctrl, at_act = offsets["userdata"], offsets["ctrl"], offsets["act"]

    @cfunc("void(voidptr, voidptr)", cache=True)
    def passive(model, data):  # noqa: ARG001 (MuJoCo's signature)
        words = carray(data, (WORDS,), np.uintp)
        d = carray(as_pointer(words[at_user]), (SIZE,), np.float64)
        qpos = carray(as_pointer(words[at_qpos]), (3,), np.float64)
        qvel = carray(as_pointer(words[at_qvel]), (3,), np.float64)
        force = carray(as_pointer(words[at_force]), (3,), np.float64)
        command = carray(as_pointer(words[at_act if d[0] > 0 else at_ctrl]), (2,), np.float64)
        c, s = np.cos(qpos[2]), np.sin(qpos[2])
        ahead = c * qvel[0] + s * qvel[1]
        for axle in range(2):
            arm, angle = (d[1], qpos[2] + command[1]) if axle == 0 else (-d[1], qpos[2])
            # where the axle is, and how it moves, in the world; then along and across its wheel
            vx, vy = qvel[0] - arm * s * qvel[2], qvel[1] + arm * c * qvel[2]
            wc, ws = np.cos(angle), np.sin(angle)
            side = -d[2 + axle] * np.arctan2(wc * vy - ws * vx, wc * vx + ws * vy)
            fx, fy = -ws * side, wc * side
            force[0] += fx
            force[1] += fy
            force[2] += arm * (c * fy - s * fx)
        wind = c * d[8] + s * d[9]
        push = (d[4] - d[5] * ahead) * command[0] - d[6] * np.tanh(ahead / CREEP)
        push -= d[7] * abs(ahead - wind) * (ahead - wind)
        force[0] += c * push
        force[1] += s * push

    return passive
