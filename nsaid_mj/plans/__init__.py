"""What is done with many runs, or before one: excitation, tracking, studies.

The names that other houses may use are in `__init__.pyi`; each is imported on first use.
"""

from ..base import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
