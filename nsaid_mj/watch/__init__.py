"""What watches a law: faults, drift, learning again, and the misfit of the structure.

`supervised` gives a law its guest; see `laws.efficient.supervisor` for the protocol.

The names that other houses may use are in `__init__.pyi`; each is imported on first use.
"""

from ..base import door

__getattr__, __dir__, __all__ = door(__name__, __file__)
