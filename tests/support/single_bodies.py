"""Single bodies by their sources' equations in plain numpy: M ν̇ + C(ν) ν − F(q, ν, u) θ.

Kirchhoff's equations in body axes with ν = [v, ω]: the momentum h = M ν changes by the forces minus
[ω × h_v, v × h_v + ω × h_ω], which is C(ν) ν for every choice of C. Forces are written as vectors
that act at points. Nothing here knows `nsaid_mj.core.structure`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.parts import Column
from nsaid_mj.lab.plants.conversion import odd
from nsaid_mj.lab.plants.scalar_rov import heaving
from nsaid_mj.lab.plants.world.blueprint import VehicleSheet, sheet_of
from tests.support.matrices import skew

Z = np.array([0.0, 0.0, 1.0])


def regressor(made: Made, q: Array, v: Array, a: Array, u: Array) -> Array:
    """(n, p) W(t, x, v, a), column by column."""
    residual, s = REFERENCES[made.family], SimpleNamespace(**made.geometry)
    return np.stack([residual(s, q, v, a, u, e) for e in np.eye(made.system.p)], axis=1)


def moved(M: Array, v: Array, a: Array) -> Array:
    """(6,) M ν̇ + C(ν) ν."""
    h = M @ v
    turning = np.concatenate([np.cross(v[3:], h[:3]), np.cross(v[:3], h[:3])])
    turning[3:] += np.cross(v[3:], h[3:])
    return M @ a + turning


def at(point: Array, force: Array) -> Array:
    """(6,) wrench of a force at a point."""
    return np.concatenate([force, np.cross(point, force)])


def about(torque: Array) -> Array:
    """(6,) wrench of a torque."""
    return np.concatenate([np.zeros(3), torque])


def up(q: Array) -> Array:
    """(3,) the world's upward direction in body axes."""
    return Rotation.from_quat(q[3:]).inv().apply(Z)


def rigid(ten: Array) -> Array:
    """(6, 6) of m, m c, Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin."""
    m, h, (xx, xy, yy, xz, yz, zz) = ten[0], skew(ten[1:4]), ten[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return np.block([[m * np.eye(3), -h], [h, inertia]])


# -- the families ----------------------------------------------------------------------------------


def underwater(s: Any, q: Array, v: Array, a: Array, u: Array, theta: Array) -> Array:
    """Fossen (2021): M symmetric, drag on every axis, restoring forces, thrusters."""
    M = np.zeros((6, 6))
    M[np.triu_indices(6)] = theta[:21]
    M += np.triu(M, 1).T
    drag = theta[21:27] * v + theta[27:33] * np.abs(v) * v
    weight = np.concatenate([theta[33] * up(q), np.cross(up(q), theta[34:37])])
    thrust = sum(
        gain * sum(c * command ** (2 * i + 1) for i, c in enumerate(s.curve)) * at(p, d)
        for gain, command, p, d in zip(theta[37:], u, s.positions, s.directions, strict=False)
    )
    return moved(M, v, a) + drag + weight - thrust


def torpedo(s: Any, q: Array, v: Array, a: Array, u: Array, theta: Array) -> Array:
    """Prestero (2001): a body of revolution, its lift, fins and a propeller."""
    x, y, z = v[:3]
    M = np.diag(theta[[0, 1, 1, 2, 3, 3]])
    M[1, 5] = M[5, 1] = theta[4]
    M[2, 4] = M[4, 2] = -theta[4]
    M[0, 4] = M[4, 0] = theta[5]
    M[1, 3] = M[3, 1] = -theta[5]
    force = -theta[[6, 7, 7, 8, 9, 9]] * np.abs(v) * v
    force -= theta[10] * abs(x) * np.array([0, y, z, 0, 0, 0])
    force += theta[11] * abs(x) * np.array([0, 0, 0, 0, -z, y])
    force -= theta[12] * np.r_[up(q), 0, 0, 0]
    force += about(np.asarray(np.cross(theta[13] * Z, up(q)), dtype=float))
    n, forward = u[-1], np.array([1.0, 0, 0])
    force += theta[14] * abs(n) * (n - s.slip * x) * np.r_[forward, 0, 0, 0]
    force -= theta[15] * abs(n) * n * about(forward)
    k = len(u) - 1
    for i in range(k):
        p, e, delta = s.positions[i], s.lifts[i], u[i]
        sideways = e @ (v[:3] + np.cross(v[3:], p))
        force += theta[16 + i] * abs(x) * (x * delta - sideways) * at(p, e)
        force -= theta[16 + k + i] * abs(x) * x * delta**2 * at(p, forward)
    return moved(M, v, a) - force


def quadrotor(s: Any, q: Array, v: Array, a: Array, u: Array, theta: Array) -> Array:
    """Weight at the centre of mass, drag of the body, and four rotors."""
    down = -9.81 * up(q)
    force = np.concatenate([theta[0] * down, np.cross(theta[1:4], down)])
    force[:3] -= np.linalg.norm(v[:3]) * theta[13:16] * v[:3]
    for i, p in enumerate(s.rotors):
        there, square = v[:3] + np.cross(v[3:], p), u[i] * abs(u[i])
        lift = theta[16 + i] * square + theta[10] * (there[0] ** 2 + there[1] ** 2)
        drag = -abs(u[i]) * theta[[11, 11, 12]] * there
        force += at(p, lift * Z + drag) + about(s.spin[i] * theta[20 + i] * square * Z)
    return moved(rigid(theta[:10]), v, a) - force


def free_flyer(s: Any, q: Array, v: Array, a: Array, u: Array, theta: Array) -> Array:
    """A rigid body and nozzles."""
    places = zip(theta[10:], u, s.positions, s.directions, strict=False)
    force = sum(gain * command * at(p, d) for gain, command, p, d in places)
    return moved(rigid(theta[:10]), v, a) - force


def car(s: Any, q: Array, v: Array, a: Array, u: Array, theta: Array) -> Array:
    """Rajamani (2012): the single-track model, about mid-wheelbase."""
    (m, h, inertia, front, rear, k_d, k_v, c_0, c_D), (x, y, r) = theta, v
    (d, steer), half = u, s.wheelbase / 2
    F_f = -front * (np.arctan2(y + half * r, x) - steer)
    F_r = -rear * np.arctan2(y - half * r, x)
    along = (k_d - k_v * x) * d - c_0 * np.tanh(x / 0.1) - c_D * abs(x) * x
    return np.array(
        [
            m * (a[0] - r * y) - h * r**2 - along + F_f * np.sin(steer),
            m * (a[1] + r * x) + h * a[2] - F_f * np.cos(steer) - F_r,
            inertia * a[2] + h * (a[1] + r * x) - half * (F_f * np.cos(steer) - F_r),
        ]
    )


def scalar(s: Any, q: Array, v: Array, a: Array, u: Array, theta: Array) -> Array:
    """(16): m v̇ = −d v|v| − g + a u."""
    m, d, g, gain = theta
    return m * a + d * v * np.abs(v) + g - gain * u


REFERENCES: dict[str, Callable[..., Array]] = {
    "underwater": underwater,
    "torpedo": torpedo,
    "quadrotor": quadrotor,
    "free flyer": free_flyer,
    "car": car,
    "scalar": scalar,
}
FAMILIES = tuple(REFERENCES)
SHEETS: dict[str, tuple[type[VehicleSheet], str]] = {
    "underwater": (sheet_of("underwater"), "bluerov2"),
    "torpedo": (sheet_of("torpedo"), "remus100"),
    "quadrotor": (sheet_of("quadrotor"), "hummingbird"),
    "free flyer": (sheet_of("free-flyer"), "astrobee"),
    "car": (sheet_of("car"), "f1tenth"),
}


# -- systems of random geometry --------------------------------------------------------------------


class Made(NamedTuple):
    """A system, its family, and its geometry."""

    system: Any
    family: str
    geometry: dict[str, Any]


def units(rng: np.random.Generator, k: int) -> Array:
    """(k, 3) unit vectors."""
    found = rng.standard_normal((k, 3))
    return found / np.linalg.norm(found, axis=1)[:, None]


def random(family: str, rng: np.random.Generator) -> Made:
    """A system of a family: an included vehicle with its actuators elsewhere."""
    if family == "scalar":
        return Made(heaving(np.ones(4)).system, family, {})
    points, directions = rng.uniform(-1, 1, (12, 3)), units(rng, 12)
    placed, curve = {"positions": points, "directions": directions}, rng.uniform(-1, 1, 3)
    if family == "car":
        length = rng.uniform(0.3, 3)
        arms = {0: {"arm": length / 2}, 1: {"arm": -length / 2}}
        return Made(_with(family, {"tyre": arms}), family, {"wheelbase": length})
    if family == "quadrotor":
        spin = rng.choice([-1.0, 1.0], 4)
        at = {i: {"point": points[i]} for i in range(4)}
        rotors: dict[str, Any] = dict.fromkeys(("rotor", "rotor_drag", "rotor_damping"), at)
        rotors["rotor_inflow"] = [{"point": p} for p in points[:4]]
        rotors["rotor_torque"] = {i: {"direction": spin[i] * Z} for i in range(4)}
        return Made(_with(family, rotors), family, {"rotors": points[:4], "spin": spin})
    at = {
        i: {"point": p, "direction": e}
        for i, (p, e) in enumerate(zip(points, directions, strict=True))
    }
    if family == "torpedo":
        slip = rng.uniform(0, 0.5)
        fins = {i: {"point": p} for i, p in enumerate(points)}
        columns = {"fin": at, "fin_drag": fins, "propeller": {0: {"slip": slip}}}
        geometry = {"positions": points, "lifts": directions, "slip": slip}
        return Made(_with(family, columns), family, geometry)
    if family == "underwater":
        at = {i: {**own, "curve": odd(*curve)} for i, own in at.items()}
        return Made(_with(family, {"thruster": at}), family, {**placed, "curve": curve})
    return Made(_with(family, {"nozzle": at}), family, placed)


def _with(family: str, constants: dict[str, Any]) -> Any:
    """A family's included vehicle with other constants, by kind and number of the column."""
    sheet, name = SHEETS[family]
    blueprint, terms, seen = sheet.of(name).blueprint(), [], dict.fromkeys(constants, 0)
    for term in blueprint.terms:
        columns = []
        for c in term.columns:
            own = dict[str, Any](c.constants)
            if c.kind in constants:
                number, seen[c.kind] = seen[c.kind], seen[c.kind] + 1
                own |= constants[c.kind][number]
            columns.append(Column(c.kind, c.parameter, body=c.body, input=c.input, **own))
        terms.append(term._replace(columns=columns))
    return replace(blueprint, terms=terms).system
