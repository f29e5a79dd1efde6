"""Established identification methods, for comparison on identical logs."""

from .. import numerics as numerics  # sets the kernels' cache folder before a kernel is compiled
from .adaptive import follow as follow
from .base import Estimate as Estimate
from .base import Method as Method
from .base import Problem as Problem
from .least_squares import ordinary, practitioners
from .recursive import kalman, normalised
from .total import total

BATCH: dict[str, Method] = {
    "ols": ordinary,
    "wls": practitioners,
    "tls": total,
    "rls": normalised,
    "ekf": kalman,
}
"""The methods that need only a `Problem`, by name."""
