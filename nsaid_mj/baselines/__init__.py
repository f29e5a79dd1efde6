"""Other people's methods on the same logs: what identification is compared with."""

from .. import numerics as numerics  # where kernels are kept: before the first one
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
"""The methods that need nothing but a problem, by name."""
