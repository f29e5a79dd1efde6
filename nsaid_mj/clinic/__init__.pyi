"""The door of `clinic`: what other houses may use."""

# Executes `nsaid compare` of model files on logs; returns the exit code.
from .commands.compare import compare_on_logs as compare_on_logs

# Executes `nsaid identify` and returns the exit code.
from .commands.identify import identify_log as identify_log

# Executes `nsaid inspect` and returns the exit code: unusable where `identify` would refuse.
from .commands.identify import inspect_log as inspect_log

# Executes `nsaid live` and returns the exit code.
from .commands.live import follow_robot as follow_robot

# The plant of the family to which a vehicle's TOML file belongs.
from .identify.models import plant_of as plant_of
