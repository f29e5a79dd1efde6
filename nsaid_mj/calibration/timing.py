"""When and how a vehicle's commands act: the actuators' delay, and the rotors' curve and lag.

All are judged by the cost of the whole fit, see `vehicles`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ..parameters import Array
from .findings import Finding
from .selection import REACH

WORTH = 6.0
"""Fall of the cost that a delay or a set of columns must bring: a likelihood ratio."""

_COARSE, _FINE = 0.02, 0.002  # spacing of the trial delays [s]
_MIXES = (1.0, 0.0, 0.3, 0.6, 0.8, 0.9)  # trial shares of the square
_LAGS = (0.0, 0.01, 0.02, 0.05, 0.1)  # trial lags of rotors [s]
_STEPS = (0.002, 0.003, 0.05)  # by which the cost's curvature is measured [s, s, 1]
_DOUBT = 2.0  # formal deviations that count as one


class Drive(NamedTuple):
    """How the rotors of a vehicle follow their commands.

    Attributes:
        mix: share m of the square in the force m u² + (1 − m) u of a command u held for long: 1
            where the command is the rotor's speed, 0 where it is its thrust.
        lag: time constant of the rotor's speed [s].
    """

    mix: float = 1.0
    lag: float = 0.0

    def speeds(self, u: Array, rate: float) -> Array:
        """(N, k) relative speeds of rotors under commands u (N, k); force grows with their square.

        `rate` is in samples per second [Hz].
        """
        size = np.abs(u)
        speed = np.sign(u) * np.sqrt(self.mix * size**2 + (1 - self.mix) * size)
        if self.lag == 0:
            return speed
        r = 1 / (rate * self.lag)  # exact for a course that is linear between samples
        kept, mean = np.exp(-r), -np.expm1(-r) / r
        taps, start = [1 - mean, mean - kept], mean * speed[:1]
        return np.asarray(scipy.signal.lfilter(taps, [1, -kept], speed, axis=0, zi=start)[0])


SPEED = Drive()
"""Of rotors whose commands are their speeds."""


class Timing(NamedTuple):
    """When and how commands act.

    Attributes:
        delay: that all actuators share [s]; (k,) one for each where it is given.
        drive: of the rotors.
    """

    delay: float | Array = 0.0
    drive: Drive = SPEED


class _Place(NamedTuple):
    """A timing as three numbers, each of which affects the motion in a way of its own.

    Attributes:
        total: delay and lag, which slow motion cannot tell apart [s].
        lag: [s].
        mix: share of the square.
    """

    total: float
    lag: float = 0.0
    mix: float = 1.0

    @property
    def timing(self) -> Timing | None:
        """The timing; None if there is no such one."""
        if self.lag < 0 or not 0 <= self.mix <= 1:
            return None
        return Timing(self.total - self.lag, Drive(self.mix, self.lag))


Cost = Callable[[Timing], float]


def search(
    cost: Cost, names: Sequence[str], rotors: bool, told: Callable[[str], None]
) -> tuple[Timing, list[Timing], list[Finding]]:
    """The timing that minimises a cost, others that are as plausible, and notes.

    Args:
        cost: of a timing.
        names: of the actuators.
        rotors: whether some are rotors whose commands may not be their speeds.
        told: called with the name of every stage.
    """
    told("searching for delays")
    grid = np.arange(-REACH, REACH + 1e-9, _COARSE)
    costs = np.array([cost(Timing(d)) for d in grid])
    at, zero = int(np.argmin(costs)), int(np.argmin(np.abs(grid)))
    found, there = _Place(0.0), costs[at] <= costs[zero] - WORTH
    edge = at in (0, len(grid) - 1)
    if there and not edge:
        least = scipy.optimize.minimize_scalar(
            lambda d: cost(Timing(d)), bounds=(grid[at - 1], grid[at + 1]), options={"xatol": _FINE}
        )
        found = _Place(float(least.x))
    along = _along(cost)
    if rotors:
        told("choosing the rotors' curve and lag")
        found = _with_drive(along, found)
    timing, notes = found.timing or Timing(), []
    if there and edge and not rotors:
        text = (
            f"the best delay of the commands, {grid[at] * 1e3:+.0f} ms, lies at the edge of the "
            "search"
        )
        remedy = "Align the clocks of commands and positions in the map."
        notes.append(Finding("warning", "delay_at_edge", "", text, remedy))
    elif there:
        text = f"commands act {timing.delay * 1e3:.1f} ms after they were recorded"
        notes.append(Finding("note", "delay", "", text, data=dict.fromkeys(names, timing.delay)))
    return timing, _plausible(along, found, rotors), [*notes, *_drive_notes(timing.drive)]


def _along(cost: Cost) -> Callable[[Array], float]:
    """The cost at the numbers of a place; infinite outside."""

    def along(x: Array) -> float:
        timing = _Place(*map(float, x)).timing
        return np.inf if timing is None else cost(timing)

    return along


def _with_drive(along: Callable[[Array], float], start: _Place) -> _Place:
    """The place with the rotors' drive that minimises the cost: a grid search, then a simplex.

    The search starts from the delay that suits rotors whose commands are their speeds, without a
    lag. A mix near 1 or 0, or a lag, that lowers the cost by less than `WORTH` is taken as 1 or 0.
    """
    mixes = [np.array(start._replace(mix=mix)) for mix in _MIXES]
    lags = [np.array([start.total, lag, min(mixes, key=along)[2]]) for lag in _LAGS]
    best = min(lags, key=along)
    if along(mixes[0]) < along(best) + WORTH:
        return start
    corners = best + np.vstack([np.zeros(3), np.diag([0.01, 0.01, 0.1 - 0.2 * (best[2] > 0.5)])])
    options = {"initial_simplex": corners, "xatol": 2e-3, "fatol": 1.0, "maxfev": 90}
    least = scipy.optimize.minimize(along, best, method="Nelder-Mead", options=options)
    found = np.asarray(least.x)
    for k, plain in ((1, 0.0), (2, 0.0), (2, 1.0)):
        simpler = np.where(np.arange(3) == k, plain, found)
        if along(simpler) < along(found) + WORTH:
            found = simpler
    return _Place(*found.tolist())


def _plausible(along: Callable[[Array], float], found: _Place, rotors: bool) -> list[Timing]:
    """Timings that differ from a found one by as much as its numbers are uncertain, in turn.

    An uncertainty is that of a parabola through the cost's rise by a small step to either side.
    """
    at, others = np.array(found), []
    least = along(at)
    for k, step in enumerate(_STEPS[: 3 if rotors else 1]):
        change = step * np.eye(3)[k]
        rises = [along(at + change) - least, along(at - change) - least]
        rise = max(float(np.mean([x for x in rises if np.isfinite(x)])), 0.5)
        size = _DOUBT * change / np.sqrt(2 * rise)
        sides = (_Place(*(at + side * size)).timing for side in (1, -1))
        others += [next(timing for timing in sides if timing is not None)]
    return others


def _drive_notes(drive: Drive) -> list[Finding]:
    """Describes the rotors' drives, unless their commands are their speeds at once."""
    found = []
    if drive.mix != 1.0:
        text = f"the rotors' thrust is {drive.mix:.2f} u² + {1 - drive.mix:.2f} u of the command u"
        found.append(Finding("note", "curve", "", text, data={"mix": drive.mix}))
    if drive.lag:
        text = f"the rotors' speeds lag behind their commands by {drive.lag * 1e3:.0f} ms"
        found.append(Finding("note", "lag", "", text, data={"seconds": drive.lag}))
    return found
