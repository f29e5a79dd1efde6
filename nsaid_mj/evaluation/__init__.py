"""What a run's numbers are: read the truth after the fact, judge, summarize.

`truth` has the true set and the distance to it, `judging` the figures of any method's estimate,
`lyapunov` those of the paper's V, `motion` those of what a run has excited; `summary` is all that
summary.json holds, and `words` tells it.
"""

from .figures import Judge as Judge
from .lyapunov import energy as energy
from .summary import summarize as summarize
from .summary import versions as versions
from .truth import distance as distance
from .truth import true_nullspace as true_nullspace
from .truth import true_theta as true_theta
from .words import FIGURES as FIGURES
from .words import OWN as OWN
from .words import confidence_lines as confidence_lines
from .words import figure as figure
from .words import gain_rows as gain_rows
from .words import unobservable_lines as unobservable_lines
