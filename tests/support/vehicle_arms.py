"""Vehicles with an arm by Kane's equations in numpy, on Pinocchio's kinematics of their joints.

A body with a constant 6×6 inertia I and twist V = J v, both in its axes, asks for the wrench
I V̇ + V ×* I V; projected by Jᵀ and summed, these balance the applied wrenches. Nothing here knows
`nsaid_mj.core.structure`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from nsaid_mj.core.parameters import Array
from nsaid_mj.robots.assets import published_numbers
from tests.support.fossen import published
from tests.support.single_bodies import about, at, rigid

Z = np.array([0.0, 0.0, 1.0])
G = 9.81


def acceleration(name: str, system: Any, q: Array, v: Array, u: Array, theta: Array) -> Array:
    """(n,) v̇ of `uvms`, `borinot` or `iris` under θ (p,)."""
    model = system.model
    data, n, k = model.createData(), model.nv, model.njoints - 2
    pin.computeJointJacobiansTimeVariation(model, data, q, v)
    pin.computeJointJacobians(model, data, q)
    M, force = np.zeros((n, n)), joint_forces(system, v, u, theta)
    if k:
        M[6:, 6:] = np.diag(theta[system.space["rotor inertia"]])
    for b in range(k + 1):
        J = pin.getJointJacobian(model, data, b + 1, pin.LOCAL)
        rate = pin.getJointJacobianTimeVariation(model, data, b + 1, pin.LOCAL)
        V, up = J @ v, data.oMi[b + 1].rotation.T @ Z
        bodies = in_water if name == "uvms" else in_air
        inertia, wrench = bodies(name, system, b, V, up, u[k:], theta)
        M += J.T @ inertia @ J
        momentum = inertia @ V
        turning = np.r_[np.cross(V[3:], momentum[:3]), np.cross(V[3:], momentum[3:])]
        turning[3:] += np.cross(V[:3], momentum[:3])
        force += J.T @ (wrench - inertia @ (rate @ v) - turning)
    return np.asarray(np.linalg.solve(M, force), dtype=np.float64)


def joint_forces(system: Any, v: Array, u: Array, theta: Array) -> Array:
    """(n,) friction and motors of the joints."""
    force, k, space = np.zeros(len(v)), len(v) - 6, system.space
    if k:
        viscous, coulomb, gain = (
            theta[space[name]] for name in ("viscous friction", "Coulomb friction", "motor gain")
        )
        rate = v[6:]
        force[6:] = gain * u[:k] - viscous * rate - coulomb * np.tanh(rate / system.friction_speed)
    return force


def weight(ten: Array, up: Array) -> Array:
    """(6,) wrench of a rigid body's weight."""
    return -G * np.r_[ten[0] * up, np.cross(ten[1:4], up)]


def in_air(name: str, system: Any, b: int, V: Array, up: Array, u: Array, theta: Array) -> Any:
    """Inertia (6, 6) of a body, and the wrench (6,) on it: weight, and rotors on the base."""
    ten = theta[10 * b : 10 * b + 10]
    wrench = weight(ten, up)
    if b == 0:
        d, space = published_numbers("flying_arm")[name], system.space
        thrust, torque = (theta[space[f"rotor {what} gain"]] for what in ("thrust", "torque"))
        for i, place in enumerate(d["positions"]):
            square = u[i] * abs(u[i])
            wrench += at(np.array(place), thrust[i] * square * Z)
            wrench += about(d["spins"][i] * torque[i] * square * Z)
    return rigid(ten), wrench


def in_water(name: str, system: Any, b: int, V: Array, up: Array, u: Array, theta: Array) -> Any:
    """Inertia (6, 6) of a body with its added mass, and the wrench (6,) on it, after Fossen."""
    space = system.space
    if b == 0:
        inertia, sheet = np.zeros((6, 6)), published()
        inertia[np.triu_indices(6)] = theta[:21]
        inertia += np.triu(inertia, 1).T
        wrench = -theta[space["linear drag"]] * V - theta[space["quadratic drag"]] * np.abs(V) * V
        wrench -= np.r_[theta[space["net weight"]] * up, np.zeros(3)]
        wrench += about(np.asarray(np.cross(theta[space["righting moment"]], up), dtype=float))
        curve = published_numbers("bluerov2")["thrusters"]["curve"]
        for i, gain in enumerate(theta[space["thruster gain"]]):
            effort = sum(c * u[i] ** (2 * j + 1) for j, c in enumerate(curve)) / sum(curve)
            wrench += at(sheet.positions[i], gain * effort * sheet.directions[i])
        return inertia, wrench
    arm = published_numbers("uvms")
    ten, shape = theta[11 + 10 * b : 21 + 10 * b], arm["links"][b - 1]["cylinder"]
    start, end = np.array(shape["start"]), np.array(shape["end"])
    length = np.linalg.norm(end - start)
    e, middle = (end - start) / length, (start + end) / 2
    added, drag, buoyancy = (
        theta[space[what]][b - 1] for what in ("added mass", "link drag", "link buoyancy")
    )
    inertia, across = rigid(ten), np.eye(3) - np.outer(e, e)
    wrench = weight(ten, up) + at(middle, buoyancy * up)
    for s, share in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        point = middle + s * length / 2 * e
        X = across @ np.hstack([np.eye(3), np.cross(np.eye(3), point).T])  # flow across the axis
        inertia += added * share / 2 * X.T @ X
        flow = X @ V
        wrench += at(point, -drag * share * length / 2 * np.linalg.norm(flow) * flow)
    return inertia, wrench
