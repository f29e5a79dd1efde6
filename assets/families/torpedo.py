"""Torpedo-shaped underwater vehicles with four fins and a propeller; a REMUS 100 is included."""

from typing import ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from nsaid_mj.lab.plants.conversion import (
    Array,
    Block,
    Blueprint,
    Column,
    Fluid,
    Guess,
    Inertia,
    InvalidInput,
    Negative,
    Number,
    Operation,
    Positive,
    Share,
    SheetTable,
    Term,
    VehicleSheet,
    check_inertia,
    one,
    several,
)

_FLUID = Fluid(
    1000.0,
    1e-3,
    lambda geom: geom == "hull",  # the fins keep their own lift
    ("mass matrix", "quadratic drag", "body lift"),
)
_DRAG = ((1, 0, 0, 0, 0, 0), (0, 1, 1, 0, 0, 0), (0, 0, 0, 1, 0, 0), (0, 0, 0, 0, 1, 1))
_DRAGS = {
    "dq_along": "quadratic drag along the hull",
    "dq_across": "quadratic drag across the hull",
    "dq_roll": "quadratic drag in roll",
    "dq_turn": "quadratic drag in pitch and yaw",
}
"""Names and labels of the drags, which act on the axes above."""
_MASS = (
    (0, 0, 0, 1.0),
    (1, 1, 1, 1.0),
    (2, 2, 1, 1.0),
    (3, 3, 2, 1.0),
    (4, 4, 3, 1.0),
    (5, 5, 3, 1.0),
    (5, 1, 4, 1.0),
    (4, 2, 4, -1.0),
    (4, 0, 5, 1.0),
    (3, 1, 5, -1.0),
)
"""Rows (i, j, l, value), i ≥ j: M of a body of revolution about x has value · θ_l at i, j."""
_INERTIA = (
    ("M_11", "kg", "effective surge mass", (0, 0)),
    ("M_22", "kg", "effective sway and heave mass", (1, 1)),
    ("M_44", "kg·m²", "effective roll inertia", (3, 3)),
    ("M_55", "kg·m²", "effective pitch and yaw inertia", (5, 5)),
    ("M_26", "kg·m", "sway–yaw and heave–pitch coupling of M", (1, 5)),
    ("M_15", "kg·m", "surge–pitch and sway–roll coupling of M", (0, 4)),
)
"""Name, unit and label of these θ_l, and a place in M for the guess."""


class AddedMass(SheetTable):
    """Added-mass derivatives, with their published signs."""

    X_udot: Negative = one("a number < 0 [kg]")
    Y_vdot: Negative = one("a number < 0 [kg]")
    K_pdot: Negative = one("a number < 0 [kg·m²]")
    M_qdot: Negative = one("a number < 0 [kg·m²]")
    Y_rdot: Number = one("a number that is not 0 [kg·m]")


class Drag(SheetTable):
    """Quadratic drag derivatives, with their published signs."""

    coefficient: Positive = one("a coefficient > 0 on the frontal area")
    diameter: Positive = one("a number > 0 [m]")
    Y_vv: Negative = one("a number < 0 [N·s²/m²]")
    K_pp: Negative = one("a number < 0 [N·m·s²]")
    M_qq: Negative = one("a number < 0 [N·m·s²]")


class Lift(SheetTable):
    """Lift derivatives of body and fins together."""

    Y_uv: Number = one("a number [N·s²/m²]")
    M_uw: Number = one("a number [N·s²/m]")


class Fins(SheetTable):
    """Four fins, with coefficients published per pair."""

    Y_uudr: Positive = one("a number > 0 [N·s²/m² for each rad]")
    N_uudr: Negative = one("a number < 0 [N·s²/m for each rad]")
    drag_by_lift: Positive = one("a share > 0")
    radius: Positive = one("a number > 0 [m]")
    limit: float = Field(gt=0, lt=1.5, description="a deflection in (0, 1.5) [rad]")


class Propeller(SheetTable):
    """The propeller and its thrust coefficients."""

    diameter: Positive = one("a number > 0 [m]")
    shaft_speed: Positive = one("a number > 0 at full command [1/s]")
    K_T: list[Positive] = several(2, "two numbers > 0, at advance ratios 0 and `advance`")
    advance: Positive = one("an advance ratio > 0")
    wake: Positive = one("a share > 0")
    deduction: Share = one("a share in [0, 1)")
    torque: Positive = one("a number > 0 [N·m·s²/rad²]")
    position: Number = one("x of the propeller [m]")


class TorpedoSheet(VehicleSheet):
    """A torpedo's data sheet; axes x forward, y right, z down, origin at the centre of buoyancy."""

    family: ClassVar[str] = "torpedo"

    mass: Positive = one("a number > 0 [kg]")
    inertia: list[Positive] = several(3, "three moments about the origin > 0 [kg·m²]")
    gravity_centre: list[Number] = several(3, "three numbers [m], z > 0 if self-righting")
    gravity: Positive = one("a number > 0 [m/s²]")
    water_density: Positive = one("a number > 0 [kg/m³], 1026 in the sea")
    net_weight: Number = one("weight less buoyancy, not 0 [N]")
    added_mass: AddedMass
    drag: Drag
    lift: Lift
    fins: Fins
    propeller: Propeller
    guess: Guess

    @model_validator(mode="after")
    def _fits(self) -> Self:
        height = self.gravity_centre[2]
        for key, value in (
            ("net_weight", self.net_weight),
            ("gravity_centre", height),
            ("added_mass.Y_rdot", self.added_mass.Y_rdot),
        ):
            if abs(value) < 1e-9:
                raise InvalidInput(
                    key,
                    "a number that is not 0 (of the centre of gravity, its z)",
                    value,
                    "It is a parameter to be identified, and needs a scale.",
                )
        shift = self.mass * height**2
        check_inertia([self.inertia[0] - shift, self.inertia[1] - shift, self.inertia[2]])
        if not self.propeller.K_T[0] > self.propeller.K_T[1]:
            raise InvalidInput(
                "propeller.K_T",
                "a coefficient that falls with the advance ratio",
                self.propeller.K_T,
                "Give first the one at standstill.",
            )
        return self

    def blueprint(self) -> Blueprint:
        """M ν̇ + C(ν) ν = −D_q |ν| ν − L(ν) − g(q) + propeller + Σ fins (6).

        θ = [M_11, M_22 = M_33, M_44, M_55 = M_66, M_26 = −M_35, M_15 = −M_24, drag (4), body lift,
        its moment, net weight, righting moment, propeller (2), fin lift (4), fin drag (4)]: a body
        of revolution about x with its centre of gravity on its z axis. Commands are the fins'
        deflections [rad], then the propeller's speed in [−1, 1]. Lift and drag depend on the
        vehicle's own u, as in Prestero (2001); stall is not modelled.

        From z down to z up, the y and z components of vectors change sign. Coefficients that relate
        two such components, as Y_uv and N_vdot, keep theirs; m z_g, the righting moment and Y_uuδr
        do not.
        """
        a, height = self.added_mass, -self.gravity_centre[2]
        added = -np.diag([a.X_udot, *[a.Y_vdot] * 2, a.K_pdot, *[a.M_qdot] * 2])
        added[1, 5] = added[5, 1] = -a.Y_rdot
        added[2, 4] = added[4, 2] = a.Y_rdot
        rigid = np.diag([self.mass] * 3 + self.inertia)
        rigid[0, 4] = rigid[4, 0] = self.mass * height
        rigid[1, 3] = rigid[3, 1] = -self.mass * height
        most, speed = self.fins.limit * np.ones(4), np.array(self.guess.speed)
        slow, fast = np.r_[0.4, -np.ones(5)] * speed, np.r_[1.2, np.ones(5)] * speed
        return Blueprint(
            _mass_block(rigid + added),
            rigid,
            [*self._hull(), *self._actuators()],
            Operation((slow, fast), (np.r_[-most, 0.2], np.r_[most, 1.0]), turn=0.5),
            Inertia.tied(list(_MASS)),
            added,
            fluid=_FLUID,
            size=self.size,
        )

    def _hull(self) -> list[Term]:
        """Drag, lift, net weight and righting moment of the body."""
        a, d, fins = self.added_mass, self.drag, self.fins
        front = np.pi / 4 * d.diameter**2
        drag = [self.water_density / 2 * d.coefficient * front, -d.Y_vv, -d.K_pp, -d.M_qq]
        munk = a.X_udot - a.Y_vdot
        lift = [-self.lift.Y_uv - fins.Y_uudr, munk + fins.N_uudr - self.lift.M_uw]
        righting = self.gravity_centre[2] * self.mass * self.gravity
        return [
            Term.of("drag", _DRAGS, drag, geometry="positive", axes=_DRAG),
            Term.of(
                [Column("lift", 0, body=0), Column("lift_moment", 1, body=0)],
                {"lift_body": "body lift", "lift moment_body": "body lift moment"},
                lift,
            ),
            Term.of("weight", {"net weight": "net weight"}, self.net_weight),
            Term.of("righting", {"righting_z": "righting moment"}, righting, axis=[[0, 0, 1]]),
        ]

    def _actuators(self) -> list[Term]:
        """Propeller and fins; a fin has half its pair's lift."""
        fins, p = self.fins, self.propeller
        x, r = fins.N_uudr / fins.Y_uudr, fins.radius
        positions = np.array([[x, 0, r], [x, 0, -r], [x, r, 0], [x, -r, 0]])
        lifts = np.array([[0.0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]])
        n, wide = p.shaft_speed, p.diameter
        slope = (p.K_T[0] - p.K_T[1]) / p.advance
        thrust = (1 - p.deduction) * self.water_density * n**2 * wide**4 * p.K_T[0]
        gains = [thrust, p.torque * (2 * np.pi * n) ** 2]
        ahead = {"body": 0, "input": 4, "direction": (1.0, 0.0, 0.0)}
        slip = slope * p.wake / (n * wide) / p.K_T[0]
        lift, drag = fins.Y_uudr / 2, fins.drag_by_lift * fins.Y_uudr / 2
        return [
            Term.of(
                [
                    Column("propeller", 0, point=(p.position, 0.0, 0.0), slip=slip, **ahead),
                    Column("propeller_torque", 1, **ahead),
                ],
                {"thrust": "propeller thrust", "torque": "propeller torque"},
                gains,
            ),
            Term.actuators(
                "fin", "fin lift", "lift of fin", lift, point=positions, direction=lifts
            ),
            Term.actuators("fin_drag", "fin drag", "drag of fin", drag, point=positions),
        ]


def _mass_block(M: Array) -> Block:
    """The six parameters of a body of revolution; guesses from its nominal M (6, 6)."""
    names, units, labels, places = zip(*_INERTIA, strict=True)
    scale = Block.guessed([M[place] for place in places])
    return Block("mass matrix", names, units, scale, "tied", entries=_MASS, labels=labels)
