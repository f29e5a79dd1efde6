"""Zero-phase filters for a log and for its regressors."""

from __future__ import annotations

import numpy as np

from ..log import Log
from ..numerics.low_pass import decimated, symmetric, zero_phase
from ..parameters import Array
from ..system import SecondOrderSystem


def smoothed(system: SecondOrderSystem, log: Log, cutoff: float) -> Log:
    """The log with q and v passed through a zero-phase Butterworth filter; u is unchanged.

    Positions on a manifold are filtered component by component; each measured position is then
    moved along its tangent space towards the filtered value, so that it remains on the manifold.
    The log has a constant rate; the cut-off [Hz] is limited to 0.8 of the Nyquist frequency.
    """
    rate = 1 / log.step
    cutoff, q = min(cutoff, 0.4 * rate), _continuous(system, log.q)
    filtered = zero_phase(q, cutoff, rate)
    if system.m != system.n:
        steps = [np.linalg.lstsq(system.J(z), dz)[0] for z, dz in zip(q, filtered - q, strict=True)]
        filtered = np.array([system.integrate(z, dz) for z, dz in zip(q, steps, strict=True)])
    return log._replace(q=filtered, v=zero_phase(log.v, cutoff, rate))


def _continuous(system: SecondOrderSystem, q: Array) -> Array:
    """Positions (N, m) with quaternion signs chosen so that they are continuous in time."""
    if system.group != 6:
        return q
    attitude = q[:, 3:7]
    turned = np.sum(attitude[1:] * attitude[:-1], axis=1) < 0
    side = np.where(np.cumsum(turned) % 2, -1.0, 1.0)
    q = q.copy()
    q[1:, 3:7] *= side[:, None]
    return q


def low_passed(W: Array, rate: float, cutoff: float) -> Array:
    """(K, n, p) rows of W (N, n, p), low-pass filtered and decimated to 4·cutoff [Hz].

    The filter is a symmetric FIR filter with half amplitude at the cut-off; rows where it would
    extend beyond the data are dropped.
    """
    return decimated(W, symmetric(cutoff, rate), max(1, int(rate / (4 * cutoff))))
