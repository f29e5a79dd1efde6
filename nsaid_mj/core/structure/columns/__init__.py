"""Kinds of columns of F θ, by the source of the force: a joint, a fluid, thrust, wheels."""

from . import fluid, joint, thrust, wheels
from .kind import Kind

KINDS: dict[str, Kind] = {
    kind.name: kind for file in (joint, fluid, thrust, wheels) for kind in file.KINDS
}
"""All kinds of columns, by name."""
