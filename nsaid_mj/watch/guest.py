"""Which laws are supervised; what supervises them is imported for them alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..core import Identifier


def supervised(identifier: Identifier) -> Identifier:
    """The identifier with its supervisor, if its law can be supervised; else as it is."""
    invite = getattr(identifier, "supervised_by", None)
    if invite is None:
        return identifier
    from .supervisor import FilterSupervisor

    return invite(FilterSupervisor(identifier))  # pyright: ignore[reportArgumentType]
