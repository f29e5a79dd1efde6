"""Low-pass filters without a phase."""

from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_ORDER = 4  # forward, and the same backward


def zero_phase(x: _Array, cutoff: float, rate: float, periods: float = 3.0) -> _Array:
    """A Butterworth filter of x (N, ...) along the first axis, forward and backward.

    `cutoff` is the frequency of −6 dB and `rate` that of the samples [Hz]; values are extrapolated
    by so many `periods` of the cut-off at both ends.
    """
    reach = min(len(x) - 1, int(periods * rate / cutoff))
    found = scipy.signal.sosfiltfilt(_sections(cutoff, rate), x, axis=0, padlen=reach)
    return np.asarray(found, dtype=np.float64)


@lru_cache(maxsize=64)
def _sections(cutoff: float, rate: float) -> _Array:
    """The filter's second-order sections, whose design takes longer than filtering a short log."""
    return scipy.signal.butter(_ORDER, cutoff, fs=rate, output="sos")


class LowPass:
    """An FIR filter without a phase, with half amplitude at a cut-off.

    `cutoff` is that frequency and `rate` that of the samples [Hz].

    Attributes:
        half: number h of samples on either side that it extends to.
    """

    def __init__(self, cutoff: float, rate: float):
        self._weights = _symmetric(cutoff, rate)
        self.half = len(self._weights) // 2

    def every(self, count: int, x: _Array) -> _Array:
        """(K, ...) every so many values of x (N, ...), filtered.

        Values at which the filter would extend beyond the data are dropped.
        """
        weights = self._weights
        if len(x) < len(weights):
            return np.empty((0, *x.shape[1:]))
        flat = x.reshape(len(x), -1)
        windows = np.lib.stride_tricks.sliding_window_view(flat, len(weights), axis=0)[::count]
        return (windows @ weights).reshape(len(windows), *x.shape[1:])


@lru_cache(maxsize=64)
def _symmetric(cutoff: float, rate: float) -> _Array:
    """(2h + 1,) weights of the filter."""
    half = int(np.ceil(1.5 * rate / cutoff))
    weights = scipy.signal.firwin(2 * half + 1, min(cutoff, 0.45 * rate), fs=rate)
    weights.flags.writeable = False  # they are shared
    return np.asarray(weights, dtype=np.float64)
