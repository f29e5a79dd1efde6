"""Identifiers in the metric of the cone of physical parameters: the laws `cone` and `memory`."""

from __future__ import annotations

from ..log import EXACT, SensorLevels
from ..parameters import Array
from ..structure.system import SecondOrderSystem
from .cone.law import ConeMetric
from .memory.implicit import ImplicitMemory
from .memory.statistics import MemoryConfig
from .nullspace_aid import NullspaceIdentifier


def cone_identifier(
    system: SecondOrderSystem,
    K: Array,
    Gamma: Array,
    prior: Array,
    dt: float,
    mu: float,
    hermite: bool = True,
) -> NullspaceIdentifier:
    """The identifier of (44, 45) in the cone's metric, integrated by RK4 in its chart.

    Args:
        system: the structure.
        K: (n,) or (n, n) gain of the identification plant [1/s].
        Gamma: (p,) or (p, p) adaptation gain.
        prior: (p,) θ̂(0), inside the cone.
        dt: time between measurements [s].
        mu: weight μ of the barrier [J]; > 0.
        hermite: cubic Hermite interpolation between samples; else linear.

    Raises:
        InvalidInput: a shape or value is wrong, μ is not > 0, or the prior is outside the cone.
    """
    metric = ConeMetric(system.space, Gamma, prior, mu)
    return NullspaceIdentifier(system, K, metric, prior, dt, hermite)


def memory_identifier(
    system: SecondOrderSystem,
    K: Array,
    Gamma: Array,
    prior: Array,
    dt: float,
    mu: float,
    hermite: bool = True,
    config: MemoryConfig | None = None,
    levels: SensorLevels = EXACT,
) -> NullspaceIdentifier:
    """The identifier of `cone_identifier`, with implicit steps on the cost of a memory.

    `config` says how past data are kept and used, None for `MemoryConfig()`; `levels` are standard
    deviations of the sensors' noise.

    Raises:
        InvalidInput: a shape or value is wrong, the prior is outside the cone, or the system has no
            actuator.
    """
    metric = ConeMetric(system.space, Gamma, prior, mu)
    memory = ImplicitMemory(system, metric, prior, dt, hermite, config or MemoryConfig(), levels)
    return NullspaceIdentifier(system, K, metric, prior, dt, hermite, memory)
