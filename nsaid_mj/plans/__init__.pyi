"""The door of `plans`: what other houses may use."""

# Executes `nsaid compare`: compares methods on the logs of a scenario.
from .commands import compare_methods as compare_methods

# Executes `nsaid track`: compares tracking laws on the plants of a scenario.
from .commands import compare_trackers as compare_trackers

# Executes `nsaid report`: draws the page of the sweep in a folder.
from .commands import draw_sweep as draw_sweep

# Executes `nsaid montecarlo`: identifies from many priors.
from .commands import identify_often as identify_often

# Executes `nsaid sweep`: runs a scenario with varied fields and seeds.
from .commands import sweep_scenario as sweep_scenario

# Executes `nsaid excite` and returns the exit code.
from .excite.command import design_experiment as design_experiment

# The excitation for `--excitation designed` or `--excitation designed:FOLDER`.
from .excite.command import designed as designed
