"""The door of `watch`: what other houses may use."""

# The signals that act once some faults have happened.
from .faults.signals import signals_after as signals_after

# The identifier with its supervisor, if its law can be supervised; else as it is.
from .guest import supervised as supervised

# Goodness of fit of a structure to a log.
from .misfit import Misfit as Misfit

# A confidence with standard deviations times a factor; what is added is at most the prior's.
from .misfit import widened as widened

# Variance per second by which a law's gains walk [1/s], and since when [s]; 0 if constant.
from .state import drift_of as drift_of
