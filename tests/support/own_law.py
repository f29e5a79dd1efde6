"""A user's law: (44, 45) from the paper's file, by another name."""

from __future__ import annotations

from typing import Any

import numpy as np

from nsaid_mj.base.bounds import Positive, config
from nsaid_mj.core import paper
from nsaid_mj.core.laws.config import IdentifierConfig
from nsaid_mj.core.laws.plain import NumpyIdentifier
from nsaid_mj.core.log import Measurement
from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.system import SecondOrderSystem


class OwnLaw(NumpyIdentifier):
    """The paper's rates with K (n, n) and Γ (p, p)."""

    def __init__(
        self, system: SecondOrderSystem, K: Array, Gamma: Array, prior: Array, hermite: bool = True
    ):
        super().__init__(system, prior, hermite)
        self.K, self.Gamma = K, Gamma

    def rates(self, sample: Measurement, v_hat: Array, theta_hat: Array) -> tuple[Array, Array]:
        at = paper.Moment(sample.t, np.hstack([sample.q, sample.v]), sample.u)
        return paper.rates(self.system, self.K, self.Gamma, at, v_hat, theta_hat)


@config
class OwnConfig(IdentifierConfig):
    """Its configuration, as `NullspaceAID` has it."""

    K: Positive = 20.0
    gain: Positive = 1.0

    @property
    def name(self) -> str:
        return "own words"

    @property
    def in_cone(self) -> bool:
        return False

    def build(self, system: SecondOrderSystem, prior: Array, dt: float, *_: Any) -> NumpyIdentifier:
        Gamma = self.gain * np.diag(system.space.scale**2)
        return OwnLaw(system, self.K * np.eye(system.n), Gamma, prior)
