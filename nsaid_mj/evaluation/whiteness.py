"""Whether innovations are white, judged by their spectrum in octaves (Mehra, IEEE TAC 15(2), 1970).

Where the structure explains the motion, the normalised innovations of a filter are white: at every
frequency the periodogram of each is exponentially distributed about their variance, independently.
An effect that is left out makes them larger where the motion has its power, at 0.03 to a few hertz:
by far too little to be seen sample by sample, but over 1 to 100 s it adds up. So each octave has
its own test, from the mean of the whole log to the upper half of the spectrum, whose mean, or 1 if
that is larger, is the level of the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import gamma

from ..parameters import Array

_FEWEST = 32  # samples that have a spectrum


class Whiteness(NamedTuple):
    """How far innovations are from white.

    Attributes:
        chance: probability that white innovations have a cell, an octave of one channel, as large
            as the largest is, times the number of cells.
        energy: squared normalised innovations in excess of chance, in the cells with more than it.
        channel: of the largest cell; −1 if there is none.
        period: of the largest cell [samples]; infinite for the mean.
    """

    chance: float
    energy: float
    channel: int
    period: float


def whiteness(e: Array) -> Whiteness:
    """Judges normalised innovations (N, c); rows that are not finite are left out."""
    e = e[np.isfinite(e).all(axis=1)]
    if len(e) < _FEWEST:
        return Whiteness(1.0, 0.0, -1, np.inf)
    power = np.abs(np.fft.rfft(e, axis=0)) ** 2 / len(e)
    upper = len(power) // 2
    level = np.maximum(1.0, power[upper:].mean(axis=0))
    edges = [0, *_octaves(upper)]
    count = np.diff(edges)
    shape = np.where(np.array(edges[:-1]) == 0, 0.5, count)[:, None]  # of the mean: χ² of one
    ratio = np.add.reduceat(power[:upper], edges[:-1], axis=0) / count[:, None] / level
    chance = gamma.sf(ratio * shape, shape)
    beyond = chance < 0.05 / chance.size
    energy = float(np.sum((2 * shape * level * (ratio - 1))[beyond]))
    band, channel = np.unravel_index(np.argmin(chance), chance.shape)
    period = len(e) / edges[band] if edges[band] else np.inf
    return Whiteness(float(chance.min() * chance.size), energy, int(channel), float(period))


def _octaves(upper: int) -> list[int]:
    """Edges of the octaves, as indices of frequencies: 1, 3, 7, 15 … and `upper`."""
    edges = [1]
    while 2 * edges[-1] + 1 < upper:
        edges.append(2 * edges[-1] + 1)
    return [*edges, upper] if edges[-1] < upper else edges
