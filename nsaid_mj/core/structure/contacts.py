"""Contacts whose forces nobody measures: where they act, and W without them.

A contact's force λ is unknown, but the point where it acts is known: W θ = Jᵀ λ, with J the
Jacobian of the contact points. Every E with E Jᵀ = 0 removes λ. **E W θ = 0** is linear and
homogeneous in θ as (13), and holds for every λ: with any friction, with slip, on soft ground. P(θ)
is then the nullspace of E W. With positive weights D,

    E = 1 − Jᵀ (J D Jᵀ)⁻¹ J D,        λ̂ = (J D Jᵀ)⁻¹ J D W θ.

E subtracts from every row the contacts' part as estimated by λ̂, so a row keeps its meaning and its
unit. With small weights D for a floating base, λ̂ is determined by the joints of the legs. The
base's rows are then the force balance of the whole robot. The rows of a leg vanish if it has as
many joints as its contact force has components.

A momentum balance needs Ė too. With T = (J D Jᵀ)⁻¹ J D and U = Jᵀ (J D Jᵀ)⁻¹,

    Ė = −E J̇ᵀ T − U J̇ D E.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..parameters import Array
from .arrays import FRAME, POSITION, RATE, TWIST
from .kinematics import place_along
from .parts import ContactPoint

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .structure import Structure

_OF_BASE = 1e-6  # weight of a base's rows over a joint's: the legs alone tell the contacts' forces


def contact_jacobians(
    structure: Structure, contacts: Sequence[ContactPoint], q: Array
) -> tuple[Array, Array]:
    """(N, c, n) J and (N, k, 3) the places of k contacts at positions q (N, m).

    Both are in the common frame: of a floating base its own at each sample, else the world's. Rows
    follow one another contact by contact, forces [linear, then angular if flat].
    """
    J, _, places = _contact_motion(structure, contacts, q)
    return J, places


def displaced_jacobians(
    structure: Structure, contacts: Sequence[ContactPoint], q: Array
) -> tuple[Array, Array]:
    """(N, c, n) J at positions q (N, m), and how J changes where every contact's force acts higher.

    That is by `ContactPoint.sinking`; in the common frame of `contact_jacobians`.
    """
    J, _ = contact_jacobians(structure, contacts, q)
    if not any(contact.sinking for contact in contacts):
        return J, np.zeros_like(J)
    higher = [replace(contact, radius=contact.radius - contact.sinking) for contact in contacts]
    return J, contact_jacobians(structure, higher, q)[0] - J


def contact_accelerations(
    structure: Structure, contacts: Sequence[ContactPoint], q: Array, v: Array
) -> Array:
    """(N, c) J̇ v at positions q (N, m) and velocities v (N, n): J v̇ + J̇ v is that of the points.

    Rows are those of `contact_jacobians`, in an inertial frame.
    """
    _, change, _ = _contact_motion(structure, contacts, q, v)
    return np.asarray((change @ v[:, :, None])[:, :, 0])


def _contact_motion(
    structure: Structure, contacts: Sequence[ContactPoint], q: Array, v: Array | None = None
) -> tuple[Array, Array, Array]:
    """(N, c, n) J and J̇, in an inertial frame, and (N, k, 3) the contacts' places.

    J̇ is 0 without velocities v (N, n).
    """
    n = structure.n
    still = v is None
    v = np.zeros((len(q), n)) if v is None else v
    bodies = len(structure.bodies)
    states = np.empty((len(q), (bodies + n + 1) * FRAME + 36 * len(structure.arrays.terms)))
    q = np.array(q, dtype=np.float64, order="C")
    place_along(structure.arrays, q, np.array(v, dtype=np.float64, order="C"), states)
    axes = states[:, bodies * FRAME : (bodies + n) * FRAME].reshape(len(q), n, FRAME)
    ground = states[:, (bodies + n) * FRAME :]
    J = np.zeros((len(q), sum(contact.rows for contact in contacts), n))
    change = np.zeros_like(J)
    places = np.empty((len(q), len(contacts), 3))
    first = 0
    for k, contact in enumerate(contacts):
        frame = states[:, contact.body * FRAME : (contact.body + 1) * FRAME]
        turned = frame[:, :9].reshape(-1, 3, 3) @ np.asarray(contact.centre, float)
        point = frame[:, POSITION : POSITION + 3] + turned
        centre = point
        if contact.radius:
            point = point - contact.radius * _normals(structure, contact, q, ground)
        places[:, k] = point
        moving = structure.path(contact.body)
        S = axes[:, moving, :6]
        linear = S[:, :, :3] + np.cross(S[:, :, 3:], point[:, None])
        J[:, first : first + 3, moving] = np.swapaxes(linear, 1, 2)
        if contact.flat:
            J[:, first + 3 : first + 6, moving] = np.swapaxes(S[:, :, 3:], 1, 2)
        if not still:
            rate = axes[:, moving, RATE : RATE + 6]
            twist = frame[:, TWIST : TWIST + 6]
            speed = (twist[:, :3] + np.cross(twist[:, 3:], centre))[:, None]
            moved = rate[:, :, :3] + np.cross(rate[:, :, 3:], point[:, None])
            moved += np.cross(S[:, :, 3:], speed)
            change[:, first : first + 3, moving] = np.swapaxes(moved, 1, 2)
            if contact.flat:
                change[:, first + 3 : first + 6, moving] = np.swapaxes(rate[:, :, 3:], 1, 2)
        first += contact.rows
    return J, change, places


def _normals(structure: Structure, contact: ContactPoint, q: Array, ground: Array) -> Array:
    """(N, 3) normals of a contact's surface in the common frame."""
    if contact.normal is None:
        return ground[:, :3]
    normal = np.asarray(contact.normal, dtype=np.float64)
    normal = normal / np.linalg.norm(normal)
    if not structure.group:
        return np.broadcast_to(normal, (len(q), 3))
    from scipy.spatial.transform import Rotation

    return Rotation.from_quat(q[:, 3:7]).inv().apply(normal)


def weights_of(structure: Structure) -> Array:
    """(n,) weights D by default: a floating base's rows count next to nothing."""
    weights = np.ones(structure.n)
    weights[: structure.group] = _OF_BASE
    return weights


def balanced_rows(structure: Structure) -> NDArray[np.bool_]:
    """(n,) the rows of E W that hold a balance, with the structure's contacts and default weights.

    Those of a limb that has as many joints of its own as its contacts' forces have components
    say what these forces are, and nothing else: their rows of E W vanish.
    """
    limbs = [set(structure.path(c.body)) - set(range(structure.group)) for c in structure.contacts]
    kept = np.ones(structure.n, dtype=bool)
    if not structure.group:
        return kept
    for k, limb in enumerate(limbs):
        own = limb - {i for j, other in enumerate(limbs) if j != k for i in other}
        if len(own) == structure.contacts[k].rows:
            kept[list(own)] = False
    return kept


class Elimination:
    """E and λ̂ of contacts at N samples.

    Attributes:
        E: (N, n, n) with E Jᵀ = 0.
        to_force: (N, c, n) with λ̂ = to_force · (W θ); forces and torques in the common frame.
        places: (N, k, 3) places of the contacts in the common frame [m].
        rate: (N, n, n) Ė along velocities v.
    """

    def __init__(
        self,
        structure: Structure,
        contacts: Sequence[ContactPoint],
        q: Array,
        touching: NDArray[np.bool_] | None = None,
        weights: Array | None = None,
        v: Array | None = None,
    ):
        """At positions q (N, m).

        `touching` (N, k) says which of the k contacts exert a force, all by default; `weights` (n,)
        are D; velocities v (N, n), 0 by default, are those of `rate`.
        """
        J, self._change, self.places = _contact_motion(structure, contacts, q, v)
        self._weights = weights_of(structure) if weights is None else weights
        if touching is not None:
            mask = np.repeat(touching, [contact.rows for contact in contacts], axis=1)[:, :, None]
            J = J * mask
            self._change = self._change * mask
        idle = ~J.any(axis=2)
        weighted = J * self._weights
        self._square = weighted @ np.swapaxes(J, 1, 2)
        sample, row = np.nonzero(idle)
        self._square[sample, row, row] = 1.0  # of a contact without a force, whose rows of J are 0
        self._J = J
        self.to_force = np.linalg.solve(self._square, weighted)
        self.E = np.eye(structure.n) - np.swapaxes(J, 1, 2) @ self.to_force

    @cached_property
    def condition(self) -> Array:
        """(N,) condition of J D Jᵀ: large where a leg is stretched and its force uncertain."""
        eigenvalues = np.linalg.eigvalsh(self._square)
        return np.asarray(eigenvalues[:, -1] / np.maximum(eigenvalues[:, 0], 1e-300))

    @cached_property
    def rate(self) -> Array:
        """(N, n, n) Ė; see the module."""
        pushes = np.swapaxes(np.linalg.solve(self._square, self._J), 1, 2)
        first = (self.E @ np.swapaxes(self._change, 1, 2)) @ self.to_force
        return -first - pushes @ ((self._change * self._weights) @ self.E)


def without_contact_forces(structure: Structure, q: Array, rows: Array) -> Array:
    """(N, n, p) E times rows (N, n, p) at positions q (N, m), 0 where they hold no balance."""
    eliminated = Elimination(structure, structure.contacts, q).E @ rows
    eliminated[:, ~balanced_rows(structure)] = 0.0
    return eliminated


def eliminated_balance(
    structure: Structure,
    positions: tuple[Array, Array],
    velocities: tuple[Array, Array],
    momenta: tuple[Array, Array],
    drives: tuple[Array, Array, Array],
) -> tuple[Array, Array, Array, Array]:
    """The terms of the filtered momentum balance without the contacts' forces.

    d/dt (E W_M θ) = (Ė W_M + E Ψ) θ, since E Jᵀ λ = 0; Ψ is F and the regressor of Cᵀ v.

    Args:
        structure: the robot, with its contacts.
        positions: (N, m) at the samples and (N−1, m) half-way between.
        velocities: (N, n) and (N−1, n).
        momenta: (N, n, p) and (N−1, n, p) W_M(q, v).
        drives: (N−1, n, p) each, a W_M + Ψ at start, middle and end of every step.

    Returns:
        What `SecondOrderSystem.momentum_balance` returns, 0 in the rows without a balance.
    """
    contacts = structure.contacts
    at, between = (
        Elimination(structure, contacts, q, v=v) for q, v in zip(positions, velocities, strict=True)
    )
    kept = np.flatnonzero(balanced_rows(structure))

    def placed(rows: Array) -> Array:
        whole = np.zeros((len(rows), structure.n, momenta[0].shape[2]))
        whole[:, kept] = rows
        return whole

    E, middle = at.E[:, kept], between.E[:, kept]
    turning = at.rate[:, kept] @ momenta[0]
    start, half, end = drives
    return (
        placed(E @ momenta[0]),
        placed(E[:-1] @ start + turning[:-1]),
        placed(middle @ half + between.rate[:, kept] @ momenta[1]),
        placed(E[1:] @ end + turning[1:]),
    )
