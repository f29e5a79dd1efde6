"""Established identification methods, for comparison on identical logs."""

from .base import Method as Method
from .base import MethodEstimate as MethodEstimate
from .base import Problem as Problem
from .base import follow as follow
from .least_squares import ordinary, practitioners, total
from .recursive import kalman, normalised

BATCH: dict[str, Method] = {
    "ols": ordinary,
    "wls": practitioners,
    "tls": total,
    "rls": normalised,
    "ekf": kalman,
}
"""The methods that need only a `Problem`, by name."""
