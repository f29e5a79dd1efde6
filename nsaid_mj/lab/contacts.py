"""Rows of W along a motion, without forces of contacts that nobody measures."""

from __future__ import annotations

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
