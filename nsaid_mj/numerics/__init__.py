"""Small compiled mathematics: linear algebra, rotations and poses. No robotics.

Importing this room decides where compiled kernels are kept, see `kernels`; every room that defines
kernels imports it before its first one.
"""

from . import kernels as kernels
