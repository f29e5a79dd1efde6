"""Rows of W along a motion, without forces of contacts that nobody measures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core import Array, Elimination, Indices, Log, SecondOrderSystem


def without_contacts(system: SecondOrderSystem, q: Array, W: Array) -> Array:
    """W (k, n, p) at positions q (k, m), without the forces of the structure's contacts."""
    contacts = system.structure.contacts
    return Elimination(system.structure, contacts, q).E @ W if contacts else W


def rows_along(
    system: SecondOrderSystem, log: Log, rows: Indices | slice, v_hat: Array, theta: Array
) -> Array:
    """(k, n, p) W(t, x, v̂, θ) at some rows of a log, with velocities v̂ (k, n) and θ (k, p).

    Of a system with contacts it is E W(t, x, v, v̇), whatever θ: v̇ are differences of measured
    velocities, because (29) does not give them.
    """
    t = log.t[rows]
    q = log.q[rows]
    v = log.v[rows]
    u = log.u[rows]
    x = np.hstack([q, v])
    if not system.structure.contacts:
        return system.evaluate(t, x, v_hat, u, theta)[1]
    several = len(log.t) > 1
    rates = np.gradient(log.v, log.t, axis=0) if several else np.zeros_like(log.v)
    return without_contacts(system, q, system.regressor(t, x, v, rates[rows], u))


class ContactForces(NamedTuple):
    """Forces on the contacts along k samples, that a θ implies."""

    places: Array  # (k, c, 3) places of the c contacts, in the base's or the world's axes [m]
    force: Array  # (k, c, 3) forces on them, in the same axes [N]
    upwards: Array  # (k, c) components against gravity [N]


def contact_forces(
    system: SecondOrderSystem, log: Log, rows: Indices, theta: Array
) -> ContactForces:
    """λ̂ of W θ = Jᵀ λ at some rows of a log, under θ (p,) or (k, p)."""
    structure = system.structure
    q = log.q[rows]
    x = np.hstack([q, log.v[rows]])
    rates = np.gradient(log.v, log.t, axis=0)[rows]
    W = system.regressor(log.t[rows], x, log.v[rows], rates, log.u[rows])
    found = Elimination(structure, structure.contacts, q)
    theta = np.broadcast_to(theta, (len(q), system.p))
    wrench = np.einsum("kcn,knp,kp->kc", found.to_force, W, theta, optimize=True)
    starts = np.cumsum([0, *(contact.rows for contact in structure.contacts)])[:-1]
    force = np.stack([wrench[:, start : start + 3] for start in starts], axis=1)
    up = np.broadcast_to(_up(system, q), (len(q), 3))
    return ContactForces(found.places, force, np.einsum("kca,ka->kc", force, up))


def _up(system: SecondOrderSystem, q: Array) -> Array:
    """(k, 3) upward direction in the common frame of positions q (k, m), or (3,)."""
    if not system.structure.group:
        return np.array([0.0, 0.0, 1.0])
    x, y, z, w = q[:, 3:7].T  # the last row of the base's rotation matrix
    return np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)], axis=1)
