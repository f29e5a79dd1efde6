"""Kinds of columns of weight, buoyancy, drag and lift: a wrench on a body, in its axes.

A kind's function takes the constants c, the index at of its own, x = [twist V (6), up (3), gravity
(3)] of the body in its axes, and the command u (0 if it reads none). It writes the wrench (6) per
unit of the parameter into zeros that follow in x.
"""

from functools import partial

import numpy as np

from ...numerics.kernels import f8, helper, index, vector, void
from ..spatial import add_cross
from .kind import LISTED, Constants, Kind

WRENCH_OF = void(vector, index, vector, f8)
FLOW_OF = void(vector, index, vector)
"""Signatures of a kind's function: (c, at, x), and (c, at, x) if it reads no command."""
UP = 6
GRAVITY = 9
F = 12
"""Where the other vectors begin in x, after the twist."""

(
    WEIGHT,
    BUOYANCY,
    RIGHTING,
    PAYLOAD,
    LINEAR_DRAG,
    QUADRATIC_DRAG,
    SPEED_DRAG,
    STRIP_DRAG,
    LIFT,
    LIFT_MOMENT,
    FLUID_KINDS,
) = range(100, 111)
_POINT: Constants = {"point": (3, 0.0)}
_AXIS: Constants = {"axis": (3, None)}
_AXES: Constants = {"axes": (6, None)}
_STRIPS: Constants = {**_AXIS, "strips": (LISTED, None)}
_LINEAR = ("N·m·s/rad", "N·s/m")
_SQUARE = ("N·m·s²/rad²", "N·s²/m²")
_weighs = partial(Kind, reads="pose")

KINDS = (
    _weighs(WEIGHT, "weight", "net weight", "net weight", "N", "free", constants=_POINT),
    _weighs(BUOYANCY, "buoyancy", "buoyancy", "buoyancy", "N", constants=_POINT),
    _weighs(RIGHTING, "righting", "righting moment", "righting", "N·m", "free", constants=_AXIS),
    _weighs(PAYLOAD, "payload", "payload", "payload", "kg", constants=_POINT),
    Kind(LINEAR_DRAG, "linear_drag", "linear drag", "d", _LINEAR, "free", constants=_AXES),
    Kind(QUADRATIC_DRAG, "drag", "quadratic drag", "dq", _SQUARE, "free", constants=_AXES),
    Kind(SPEED_DRAG, "speed_drag", "body drag", "drag", "N·s²/m²", constants=_AXES),
    Kind(STRIP_DRAG, "strip_drag", "link drag", "link_drag", "N·s²/m³", constants=_STRIPS),
    Kind(LIFT, "lift", "body lift", "lift", "N·s²/m²", "free", drawn="arrow"),
    Kind(LIFT_MOMENT, "lift_moment", "body lift moment", "lift moment", "N·s²/m", "free"),
)


@helper(FLOW_OF)
def buoyancy(c, at, x):
    """A force of 1 N upwards at a point."""
    for i in range(3):
        x[F + i] = x[UP + i]
    add_cross(c, at, x, UP, 1.0, x, F + 3)


@helper(FLOW_OF)
def payload(c, at, x):
    """The weight of 1 kg at a point; its inertia is among the robot's inertias."""
    for i in range(3):
        x[F + i] = x[GRAVITY + i]
    add_cross(c, at, x, GRAVITY, 1.0, x, F + 3)


@helper(FLOW_OF)
def strip_drag(c, at, x):
    """−|v_⊥| v_⊥ ds, summed over strips ds of a cylinder with a known axis.

    Constants: the axis (3), 4 k, and position (3) and length of k strips.
    """
    for k in range(at + 4, at + 4 + int(c[at + 3]), 4):
        px = c[k]
        py = c[k + 1]
        pz = c[k + 2]
        vx = x[0] + x[4] * pz - x[5] * py
        vy = x[1] + x[5] * px - x[3] * pz
        vz = x[2] + x[3] * py - x[4] * px
        along = c[at] * vx + c[at + 1] * vy + c[at + 2] * vz
        vx = vx - along * c[at]
        vy = vy - along * c[at + 1]
        vz = vz - along * c[at + 2]
        push = -c[k + 3] * np.sqrt(vx * vx + vy * vy + vz * vz)
        x[F] += push * vx
        x[F + 1] += push * vy
        x[F + 2] += push * vz
        x[F + 3] += push * (py * vz - pz * vy)
        x[F + 4] += push * (pz * vx - px * vz)
        x[F + 5] += push * (px * vy - py * vx)


@helper(void(index, vector, index, vector))
def write_fluid(kind, c, at, x):
    """Writes the wrench of a kind of this file."""
    if kind == WEIGHT:
        buoyancy(c, at, x)
        for i in range(6):
            x[F + i] = -x[F + i]
    elif kind == BUOYANCY:
        buoyancy(c, at, x)
    elif kind == RIGHTING:
        add_cross(c, at, x, UP, 1.0, x, F + 3)
    elif kind == PAYLOAD:
        payload(c, at, x)
    elif kind == LINEAR_DRAG:
        for i in range(6):
            x[F + i] = -c[at + i] * x[i]
    elif kind == QUADRATIC_DRAG:
        for i in range(6):
            x[F + i] = -c[at + i] * abs(x[i]) * x[i]
    elif kind == SPEED_DRAG:
        speed = np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
        for i in range(6):
            x[F + i] = -c[at + i] * speed * x[i]
    elif kind == STRIP_DRAG:
        strip_drag(c, at, x)
    elif kind == LIFT:  # of a body of revolution about x
        x[F + 1], x[F + 2] = -abs(x[0]) * x[1], -abs(x[0]) * x[2]
    elif kind == LIFT_MOMENT:  # of a lift behind the origin: turns the nose into the flow
        x[F + 4], x[F + 5] = -abs(x[0]) * x[2], abs(x[0]) * x[1]
