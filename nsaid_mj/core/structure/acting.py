"""What acts on a structure beyond its bodies' own motion, for a plant that integrates the bodies.

A plant calls one of two functions with its own state: `act` if any force depends on the bodies'
poses or there is inertia beyond the bodies', `act_on_joints` otherwise.
"""

from ..numerics.kernels import boolean, helper, vector, void
from .arrays import (
    AT,
    AT_V,
    CONSTANTS,
    INPUT,
    PARAMETER,
    RIGID,
    SORT,
    TEN,
    Array,
    StructureArrays,
)
from .columns import KINDS, joint
from .columns.joint import force_alone
from .compiled import STRUCTURE, WORKSPACE
from .forces import ALL, ROLLING, write_forces
from .forward_dynamics import write_equations
from .kinematics import place
from .structure import Structure

_NEAR = {kind.name for kind in joint.KINDS if kind.name != "load"}


def has_added_inertia(structure: Structure, theta: Array) -> bool:
    """Whether θ (p,) has inertia beyond that of rigid bodies."""
    tensors = (i for i in structure.inertias if i.tensor is not None)
    return any(theta[i.start : i.start + i.tensor.shape[2]].any() for i in tensors)


def acts_on_bodies(structure: Structure, theta: Array) -> bool:
    """Whether `act` is needed at θ (p,), because something depends on the bodies' poses."""
    acting = (column for column in structure.columns if theta[column.parameter])
    return has_added_inertia(structure, theta) or any(c.kind not in _NEAR for c in acting)


def acting_arrays(structure: Structure, theta: Array) -> StructureArrays:
    """The structure's arrays, without rigid bodies if θ (p,) has none."""
    arrays = structure.arrays
    tens = [i.start for i in structure.inertias if i.tensor is None]
    if any(theta[k : k + 10].any() for k in tens):
        return arrays
    bodies = arrays.bodies.copy()
    bodies[:, TEN] = -1
    bodies[:, RIGID] = 0
    return arrays._replace(bodies=bodies)


def gains_of_commands(structure: Structure) -> list[list[int]]:
    """For every command, the indices of the parameters that scale it."""
    acting = [c for c in structure.columns if KINDS[c.kind].actuator]
    commands = range(structure.n_u)
    return [sorted({c.parameter for c in acting if c.input == k}) for k in commands]


@helper(void(STRUCTURE, vector, vector, vector, vector, vector))
def act_on_joints(structure, theta, angles, rates, u, force):
    """Adds the forces of columns on joints to force (n,).

    angles (n,) and rates (n,) are those of every velocity's joint, u (n_u,) the commands, theta
    (p,) the parameters.
    """
    bodies = structure.bodies
    columns = structure.columns
    constants = structure.constants
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


@helper(
    void(
        STRUCTURE,
        vector,
        vector,
        vector,
        vector,
        vector,
        boolean,
        boolean,
        WORKSPACE,
        vector,
        vector,
        vector,
    )
)
def act(structure, theta, q, v, ground, u, added, flowing, work, state, F, force):
    """Writes the generalised forces F θ − C v (n,), and the lower triangle of M into work.M.

    M and C are those of `structure`, whose rigid bodies the plant may have taken out.

    Args:
        structure: the robot.
        theta: (p,) parameters.
        q: (m,) position.
        v: (n,) velocity relative to the fluid.
        ground: (n,) velocity relative to the ground, which wheels see.
        u: (n_u,) commands.
        added: whether there is any inertia; if not, M is not written and C v is 0.
        flowing: whether the two velocities differ.
        work: workspace.
        state: (s,) workspace; afterwards the state at `ground` if flowing, else at v.
        F: (z,) workspace.
        force: (n,) written.
    """
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
