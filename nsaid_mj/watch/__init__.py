"""What watches a law: faults, drift, learning again, and the misfit of the structure.

`supervised` gives a law its guest; see `laws.efficient.supervisor` for the protocol.
"""

from .faults.signals import signals_after as signals_after
from .misfit import CONTRADICTS as CONTRADICTS
from .misfit import FEWEST as FEWEST
from .misfit import LEVELS as LEVELS
from .misfit import LONGEST as LONGEST
from .misfit import Misfit as Misfit
from .misfit import judged_drift as judged_drift
from .misfit import judged_estimate as judged_estimate
from .misfit import running_misfit as running_misfit
from .misfit import widened as widened
from .misfit import worst_of as worst_of
from .state import drift_of as drift_of
from .supervisor import supervised as supervised
