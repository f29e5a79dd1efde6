"""The force regressor F at one sample, as its entries that can differ from 0."""

from __future__ import annotations

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
    PARAMETER,
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
from .compiled import STRUCTURE, f8, helper, index, inlined, kernel, routine, table, vector, void
from .spatial import clear, dot, into_body, out_of_body, unrotate

BODY_KINDS = 100
ALL, COMMANDED, MOVING = range(3)
"""Which columns to write: all, those that read a command, those that change while it is held."""
_COMMON, _SUM = 18, 24  # in the scratch: a wrench in the common frame; the sum of wrenches


@helper(void(vector, index, index, vector))
def write_surroundings(state, frame, ground, x):
    """Writes what kinds on a body read: its twist, up and gravity, in its axes."""
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


@helper(void(table, vector, index, vector, vector))
def _add_projection(bodies, state, b, x, force):
    """Adds the generalised forces of the wrench in x on body b to force (n,)."""
    out_of_body(state, b * FRAME, x, WRENCH, x, _COMMON)
    while b >= 0:
        first = bodies[b, AT_V]
        for j in range(first, first + bodies[b, COUNT]):
            force[j] += dot(state, (bodies.shape[0] + j) * FRAME, x, _COMMON)
        b = bodies[b, PARENT]


@kernel(void(STRUCTURE, vector, vector, vector, vector, index, vector, vector), inner=True)
def write_forces(structure, state, q, v, u, which, x, F):
    """Writes the entries of F that can differ from 0 into F (z,), at one sample.

    state (s,) is that of `kinematics.place` at q (m,) and v (n,); u (n_u,) are the commands,
    `which` is `ALL`, `COMMANDED` or `MOVING`, and x (SCRATCH,) is workspace.
    """
    bodies, columns, c, seen = structure.bodies, structure.columns, structure.constants, -1
    nonzeros = structure.nonzeros
    ground = (bodies.shape[0] + v.shape[0]) * FRAME
    for k in range(columns.shape[0]):
        kind, b, own = columns[k, SORT], columns[k, AT], columns[k, CONSTANTS]
        on_body = kind >= BODY_KINDS
        if which == COMMANDED and columns[k, INPUT] < 0:
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


@routine(void(STRUCTURE, vector, vector, vector, vector, vector, vector, vector, vector))
def add_forces(structure, state, on_ground, q, v, u, theta, x, force):
    """Adds F θ to force (n,), without forming F.

    `state` and `on_ground` (s,) are those of `kinematics.place` at q (m,), with the velocity
    relative to water or air, and v (n,), that relative to the ground. u is (n_u,), theta (p,) and
    x (SCRATCH,) workspace.
    """
    bodies, columns, c = structure.bodies, structure.columns, structure.constants
    ground, seen, wheel = (bodies.shape[0] + v.shape[0]) * FRAME, -1, False
    clear(x, _SUM, 6)
    for k in range(columns.shape[0] + 1):
        last = k == columns.shape[0]
        kind, b, own = 0, -1, 0
        if not last:
            kind, b, own = columns[k, SORT], columns[k, AT], columns[k, CONSTANTS]
        rolls = kind >= THRUST_KINDS
        if seen >= 0 and (last or kind < BODY_KINDS or b != seen or rolls != wheel):
            for i in range(6):
                x[WRENCH + i] = x[_SUM + i]
            _add_projection(bodies, state, seen, x, force)
            clear(x, _SUM, 6)
            seen = -1
        if last or theta[columns[k, PARAMETER]] == 0.0:
            continue
        gain = theta[columns[k, PARAMETER]]
        command = u[columns[k, INPUT]] if columns[k, INPUT] >= 0 else 0.0
        if kind < BODY_KINDS:
            i = bodies[b, AT_V]
            angle = coordinate(bodies, b, q)
            force[i] += gain * joint_force(
                kind, c, own, bodies, b, state, ground, angle, v[i], v, command, x
            )
            continue
        if seen < 0:
            write_surroundings(on_ground if rolls else state, b * FRAME, ground, x)
            seen, wheel = b, rolls
        write_wrench(kind, c, own, command, x)
        for i in range(6):
            x[_SUM + i] += gain * x[WRENCH + i]
