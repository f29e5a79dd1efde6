"""Types of every robot's data, for the signatures of kernels.

All arrays of numbers are C-contiguous float64, all arrays of indices C-contiguous int64, so that
every function has one signature, which its decorator states.
"""

from __future__ import annotations

from numba import types

from ..numerics.kernels import FAST as FAST
from ..numerics.kernels import Kernel as Kernel
from ..numerics.kernels import boolean as boolean
from ..numerics.kernels import cube as cube
from ..numerics.kernels import f8 as f8
from ..numerics.kernels import helper as helper
from ..numerics.kernels import i8 as i8
from ..numerics.kernels import index as index
from ..numerics.kernels import kernel as kernel
from ..numerics.kernels import matrix as matrix
from ..numerics.kernels import routine as routine
from ..numerics.kernels import table as table
from ..numerics.kernels import vector as vector
from ..numerics.kernels import void as void
from .arrays import Slopes, StructureArrays, Workspace

STRUCTURE = types.NamedTuple(
    (table, vector, vector, table, table, vector, table, table, vector, table), StructureArrays
)
"""The type of every robot."""
WORKSPACE = types.NamedTuple((vector, vector, matrix, matrix, matrix, vector), Workspace)
SLOPES = types.NamedTuple((vector, vector, vector, vector, matrix, matrix), Slopes)
