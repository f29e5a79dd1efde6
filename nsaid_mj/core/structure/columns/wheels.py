"""Kinds of columns of wheels: tyres, drive and rolling resistance; see `fluid` for arguments."""

from functools import partial

import numpy as np

from ...numerics.kernels import f8, helper, index, vector, void
from .fluid import WRENCH_OF, F
from .kind import Constants, Kind

TYRE, ROLLING, DRIVE, DRIVE_LOSS, WHEEL_KINDS = range(300, 305)

_ARM: Constants = {"arm": (1, None)}
_POINT: Constants = {"point": (3, 0.0)}
_drive = partial(Kind, actuator=True, commanded=True)

KINDS = (
    Kind(TYRE, "tyre", "cornering stiffness", "C", "N/rad", constants=_ARM, drawn="patch"),
    Kind(ROLLING, "rolling", "rolling resistance", "c_0", "N", constants={"speed": (1, 0.1)}),
    _drive(
        DRIVE,
        "drive",
        "drive gain",
        "k_d",
        "N",
        share=1.0,
        constants=_POINT,
        drawn="arrow",
        reads="",
    ),
    _drive(DRIVE_LOSS, "drive_loss", "drive loss", "k_v", "N·s/m"),
)


@helper(WRENCH_OF)
def tyre(c, at, x, u):
    """Force −α of an axle's linear tyres across its wheels, steered by u, at x = c[at]."""
    slip = np.arctan2(x[1] + c[at] * x[5], x[0]) - u
    x[F], x[F + 1] = slip * np.sin(u), -slip * np.cos(u)
    x[F + 5] = c[at] * x[F + 1]


@helper(void(index, vector, index, vector, f8))
def write_wheel(kind, c, at, x, u):
    """Writes the wrench of a kind of this file."""
    if kind == TYRE:
        tyre(c, at, x, u)
    elif kind == ROLLING:  # continuous where the speed changes sign
        x[F] = -np.tanh(x[0] / c[at])
    elif kind == DRIVE:
        x[F] = u
        x[F + 4] = u * c[at + 2]
        x[F + 5] = -u * c[at + 1]
    elif kind == DRIVE_LOSS:
        x[F] = -x[0] * u
