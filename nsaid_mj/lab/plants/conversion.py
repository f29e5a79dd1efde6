"""What the converters in assets/families need: a sheet's tables and checks, and blocks of columns.

A converter is a `VehicleSheet` in the numbers that its literature publishes; its `blueprint` gives
the vehicle's columns, in SI units, x forward, y left, z up.
"""

import numpy as np

from ...base import InvalidInput as InvalidInput
from ...core import GRAVITY as GRAVITY
from ...core import Array as Array
from ...core import Block as Block
from ...core import Column
from ...core import Inertia as Inertia
from ...core import Operation as Operation
from ...core import Term as Term
from ..fields import Share as Share
from .rotors import rotor_terms as rotor_terms
from .single_track import operation as operation
from .single_track import planar_mass as planar_mass
from .single_track import single_track as single_track
from .world.blueprint import Blueprint as Blueprint
from .world.blueprint import Fluid as Fluid
from .world.blueprint import VehicleSheet as VehicleSheet
from .world.body import NED as NED
from .world.body import BodyInertia as BodyInertia
from .world.body import hidden as hidden
from .world.sheet import Guess as Guess
from .world.sheet import Negative as Negative
from .world.sheet import NotNegative as NotNegative
from .world.sheet import Number as Number
from .world.sheet import Place as Place
from .world.sheet import Positive as Positive
from .world.sheet import SheetTable as SheetTable
from .world.sheet import check_directions as check_directions
from .world.sheet import check_inertia as check_inertia
from .world.sheet import one as one
from .world.sheet import several as several


def odd(*coefficients: float) -> Array:
    """A curve by its coefficients of u, u³, u⁵ and so on."""
    spread = np.zeros(2 * len(coefficients) - 1)
    spread[::2] = coefficients
    return Column.polynomial(*spread)
