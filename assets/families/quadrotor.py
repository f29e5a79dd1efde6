"""Quadrotors: four rotors of unknown gain; Hummingbird and Crazyflie are included."""

from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from nsaid_mj.lab.plants.conversion import (
    GRAVITY,
    Array,
    Block,
    Blueprint,
    BodyInertia,
    Column,
    Fluid,
    Guess,
    InvalidInput,
    NotNegative,
    Number,
    Operation,
    Positive,
    SheetTable,
    Term,
    VehicleSheet,
    check_inertia,
    hidden,
    one,
    rotor_terms,
    several,
)

_AIR = Fluid(
    1.225,  # standard atmosphere at sea level
    1.81e-5,
    lambda geom: not geom.startswith("rotor"),  # rotor disks are not solid
    ("body drag",),
)
_UP = (0.0, 0.0, 1.0)
_FRAMES = {  # places of the rotors, times arm/√2, and the signs of their torques
    # PX4's and ArduPilot's motors 1 to 4: front right, rear left, front left, rear right
    "x": ([[1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [-1.0, -1.0]], [-1.0, -1.0, 1.0, 1.0]),
    # theirs of a cross: right, left, front, rear
    "+": (
        [[0.0, -(2**0.5)], [0.0, 2**0.5], [2**0.5, 0.0], [-(2**0.5), 0.0]],
        [-1.0, -1.0, 1.0, 1.0],
    ),
    # Betaflight's: rear right, front right, rear left, front left
    "betaflight": ([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]], [1.0, -1.0, -1.0, 1.0]),
}
_Place = Annotated[list[Number], Field(min_length=2, max_length=2)]


def _digits(value: float) -> float:
    """Three significant digits, as guesses are stated."""
    return float(f"{value:.3g}")


class Rotors(SheetTable):
    """Four equal rotors with thrust along z."""

    arm: Positive = one("distance of a rotor from the origin, a number > 0 [m]")
    places: list[_Place] = several(4, "two numbers for each of four rotors, times arm/√2")
    spin: list[Number] = several(4, "1 or −1 for each of four rotors, the sign of its torque")
    top_speed: Positive = one("a number > 0 [rad/s]")
    thrust: Positive = one("a number > 0 [N·s²/rad²]")
    torque: Positive = one("a number > 0 [N·m·s²/rad²]")
    drag: list[Positive] = several(2, "two numbers > 0 [N·s²/(m·rad)], in and across its plane")
    lift: NotNegative = one("a number ≥ 0 [N·s²/m²]")


class RotorGuess(Guess):
    """An engineer's guesses before any measurement."""

    offset: Positive = one("a distance of the centre of mass from the origin > 0 [m]")
    lift: Positive = one("a number > 0 [N·s²/m²]")


class QuadrotorSheet(VehicleSheet):
    """A quadrotor's data sheet; axes x forward, y left, z up, origin at the rotors' centre."""

    family: ClassVar[str] = "quadrotor"
    frames: ClassVar[tuple[str, ...]] = tuple(_FRAMES)
    of_frame: ClassVar[tuple[str, ...]] = ("rotors.arm", "rotors.places", "rotors.spin")

    mass: Positive = one("a number > 0 [kg]")
    inertia: list[Positive] = several(3, "three principal moments > 0 [kg·m²]")
    centre_of_mass: list[NotNegative] = several(
        3, "three numbers ≥ 0, how far off the origin it may be [m]"
    )
    body_drag: list[Positive] = several(3, "three numbers > 0 [N·s²/m²]")
    rotors: Rotors
    guess: RotorGuess

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        if strange := [s for s in self.rotors.spin if abs(s) != 1]:
            raise InvalidInput(
                "rotors.spin", "1 or −1", strange[0], "1 is a torque that turns the body left."
            )
        return self

    @classmethod
    def begun(cls, frame: str, mass: float, arm: float) -> dict[str, Any]:
        """Shares of m and arm² as Hummingbird's and Crazyflie's; full thrust is 3 times the weight.

        A rotor's radius is .6 arm; its tip turns at 150 m/s at full command.
        """
        places, spin = _FRAMES[frame]
        area = arm**2
        top = 150.0 / (0.6 * arm)
        thrust = 3.0 * mass * GRAVITY / 4
        hover = top / 3.0**0.5  # speed at which four rotors carry the weight
        drag = 0.3 * mass / (4 * hover)  # four rotors stop the body within some 3 s
        return {
            "mass": mass,
            "inertia": [_digits(share * mass * area) for share in (0.25, 0.25, 0.48)],
            "centre_of_mass": [_digits(share * arm) for share in (0.02, 0.02, 0.06)],
            "body_drag": [_digits(share * area) for share in (0.17, 0.17, 0.35)],
            "rotors": {
                "arm": arm,
                "places": places,
                "spin": spin,
                "top_speed": _digits(top),
                "thrust": _digits(thrust / top**2),
                "torque": _digits(0.15 * arm * thrust / top**2),
                "drag": [_digits(drag), _digits(2 * drag)],
                "lift": _digits(0.12 * area),
            },
            "guess": {
                "offset": _digits(0.06 * arm),
                "lift": _digits(0.12 * area),
                "speed": [6.0, 6.0, 4.0, 4.0, 4.0, 2.0],
            },
        }

    def blueprint(self) -> Blueprint:
        """M ν̇ + C(ν) ν = weight + drag + rotors, in still air.

        θ = [m, m c (3), inertia (6), lift, rotor drag (2), body drag (3), thrust (4), torque (4)],
        all about the rotors' centre, where the centre of mass is published. The command
        u_i ∈ [0, 1] is a rotor's speed relative to its maximum, negative if it turns backwards.
        With v_i the velocity of rotor i in the body's axes, it produces

            thrust along z   k_i u_i abs(u_i) + lift (v_ix² + v_iy²)
            torque about z   s_i κ_i u_i abs(u_i)
            drag             −abs(u_i) diag(d_h, d_h, d_z) v_i

        and the body −|v| diag(c) v. The drag on the rotors grows with their speed, but is not an
        actuator's gain: it exerts no force on a vehicle at rest.
        """
        rotors, top, guess = self.rotors, self.rotors.top_speed, self.guess
        body = Block.guessed(np.array([self.mass, *self.inertia]))
        places = np.c_[rotors.arm / np.sqrt(2) * np.array(rotors.places), np.zeros(4)]
        at: list[dict[str, Any]] = [{"body": 0, "point": p, "direction": _UP} for p in places]
        inflow = [Column("rotor_inflow", 0, **there) for there in at]
        drags = ("rotor_drag", "rotor_damping")
        drag = [Column(drags[k], k, input=i, **at[i]) for i in range(4) for k in range(2)]
        of_drag = {"h": "rotor drag across its axis", "z": "rotor drag along it"}
        of_drag = {f"rotor_drag_{axis}": label for axis, label in of_drag.items()}
        of_body = Term.named("drag", "body drag along", "xyz")
        thrust, torque = rotors.thrust * top**2, rotors.torque * top**2
        return Blueprint(
            Block.of_body(body[0], guess.offset, body[1:]),
            BodyInertia(self.mass, np.zeros(3), np.diag(self.inertia)).matrix(),
            [
                Term.of(inflow, {"lift": "translational lift"}, rotors.lift, guess.lift),
                Term.of(drag, of_drag, top * np.array(rotors.drag)),
                Term.of("speed_drag", of_body, self.body_drag, axes=np.eye(6)[:3]),
                *rotor_terms(places, rotors.spin, thrust, torque, spread=0.5),
            ],
            Operation.within(guess.speed, np.ones(4), 0.1),
            gravity=GRAVITY,
            fluid=_AIR,
            size=self.size,
            hidden_body=self._hidden_body,
        )

    def _hidden_body(self, spread: float, rng: np.random.Generator) -> Array:
        """(6, 6) a true mass matrix: mass and second moments vary, and so does the centre.

        Any three positive second moments ∫x² dm, ∫y² dm, ∫z² dm give principal moments that satisfy
        the triangle inequality.
        """
        mass, moments = float(hidden(self.mass, spread, rng)), np.array(self.inertia)
        centre = np.array(self.centre_of_mass) * rng.uniform(-1, 1, 3)
        second = hidden(moments.sum() / 2 - moments, spread, rng)
        return BodyInertia(mass, centre, np.diag(second.sum() - second)).matrix()
