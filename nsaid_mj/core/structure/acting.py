"""What acts on a structure beyond its bodies' own motion, for a plant that integrates the bodies.

A plant calls one of two functions with its own state: `act` if `Structure.acts_on_bodies`,
`act_on_joints` otherwise.
"""

from ..numerics.kernels import boolean, helper, vector, void
from .arrays import (
    AT,
    AT_V,
    CONSTANTS,
    INPUT,
    PARAMETER,
    SORT,
)
from .columns.joint import force_alone
from .compiled import STRUCTURE, WORKSPACE
from .forces import ALL, ROLLING, write_forces
from .forward_dynamics import write_equations
from .kinematics import place


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
