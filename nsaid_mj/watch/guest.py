"""Which laws are supervised; what supervises them is imported for them alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..core import Identifier


def supervised(identifier: Identifier) -> Identifier:
    """The identifier with its supervisor, if its law can be supervised; else as it is."""
    law: Any = identifier
    if not hasattr(law, "supervised_by"):
        return identifier
    from .supervisor import FilterSupervisor

    return law.supervised_by(FilterSupervisor(law.estimator, law.every, law.interval))
