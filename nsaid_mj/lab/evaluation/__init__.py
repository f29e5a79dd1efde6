"""Evaluation of a finished run: its accuracy, the Lyapunov function, excitation, what is drawn.

`evaluate` makes one `RunResult`, from which everything else is made: summary.json by its `summary`,
the page, the terminal's text and the recording. `result_from` reads it back. `truth` provides the
true parameters, the true set and the distance to it; every function that takes them also accepts
None, for a run whose truth is unknown. `figures` evaluates the estimate of any method, `lyapunov`
the paper's V, `excitation` the motion; `verify` checks the paper's statements against a run.
`result` defines the result that every command reports, `statistics` what is special to a run's,
`wording` how numbers are phrased.
"""
