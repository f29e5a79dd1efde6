"""One time axis for several logs, for plots and recordings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..parameters import Array
from .result import Curves, Identification

_BETWEEN = 1.0  # time between two logs on the common axis [s]
_NEAR = 10.0  # a log that begins this soon after the one before it keeps its own times [s]


class Span(NamedTuple):
    """Duration of a segment.

    Attributes:
        source: file name.
        start: of its first sample [s].
        end: of its last sample [s].
    """

    source: str
    start: float
    end: float


def shifts(spans: Sequence[Span]) -> Array:
    """(S,) times [s] to add to the segments' own, so that logs follow one another.

    Segments of one file keep their distances, so that the axis shows the file's times up to a
    constant, and exactly for the first file.
    """
    found, shift, end = [], 0.0, -np.inf
    for k, span in enumerate(spans):
        new = k > 0 and (span.source != spans[k - 1].source or span.start + shift < end)
        if new:
            shift = 0.0
            if not end <= span.start <= end + _NEAR:
                shift = end + _BETWEEN - span.start
        found.append(shift)
        end = span.end + shift
    return np.array(found)


def training_shifts(result: Identification) -> Array:
    """(S,) shifts of the segments of the training logs."""
    return shifts(
        [Span(s.source, float(s.log.t[0]), float(s.log.t[-1])) for s in result.recordings.segments]
    )


def own_shifts(curves: Curves) -> Array:
    """Shifts by number of the segment, for curves whose logs are not at hand."""
    count = int(curves.segment.max(initial=-1)) + 1
    spans, last = [], 0.0
    for k in range(count):
        t = curves.t[curves.segment == k]
        start, last = (float(t[0]), float(t[-1])) if len(t) else (last, last)
        spans.append(Span("", start, last))
    return shifts(spans)


def history_times(result: Identification) -> Array:
    """(K,) times of the estimates along the log on the common axis; empty if there are none.

    Each time is found among the rows of the fit, of which it is one, in their order.
    """
    if result.history is None:
        return np.zeros(0)
    curves, shift, found, row = result.curves, training_shifts(result), [], 0
    for t in result.history[0]:
        later = np.flatnonzero(curves.t[row:] == t)
        row += int(later[0]) if len(later) else 0
        inside = row < len(curves.segment)
        found.append(t + (shift[int(curves.segment[row])] if inside else 0.0))
    return np.array(found)
