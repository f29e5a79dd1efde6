"""Whether innovations are white, judged by their spectrum in octaves (Mehra, IEEE TAC 15(2), 1970).

Where the structure explains the motion, the normalised innovations of a filter are white: at every
frequency the periodogram of each is exponentially distributed about their variance, independently.
An effect that is left out makes them larger where the motion has its power, at 0.03 to a few hertz:
by far too little to be seen sample by sample, but over 1 to 100 s it adds up. So each octave has
its own test, from the mean of the whole log to the upper half of the spectrum, whose mean, or 1 if
that is larger, is the level of the others; and so has each line, for periodic motions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import gammaincc

from ..parameters import Array, Indices

_FEWEST = 32  # samples that have a spectrum


class Whiteness(NamedTuple):
    """How far innovations are from white.

    Attributes:
        chance: probability that white innovations have a cell, an octave or a line of one channel,
            as large as the largest is, times the number of cells.
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
    edges = np.array([0, *_octaves(upper)])
    octaves = np.add.reduceat(power[:upper], edges[:-1], axis=0)
    lines = np.arange(1, upper)
    found = [
        _judged(power[lines] / level, np.ones(len(lines)), lines, level),
        _judged(octaves / level, np.where(edges[:-1], np.diff(edges), 0.5), edges[:-1], level),
    ]
    chance = min(2.0 * one.chance for one in found)  # two families of tests
    energy = max(one.energy for one in found)
    best = min(found, key=lambda one: one.chance)
    return Whiteness(chance, energy, best.channel, len(e) * best.period)


def _judged(sums: Array, shape: Array, first: Indices, level: Array) -> Whiteness:
    """Judges cells of a spectrum, with the period in units of the log's length.

    Args:
        sums: (b, c) of the periodogram over its level; Γ(shape, 1) of white innovations.
        shape: (b,) number of frequencies in each; ½ for the mean.
        first: (b,) lowest frequency in each, in periods of the log.
        level: (c,) of each channel.
    """
    sums = sums * np.where(shape < 1, 0.5, 1.0)[:, None]  # the mean is χ² of one degree
    chance = gammaincc(shape[:, None], sums)
    beyond = chance < 0.05 / chance.size
    energy = float(np.sum((2 * level * (sums - shape[:, None]))[beyond]))
    band, channel = np.unravel_index(np.argmin(chance), chance.shape)
    period = 1 / first[band] if first[band] else np.inf
    return Whiteness(float(chance.min() * chance.size), energy, int(channel), float(period))


def _octaves(upper: int) -> list[int]:
    """Edges of the octaves, as indices of frequencies: 1, 3, 7, 15 … and `upper`."""
    edges = [1]
    while 2 * edges[-1] + 1 < upper:
        edges.append(2 * edges[-1] + 1)
    return [*edges, upper] if edges[-1] < upper else edges
