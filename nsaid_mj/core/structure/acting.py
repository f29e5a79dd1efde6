"""What acts on a structure beyond its bodies' own motion, for a plant that integrates the bodies.

A plant keeps an `Acting` in its own memory, and calls one of two functions with its own state:
`act` if `Structure.acts_on_bodies`, `act_on_joints` otherwise.
"""

from typing import NamedTuple

from numba import types

from ..numerics.kernels import boolean, helper, matrix, table, vector, void
from .arrays import (
    AT,
    AT_V,
    CONSTANTS,
    INPUT,
    PARAMETER,
    SORT,
    Array,
    Integers,
    StructureArrays,
    Workspace,
)
from .columns.joint import force_alone
from .compiled import STRUCTURE, WORKSPACE
from .forces import ALL, ROLLING, write_forces
from .forward_dynamics import write_equations
from .kinematics import place


class Acting(NamedTuple):
    """A structure at some θ, and the workspace of `act`: flat, as one part of a plant's memory."""

    # the fields of `StructureArrays`
    bodies: Integers
    joints: Array
    gravity: Array
    rotors: Integers
    entries: Integers
    values: Array
    terms: Integers
    columns: Integers
    constants: Array
    nonzeros: Integers
    theta: Array  # (p,) parameters
    # the fields of `Workspace`
    motion: Array
    inertia: Array
    M: Array
    L: Array
    rows: Array
    scratch: Array
    state: Array  # (s,) after `act` the state at the velocity on the ground if there is a flow
    F: Array  # (z,) entries of F


ACTING = types.NamedTuple(
    (
        *(table, vector, vector, table, table, vector, table, table, vector, table),
        vector,
        *(vector, vector, matrix, matrix, matrix, vector),
        *(vector, vector),
    ),
    Acting,
)
"""The type of `Acting` in signatures of compiled functions."""


@helper(STRUCTURE(ACTING))
def _structure(acting):
    """The structure."""
    return StructureArrays(
        acting.bodies,
        acting.joints,
        acting.gravity,
        acting.rotors,
        acting.entries,
        acting.values,
        acting.terms,
        acting.columns,
        acting.constants,
        acting.nonzeros,
    )


@helper(WORKSPACE(ACTING))
def _workspace(acting):
    """The workspace of a stage."""
    return Workspace(acting.motion, acting.inertia, acting.M, acting.L, acting.rows, acting.scratch)


@helper(void(ACTING, vector, vector, vector, vector))
def act_on_joints(acting, angles, rates, u, force):
    """Adds the forces of columns on joints to force (n,).

    angles (n,) and rates (n,) are those of every velocity's joint, u (n_u,) the commands.
    """
    theta = acting.theta
    bodies = acting.bodies
    columns = acting.columns
    constants = acting.constants
    for k in range(columns.shape[0]):
        gain = theta[columns[k, PARAMETER]]
        if gain == 0.0:
            continue
        i = bodies[columns[k, AT], AT_V]
        own = columns[k, CONSTANTS]
        command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
        force[i] += gain * force_alone(
            columns[k, SORT], constants, own, angles[i], rates[i], command
        )


@helper(void(ACTING, vector, vector, vector, vector, boolean, boolean, vector))
def act(acting, q, v, ground, u, added, flowing, force):
    """Writes the generalised forces F θ − C v (n,), and the lower triangle of M into acting.M.

    M and C are those of the structure, whose rigid bodies the plant may have taken out.

    Args:
        acting: the robot and its parameters.
        q: (m,) position.
        v: (n,) velocity relative to the fluid.
        ground: (n,) velocity relative to the ground, which wheels see.
        u: (n_u,) commands.
        added: whether there is any inertia; if not, M is not written and C v is 0.
        flowing: whether the two velocities differ.
        force: (n,) written.
    """
    structure = _structure(acting)
    work = _workspace(acting)
    theta = acting.theta
    state = acting.state
    F = acting.F
    place(structure, q, v, state)
    if added:
        write_equations(structure, state, v, theta, work, force)
    else:
        for i in range(force.shape[0]):
            force[i] = 0.0
    nonzeros = structure.nonzeros
    write_forces(structure, state, q, v, u, ALL, work.scratch, F)
    if flowing:
        place(structure, q, ground, state)
        write_forces(structure, state, q, v, u, ROLLING, work.scratch, F)
    for z in range(nonzeros.shape[0]):
        force[nonzeros[z, 0]] += F[z] * theta[nonzeros[z, 1]]
