"""Names, with units, of groups of parameters and of levels that are drawn over time."""

from dataclasses import dataclass

import numpy as np

from ...core import Indices, ParameterSpace


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters of one block that have the same unit, and so share a plot."""

    block: str  # name of the block
    key: tuple[str, ...]  # of the panel with their estimates
    title: str  # title of the group, with the unit
    names: list[str]  # labels with units: "gain of elbow_joint [N·m/A]"
    indices: Indices  # (k,) in θ


def groups(space: ParameterSpace) -> list[ParameterGroup]:
    """The parameters by block and unit."""
    found = []
    for block, place in space:
        units = list(dict.fromkeys(block.units))
        for number, unit in enumerate(units, 1):
            inside = [k for k, own in enumerate(block.units) if own == unit]
            suffix = [str(number)] if len(units) > 1 else []
            names = [f"{block.labels[k]} [{unit}]" for k in inside]
            indices = place.start + np.array(inside, dtype=np.intp)
            key = ("estimate", block.name, *suffix)
            found.append(ParameterGroup(block.name, key, f"{block.name} [{unit}]", names, indices))
    return found


EXCITATION_LEVELS = ("all directions, (2) [N·m·s]", "observable directions, (75) [N·m·s]")
"""Names of the online excitation levels."""
