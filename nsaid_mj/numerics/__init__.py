"""Small compiled mathematics: linear algebra, rotations and poses. No robotics.

Importing this package sets the cache folder of compiled kernels, see `kernels`; every package that
defines kernels imports it first.
"""

from . import kernels as kernels
