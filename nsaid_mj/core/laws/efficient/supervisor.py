"""The protocol of what supervises the law `efficient`: faults, drift, learning again.

A supervisor is a guest of the law. The law calls it in three places, with its state and the samples
since the last one, and continues from the state that it returns:

- `contradicted`, where the innovations of the filter are larger than chance allows;
- `tried`, instead of the filter, while the supervisor tries explanations of a contradiction;
- `watched`, after every piece of a log; where that ends an interval of the memory, the law has
  compared filter and memory before.

The supervisor returns its orders to the law as a `Supervision`. Without a supervisor θ is constant,
and a contradicted filter restarts at the memory's estimate.
"""

from typing import Protocol

from ...log import Log
from .state import EfficientState


class Supervisor(Protocol):
    """Supervises a filter; see the module. All calls return the law's next state."""

    def contradicted(self, state: EfficientState, log: Log) -> EfficientState:
        """After a log, as recorded, from the sample of `state.step`, whose end contradicts."""
        ...

    def tried(self, state: EfficientState, log: Log) -> tuple[EfficientState, int]:
        """Tries explanations along a log, as recorded, as far as they need to be.

        Also returns the index of the last sample used, after which the filter continues if
        `supervision.trying` is False.
        """
        ...

    def watched(self, state: EfficientState, log: Log) -> EfficientState:
        """After a piece of a log, as recorded, of at most an interval; `state.step` is its end."""
        ...
