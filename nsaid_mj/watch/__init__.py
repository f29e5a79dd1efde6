"""What watches a law: faults, drift, learning again, and the misfit of the structure.

`supervised` gives a law its guest; see `laws.efficient.supervisor` for the protocol.

The names that other houses may use are in `__init__.pyi`; each is imported on first use.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
