"""Evaluation of a finished run: figures of the estimate, of the Lyapunov function, of excitation.

`truth` provides the true parameters, the true set and the distance to it; every function that takes
them also accepts None, for a run whose truth is unknown. `figures` evaluates the estimate of any
method, `lyapunov` the paper's V, `excitation` the motion. `summary` assembles summary.json, `words`
phrases it, and `verify` checks the paper's statements against a run. `result` defines the result
that every command reports.
"""

from ..structure.sensing import velocity_labels as velocity_labels
from .figures import Judge as Judge
from .figures import common_factor as common_factor
from .figures import converged_at as converged_at
from .figures import forces_of as forces_of
from .lyapunov import energy as energy
from .result import result_of as result_of
from .summary import summarize as summarize
from .summary import versions as versions
from .truth import Truth as Truth
from .truth import nullspace_of as nullspace_of
from .truth import truth_of as truth_of
from .words import FIGURES as FIGURES
from .words import OWN as OWN
from .words import confidence_lines as confidence_lines
from .words import figure as figure
from .words import force_units as force_units
from .words import observable_line as observable_line
from .words import unobservable_lines as unobservable_lines
