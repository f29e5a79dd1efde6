"""How far the clocks of commands and motion are apart, where no delay within reach fits."""

import numpy as np
import scipy

from ....base import Finding
from ....core import Array, Indices

_AGREE = 0.5  # correlation of forces from which commands and motion belong together
_BETTER = 0.2  # by which it must exceed that without an offset
_OVERLAP = 0.5  # of the log that both have at any offset that is tried


def at_edge(delay: float, where: str = "", offset: float | None = None) -> Finding:
    """The finding about a delay [s] at the edge of its search, which is none.

    `offset` [s] is how much later the commands would agree with the motion, if that was found.
    """
    if offset is not None:
        text = (
            f"commands and motion agree where the commands are taken {offset:+.3g} s later: their "
            "clocks are apart; no delay was used"
        )
        remedy = f"Set `offset = {offset:.4g}` for the file of the commands in the map."
        data = {"seconds": offset}
        return Finding("warning", "clock_offset", where, text, remedy, data)
    text = (
        "no delay of the command is identified: errors still fall at the edge of the search, "
        f"{delay * 1e3:+.0f} ms; none was used"
    )
    remedy = "Align the clocks of commands and positions in the map (`offset` of a file)."
    return Finding("warning", "delay_at_edge", where, text, remedy)


def clock_offset(needed: Array, acting: Array, t: Array, segment: Indices) -> float | None:
    """Time [s] by which forces that act (N, n) come before those that the motion needs (N, n).

    None unless both agree there and clearly less without it. t (N,) are times [s] at a constant
    rate within each segment (N,), of which the longest is used.
    """
    own = segment == np.bincount(segment).argmax()
    if own.sum() < 16:
        return None
    period = float(np.median(np.diff(t[own])))
    count = int(own.sum())
    lags = scipy.signal.correlation_lags(count, count)
    inside = np.abs(lags) <= (1 - _OVERLAP) * count
    total = np.zeros(len(lags))
    used = 0
    for want, have in zip(needed[own].T, acting[own].T, strict=True):
        pair = want - want.mean(), have - have.mean()
        size = float(np.linalg.norm(pair[0]) * np.linalg.norm(pair[1]))
        if size > 0:
            total += scipy.signal.correlate(*pair) / size
            used += 1
    if not used:
        return None
    # fewer rows overlap at a large offset
    agreement = total / used / np.maximum(1 - np.abs(lags) / count, _OVERLAP)
    best = int(np.argmax(np.where(inside, agreement, -np.inf)))
    now = float(agreement[len(lags) // 2])
    if agreement[best] < _AGREE or agreement[best] < now + _BETTER:
        return None
    return float(lags[best]) * period
