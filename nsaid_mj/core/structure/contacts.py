"""Contacts whose forces nobody measures: where they act, and W without them.

A contact's force λ is unknown, but not where it acts: W θ = Jᵀ λ, with J the Jacobian of the
contact points. Every E with E Jᵀ = 0 removes it whatever it is: **E W θ = 0** is linear and
homogeneous in θ as (13), for every λ, friction cone, slip or soft ground. P(θ) is then the
nullspace of E W. With positive weights D,

    E = 1 − Jᵀ (J D Jᵀ)⁻¹ J D,        λ̂ = (J D Jᵀ)⁻¹ J D W θ.

It takes from every row the force that these rows ascribe to the contacts, so a row keeps its
meaning and its unit. With weights that are small for a floating base, λ̂ comes from the legs'
joints: the base's rows become the balance of the whole robot, and the rows of a leg with as many
joints as its foot has components vanish.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..parameters import Array
from .arrays import FRAME, POSITION
from .configuration_space import plain
from .kinematics import place_along
from .structure import Structure

_OF_BASE = 1e-6  # weight of a base's rows over a joint's: the legs alone tell the contacts' forces


@dataclass(frozen=True, eq=False)
class ContactPoint:
    """Where a body touches its surroundings.

    Attributes:
        body: number of the body.
        centre: (3,) point in the body's frame [m]; the centre of a round foot.
        radius: radius of a round foot, which touches at its lowest point [m]; 0 for a point.
        flat: whether the contact also exerts a torque, as a flat foot's: six rows instead of three.
        normal: (3,) outward normal of the surface in world axes; None for the vertical.
        name: name, for messages.
    """

    body: int
    centre: ArrayLike
    radius: float = 0.0
    flat: bool = False
    normal: ArrayLike | None = None
    name: str = ""

    @property
    def rows(self) -> int:
        """Number of components of its force: 3, or 6 with a torque."""
        return 6 if self.flat else 3


def contact_jacobians(
    structure: Structure, contacts: list[ContactPoint], q: Array
) -> tuple[Array, Array]:
    """(N, c, n) J and (N, k, 3) the places of k contacts at positions q (N, m).

    Both are in the common frame: of a floating base its own at each sample, else the world's. Rows
    follow one another contact by contact, forces [linear, then angular if flat].
    """
    n = structure.n
    bodies = len(structure.bodies)
    length = (bodies + n + 1) * FRAME + 36 * len(structure.arrays.terms)
    states = np.empty((len(q), max(length, len(structure.memory()[1].state))))
    place_along(structure.arrays, plain(q), np.zeros((len(q), n)), states)
    axes = states[:, bodies * FRAME : (bodies + n) * FRAME].reshape(len(q), n, FRAME)[:, :, :6]
    ground = states[:, (bodies + n) * FRAME :]
    J = np.zeros((len(q), sum(contact.rows for contact in contacts), n))
    places = np.empty((len(q), len(contacts), 3))
    first = 0
    for k, contact in enumerate(contacts):
        frame = states[:, contact.body * FRAME : (contact.body + 1) * FRAME]
        rotation = frame[:, :9].reshape(-1, 3, 3)
        point = frame[:, POSITION : POSITION + 3] + rotation @ np.asarray(contact.centre, float)
        if contact.radius:
            point = point - contact.radius * _normals(structure, contact, q, ground)
        places[:, k] = point
        moving = structure.path(contact.body)
        linear = axes[:, moving, :3] + np.cross(axes[:, moving, 3:], point[:, None])
        J[:, first : first + 3, moving] = np.swapaxes(linear, 1, 2)
        if contact.flat:
            J[:, first + 3 : first + 6, moving] = np.swapaxes(axes[:, moving, 3:], 1, 2)
        first += contact.rows
    return J, places


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


class Elimination:
    """E and λ̂ of contacts at N samples.

    Attributes:
        E: (N, n, n) with E Jᵀ = 0.
        to_force: (N, c, n) with λ̂ = to_force · (W θ); forces and torques in the common frame.
        places: (N, k, 3) places of the contacts in the common frame [m].
        condition: (N,) condition of J D Jᵀ: large where a leg is stretched and its force uncertain.
    """

    def __init__(
        self,
        structure: Structure,
        contacts: list[ContactPoint],
        q: Array,
        touching: NDArray[np.bool_] | None = None,
        weights: Array | None = None,
    ):
        """At positions q (N, m).

        `touching` (N, k) says which of the k contacts exert a force, all by default; `weights` (n,)
        are D.
        """
        J, self.places = contact_jacobians(structure, contacts, q)
        D = weights_of(structure) if weights is None else weights
        if touching is not None:
            J = J * np.repeat(touching, [contact.rows for contact in contacts], axis=1)[:, :, None]
        idle = ~J.any(axis=2)
        weighted = J * D
        square = weighted @ np.swapaxes(J, 1, 2)
        sample, row = np.nonzero(idle)
        square[sample, row, row] = 1.0  # of a contact without a force, whose rows of J are 0
        eigenvalues = np.linalg.eigvalsh(square)
        self.condition = eigenvalues[:, -1] / np.maximum(eigenvalues[:, 0], 1e-300)
        self.to_force = np.linalg.solve(square, weighted)
        self.E = np.eye(structure.n) - np.swapaxes(J, 1, 2) @ self.to_force
