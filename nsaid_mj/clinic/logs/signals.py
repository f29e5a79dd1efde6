"""One signal over time: order of its rows, outliers, noise, quantisation, resampling."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy import ndimage

from ...core import Array, zero_phase

LONG_GAP = 0.05
"""A signal is split where it has no rows for longer than this [s] and than five of its periods."""

_RESET = 20  # successive rows before the latest time from which the clock has restarted
_AT_ZERO = 0.005  # share of rows without force from which commands of one sign have none
_PAUSE = 1.0  # between the parts of a file whose clock was reset [s]


class Signal(NamedTuple):
    """A quantity in order of time."""

    t: Array  # (N,) times [s], strictly increasing
    x: Array  # (N,) finite values
    row: np.ndarray  # (N,) their rows in the file
    doubtful: Array  # (k, 2) open intervals of time in which values are interpolated [s]

    @property
    def period(self) -> float:
        """The median interval between rows [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def rate(self) -> float:
        """Mean rows per second, gaps aside."""
        steps = np.diff(self.t)
        return float(1 / np.mean(steps[steps <= 3 * np.median(steps)]))


class Order(NamedTuple):
    """The usable rows of a clock."""

    index: np.ndarray  # (N,) rows used, from 0
    t: Array  # (N,) their times [s], strictly increasing
    repeated: np.ndarray  # rows dropped because their time equals that of an earlier row
    late: np.ndarray  # rows dropped because their time lies before that of an earlier row
    resets: np.ndarray  # rows at which the clock restarts; later times are shifted to follow on
    rows: np.ndarray  # (N,) rows used, from 1


def without_signs(commands: Sequence[Array]) -> bool:
    """Whether commands (N,) of two joints or more are magnitudes: of one sign, and often 0.

    Those that never change are not judged. A joint that weight always pulls to one side has one
    sign, but is not without force for long.
    """
    known = [u[np.isfinite(u)] for u in commands]
    moving = [u for u in known if len(u) and np.ptp(u) > 0]
    return len(moving) > 1 and all(
        (u.min() == 0 or u.max() == 0) and np.mean(u == 0) > _AT_ZERO for u in moving
    )


def runs(chosen: np.ndarray) -> np.ndarray:
    """(k, 2) first row of every run of chosen (N,) rows, and the first one after it."""
    return np.flatnonzero(np.diff(np.r_[False, chosen, False].astype(int))).reshape(-1, 2)


def order(t: Array) -> Order:
    """Puts a clock in order: drops rows that repeat or step back, follows one that restarts."""
    index = np.flatnonzero(np.isfinite(t))
    t = t[index].copy()
    resets = []
    while True:
        behind = np.zeros(len(t), bool)
        behind[1:] = t[1:] < np.maximum.accumulate(t)[:-1]
        edges = runs(behind)
        long = edges[np.diff(edges, axis=1)[:, 0] > _RESET]
        if not len(long):
            break
        start = long[0, 0]
        resets.append(index[start])
        t[start:] += t[:start].max() - t[start] + _PAUSE
    latest = np.maximum.accumulate(t)
    keep = np.r_[True, t[1:] > latest[:-1]] if len(t) else np.zeros(0, bool)
    same = np.r_[False, t[1:] == latest[:-1]] if len(t) else keep
    late = ~keep & ~same
    used = index[keep]
    return Order(used, t[keep], index[same], index[late], np.array(resets, int), used + 1)


def unwrap(x: Array) -> tuple[Array, np.ndarray]:
    """An angle (N,) [rad] continued across jumps of a whole turn, and the rows after the jumps."""
    steps = np.diff(x)
    jumps = np.flatnonzero(np.abs(steps) > 0.9 * 2 * np.pi)
    if not len(jumps) or np.any(np.abs(steps[jumps]) > 1.1 * 2 * np.pi):
        return x, np.zeros(0, int)
    turns = np.zeros(len(x))
    turns[jumps + 1] = -np.round(steps[jumps] / (2 * np.pi))
    return x + 2 * np.pi * np.cumsum(turns), jumps + 1


def heading_unit(x: Array) -> Literal["rad", "deg"]:
    """The unit of a heading (N,): degrees begin beyond a turn in radians, or jump by 360."""
    begins = len(x) > 0 and abs(x[0]) > 1.05 * 2 * np.pi
    jumps = np.abs(np.abs(np.diff(x)) - 360) < 90
    return "deg" if begins or jumps.any() else "rad"


def outliers(t: Array, x: Array) -> np.ndarray:
    """Rows that lie off the curve through their neighbours, at most three in a row.

    A single row is compared with the cubic through two rows on either side, several with the median
    of seven rows (Hampel). The threshold depends on the noise, the quantisation and the steps
    between nearby rows, so that neither fast motion nor a repeated value counts as an outlier.
    """
    if len(x) < 15:
        return np.zeros(0, int)
    steps = np.abs(np.diff(x, prepend=x[0]))
    nearby = ndimage.median_filter(steps, 15, mode="nearest")
    some = steps[steps > 0]
    smallest = float(np.quantile(some, 0.25)) if len(some) else 0.0
    noisy = 1.4826 * np.median(np.abs(np.diff(x, 4))) / np.sqrt(70)  # see `noise`
    floor = max(8 * noisy, 5 * smallest)
    from_cubic = np.abs(ndimage.convolve1d(x, np.array([1, -4, 6, -4, 1]) / 6, mode="nearest"))
    intervals = np.diff(t, prepend=2 * t[0] - t[1])
    uneven = ndimage.maximum_filter1d(intervals > 1.5 * np.median(intervals), 5)
    uneven[[0, 1, -2, -1]] = True
    from_cubic = np.where(uneven, 0.0, from_cubic)
    peak = from_cubic >= ndimage.maximum_filter1d(from_cubic, 5)
    single = peak & (from_cubic > np.maximum(3 * nearby, floor))
    from_median = np.abs(x - ndimage.median_filter(x, 7, mode="nearest"))
    far = single | (from_median > np.maximum(10 * nearby, floor))
    short = [np.arange(start, end) for start, end in runs(far) if end - start <= 3]
    return np.concatenate(short) if short else np.zeros(0, int)


def noise(x: Array) -> float:
    """Standard deviation of the white part of a smooth signal, by its fourth differences.

    The mean square of fourth differences of white noise is C(8, 4) = 70 times its variance; the
    largest hundredth of them is excluded.
    """
    if len(x) < 10:
        return 0.0
    squares = np.diff(x, 4) ** 2
    kept = max(5, int(0.99 * len(squares)))
    squares.partition(kept - 1)
    return float(np.sqrt(np.mean(squares[:kept]) / 70))


def quantum(x: Array) -> float:
    """The step of which all values are multiples, up to an offset; 0 if there is none.

    In N rows with at most N/2 levels, neighbours or some of 20 √N rows are equal; if none are, the
    rows need not be sorted.
    """
    some = np.sort(x[:: max(1, int(len(x) ** 0.5 / 20))])
    if not ((some[1:] == some[:-1]).any() or (x[1:] == x[:-1]).any()):
        return 0.0
    levels = np.unique(x)
    if not 3 <= len(levels) <= 0.5 * len(x):
        return 0.0
    steps = np.diff(levels)
    steps = steps[steps > 1e-9 * (levels[-1] - levels[0])]
    step = float(steps.min())
    step = float(np.median(steps[steps < 1.5 * step]))
    multiples = steps / step
    off = np.abs(multiples - np.round(multiples)) > 0.1
    return step if np.mean(off) < 0.02 else 0.0


def flat_extremes(x: Array, period: float) -> np.ndarray:
    """(N,) whether a row belongs to a plateau at the largest or smallest value.

    A clipped signal stays at exactly one value, its extreme, for at least 5 rows and 10 ms, and
    takes it far more often than the next level, unlike a quantised peak.
    """
    found = np.zeros(len(x), bool)
    spread = float(np.ptp(x))
    if spread == 0:
        return found
    shortest = max(5, round(0.01 / period))
    for extreme in (x.max(), x.min()):
        at = np.abs(x - extreme) <= 1e-9 * spread
        edges = runs(at)
        long = edges[edges[:, 1] - edges[:, 0] >= shortest]
        following = x[~at].max() if extreme == x.max() else x[~at].min()
        if len(long) and at.sum() > 6 * np.sum(np.abs(x - following) <= 1e-9 * spread):
            for start, end in long:
                found[start:end] = True
    return found


def gaps(s: Signal) -> Array:
    """(k, 2) beginning and end of every gap of a signal [s]."""
    late = np.flatnonzero(np.diff(s.t) > max(5 * s.period, LONG_GAP))
    return np.column_stack([s.t[late], s.t[late + 1]])


def dropouts(s: Signal) -> Array:
    """(k, 2) beginning and end of every interval with missing rows, gaps included [s]."""
    late = np.flatnonzero(np.diff(s.t) > 2.5 * s.period)
    return np.column_stack([s.t[late], s.t[late + 1]])


def resample(s: Signal, t: Array, hold: bool = False) -> Array:
    """(N,) the signal at the times t (N,) of a grid [s], within the signal's rows.

    A signal with more than one and a half rows per step of the grid is first low-passed with zero
    phase, so that nothing above half the grid's rate is aliased. With `hold` a value holds until
    the next row; else values are interpolated linearly.
    """
    if hold:
        return s.x[np.clip(np.searchsorted(s.t, t + 1e-9, side="right") - 1, 0, None)]
    step = (t[-1] - t[0]) / (len(t) - 1)
    factor = round(step / s.period)
    if factor < 2:
        return np.interp(t, s.t, s.x)
    fine = t[0] + step / factor * np.arange((len(t) - 1) * factor + 1)
    return low_pass(np.interp(fine, s.t, s.x), 0.8 / factor)[::factor]


def low_pass(x: Array, cut: float) -> Array:
    """A zero-phase Butterworth low-pass of x (N,) or (N, k), of order 4 forward and backward.

    `cut` is the frequency of −6 dB over half the sampling rate.
    """
    return zero_phase(x, cut, 2.0, periods=6.0)


def derivative(x: Array, rate: float) -> Array:
    """The zero-phase derivative of (N, k) values at a constant rate, low-passed at `bandwidth`."""
    slopes = np.gradient(x, 1 / rate, axis=0)
    return low_pass(slopes, bandwidth(rate) / (0.5 * rate))


def bandwidth(rate: float) -> float:
    """Cut-off of the derivative of positions at a given rate [Hz]."""
    return min(100.0, rate / 5)


def derivative_noise(sigma: float, position_rate: float, rate: float) -> float:
    """Standard deviation of the derivative, on a grid of `rate` [Hz], of positions with noise σ.

    White noise σ at the positions' rate f [Hz] has the density 2σ²/f, and the derivative up to fc
    the variance ∫ (2πf')² 2σ²/f df' = (2π)² 2σ² fc³ / (3f).
    """
    cut = bandwidth(rate)
    return 2 * np.pi * sigma * np.sqrt(2 * cut**3 / (3 * position_rate))
