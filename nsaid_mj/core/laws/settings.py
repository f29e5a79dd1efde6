"""Settings of the laws `memory` and `efficient`, as part of a scenario."""

from ...base import Config, NonNegative, Positive, config


@config
class MemoryConfig(Config):
    """Storage and use of past data by the law `memory`.

    Attributes:
        window: time constant 1/a of the leak in the momentum balance [s].
        block: time over which its rows are averaged [s].
        interval: time between two implicit steps [s].
        pace: κ/μ [1/s], the rate at which a direction converges in which the data carry as much
            information as the barrier; better observed directions converge faster.
        anchor: weight of the divergence from the prior relative to the data; 1 counts the prior as
            one measurement whose error is as large as the prior itself. None is 0 with exact data,
            else 1 (noisy sensors, or contacts that sink in). With inexact data keep it near 1:
            otherwise noise makes the scale and all unexcited directions drift.
        horizon: time constant of forgetting [s]; 0 never forgets. Information is forgotten only
            in directions in which new data bring as much: unexcited directions keep theirs.
    """

    _path = "identifier.memory"

    window: Positive = 0.5
    block: Positive = 0.1
    interval: Positive = 0.5
    pace: Positive = 10.0
    anchor: NonNegative | None = None
    horizon: NonNegative = 0.0

    def weight(self, exact: bool) -> float:
        """The anchor's weight, with rows that are `exact` or not."""
        return self.anchor if self.anchor is not None else 0.0 if exact else 1.0


@config
class EfficientConfig(Config):
    """The filter of the law `efficient`.

    Attributes:
        prior: largest relative error of θ̂(0); None takes `Scenario.initial_error`; see
            `drawn_covariance`.
        linearisation: γ, standard deviation of the error of a step's linearisation relative to that
            of the effect of θ in it, in the first 15 s; later 0.3 at most.
        innovation_window: time over which innovations are tested against chance [s].
        unexplained: density of the force on every velocity that the structure does not explain,
            over the last motor's gain [units of its command, squared, times s]; none for an exact
            structure.
    """

    _path = "identifier.efficient"

    prior: Positive | None = None
    linearisation: NonNegative = 0.7
    innovation_window: Positive = 0.1
    unexplained: tuple[NonNegative, ...] = ()
