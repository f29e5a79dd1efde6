"""A BlueROV2 by Fossen's equations, integrated by scipy, and the plant with its numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.polynomial import polynomial
from scipy.integrate import solve_ivp

from nsaid_mj.core.parameters import Array
from nsaid_mj.lab.plants.world.blueprint import sheet_of
from nsaid_mj.lab.plants.world.body import NED, BodyInertia, command_inputs, hidden, vehicle_spec
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.plants.world.plant import Plant
from nsaid_mj.lab.plants.world.simulated import SimulatedRobot
from nsaid_mj.robots.assets import VehicleFiles
from tests.support.matrices import skew

START = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 0.8]), np.array([0.7, 0.4, -0.5, 0.5, 0.6, -0.4])
SHEET: Any = sheet_of("underwater").of("bluerov2")
FLOW = (0.3, -0.2, 0.1)


@dataclass(frozen=True)
class Hydrodynamics:
    """Parameters of a body in water; axes x forward, y left, z up.

    Attributes:
        rigid: (6, 6) M_RB about the body's origin [kg, kg·m, kg·m²].
        added: (6, 6) M_A, symmetric [kg, kg·m, kg·m²].
        linear: (6,) linear drag [N·s/m, N·m·s/rad].
        quadratic: (6,) quadratic drag [N·s²/m², N·m·s²/rad²].
        net_weight: weight less buoyancy [N].
        righting: (3,) r_B B − r_G W [N·m].
        positions: (k, 3) of the thrusters [m].
        directions: (k, 3) unit vectors of the thrusts.
        thrust: (k,) at full command [N].
        curve: coefficients of u, u³, u⁵ … in the command curve.
    """

    rigid: Array
    added: Array
    linear: Array
    quadratic: Array
    net_weight: float
    righting: Array
    positions: Array
    directions: Array
    thrust: Array
    curve: Array

    def drawn(self, spread: float, rng: np.random.Generator) -> Hydrodynamics:
        """Random true parameters: all but the inertias deviate by up to `spread`."""
        return replace(
            self,
            linear=hidden(self.linear, spread, rng),
            quadratic=hidden(self.quadratic, spread, rng),
            net_weight=float(hidden(self.net_weight, spread, rng)),
            righting=hidden(self.righting, spread, rng),
            thrust=hidden(self.thrust, spread, rng),
        )

    def theta(self) -> Array:
        """(p,) θ in the order of the underwater sheet's blueprint."""
        M = (self.rigid + self.added)[np.triu_indices(6)]
        drag = self.linear, self.quadratic
        return np.concatenate([M, *drag, [self.net_weight], self.righting, self.thrust])


def published() -> Hydrodynamics:
    """The BlueROV2's numbers, from its sheet."""
    places, pushes = (NED * SHEET.thrusters.placed(what) for what in ("position", "direction"))
    curve = np.array(SHEET.thrusters.curve)
    return Hydrodynamics(
        np.diag([SHEET.mass] * 3 + SHEET.inertia),
        np.diag(SHEET.added_mass),
        np.array(SHEET.linear_drag),
        np.array(SHEET.quadratic_drag),
        SHEET.net_weight,
        NED * SHEET.buoyancy_centre * SHEET.buoyancy,
        places,
        pushes,
        np.full(len(places), curve.sum()),
        curve / curve.sum(),
    )


# -- Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control, 2021 -----------------------


def coriolis(M: Array, nu: Array) -> Array:
    """(6, 6) C(ν) of a symmetric M, equation (3.62) of Theorem 3.2."""
    one = M[:3, :3] @ nu[:3] + M[:3, 3:] @ nu[3:]
    two = M[3:, :3] @ nu[:3] + M[3:, 3:] @ nu[3:]
    C = np.zeros((6, 6))
    C[:3, 3:] = C[3:, :3] = -skew(one)
    C[3:, 3:] = -skew(two)
    return C


def attitude(quaternion: Array) -> Array:
    """(3, 3) R of (η, ε), equation (2.68): 1 + 2 η skew(ε) + 2 skew(ε)²."""
    eta, eps = quaternion[0], quaternion[1:]
    return np.eye(3) + 2 * eta * skew(eps) + 2 * skew(eps) @ skew(eps)


class Fossen:
    """d/dt of [position, (η, ε), ν, what the thrusters do] under a constant command.

    Args:
        true: the numbers.
        u: (k,) command.
        mismatch: of the plant.
    """

    def __init__(self, true: Hydrodynamics, u: Array, mismatch: Mismatch):
        self.true, self.u, self.lag = true, u, mismatch.lag
        self.flow = np.array(mismatch.flow)
        self.curve = np.zeros(2 * len(true.curve))
        self.curve[1::2] = true.curve
        self.M_inverse = np.linalg.inv(true.rigid + true.added)
        self.B = np.vstack([true.directions.T, np.cross(true.positions, true.directions).T])
        self.held = self.thrust(u)

    def thrust(self, command: Array) -> Array:
        """(6,) τ of the thrusters."""
        return self.B @ (self.true.thrust * polynomial.polyval(command, self.curve))

    def __call__(self, t: float, x: Array) -> Array:
        h, (quaternion, nu, act) = self.true, (x[3:7], x[7:13], x[13:])
        quaternion = quaternion / np.sqrt(quaternion @ quaternion)
        R = attitude(quaternion)
        nu_c, nu_c_dot = np.zeros(6), np.zeros(6)
        nu_c[:3] = R.T @ self.flow
        nu_c_dot[:3] = -skew(nu[3:]) @ nu_c[:3]
        nu_r, up = nu - nu_c, R[2]
        tau = self.thrust(act) if self.lag else self.held
        g = np.concatenate([h.net_weight * up, -skew(h.righting) @ up])
        nu_dot = self.M_inverse @ (
            tau
            - g
            - coriolis(h.rigid, nu) @ nu
            - coriolis(h.added, nu_r) @ nu_r
            - (h.linear + h.quadratic * np.abs(nu_r)) * nu_r
            + h.added @ nu_c_dot
        )
        eta, eps, omega = quaternion[0], quaternion[1:], nu[3:]
        turning = 0.5 * np.concatenate([[-eps @ omega], eta * omega + skew(eps) @ omega])
        act_dot = (self.u - act) / self.lag if self.lag else 0 * act
        return np.concatenate([R @ nu[:3], turning, nu_dot, act_dot])


def flown(
    true: Hydrodynamics,
    commands: list[Array],
    each: float,
    mismatch: Mismatch = Mismatch(),  # noqa: B008
) -> Array:
    """(13 + k,) the state after commands of `each` seconds, from START."""
    numbers, v = START
    angle = np.linalg.norm(numbers[3:])
    quaternion = np.r_[np.cos(angle / 2), np.sin(angle / 2) * numbers[3:] / angle]
    x = np.concatenate([numbers[:3], quaternion, v, np.zeros(len(commands[0]))])
    for u in commands:
        x = solve_ivp(
            Fossen(true, u, mismatch), (0, each), x, method="DOP853", rtol=1e-13, atol=1e-14
        ).y[:, -1]
    return x


# -- MuJoCo ----------------------------------------------------------------------------------------


@cache
def true_numbers(kind: str) -> Hydrodynamics:
    """A BlueROV2's hidden numbers; `full` ones have a CG offset and couplings of every kind."""
    true = published().drawn(0.2, np.random.default_rng(3))
    if "full" in kind:
        rng = np.random.default_rng(4)
        body = pin.Inertia(13.5, np.array([0.03, -0.02, -0.04]), _spd(rng, [0.26, 0.23, 0.37], 0.1))
        root = np.sqrt(np.diag(true.added))
        added = np.outer(root, root) * _spd(rng, np.ones(6), 0.25)
        true = replace(true, rigid=body.matrix(), added=added, righting=np.array([0.5, -0.4, 2.0]))
    return true


def _spd(rng: np.random.Generator, diagonal: Any, coupling: float) -> Array:
    root = np.sqrt(diagonal)
    A = coupling * rng.uniform(-1, 1, (len(root), len(root)))
    np.fill_diagonal(A, 1.0)
    return np.outer(root, root) * (A + A.T) / 2


def vehicle(true: Hydrodynamics, dt: float, mismatch: Mismatch = Mismatch()) -> SimulatedRobot:  # noqa: B008
    """The plant with these numbers, its centre of gravity where M_RB has it."""
    system = SHEET.blueprint().system
    m, S_c = true.rigid[0, 0], true.rigid[3:, :3] / true.rigid[0, 0]
    centre = np.array([S_c[2, 1], S_c[0, 2], S_c[1, 0]])
    body = BodyInertia(m, centre, true.rigid[3:, 3:] + m * S_c @ S_c)
    spec = vehicle_spec(VehicleFiles.of("bluerov2"), dt, body)
    command_inputs(spec, system.n_u)
    acting = replace(true, rigid=np.zeros((6, 6))).theta()
    return SimulatedRobot(system, true.theta(), acting, spec, ("pose",), mismatch)


def ends(p: Plant, commands: list[Array], each: float) -> Array:
    """(13 + k,) the same state, of MuJoCo."""
    with p.running():
        p.reset(*START)
        for u in commands:
            for _ in range(round(each / p.dt)):
                p.step(u)
        _, v = p.coordinates()
    return np.concatenate([p.data.qpos, v, p.data.act])


def apart(found: Array, expected: Array) -> float:
    """Largest difference of place [m], quaternion and twist [m/s, rad/s]."""
    sign = np.sign(found[3:7] @ expected[3:7])
    quaternion = expected[3:7] / np.linalg.norm(expected[3:7])
    return max(
        np.abs(found[:3] - expected[:3]).max(),
        np.abs(sign * found[3:7] - quaternion).max(),
        np.abs(found[7:13] - expected[7:13]).max(),
    )


def commands(count: int) -> list[Array]:
    return list(np.random.default_rng(5).uniform(-0.6, 0.6, (count, 8)))
