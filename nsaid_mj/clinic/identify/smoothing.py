"""Smoothed motion of a segment, and the one low-pass filter through which all rows pass.

Positions pass through a zero-phase filter and are differentiated twice. Regressors and commands
then pass through the same low-pass filter and are decimated, so that the balance W(q, v, v̇, u) θ =
0 still holds for the filtered signals.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy

from ...core import Array, Indices, Log, LowPass, zero_phase
from ..logs.recordings import LogSegment, Recordings
from ..logs.signals import noise
from .problem import Mask

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

_WIDER = 5.0  # cut-off of the smoothing filter over that of the rows' filter
_FINE = 200.0  # least rate at which an arm's regressors are computed [Hz]


class Smooth(NamedTuple):
    """Smoothed motion of one segment at the rate at which regressors are computed."""

    t: Array  # (N,) times [s]
    q: Array  # (N, n) coordinates
    v: Array  # (N, n) velocities
    a: Array  # (N, n) accelerations
    usable: Mask  # (N, n) whether a velocity's row may be used


class Filter(NamedTuple):
    """The low-pass filters of a fit."""

    cutoff: float  # of the rows [Hz]: one and the same for regressors and commands
    rate: float  # rate of the recordings [Hz]
    every: int  # samples of the recordings per computed regressor
    least: int = 1  # computed regressors per row of the fit, at least
    differentiate: bool = False  # whether velocities are derivatives of positions
    quiet: float = 0.0  # frequency up to which velocities have little noise [Hz]

    @property
    def smoothing(self) -> float:
        """Cut-off of the zero-phase filter on positions, velocities and commands [Hz].

        Where the sensors are quiet it is as wide as the regressors' rate allows: dry friction
        changes within milliseconds, and a velocity that passes zero more slowly than the joint does
        leaves residuals that look like a lag or a yielding gear.
        """
        widest = min(self.quiet, 0.4 * self.rate / self.every)
        return min(max(_WIDER * self.cutoff, widest), 0.4 * self.rate)

    def low_pass(self, x: Array) -> Array:
        """x (N, ·) through the zero-phase smoothing filter."""
        return x if len(x) < 8 else zero_phase(x, self.smoothing, self.rate)

    @property
    def filter(self) -> LowPass:
        """The filter of the rows, at the regressors' rate."""
        return LowPass(self.cutoff, self.rate / self.every)

    @property
    def decimation(self) -> int:
        """Computed regressors per row of the fit: rows come at four times the cut-off."""
        return max(self.least, int(self.rate / self.every / (4 * self.cutoff)))

    def centres(self, samples: int) -> Indices:
        """Indices of the regressors, of `samples` in a segment, at the centres of the rows."""
        half = self.filter.half
        return np.arange(half, samples - half, self.decimation)

    def rows(self, x: Array) -> Array:
        """(K, ...) rows of x (N, ...) at the centres."""
        return self.filter.every(self.decimation, x)


def noise_levels(log: Log) -> tuple[float, float]:
    """Standard deviations of the noise of positions and of velocities, by fourth differences."""
    position, velocity = (float(np.median([noise(x) for x in part.T])) for part in (log.q, log.v))
    return position, velocity


def refined(recordings: Recordings) -> Recordings:
    """The recordings with splines between their rows, at `_FINE` rows per second or more.

    Friction and weight are not band-limited even if the motion is: computed at too low a rate and
    then low-passed, they would not match the low-passed command.
    """
    times = int(np.ceil(_FINE / recordings.rate - 1e-9))
    if times <= 1:
        return recordings
    segments = []
    for segment in recordings.segments:
        log = segment.log
        if len(log.t) < 8:
            segments.append(segment)
            continue
        t = np.linspace(log.t[0], log.t[-1], times * (len(log.t) - 1) + 1)
        near = np.round(np.arange(len(t)) / times).astype(int)
        spline = scipy.interpolate.make_interp_spline
        q, v, u = (spline(log.t, x, 5)(t) for x in (log.q, log.v, log.u))
        segments.append(segment._replace(log=Log(t, q, v, u), usable=segment.usable[near]))
    rate = times * recordings.rate
    return replace(recordings, segments=tuple(segments), rate=rate, filled=times)


def twice_as_noisy(recordings: Recordings) -> Recordings:
    """The recordings with independent noise added, which doubles that of the sensors."""
    rng = np.random.default_rng(0)
    segments = []
    for segment in recordings.segments:
        log = segment.log
        q, v = (
            x + [noise(column) for column in x.T] * rng.standard_normal(x.shape)
            for x in (log.q, log.v)
        )
        segments.append(segment._replace(log=Log(log.t, q, v, log.u)))
    return replace(recordings, segments=tuple(segments))


def smooth(segment: LogSegment, chosen: Filter) -> Smooth:
    """The smoothed motion of a segment."""
    log = segment.log
    pick = slice(None, None, chosen.every)
    q = chosen.low_pass(log.q)
    v = slope(log.t, q) if chosen.differentiate else chosen.low_pass(log.v)
    a = slope(log.t, v)
    return Smooth(log.t[pick], q[pick], v[pick], a[pick], segment.usable[pick])


def slope(t: Array, x: Array) -> Array:
    """(N, n) derivative of samples x (N, n), by splines of fifth degree.

    Central differences attenuate a frequency ω by (ωh)²/6: 18 % of the acceleration at 6 Hz and 50
    rows per second; splines by less than 0.1 %.
    """
    degree = min(5, (len(t) - 1) | 1)
    if degree > len(t) - 1:
        return np.gradient(x, t, axis=0) if len(t) > 1 else np.zeros_like(x)
    return np.asarray(scipy.interpolate.make_interp_spline(t, x, degree).derivative()(t))


def fed_back(feedback: Array | None, q: Array, v: Array) -> Array | float:
    """(N, n) what a PD law takes from the commands at (N, n) q and v; see `Recordings.feedback`."""
    return 0.0 if feedback is None else feedback[0] * q + feedback[1] * v


def smooth_commands(segment: LogSegment, chosen: Filter, feedback: Array | None = None) -> BSpline:
    """The cubic spline through a segment's commands (N, n_u) after the smoothing filter.

    Of motors under a PD law it is the part of the targets alone, see `Recordings.feedback`.
    """
    log = segment.log
    u = chosen.low_pass(log.u + fed_back(feedback, log.q, log.v))
    return scipy.interpolate.make_interp_spline(segment.log.t, u, min(3, len(u) - 1))


def delayed(segment: LogSegment, chosen: Filter, curve: BSpline, delay: Array) -> Array:
    """(N, n_u) smoothed commands at the regressors' times, `delay` (n_u,) [s] after recording."""
    t = segment.log.t
    at = t[:: chosen.every]
    found = np.empty((len(at), len(delay)))
    for value in np.unique(delay):
        own = delay == value
        found[:, own] = curve(np.clip(at - value, t[0], t[-1]))[:, own]
    return found
