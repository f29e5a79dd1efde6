"""Types of every robot's data, for the signatures of kernels.

All arrays of numbers are C-contiguous float64, all arrays of indices C-contiguous int64, so that
every function has one signature, which its decorator states.
"""

from numba import types

from ..numerics.kernels import matrix, table, vector
from .arrays import Slopes, StructureArrays, Workspace

STRUCTURE = types.NamedTuple(
    (table, vector, vector, table, table, vector, table, table, vector, table), StructureArrays
)
"""The type of every robot."""
WORKSPACE = types.NamedTuple((vector, vector, matrix, matrix, matrix, vector), Workspace)
SLOPES = types.NamedTuple((vector, vector, vector, vector, matrix, matrix), Slopes)
