"""Loads scenarios by name or by the path of their script."""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InvalidInput, UnknownName
from ..resources import scenarios

if TYPE_CHECKING:
    from .scenario import Scenario


def load(name: str) -> Scenario:
    """Loads a scenario by the name of a packaged one, or from a script.

    Raises:
        UnknownName: there is no such scenario; lists near matches.
        InvalidInput: the script defines no `scenario`.
    """
    known = scenarios()
    path = Path(name) if name.endswith(".py") or name not in known else known[name]
    if path.suffix != ".py" or not path.is_file():
        remedy = "The name comes before all flags; a script is given by its path, ending in .py."
        raise UnknownName("scenario", name, known, remedy)
    spec = importlib.util.spec_from_file_location(f"_scenario_{path.stem}", path)
    assert spec is not None and spec.loader is not None  # a .py file always has one
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses of the script resolve their annotations here
    spec.loader.exec_module(module)
    from ..experiment.scenario import Scenario

    found = getattr(module, "scenario", None)
    if not isinstance(found, Scenario):
        expected = "a script that defines `scenario = Scenario(…)`"
        raise InvalidInput(str(path), expected, type(found).__name__, "See scenarios/ur5.py.")
    return found


def digest_of(script: str) -> str:
    """SHA-256 of a scenario's script, given by packaged name or path."""
    path = scenarios().get(script, Path(script))
    return hashlib.sha256(path.read_bytes()).hexdigest()
