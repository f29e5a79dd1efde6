"""What an experiment is asked for: numbers whose predicted deviation a design minimises."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import UnknownName
from ..parameters import Array, ParameterSpace

GAINS, ALL = "gains", "all"


@dataclass(frozen=True)
class Asked:
    """Numbers that are linear in small changes of θ.

    Attributes:
        words: what is asked for, for reports.
        names: one for each number.
        rows: of θ (p,), the (k, p) derivatives of the numbers with respect to θ/scale.
    """

    words: str
    names: tuple[str, ...]
    rows: Callable[[Array], Array]

    def deviations(self, covariance: Array, theta: Array) -> Array:
        """(k,) standard deviations under a covariance (p, p) of θ̂/scale, at θ."""
        rows = self.rows(theta)
        return np.sqrt(np.maximum(np.einsum("kp,pq,kq->k", rows, covariance, rows), 0.0))


def asked_for(text: str, space: ParameterSpace) -> Asked:
    """Parses `gains`, `all`, or comma-separated names of parameters.

    `gains` are the ratios k_i/mean(k), which do not depend on the unknown common scale, and `all`
    the changes of θ/scale. Named parameters are relative to their magnitude, or to a tenth of their
    scale if that is larger. The common scale and all else in P_s is held fixed. A link's mass m_i
    may be written mass_i.

    Raises:
        UnknownName: there is no such parameter, or the system has no actuator.
    """
    if text == GAINS:
        if len(space.actuators) < 2:
            remedy = f"Ask for {ALL}, or for parameters by name: there is no ratio of gains."
            raise UnknownName("target", text, [ALL, *space.names], remedy)
        return Asked("ratios of the actuators' gains", _gain_names(space), _gains(space))
    if text == ALL:
        eye = np.eye(len(space))
        return Asked("all parameters", tuple(space.names), lambda _: eye)
    names = tuple(
        re.sub(r"^mass(?=_\d+$)", "m", part.strip()) for part in text.split(",") if part.strip()
    )
    for name in names or ("",):
        if name not in space.names:
            raise UnknownName("parameter", name, [GAINS, ALL, *space.names])
    at = np.array([space.index(name) for name in names])
    chosen = np.eye(len(space))[at]

    def rows(theta: Array) -> Array:
        size = np.maximum(np.abs(theta[at]), 0.1 * space.scale[at])
        return chosen * (space.scale[at] / size)[:, None]

    return Asked(", ".join(space.labels[i] for i in at), names, rows)


def _gain_names(space: ParameterSpace) -> tuple[str, ...]:
    return tuple(space.names[i] for i in space.actuators)


def _gains(space: ParameterSpace) -> Callable[[Array], Array]:
    at = space.actuators

    def rows(theta: Array) -> Array:
        """Derivatives of k_i/mean(k) at equal relative errors: (1 − mean) of δk_i/k_i."""
        found = np.zeros((len(at), len(space)))
        share = np.eye(len(at)) - 1 / len(at)
        found[:, at] = share * (space.scale[at] / theta[at])
        return found

    return rows
