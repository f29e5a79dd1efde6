"""What every house stands on: errors, findings, bounded fields of configurations, files, clocks.

The names that other houses may use are in `__init__.pyi`; each is imported on first use.
"""

from .doors import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
