"""The change of θ by a point mass fixed to a body."""

import numpy as np

from ...base import InvalidInput, UnknownName
from ..parameters import Array, ParameterSpace
from .blocks import GRAVITY
from .parts import unit_mass

_SUBMERGED = ("mass matrix", "net weight", "righting moment")  # blocks of a body in water


class PointMasses:
    """What point masses fixed to a body change in θ.

    Attributes:
        carrier: the block of the body that carries a payload by default: the last link, or `body`.
        submerged: whether θ is that of a single body in water with a full mass matrix.
    """

    def __init__(self, space: ParameterSpace):
        self._space = space
        self._bodies = {b.name: at for b, at in space if b.geometry == "pseudo_inertia"}
        self.carrier = list(self._bodies)[-1] if self._bodies else "the body"
        sizes = {block.name: len(block) for block in space.blocks}
        self.submerged = [sizes.get(name) for name in _SUBMERGED] == [21, 1, 3]

    def change(self, mass: float, place: Array, link: str = "") -> Array:
        """(p,) change of θ by a point mass [kg].

        place (3,) is in the axes of the body, for a link in those of its joint [m]; `link` is the
        name of the body's block, "" for `carrier`.

        Raises:
            UnknownName: there is no such body.
            InvalidInput: θ has no body that could carry it.
        """
        change = np.zeros(len(self._space))
        if link and link not in self._bodies:
            raise UnknownName("body in θ", link, list(self._bodies))
        if self._bodies:
            inertia = mass * (place @ place * np.eye(3) - np.outer(place, place))
            own = np.concatenate([[mass], mass * place, inertia[np.tril_indices(3)]])
            change[self._bodies[link or self.carrier]] = own
            return change
        if not self.submerged:
            raise InvalidInput(
                "faults",
                "a vehicle whose θ can hold a payload",
                "payload",
                "Leave the payload out.",
            )
        M, weight, righting = (self._space[name] for name in _SUBMERGED)
        change[M] = mass * unit_mass(place)[np.triu_indices(6)]
        change[weight] = mass * GRAVITY
        change[righting] = -mass * GRAVITY * place
        return change
