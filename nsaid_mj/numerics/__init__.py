"""Small compiled mathematics: linear algebra, rotations and poses. No robotics.

Importing this package sets the cache folder of compiled kernels, see `cache`; every package that
defines kernels imports it first.
"""

from . import cache as cache
