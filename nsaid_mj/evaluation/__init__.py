"""Evaluation of a finished run: figures of the estimate, of the Lyapunov function, of excitation.

`truth` provides the true parameters, the true set and the distance to it; every function that takes
them also accepts None, for a run whose truth is unknown. `figures` evaluates the estimate of any
method, `lyapunov` the paper's V, `excitation` the motion. `summary` assembles summary.json, `words`
phrases it, and `verify` checks the paper's statements against a run. `result` defines the result
that every command reports.

The names are listed in `__init__.pyi`; each is imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
