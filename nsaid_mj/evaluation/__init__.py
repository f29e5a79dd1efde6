"""Evaluation of a finished run: its accuracy, the Lyapunov function, excitation, what is drawn.

`evaluate` makes one `RunResult`, from which everything else is made: summary.json by `summary_of`,
the page, the terminal's text and the recording. `result_from` reads it back. `truth` provides the
true parameters, the true set and the distance to it; every function that takes them also accepts
None, for a run whose truth is unknown. `figures` evaluates the estimate of any method, `lyapunov`
the paper's V, `excitation` the motion; `verify` checks the paper's statements against a run.
`result` defines the result that every command reports, `statistics` what is special to a run's,
`wording` how numbers are phrased.
"""

from .curves import with_curves as with_curves
from .figures import Judge as Judge
from .figures import common_factor as common_factor
from .figures import converged_at as converged_at
from .lyapunov import energy as energy
from .run_evaluation import evaluate as evaluate
from .run_evaluation import versions as versions
from .run_result import OWN as OWN
from .run_result import RunResult as RunResult
from .summary import result_from as result_from
from .summary import summary_of as summary_of
from .truth import Truth as Truth
from .truth import truth_of as truth_of
