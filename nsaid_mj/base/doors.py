"""How the door of a house hands on names: each is imported on first use."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import lazy_loader

_OFFERS = re.compile(r"^from \.([\w.]+) import (\w+) as \w+$", re.MULTILINE)


def door(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], Any]:
    """`__getattr__`, `__dir__` and `__all__` of a package whose stub lists its names.

    `package` and `file` are its `__name__` and `__file__`. Stubs are read as UTF-8, whatever the
    locale; `lazy_loader.attach_stub` reads them in the locale's encoding.
    """
    stub = Path(file).with_suffix(".pyi").read_text(encoding="utf-8")
    names: dict[str, list[str]] = {}
    for module, name in _OFFERS.findall(stub):
        names.setdefault(module, []).append(name)
    return lazy_loader.attach(package, submod_attrs=names)
