"""Plants simulated by MuJoCo; no other object holds the true parameters.

The names are listed in `__init__.pyi`; each is imported on first use, as is any other class that is
defined in a file of this folder.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import lazy_loader

_listed, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    for file in () if name in __all__ else sorted(Path(__file__).parent.glob("[!_]*.py")):
        if f"\nclass {name}(" in file.read_text(encoding="utf-8"):
            return getattr(import_module(f".{file.stem}", __name__), name)
    return _listed(name)
