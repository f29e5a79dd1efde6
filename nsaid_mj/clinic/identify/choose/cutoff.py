"""The cut-off of the rows' filter: the middle of those that predict held-out data equally well.

A higher cut-off tells more until its rows are noise, which biases θ̂ as errors in variables do.
Errors in bands of their own cannot be compared, since a lower cut-off takes the noise out of what
is predicted. So estimates at several cut-offs predict the rows of the lowest, in which the motion
has its power; the spread of the fits over the range in which none is better widens intervals.
"""

from collections.abc import Sequence

import numpy as np
import scipy

from ....core import Array, Log
from ...logs.recordings import Recordings
from ..smoothing import Filter, noise_levels
from .columns import SPEEDS

NARROWER = 0.6
"""Another plausible cut-off over the chosen one."""

_SHARE = 0.99  # of the velocity's power below the bandwidth of the motion
_MOST = 0.95  # of this power below the lowest cut-off of a comparison
_OVER = 2.5  # that cut-off over the frequency of this power
FEWEST = 200  # rows per velocity that a lower cut-off must leave
_FACTOR = 1.5  # between cut-offs that are compared
_ALIKE = 0.02  # difference of the logarithms of errors that does not matter
_ABOVE = 4.0  # power, relative to the noise's, from which it counts as motion
_LOWEST = 3.0  # cut-offs of the rows' filter [Hz]
_HIGHEST = 20.0
_SAMPLES = 10  # regressors computed per period of the rows' cut-off
_FAST = 100.0  # and per second, at least: friction's steps are not band-limited [Hz]
_SLOW = 0.5 * SPEEDS[0]  # the slowest speed of friction is not blurred [rad/s or m/s]
_LEAST = 1e-9  # noise of a sensor [rad, m, rad/s or m/s]
_MOST_ROWS = 20_000  # of a fit: of an hour, thinned ones determine all that its length can


def filter_for(recordings: Recordings, cutoff: float | None = None) -> Filter:
    """The filter that passes the motion.

    `cutoff` of the rows [Hz] is by default three times the frequency below which 99 % of the
    velocities' power lies, within 3 and 20 Hz.
    """
    rate = recordings.rate
    if cutoff is None:
        cutoff = float(np.clip(3 * _bandwidth(recordings, _SHARE), _LOWEST, _HIGHEST))
    cutoff = min(cutoff, 0.2 * rate)
    every = max(1, int(rate / max(_SAMPLES * cutoff, _FAST)))
    computed = sum(len(segment.log.t) for segment in recordings.segments) / every
    least = max(1, int(np.ceil(computed / _MOST_ROWS)))
    log = _longest(recordings)
    derived = False
    quiet = 0.0
    if log.q.shape[1] == log.v.shape[1]:
        # drives often report filtered velocities, delayed relative to the positions: they are used
        # only if the positions' derivative has more than three times their noise
        position, velocity = noise_levels(log)
        derived = bool(position * 2 * np.pi * cutoff / np.sqrt(3) <= 3 * velocity + 1e-12)
        measured = Log(*(x[:: recordings.filled] for x in log))
        quiet = _quiet(measured, rate / recordings.filled, derived)
    return Filter(cutoff, rate, every, least, derived, quiet)


def _quiet(log: Log, rate: float, derived: bool) -> float:
    """Frequency [Hz] up to which noise makes velocities of an rms of `_SLOW`.

    White noise of variance σ² has the density 2 σ²/rate; in the derivative it grows with (2π f)².
    """
    position, velocity = noise_levels(log)
    if derived:
        power = max(position, _LEAST) ** 2 / rate
        return float(np.cbrt(3 * _SLOW**2 / (8 * np.pi**2 * power)))
    return _SLOW**2 * rate / (2 * max(velocity, _LEAST) ** 2)


def trials(recordings: Recordings) -> list[float]:
    """Cut-offs that are compared [Hz], the lowest first; the last but one is that of `filter_for`.

    The lowest passes what moves, and leaves enough rows.
    """
    usual = filter_for(recordings).cutoff
    seconds = sum(len(segment.log.t) for segment in recordings.segments) / recordings.rate
    fewest = FEWEST / (4 * seconds)  # rows come at four times the cut-off
    lowest = max(2.0, _OVER * _bandwidth(recordings, _MOST), fewest)
    lower = int(np.log(max(usual / lowest, 1.0)) / np.log(_FACTOR) + 1e-9)
    return (usual * _FACTOR ** np.arange(-lower, 2)).tolist()


def flat_range(errors: Array) -> Sequence[int]:
    """Neighbouring cut-offs, of those with errors (C, 5), between which nothing speaks.

    They are about the best, and differ from it by less than `_ALIKE` or the standard error of the
    difference over the parts of the log.
    """
    level = np.log(errors)
    best = int(np.argmin(level.mean(axis=1)))
    apart = level - level[best]
    error = apart.std(axis=1) / np.sqrt(apart.shape[1] - 1)
    alike = apart.mean(axis=1) <= np.maximum(_ALIKE, error)
    first = best
    while first > 0 and alike[first - 1]:
        first -= 1
    last = best
    while last < len(level) - 1 and alike[last + 1]:
        last += 1
    return range(first, last + 1)


def middle_of(flat: Sequence[int], usual: int) -> int:
    """The usual cut-off unless all of the range lies below it; then one in the range's lower half.

    Noise grows with a power of the cut-off, information does not, and the motion has none above the
    usual one.
    """
    return usual if flat[-1] >= usual else flat[0] + (len(flat) - 1) // 3


def _longest(recordings: Recordings) -> Log:
    return max(recordings.segments, key=lambda s: len(s.log.t)).log


def _bandwidth(recordings: Recordings, share: float) -> float:
    """Frequency [Hz] below which a share of the velocities' power lies, noise excluded.

    Noise and quantisation of an encoder are nearly white in the positions, and grow with the
    frequency in the velocities: their density is estimated from the upper half of the frequencies,
    power below `_ABOVE` times it counts as noise, and so does what lies above all cut-offs.
    """
    longest = _longest(recordings)
    rate = recordings.rate
    own = longest.q.shape == longest.v.shape
    x = longest.q if own else longest.v
    window = min(len(x), int(4 * rate))
    x = scipy.signal.detrend(x, axis=0)
    frequencies, power = scipy.signal.welch(x, fs=rate, window="hann", nperseg=window, axis=0)
    low = frequencies <= min(_HIGHEST, 0.4 * rate)
    if own:
        floor = np.median(power[frequencies > 0.25 * rate], axis=0)
        power = np.where(power > _ABOVE * floor, power - floor, 0.0)
        power *= (2 * np.pi * frequencies[:, None]) ** 2
    power = power / np.maximum(power[low].sum(axis=0), 1e-300)
    total = np.cumsum(power[low].mean(axis=1))
    return float(frequencies[low][np.searchsorted(total, share * total[-1])])
