"""Configuration of nullspace adaptive identification: the law, and the design of its gain.

An identifier's code is imported when it is built.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import field
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import model_validator

from ...base import Config, InvalidInput, NonNegative, Positive, PositiveShare, config
from ..log import EXACT, SensorLevels
from ..parameters import Array
from .settings import EfficientConfig, MemoryConfig

if TYPE_CHECKING:
    from ..structure.system import SecondOrderSystem
    from .base import Identifier

ExpectedGramian = Callable[[], Array]


@config
class IdentifierConfig(Config, ABC):
    """The configuration of an identifier; `build` makes the identifier."""

    _path = "identifier"

    @property
    @abstractmethod
    def name(self) -> str:
        """What the law is called in the summary and on the page of a run."""

    @property
    @abstractmethod
    def in_cone(self) -> bool:
        """Whether θ̂ must start inside the cone of physical parameters."""

    @abstractmethod
    def build(
        self,
        system: SecondOrderSystem,
        prior: Array,
        dt: float,
        noise: SensorLevels = EXACT,
        gramian: ExpectedGramian | None = None,
    ) -> Identifier:
        """Makes the identifier of a system, of measurements every `dt` [s].

        prior (p,) is θ̂(0), `noise` the assumed standard deviations of the sensors' noise.
        `gramian` computes (p, p), the expected mean of S Wᵀ M⁻¹ W S under the prior with S =
        diag(scale), for laws whose gain is designed from it. It is called only if needed, as it is
        costly.
        """


@config
class NullspaceAID(IdentifierConfig):
    """Nullspace adaptive identification with constant gains.

    Attributes:
        K: gain of the identification plant, K = K·I [1/s].
        gain: adaptation gain γ; Γ = γ diag(scale²) [1/J].
        interpolation: between samples: `hermite`, the cubic through positions and velocities, for
            exact encoders; `linear`, the mean of both velocities, where noise dominates differences
            of positions; `auto` chooses by the sensors' noise.
        gamma: `scale`, Γ = γ diag(scale²); or `simulated`, Γ = rate·K·S H⁻¹ S, with H the mean of
            S Wᵀ M⁻¹ W S in a simulation under the prior, S = diag(scale).
        rate: convergence rate of all directions where `gamma` is `simulated` [1/s]; directions
            excited less than `floor` of the best are slower.
        floor: lower bound of H's eigenvalues, as a share of the largest.
        law: `paper`, (45) with constant Γ; `cone`, Γ⁻¹ + μ ∇²b(θ̂) in place of Γ⁻¹, which keeps θ̂
            inside the cone of physical parameters and M̂ > 0; `memory`, the law `cone` with
            implicit steps that fit past data; or `efficient`, a Kalman filter of state and
            parameters guarded by the law `memory`.
        barrier: μ of all laws but `paper`, in units of Γ⁻¹ at the scale; with 0 `cone` is
            the paper's law.
        memory: storage and use of past data, for the laws `memory` and `efficient`.
        efficient: the filter of the law `efficient`.
    """

    K: Positive = 20.0
    gain: Positive = 1.0
    interpolation: Literal["auto", "hermite", "linear"] = "auto"
    gamma: Literal["scale", "simulated"] = "scale"
    rate: Positive = 0.1
    floor: PositiveShare = 1e-2
    law: Literal["paper", "cone", "memory", "efficient"] = "paper"
    barrier: NonNegative = 1.0
    memory: MemoryConfig = field(default_factory=MemoryConfig)
    efficient: EfficientConfig = field(default_factory=EfficientConfig)

    @model_validator(mode="after")
    def _check_barrier(self) -> Self:
        if self.law in {"memory", "efficient"} and self.barrier == 0:
            raise InvalidInput(
                "identifier.barrier", f"a weight > 0 for the law {self.law}", 0, "1.0 will do."
            )
        return self

    def build(
        self,
        system: SecondOrderSystem,
        prior: Array,
        dt: float,
        noise: SensorLevels = EXACT,
        gramian: ExpectedGramian | None = None,
    ) -> Identifier:
        """Makes the identifier, with the gain K·I and Γ chosen by `gamma`.

        Raises:
            InvalidInput: `gamma` is `simulated` but no `gramian` is given, or it is 0.
        """
        from .nullspace_aid import NullspaceIdentifier, paper_identifier

        K = np.full(system.n, self.K)
        Gamma = self._gain(system, gramian)
        hermite = noise.exact if self.interpolation == "auto" else self.interpolation == "hermite"
        if not self.in_cone:
            return paper_identifier(system, K, Gamma, prior, dt, hermite)
        from .cone.law import ConeMetric

        stiffness = 1 / Gamma if Gamma.ndim == 1 else np.diag(np.linalg.inv(Gamma))
        mu = self.barrier * float(np.median(stiffness * system.space.scale**2))
        metric = ConeMetric(system.space, Gamma, prior, mu)
        if self.law == "cone":
            return NullspaceIdentifier(system, K, metric, prior, dt, hermite)
        from .memory.implicit import ImplicitMemory

        memory = ImplicitMemory(system, metric, prior, dt, hermite, self.memory, noise)
        guard = NullspaceIdentifier(system, K, metric, prior, dt, hermite, memory)
        if self.law == "memory":
            return guard
        from .efficient.estimator import KalmanFilter
        from .efficient.law import EfficientIdentifier

        return EfficientIdentifier(guard, KalmanFilter(system, dt, self.efficient))

    @property
    def name(self) -> str:
        """The `law`; `cone` without a barrier is the paper's."""
        return self.law if self.law != "cone" or self.in_cone else "paper"

    @property
    def in_cone(self) -> bool:
        """Whether θ̂ must start inside the cone of physical parameters, and stays there."""
        return self.law != "paper" and self.barrier > 0

    def _gain(self, system: SecondOrderSystem, gramian: ExpectedGramian | None) -> Array:
        """(p,) or (p, p) Γ."""
        scale = system.space.scale
        if self.gamma == "scale":
            return self.gain * scale**2
        if gramian is None:
            raise InvalidInput("gamma", "scale, without a driver", self.gamma, "Run a scenario.")
        inverse = floored_inverse(gramian(), self.floor)
        return self.rate * self.K * inverse * np.outer(scale, scale)


def floored_inverse(gramian: Array, floor: float) -> Array:
    """Inverse of a positive semidefinite matrix (p, p), eigenvalues raised to at least floor·λ_max.

    This includes unexcited directions: they are unobservable, but the estimate must be free to
    rotate, since the nullspace under the prior differs slightly from the true one.

    Raises:
        InvalidInput: the matrix is 0.
    """
    from scipy.linalg import eigh

    values, vectors = eigh(gramian)
    if not values[-1] > 0:
        raise InvalidInput(
            "gamma",
            "an excitation that moves something",
            "an expected Gramian of 0",
            "Drive the plant harder, or use --gamma scale.",
        )
    inverse = (vectors / np.maximum(values, floor * values[-1])) @ vectors.T
    return 0.5 * (inverse + inverse.T)
