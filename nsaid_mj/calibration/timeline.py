"""One time axis for several logs, for plots and recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..parameters import Array
from .data import Recordings
from .result import Curves

_BETWEEN = 1.0  # time between two logs on the common axis [s]
_NEAR = 10.0  # a log that begins this soon after the one before it keeps its own times [s]


def shifts(spans: Sequence[tuple[str, float, float]]) -> Array:
    """(S,) times [s] to add to the segments' own, so that logs follow one another.

    Spans are the segments' files, and the times of their first and last samples [s].

    Segments of one file keep their distances, so that the axis shows the file's times up to a
    constant, and exactly for the first file.
    """
    found, shift, end = [], 0.0, -np.inf
    for k, (source, start, last) in enumerate(spans):
        if k > 0 and (source != spans[k - 1][0] or start + shift < end):
            shift = 0.0 if end <= start <= end + _NEAR else end + _BETWEEN - start
        found.append(shift)
        end = last + shift
    return np.array(found)


def recording_shifts(recordings: Recordings) -> Array:
    """(S,) shifts of the segments of recordings."""
    return shifts([(s.source, s.log.t[0], s.log.t[-1]) for s in recordings.segments])


def own_shifts(curves: Curves) -> Array:
    """Shifts by number of the segment, for curves whose logs are not at hand."""
    count = int(curves.segment.max(initial=-1)) + 1
    spans, last = [], 0.0
    for k in range(count):
        t = curves.t[curves.segment == k]
        start, last = (float(t[0]), float(t[-1])) if len(t) else (last, last)
        spans.append(("", start, last))
    return shifts(spans)
