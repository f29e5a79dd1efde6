"""The file of limits that a user gives; it imports nothing heavy."""

import tomllib
from pathlib import Path
from typing import Any

from ...base import InputFile, InvalidInput, path_of

LIMITS_FORM = "For example: speed = 2.0; position = {low = -1.5, high = 1.5}; contacts = true."
"""How a file of limits looks."""


def read_limits_file(path: Path) -> dict[str, Any]:
    """The content of a TOML file of limits; raises `InvalidInput` if it is not readable."""
    try:
        return tomllib.loads(InputFile(path_of(path)).read().decode())
    except (OSError, ValueError, RecursionError) as error:
        expected = "a readable TOML file"
        raise InvalidInput("--limits", expected, f"{path}: {error}", LIMITS_FORM) from error
