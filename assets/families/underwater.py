"""Underwater vehicles with thrusters of unknown gain; a BlueROV2 Heavy is included."""

from collections.abc import Sequence
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from nsaid_mj.lab.plants.conversion import (
    NED,
    Array,
    Block,
    Blueprint,
    Fluid,
    Guess,
    Inertia,
    InvalidInput,
    NotNegative,
    Number,
    Operation,
    Place,
    Positive,
    SheetTable,
    Term,
    VehicleSheet,
    check_directions,
    check_inertia,
    odd,
    one,
    several,
)

POWERS = 5
"""Number of odd powers of the command in the thrusters' curve: u, u³, u⁵, u⁷, u⁹."""
_SLANT = 0.5**0.5
_LEVEL = (  # ArduSub's motors 1 to 4: front right, front left, rear right, rear left
    [[0.815, 0.58, 0.44], [0.815, -0.58, 0.44], [-0.815, 0.58, 0.44], [-0.815, -0.58, 0.44]],
    [
        [-_SLANT, _SLANT, 0.0],
        [-_SLANT, -_SLANT, 0.0],
        [_SLANT, _SLANT, 0.0],
        [_SLANT, -_SLANT, 0.0],
    ],
)
_UPRIGHT = {  # the further ones, which push down
    "vectored": [[0.0, 0.6, 0.0], [0.0, -0.6, 0.0]],
    "vectored 6dof": [
        [0.63, 1.14, 0.0],
        [0.63, -1.14, 0.0],
        [-0.63, 1.14, 0.0],
        [-0.63, -1.14, 0.0],
    ],
}
"""Places over the distance of the level thrusters, as on a BlueROV2, in ArduSub's frames."""
WATER = Fluid(
    1000.0,
    1e-3,
    lambda geom: not geom.startswith("thruster"),  # they only show the point of thrust
    ("mass matrix", "linear drag", "quadratic drag"),
)


class UnderwaterGuess(Guess):
    """An engineer's guesses before any measurement."""

    linear_drag: list[Positive] = several(6, "six numbers > 0 [N·s/m, N·m·s/rad]")


class Ring(SheetTable):
    """Copies of one thruster, each turned about z: Rz(angle)·position, Rz(turn)·direction."""

    position: list[Number] = several(3, "three numbers [m]")
    direction: list[Number] = several(3, "a unit vector, three numbers")
    angles: list[Number] = Field(min_length=1, description="one angle for each thruster [rad]")
    turns: list[Number] = Field(min_length=1, description="one angle for each thruster [rad]")


class Thrusters(SheetTable):
    """Thrusters listed one by one, in rings, or both; all have the same command curve."""

    curve: list[Number] = Field(
        min_length=1,
        max_length=POWERS,
        description=f"1 to {POWERS} coefficients of u, u³, u⁵, u⁷, u⁹, of command u in [−1, 1] [N]",
    )
    positions: list[Place] = Field(default=[], description="three numbers for each thruster [m]")
    directions: list[Place] = Field(
        default=[], description="a unit vector, three numbers, for each thruster"
    )
    rings: list[Ring] = Field(default=[], description="tables [[thrusters.rings]]")

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for ring in self.rings:
            if len(ring.angles) != len(ring.turns):
                raise InvalidInput(
                    "thrusters.rings.turns",
                    f"one for each of {len(ring.angles)} angles",
                    len(ring.turns),
                    "Give every thruster of the ring both.",
                )
        count = len(self.positions) + sum(len(ring.angles) for ring in self.rings)
        if not count:
            raise InvalidInput(
                "thrusters", "at least one thruster", count, "Give `positions`, or `rings`."
            )
        check_directions("thrusters", "thruster", self.placed("position"), self.placed("direction"))
        if not sum(self.curve) > 1e-9:
            raise InvalidInput(
                "thrusters.curve",
                "a thrust > 0 N at full command, the sum of all coefficients",
                sum(self.curve),
                "If thrusters push backwards, reverse their directions.",
            )
        return self

    def placed(self, what: str) -> Array:
        """(k, 3) `position` or `direction` of every thruster: single ones, then the rings'."""
        alone = np.array(getattr(self, f"{what}s"), dtype=np.float64).reshape(-1, 3)
        angles = {"position": "angles", "direction": "turns"}[what]
        rings = [_turned(getattr(ring, what), getattr(ring, angles)) for ring in self.rings]
        return np.concatenate([alone, *rings])


class UnderwaterSheet(VehicleSheet):
    """An underwater vehicle's data sheet; x forward, y right, z down from the centre of mass."""

    family: ClassVar[str] = "underwater"
    frames: ClassVar[tuple[str, ...]] = tuple(_UPRIGHT)
    of_frame: ClassVar[tuple[str, ...]] = ("thrusters.positions", "thrusters.directions")

    mass: Positive = one("a number > 0 [kg]")
    volume: Positive = one("a number > 0 [m³]")
    inertia: list[Positive] = several(3, "three principal moments > 0 [kg·m²]")
    buoyancy_centre: list[Number] = several(3, "three numbers [m], z < 0 if self-righting")
    water_density: Positive = one("a number > 0 [kg/m³], 1000 in fresh water")
    gravity: Positive = one("a number > 0 [m/s²]")
    ballast: Number = Field(default=0.0, description="a weight [N]")
    added_mass: list[NotNegative] = several(6, "six numbers ≥ 0 [kg, kg·m²]")
    linear_drag: list[NotNegative] = several(6, "six numbers ≥ 0 [N·s/m, N·m·s/rad]")
    quadratic_drag: list[Positive] = several(6, "six numbers > 0 [N·s²/m², N·m·s²/rad²]")
    guess: UnderwaterGuess
    thrusters: Thrusters

    @model_validator(mode="after")
    def _fits(self) -> Self:
        check_inertia(self.inertia)
        if abs(self.net_weight) < 1e-9:
            raise InvalidInput(
                "ballast",
                "a net weight that is not 0 N",
                self.net_weight,
                "A neutral vehicle has none to identify: add some ballast, such as 1 N.",
            )
        if abs(self.buoyancy_centre[2]) < 1e-9:
            raise InvalidInput(
                "buoyancy_centre",
                "a z that is not 0 m",
                self.buoyancy_centre,
                "Without it there is no righting moment: −0.01 is 1 cm above the centre of mass.",
            )
        return self

    @classmethod
    def begun(cls, frame: str, mass: float, arm: float) -> dict[str, Any]:
        """Shares of m and powers of arm as a BlueROV2 Heavy's; it rises with 2 % of its weight."""
        level, directions = _LEVEL
        places = [*level, *_UPRIGHT[frame]]
        heavier = mass / 13.5
        larger = arm / 0.191

        def scaled(values: Sequence[float], factor: float) -> list[float]:
            return [float(f"{value * factor:.3g}") for value in values]

        return {
            "mass": mass,
            "volume": float(f"{mass / 1000:.6g}"),
            "inertia": scaled([0.26, 0.23, 0.37], heavier * larger**2),
            "buoyancy_centre": [0.0, 0.0, *scaled([-0.01], larger)],
            "water_density": 1000.0,
            "gravity": 9.81,
            "ballast": float(f"{-0.02 * mass * 9.81:.3g}"),
            "added_mass": [
                *scaled([6.4, 7.1, 18.7], heavier),
                *scaled([0.19, 0.14, 0.22], heavier * larger**2),
            ],
            "linear_drag": [*scaled([15, 15, 30], larger), *scaled([0.5, 0.5, 0.5], larger**3)],
            "quadratic_drag": [
                *scaled([141, 217, 190], larger**2),
                *scaled([1.2, 0.5, 1.5], larger**5),
            ],
            "guess": {
                "linear_drag": [*scaled([15, 15, 30], larger), *scaled([0.5] * 3, larger**3)],
                "speed": [1.0, 0.7, 0.7, 1.5, 1.5, 1.5],
            },
            "thrusters": {  # T200 at 16 V
                "curve": [8.9, 176.0, -404.1, 389.9, -140.3],
                "positions": [scaled(place, arm) for place in places],
                "directions": [*directions, *[[0.0, 0.0, 1.0]] * (len(places) - 4)],
            },
        }

    @property
    def buoyancy(self) -> float:
        """Buoyancy of the displaced water [N]."""
        return self.volume * self.water_density * self.gravity

    @property
    def net_weight(self) -> float:
        """Weight plus ballast minus buoyancy [N]."""
        return self.mass * self.gravity - self.buoyancy + self.ballast

    def blueprint(self) -> Blueprint:
        """The vehicle after Fossen (6): M ν̇ + C(ν) ν = −D ν − D_q |ν| ν − g(q) + Σ k f(u) w.

        θ = [M (21), linear drag (6), quadratic drag (6), net weight, righting moments (3), thrust].
        Righting moments are r_B B − r_G W.
        """
        points, directions = (NED * self.thrusters.placed(x) for x in ("position", "direction"))
        rigid, added = np.diag([self.mass] * 3 + self.inertia), np.diag(self.added_mass)
        righting, guess = NED * self.buoyancy_centre * self.buoyancy, self.guess
        full_thrust, count = sum(self.thrusters.curve), len(points)
        curve = odd(*np.divide(self.thrusters.curve, full_thrust))
        linear, square = (
            Term.named("d", "linear drag in", Block.AXES),
            Term.named("dq", "quadratic drag in", Block.AXES),
        )
        upright, axes = Term.named("righting", "righting moment about", "xyz"), np.eye(6)
        thrusters = {"point": points, "direction": directions, "curve": [curve] * count}
        return Blueprint(
            Block.of_mass_matrix(Block.guessed(np.diag(rigid + added))),
            rigid,
            [
                Term.of("linear_drag", linear, self.linear_drag, guess.linear_drag, axes=axes),
                Term.of("drag", square, self.quadratic_drag, axes=axes),
                Term.of("weight", {"net weight": "net weight"}, self.net_weight),
                Term.of("righting", upright, righting, Block.guessed(righting[2]), axis=np.eye(3)),
                Term.actuators(
                    "thruster", "thrust", "thrust of thruster", full_thrust, **thrusters
                ),
            ],
            Operation.within(guess.speed, np.ones(count)),
            Inertia.full(),
            added,
            fluid=WATER,
            size=self.size,
        )


def _turned(vector: list[float], angles: list[float]) -> Array:
    """(k, 3) copies of a vector (3,), each rotated about z by its angle [rad]."""
    c, s = np.cos(angles), np.sin(angles)
    x, y, z = vector
    return np.stack([c * x - s * y, s * x + c * y, np.full(len(angles), z)], axis=1)
