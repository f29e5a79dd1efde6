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
_Place = Annotated[list[Number], Field(min_length=2, max_length=2)]


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
