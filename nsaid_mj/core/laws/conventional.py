"""Conventional adaptive identification, in which some parameters are assumed known.

With the known parameters held, W θ̂ = W_free θ̂_free − (a known signal). So (44) and (45) with Γ = 0
on the held parameters is the textbook identifier with known forces τ(u). Holding the mass of (16)
at 1 gives the identifier of the reduced form (17).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...base import InvalidInput, Positive, UnknownName, config
from ..log import EXACT, SensorLevels
from ..parameters import Array, ParameterSpace
from .config import ExpectedGramian, IdentifierConfig

if TYPE_CHECKING:
    from ..structure.system import SecondOrderSystem
    from .base import Identifier


@config
class ConventionalAID(IdentifierConfig):
    """Adaptive identification with parameters assumed known.

    Attributes:
        K: gain of the identification plant [1/s].
        gain: adaptation gain γ; Γ = γ diag(scale²) on the free parameters.
        known: blocks or parameters held at their prior; "actuators" means all actuator blocks.
    """

    K: Positive = 20.0
    gain: Positive = 1.0
    known: tuple[str, ...] = ("actuators",)

    @property
    def name(self) -> str:
        """`paper`: (44, 45) with Γ = 0 on what is held."""
        return "paper"

    @property
    def in_cone(self) -> bool:
        """Whether θ̂ must start inside the cone of physical parameters: no."""
        return False

    def build(
        self,
        system: SecondOrderSystem,
        prior: Array,
        dt: float,
        noise: SensorLevels = EXACT,
        gramian: ExpectedGramian | None = None,
    ) -> Identifier:
        """Makes the identifier; the `known` parameters stay at their prior.

        Raises:
            UnknownName: a name in `known` is neither a block nor a parameter.
            InvalidInput: all parameters are held, or none.
        """
        from .nullspace_aid import paper_identifier

        held = known_mask(system.space, self.known)
        return paper_identifier(
            system,
            K=np.full(system.n, self.K),
            Gamma=np.where(held, 0.0, self.gain * system.space.scale**2),
            prior=prior,
            dt=dt,
            hermite=noise.exact,
            held=held,
        )


def known_mask(space: ParameterSpace, known: tuple[str, ...]) -> np.ndarray:
    """(p,) boolean mask of the named parameters.

    Raises:
        UnknownName: a name is neither a block nor a parameter.
        InvalidInput: all parameters are held, or none.
    """
    held = np.zeros(len(space), dtype=bool)
    places: dict[str, Any] = {name: i for i, name in enumerate(space.names)}
    places |= {block.name: place for block, place in space} | {"actuators": space.actuators}
    for name in known:
        if name not in places:
            raise UnknownName("parameter or block", name, places)
        held[places[name]] = True
    if held.all() or not held.any():
        raise InvalidInput(
            "known",
            "some parameters but not all",
            f"{held.sum()} of {len(space)}",
            'Name what is known, e.g. ("actuators",).',
        )
    return held
