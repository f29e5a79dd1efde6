"""States of a robot whose contacts obey the dynamics, and P_s(θ) of E W along them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..parameters import Array
from ..structure.contacts import Elimination, contact_accelerations, contact_jacobians
from ..structure.system import SecondOrderSystem


class States(NamedTuple):
    """States of N samples, with accelerations and contacts' forces that obey the dynamics."""

    q: Array  # (N, m) positions
    v: Array  # (N, n) velocities
    u: Array  # (N, n_u) commands
    a: Array  # (N, n) accelerations v̇
    force: Array  # (N, c) λ, with W θ = Jᵀ λ


def random_states(
    system: SecondOrderSystem,
    theta: Array,
    rng: np.random.Generator,
    touching: NDArray[np.bool_],
    standing: bool,
) -> States:
    """Random states under θ (p,), in which a mask (N, k) of the k contacts touch.

    Contacts that are `standing` neither slip nor roll off: J v = 0, and J v̇ + J̇ v = 0 determines λ.
    Others may slip and sink in, under a random λ of the size of the other forces.
    """
    contacts = system.structure.contacts
    drawn = [system.random_state(rng) for _ in range(len(touching))]
    q, v, u = (np.array(part) for part in zip(*drawn, strict=True))
    J, _ = contact_jacobians(system.structure, contacts, q)
    mask = np.repeat(touching, [contact.rows for contact in contacts], axis=1)
    J = J * mask[:, :, None]
    back = np.swapaxes(J, 1, 2)
    if standing:
        v = v - (np.linalg.pinv(J) @ (J @ v[:, :, None]))[:, :, 0]
    x = np.hstack([q, v])
    M = system.mass_matrix(x, theta)
    free = system.acceleration(np.zeros(len(q)), x, v, u, theta)
    compliance = np.linalg.solve(M, back)
    if standing:
        drift = contact_accelerations(system.structure, contacts, q, v) * mask
        missing = -drift - (J @ free[:, :, None])[:, :, 0]
    else:
        size = np.abs(J @ free[:, :, None])[:, :, 0].mean()
        missing = size * rng.standard_normal(mask.shape) * mask
    force = (np.linalg.pinv(J @ compliance) @ missing[:, :, None])[:, :, 0] * mask
    return States(q, v, u, free + (compliance @ force[:, :, None])[:, :, 0], force)


def ground_stack(
    system: SecondOrderSystem,
    theta: Array,
    rng: np.random.Generator,
    touching: NDArray[np.bool_],
    standing: bool = False,
) -> Array:
    """(N n, p) rows of E W·diag(scale) at the states of `random_states`, for `subspace.split`.

    The forces of all contacts that touch are eliminated, and of no others.
    """
    states = random_states(system, theta, rng, touching, standing)
    W = system.regressor(
        np.zeros(len(touching)), np.hstack([states.q, states.v]), states.v, states.a, states.u
    )
    structure = system.structure
    level = np.ones(system.n)  # rows of any weights span the same; these are well-conditioned
    E = Elimination(structure, structure.contacts, states.q, touching, level).E
    return (E @ (W * system.space.scale)).reshape(-1, system.p)
