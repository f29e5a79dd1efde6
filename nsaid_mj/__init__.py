"""Nullspace adaptive identification (NS-AID) of robots on MuJoCo.

Estimates the parameters of plant and actuators together, from position, velocity and command alone,
up to the directions that no motion reveals.

The public names are listed in `__init__.pyi`, which editors and type checkers read; each is
imported on first use, so `import nsaid_mj` is fast.
"""

import os

import lazy_loader

os.environ.setdefault("NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING", "1")
# numba reads it when it is imported: colouring the messages of overloads that it tries and drops
# takes a tenth of the time of compiling

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
