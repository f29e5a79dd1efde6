"""The force regressor F at one sample, as its entries that can differ from 0."""

from ..numerics.kernels import f8, helper, index, inlined, kernel, table, vector, void
from .arrays import (
    AT,
    AT_V,
    CONSTANTS,
    COUNT,
    FALL,
    FRAME,
    FREE,
    INPUT,
    KIND,
    NONZEROS,
    NOTHING,
    PARENT,
    READS,
    SORT,
    TWIST,
)
from .columns.curve import follow_curve
from .columns.fluid import FLUID_KINDS, GRAVITY, UP, write_fluid
from .columns.fluid import F as WRENCH
from .columns.joint import MOTOR, STRIBECK, coordinate, friction, joint_force
from .columns.thrust import THRUST_KINDS, write_thrust
from .columns.wheels import write_wheel
from .compiled import STRUCTURE
from .spatial import clear, dot, into_body, out_of_body, unrotate

BODY_KINDS = 100
ALL, COMMANDED, MOVING, ROLLING = range(4)
"""The columns to write: all, those that read a command, those that change while it is held, those
of wheels."""
_COMMON = 18  # in the scratch: a wrench in the common frame


@helper(void(vector, index, index, vector))
def write_surroundings(state, frame, ground, x):
    """Writes a body's twist, the upward direction and gravity, in its axes."""
    into_body(state, frame, state, frame + TWIST, x, 0)
    unrotate(state, frame, state, ground, x, UP)
    unrotate(state, frame, state, ground + FALL, x, GRAVITY)


@helper(void(index, vector, index, f8, vector))
def write_wrench(kind, c, own, command, x):
    """Writes the wrench of a column on a body, in its axes, per unit of its parameter."""
    clear(x, WRENCH, 6)
    if kind < FLUID_KINDS:
        write_fluid(kind, c, own, x)
    elif kind < THRUST_KINDS:
        write_thrust(kind, c, own, x, command)
    else:
        write_wheel(kind, c, own, x, command)


@helper(void(table, table, vector, index, vector, vector, index, index))
def project(bodies, nonzeros, state, b, x, F, to, end):
    """Writes the generalised forces of the wrench in x on body b into F[to : end]."""
    if bodies[b, KIND] == FREE:
        for z in range(to, end):
            F[z] = x[WRENCH + nonzeros[z, 0]]
        return
    out_of_body(state, b * FRAME, x, WRENCH, x, _COMMON)
    while b >= 0:
        first = bodies[b, AT_V]
        for j in range(first, first + bodies[b, COUNT]):
            F[to] = dot(state, (bodies.shape[0] + j) * FRAME, x, _COMMON)
            to += 1
        b = bodies[b, PARENT]


@kernel(void(STRUCTURE, vector, vector, vector, vector, index, vector, vector), inner=True)
def write_forces(structure, state, q, v, u, which, x, F):
    """Writes the entries of F that can differ from 0 into F (z,), at one sample.

    state (s,) is that of `kinematics.place` at q (m,) and v (n,); u (n_u,) are the commands,
    `which` is `ALL`, or says which entries to write, and x (SCRATCH,) is workspace.
    """
    bodies = structure.bodies
    columns = structure.columns
    c = structure.constants
    seen = -1
    nonzeros = structure.nonzeros
    ground = (bodies.shape[0] + v.shape[0]) * FRAME
    for k in range(columns.shape[0]):
        kind = columns[k, SORT]
        b = columns[k, AT]
        own = columns[k, CONSTANTS]
        on_body = kind >= BODY_KINDS
        if which == COMMANDED and columns[k, INPUT] < 0:
            continue
        if which == ROLLING and kind < THRUST_KINDS:
            continue
        held = columns[k, READS] == NOTHING and (not on_body or bodies[b, KIND] == FREE)
        if which == MOVING and held:
            continue
        command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
        to = columns[k, NONZEROS]
        if not on_body:
            rate = v[bodies[b, AT_V]]
            if kind <= STRIBECK:
                F[to] = friction(kind, c, own, rate)
            elif kind == MOTOR:
                F[to] = follow_curve(c, own, command)
            else:
                angle = coordinate(bodies, b, q)
                F[to] = joint_force(
                    kind, c, own, bodies, b, state, ground, angle, rate, v, command, x
                )
                seen = -1
            continue
        if b != seen:
            write_surroundings(state, b * FRAME, ground, x)
            seen = b
        write_wrench(kind, c, own, command, x)
        end = columns[k + 1, NONZEROS] if k + 1 < columns.shape[0] else nonzeros.shape[0]
        project(bodies, nonzeros, state, b, x, F, to, end)


forces_inline = inlined(write_forces)
