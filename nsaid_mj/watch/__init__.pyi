"""The door of `watch`: what other houses may use."""

# The signals that act once some faults have happened.
from .faults.signals import signals_after as signals_after

# The identifier with its supervisor, if its law can be supervised; else as it is.
from .guest import supervised as supervised

# Level of a motion that contradicts the structure.
from .misfit import CONTRADICTS as CONTRADICTS

# rows that can be judged; the run that warms up has as many
from .misfit import FEWEST as FEWEST

# Levels of a misfit, the best first.
from .misfit import LEVELS as LEVELS

# length of log that is judged, its end [s]
from .misfit import LONGEST as LONGEST

# Goodness of fit of a structure to a log.
from .misfit import Misfit as Misfit

# The misfit of a log of N measurements with drifting gains and θ̂ (N, p).
from .misfit import judged_drift as judged_drift

# The misfit of a log for an estimate θ̂ (p,), with its covariance if any; prior is θ̂(0).
from .misfit import judged_estimate as judged_estimate

# The level during a run, from the law's state alone; "" for a law without a filter.
from .misfit import running_misfit as running_misfit

# A confidence with standard deviations times a factor; what is added is at most the prior's.
from .misfit import widened as widened

# The misfit of several parts of a log: the worst level, and the widening of the last part.
from .misfit import worst_of as worst_of

# Variance per second by which a law's gains walk [1/s], and since when [s]; 0 if constant.
from .state import drift_of as drift_of
