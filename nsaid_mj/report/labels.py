"""Names, with units, of what is drawn over time: velocities, commands, groups of parameters."""

from dataclasses import dataclass

import numpy as np

from ..core import Indices, ParameterSpace, SecondOrderSystem, rate_labels, velocity_labels


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


def velocity_names(system: SecondOrderSystem, mark: str = "Δ") -> list[str]:
    """Names of the velocities, or of their errors, with units and the prefix `mark`."""
    named = zip(rate_labels(system), system.velocity_units, strict=True)
    return [f"{mark}{label} [{unit}]" for label, unit in named]


def command_names(system: SecondOrderSystem) -> list[str]:
    """Names of the commands: those of the joints where there is one for each."""
    if system.n_u == system.n and not system.group:
        return [f"command of {label} [–]" for label in velocity_labels(system)]
    return [f"command {i} [–]" for i in range(1, system.n_u + 1)]


EXCITATION_LEVELS = ("all directions, (2) [N·m·s]", "observable directions, (75) [N·m·s]")
"""Names of the online excitation levels."""


_FORCE_UNITS = {"m/s": "N", "rad/s": "N·m"}  # of a generalised force, by unit of its velocity


def force_units(system: SecondOrderSystem) -> list[str]:
    """The unit of the generalised force of each velocity."""
    return [_FORCE_UNITS.get(unit, "SI") for unit in system.velocity_units]
