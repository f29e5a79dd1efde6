"""Kinds of columns on a joint: one force or torque each, per unit of the parameter."""

from functools import partial

import numpy as np

from ...numerics.kernels import f8, helper, index, routine, table, vector
from ..arrays import AT_Q, AT_V, CIRCLE, FALL, FRAME, KIND, PARENT, POSITION
from ..spatial import add_cross, clear, dot, rotate
from .curve import follow_curve
from .kind import CURVE, LISTED, Constants, Kind

(
    VISCOUS,
    QUADRATIC,
    CUBIC,
    COULOMB,
    STRIBECK,
    LOAD,
    OFFSET,
    SPRING,
    MOTOR,
    SERVO,
    SHARED_VISCOUS,
    SHARED_COULOMB,
) = range(12)
_SPEED: Constants = {"speed": (1, 0.05)}
_FORCE = ("N·m", "N")
_DAMPING = ("N·m·s/rad", "N·s/m")
_DRAG = ("N·m·s²/rad²", "N·s²/m²")
_STIFFNESS = ("N·m/rad", "N/m")
_drive = partial(Kind, share=1.0, actuator=True, commanded=True, drawn="ring")

KINDS = (
    Kind(VISCOUS, "viscous", "viscous friction", "viscous", _DAMPING, share=0.2),
    Kind(QUADRATIC, "quadratic", "quadratic friction", "quadratic", _DRAG, "free"),
    Kind(CUBIC, "cubic", "cubic friction", "cubic", ("N·m·s³/rad³", "N·s³/m³"), "free"),
    Kind(COULOMB, "coulomb", "Coulomb friction", "coulomb", _FORCE, share=0.2, constants=_SPEED),
    Kind(
        STRIBECK,
        "stribeck",
        "Stribeck friction",
        "stribeck",
        _FORCE,
        constants={**_SPEED, "stribeck": (1, 0.13)},
    ),
    Kind(
        LOAD,
        "load",
        "load-dependent friction",
        "load",
        ("1", "1"),
        share=0.05,
        constants={**_SPEED, "bodies": (LISTED, None)},
    ),
    Kind(
        OFFSET,
        "offset",
        "offset",
        "offset",
        _FORCE,
        "free",
        share=0.05,
        reads="",
        constants={"force": (1, 1.0)},
    ),
    Kind(
        SPRING,
        "spring",
        "stiffness",
        "stiffness",
        _STIFFNESS,
        constants={"rest": (1, 0.0)},
        drawn="ring",
        reads="pose",
    ),
    _drive(
        MOTOR,
        "motor",
        "motor gain",
        "gain",
        ("N·m/unit", "N/unit"),
        constants={"curve": (CURVE, 1.0)},
        reads="",
    ),
    _drive(
        SERVO,
        "servo",
        "servo gain",
        "kp",
        _STIFFNESS,
        constants={"limit": (1, np.inf)},
        reads="pose",
    ),
    # friction of a motor that turns by v ± v_other, on one of the two joints; this joint's own
    # viscous part belongs to its own viscous friction
    Kind(
        SHARED_VISCOUS,
        "shared_viscous",
        "shared viscous friction",
        "shared_viscous",
        _DAMPING,
        "free",
        constants={"other": (1, None)},
    ),
    Kind(
        SHARED_COULOMB,
        "shared_coulomb",
        "shared Coulomb friction",
        "shared_coulomb",
        _FORCE,
        "free",
        constants={"other": (1, None), "sign": (1, 1.0), **_SPEED},
    ),
)


@helper(f8(table, index, vector))
def coordinate(bodies, b, q):
    """Angle or travel of a body's joint."""
    at = bodies[b, AT_Q]
    if bodies[b, KIND] == CIRCLE:
        return np.arctan2(q[at + 1], q[at])
    return q[at]


@helper(f8(index, vector, index, f8, vector))
def shared_friction(kind, c, at, rate, v):
    """Friction of a motor that turns with this joint and another; v (n,) are all velocities."""
    other = v[int(c[at])]
    if kind == SHARED_VISCOUS:
        return -other
    return -np.tanh((rate + c[at + 1] * other) / c[at + 2])


@helper(f8(index, vector, index, f8))
def slope_by_other(kind, c, at, force):
    """∂/∂v_other of `shared_friction`, whose value is given."""
    if kind == SHARED_VISCOUS:
        return -1.0
    return c[at + 1] * (force * force - 1.0) / c[at + 2]


@routine(f8(vector, index, table, index, vector, index, vector))
def _weight_on_joint(c, at, bodies, b, state, ground, x):
    """Generalised force on a joint due to the weight of the bodies it carries.

    c[at] counts the numbers that follow: body, mass and first moment in body axes (3) of every body
    with a nominal weight.
    """
    axis = (bodies.shape[0] + bodies[b, AT_V]) * FRAME
    total = 0.0
    for k in range(at + 1, at + 1 + int(c[at]), 5):
        body = int(c[k])
        own = body
        while own > b:  # a parent's number is smaller
            own = bodies[own, PARENT]
        if own == b:
            rotate(state, body * FRAME, c, k + 2, x, 0)
            clear(x, 6, 6)
            for i in range(3):
                x[i] += c[k + 1] * state[body * FRAME + POSITION + i]
                x[6 + i] = c[k + 1] * state[ground + FALL + i]
            add_cross(x, 0, state, ground + FALL, 1.0, x, 9)
            total += dot(state, axis, x, 6)
    return total


@helper(f8(index, vector, index, f8))
def friction(kind, c, at, v):
    """Force of a column that depends on the joint's velocity alone."""
    if kind == VISCOUS:
        return -v
    if kind == COULOMB:
        return -np.tanh(v / c[at])
    if kind == QUADRATIC:
        return -abs(v) * v
    if kind == CUBIC:
        return -v * v * v
    # Stribeck's: what friction loses with speed, above Coulomb's
    return -np.tanh(v / c[at]) * np.exp(-((v / c[at + 1]) ** 2))


@helper(f8(index, vector, index, f8, f8, f8))
def force_alone(kind, c, at, angle, v, u):
    """Force of a column that depends on its own joint only; see `joint_force`."""
    if kind <= STRIBECK:
        return friction(kind, c, at, v)
    if kind == OFFSET:
        return c[at]
    if kind == SPRING:
        return c[at] - angle
    if kind == MOTOR:
        return follow_curve(c, at, u)
    if kind == SERVO:
        return min(max(u - angle, -c[at]), c[at])
    return np.nan


@routine(f8(index, vector, index, table, index, vector, index, f8, f8, vector, f8, vector))
def joint_force(kind, c, at, bodies, b, state, ground, angle, rate, v, u, x):
    """Force of a column on the joint of body b, per unit of its parameter.

    c are the constants of all columns, this one's from `at` on; `ground` is where the row of the
    ground begins in the state; angle (or travel) and rate are the joint's, v (n,) all velocities;
    u is the command, 0 if the column reads none; x is a workspace of twelve numbers.
    """
    if kind == LOAD:  # on the weight of nominal bodies
        weight = _weight_on_joint(c, at + 1, bodies, b, state, ground, x)
        return -np.tanh(rate / c[at]) * abs(weight)
    if kind >= SHARED_VISCOUS:
        return shared_friction(kind, c, at, rate, v)
    return force_alone(kind, c, at, angle, rate, u)
