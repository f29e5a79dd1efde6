"""Kinds of columns of thrusters, nozzles, rotors, propellers and fins; see `fluid`."""

from functools import partial

import numpy as np

from ...numerics.kernels import f8, helper, index, vector, void
from ..spatial import add_cross
from .curve import follow_curve
from .fluid import FLOW_OF, WRENCH_OF, F
from .kind import CURVE, Constants, Kind

(
    THRUSTER,
    NOZZLE,
    ROTOR,
    ROTOR_TORQUE,
    ROTOR_INFLOW,
    ROTOR_DRAG,
    ROTOR_DAMPING,
    PROPELLER,
    PROPELLER_TORQUE,
    FIN,
    FIN_DRAG,
    THRUST_KINDS,
) = range(200, 212)
_POINT: Constants = {"point": (3, None)}
_ABOUT: Constants = {"direction": (3, None)}
_PLACE: Constants = {**_POINT, **_ABOUT}
_CURVED: Constants = {**_PLACE, "curve": (CURVE, 1.0)}
_SQUARED: Constants = {**_PLACE, "curve": (CURVE, 2.0)}
_SPUN: Constants = {**_ABOUT, "curve": (CURVE, 2.0)}
_SLIPPING: Constants = {**_PLACE, "slip": (1, 0.0)}
_gain = partial(Kind, actuator=True, commanded=True)
_pushes = partial(_gain, share=1.0, drawn="arrow")
_turns = partial(_gain, drawn="ring", reads="")
_steers = partial(_gain, drawn="arrow")
_drags = partial(Kind, commanded=True, constants=_PLACE)

KINDS = (
    _pushes(THRUSTER, "thruster", "thruster gain", "thrust", "N", constants=_CURVED, reads=""),
    _pushes(NOZZLE, "nozzle", "nozzle gain", "nozzle", "N", constants=_CURVED, reads=""),
    _pushes(ROTOR, "rotor", "rotor thrust gain", "thrust", "N", constants=_SQUARED, reads=""),
    _turns(ROTOR_TORQUE, "rotor_torque", "rotor torque gain", "torque", "N·m", constants=_SPUN),
    Kind(
        ROTOR_INFLOW,
        "rotor_inflow",
        "translational lift",
        "lift",
        "N·s²/m²",
        "free",
        constants=_PLACE,
    ),
    _drags(ROTOR_DRAG, "rotor_drag", "rotor drag", "rotor_drag_h", "N·s/m"),
    _drags(ROTOR_DAMPING, "rotor_damping", "rotor damping", "rotor_drag_z", "N·s/m"),
    _pushes(PROPELLER, "propeller", "propeller gain", "thrust", "N", constants=_SLIPPING),
    _turns(
        PROPELLER_TORQUE, "propeller_torque", "propeller gain", "torque", "N·m", constants=_ABOUT
    ),
    _steers(FIN, "fin", "fin lift", "fin lift", "N·s²/m²/rad", constants=_PLACE),
    _steers(FIN_DRAG, "fin_drag", "fin drag", "fin drag", "N·s²/m²/rad²", constants=_POINT),
)


@helper(void(vector, index, f8, vector))
def write_push(c, at, force, x):
    """Writes the wrench of a force along the direction c[at + 3] at the point c[at]."""
    for i in range(3):
        x[F + i] = force * c[at + 3 + i]
    add_cross(c, at, x, F, 1.0, x, F + 3)


@helper(f8(vector, index, vector))
def speed_along(c, at, x):
    """Velocity of the point c[at] along the direction c[at + 3]."""
    return (
        c[at + 3] * (x[0] + x[4] * c[at + 2] - x[5] * c[at + 1])
        + c[at + 4] * (x[1] + x[5] * c[at] - x[3] * c[at + 2])
        + c[at + 5] * (x[2] + x[3] * c[at + 1] - x[4] * c[at])
    )


@helper(void(vector, index, vector))
def write_across(c, at, x):
    """Writes the velocity of the point c[at] across the direction c[at + 3] into f (3)."""
    along = speed_along(c, at, x)
    for i in range(3):
        x[F + i] = x[i] - along * c[at + 3 + i]
    add_cross(x, 3, c, at, 1.0, x, F)


@helper(FLOW_OF)
def rotor_inflow(c, at, x):
    """Thrust by the square of the flow across the rotor's axis."""
    write_across(c, at, x)
    write_push(c, at, x[F] * x[F] + x[F + 1] * x[F + 1] + x[F + 2] * x[F + 2], x)


@helper(WRENCH_OF)
def rotor_drag(c, at, x, u):
    """−|u| times the rotor's velocity across its axis."""
    write_across(c, at, x)
    for i in range(3):
        x[F + i] *= -abs(u)
    add_cross(c, at, x, F, 1.0, x, F + 3)


@helper(WRENCH_OF)
def fin(c, at, x, u):
    """Lift |v_x| (v_x u − sideways flow) of a fin deflected by u, to first order in its angle."""
    write_push(c, at, abs(x[0]) * (x[0] * u - speed_along(c, at, x)), x)


@helper(WRENCH_OF)
def fin_drag(c, at, x, u):
    """Drag |v_x| v_x u² of a fin deflected by u, astern."""
    x[F] = -abs(x[0]) * x[0] * u * u
    add_cross(c, at, x, F, 1.0, x, F + 3)


@helper(void(index, vector, index, vector, f8))
def write_thrust(kind, c, at, x, u):
    """Writes the wrench of a kind of this file."""
    if kind in (THRUSTER, NOZZLE, ROTOR):
        write_push(c, at, follow_curve(c, at + 6, u), x)
    elif kind == ROTOR_TORQUE:  # on the body, about the direction
        for i in range(3):
            x[F + 3 + i] = follow_curve(c, at + 3, u) * c[at + i]
    elif kind == ROTOR_INFLOW:
        rotor_inflow(c, at, x)
    elif kind == ROTOR_DRAG:
        rotor_drag(c, at, x, u)
    elif kind == ROTOR_DAMPING:
        write_push(c, at, -abs(u) * speed_along(c, at, x), x)
    elif kind == PROPELLER:  # its curve over the advance ratio, to first order
        write_push(c, at, abs(u) * (u - c[at + 6] * speed_along(c, at, x)), x)
    elif kind == PROPELLER_TORQUE:
        for i in range(3):
            x[F + 3 + i] = -abs(u) * u * c[at + i]
    elif kind == FIN:
        fin(c, at, x, u)
    elif kind == FIN_DRAG:
        fin_drag(c, at, x, u)
    else:
        x[F] = np.nan
