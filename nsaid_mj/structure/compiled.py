"""Types of every robot's data, for the signatures of kernels.

All arrays of numbers are C-contiguous float64, all arrays of indices C-contiguous int64, so that
every function has one signature, which its decorator states.
"""

from numba import types

from ..numerics.compiler import FAST
from ..numerics.kernels import (
    boolean,
    cube,
    f8,
    helper,
    i8,
    index,
    inlined,
    kernel,
    matrix,
    routine,
    table,
    vector,
    void,
)
from .arrays import Slopes, StructureArrays, Workspace

__all__ = [  # for the files here, beside the types below
    "FAST", "boolean", "cube", "f8", "helper", "i8", "index", "inlined", "kernel", "matrix",
    "routine", "table", "vector", "void",
]  # fmt: skip

STRUCTURE = types.NamedTuple(
    (table, vector, vector, table, table, vector, table, table, vector, table), StructureArrays
)
"""The type of every robot."""
WORKSPACE = types.NamedTuple((vector, vector, matrix, matrix, matrix, vector), Workspace)
SLOPES = types.NamedTuple((vector, vector, vector, vector, matrix, matrix), Slopes)
