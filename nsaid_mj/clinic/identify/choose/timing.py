"""When and how a vehicle's commands act: the actuators' delay and lag, and the rotors' curve.

All are chosen by the cost of the whole fit, see `vehicle_search`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ....base import Finding
from ....core import Array
from ....lab import INTERVAL
from .clocks import at_edge
from .options import DELAY, LAG, MIX, NUMBER, REACH, improves
from .thruster_curve import ThrusterCurve

_FINE = 0.0005  # of the best delay [s]
_STEPS = (0.0005, 0.001, 0.01, 0.01)
# first changes of delay, lag, mix and dead zone by which a cost rises
_DOUBLINGS = 6  # of a change, at most
_RISE = 2.0  # of the cost, at two standard deviations, which count as one: residuals are correlated
_CLOCK = 0.02  # of a sample: no log's clock and interpolation are more exact
_SLOWEST = 1.0  # lag of an actuator [s]
_AT_END = 0.95  # share of it from which a lag counts as no minimum: a simplex ends short of an edge
_WIDEST = 0.3  # dead zone of rotors
_DEAD = (0.08, 0.16)  # that are tried first
_NUMBERS = 4  # of a timing, see `_timing_of`
_AT_ONCE = np.array([0.0, 0.0, 1.0, 0.0])  # commands that are speeds of rotors and act at once


class Timing(NamedTuple):
    """When and how commands act."""

    delay: float | Array = 0.0  # that all actuators share [s]; (k,) one for each where it is given
    # share m of the square in a rotor's force m u² + (1 − m) u of a command u held for long: 1
    # where the command is the rotor's speed, 0 where it is its thrust
    mix: float = 1.0
    lag: float = 0.0  # time constant of a rotor's speed, or of another actuator's command [s]
    # command d at which rotors begin to turn: in the curve, u is (u − d)/(1 − d), as drives' ranges
    # begin above 0. Without it a constant force would pull the vehicle down by most of its weight
    dead: float = 0.0
    curve: ThrusterCurve = ThrusterCurve()  # of thrusters, by default the sheet's

    def speeds(self, u: Array, rate: float) -> Array:
        """(N, k) relative speeds of rotors under commands u (N, k), apart from the delay.

        Force grows with their square; `rate` is in samples per second [Hz].
        """
        size = np.maximum(np.abs(u) - self.dead, 0.0) / (1 - self.dead)
        speed = np.sign(u) * np.sqrt(self.mix * size**2 + (1 - self.mix) * size)
        if self.lag == 0:
            return speed
        r = 1 / (rate * self.lag)  # exact for a course that is linear between samples
        kept = np.exp(-r)
        mean = -np.expm1(-r) / r
        taps = [1 - mean, mean - kept]
        start = mean * speed[:1]
        return np.asarray(scipy.signal.lfilter(taps, [1, -kept], speed, axis=0, zi=start)[0])


class Timed(NamedTuple):
    """What a search of the timing found."""

    timing: Timing
    others: list[Timing]  # that are equally plausible
    findings: list[Finding]
    delay: tuple[float, float] | None = None  # 95 % interval [s]; None of one that is given


def search(
    cost: Callable[[Timing], float],
    names: Sequence[str],
    free: Sequence[int],
    report: Callable[[str], None],
    period: float,
    offset: Callable[[], float | None] = lambda: None,
    turning: float = _WIDEST,
) -> Timed:
    """The timing that minimises a cost, and equally plausible ones.

    Commands act after they were recorded. Where the cost says that they acted before, the clocks of
    commands and positions are apart, and this offset is called so; a delay at the edge of the
    search is not identified, and none is used.

    `names` are those of the actuators. `free` are the numbers of a timing that may change, see
    `_timing_of`: 0, the delay, 1, the lag, where some commands are not measured speeds, and 2 and
    3, the curve and its dead zone, where they are of rotors. `period` is that of the log [s],
    `offset` searches for clocks that are farther apart [s].
    """
    report("searching for delays")
    grid = np.array(DELAY.values)
    costs = np.array([cost(Timing(d)) for d in grid])
    at = int(np.argmin(costs))
    now = cost(Timing())
    edge = at in (0, len(grid) - 1) and improves(now, costs[at], NUMBER)
    found = _AT_ONCE.copy()
    earliest = 0.0
    if 0 < at < len(grid) - 1:
        least = scipy.optimize.minimize_scalar(
            lambda d: cost(Timing(d)), bounds=(grid[at - 1], grid[at + 1]), options={"xatol": _FINE}
        )
        early = least.x < 0 and improves(now, least.fun, NUMBER)
        if early:
            earliest = least.x - DELAY.values[1] + DELAY.values[0]
        if early or (least.x > 0 and improves(now, least.fun, DELAY.criterion)):
            found[0] = least.x

    def along(x: Array) -> float:
        timing = _timing_of(x, earliest)
        return np.inf if timing is None or timing.dead > turning else cost(timing)

    if 1 in free:
        report("choosing the actuators' curve and lag")
        found = _with_drive(along, found, free)
    timing = _timing_of(found, earliest) or Timing()
    notes = []
    if timing.lag > _AT_END * _SLOWEST:
        text = f"no lag of the actuators is identified: the cost still falls at {_SLOWEST:g} s"
        remedy = "Record faster changes of the commands, and check what the commands are."
        notes.append(Finding("warning", "lag_at_edge", "", text, remedy))
        timing = Timing()
        found = _AT_ONCE.copy()
    if edge and timing == Timing():
        notes.append(at_edge(grid[at], offset=offset()))
        return Timed(timing, _plausible(along, found, free, earliest)[0], notes)
    others, deviation = _plausible(along, found, free, earliest)
    delay = float(timing.delay)  # type: ignore[arg-type]  # of a search, that of all actuators
    half = INTERVAL * float(np.hypot(deviation[0], _CLOCK * period))
    ends = (max(delay - half, 0.0) if delay >= 0 else delay - half, delay + half)
    between = f"(95 %: {1e3 * ends[0]:.3g} to {1e3 * ends[1]:.3g} ms)"
    data = dict.fromkeys(names, delay)
    text = f"commands act {1e3 * delay:.1f} ms after they were recorded {between}"
    if earliest <= delay < 0 or delay > REACH:
        when = "before" if delay < 0 else "after"
        text = (
            f"commands act {abs(1e3 * delay):.3g} ms {when} they were recorded {between}, which is "
            "no delay but an offset between the clocks of commands and motion; it was used"
        )
        remedy = f"Set `offset = {delay:.4g}` for the file of the commands in the map."
        notes.append(Finding("warning", "clock_offset", "", text, remedy, data))
    elif delay > 0:
        notes.append(Finding("note", "delay", "", text, data=data))
    drive = _drive_notes(timing, INTERVAL * deviation[1], 2 in free)
    return Timed(timing, others, [*notes, *drive], ends)


def _timing_of(x: Array, earliest: float = 0.0) -> Timing | None:
    """The timing with four numbers that have distinguishable effects on the motion.

    They are the sum of delay and lag [s], which slow motion cannot separate, the lag [s], the share
    of the square, and the dead zone; None if there is no such timing. A delay is at least
    `earliest` [s].
    """
    total, lag, mix, dead = map(float, x)
    inside = 0 <= lag <= _SLOWEST and 0 <= mix <= 1 and 0 <= dead <= _WIDEST
    return Timing(max(total - lag, earliest), mix, lag, dead) if inside else None


def _with_drive(along: Callable[[Array], float], start: Array, free: Sequence[int]) -> Array:
    """The numbers of the timing that minimises the cost: a grid search, then a simplex.

    The search starts from the best delay for rotors whose commands are their speeds, without a lag.
    A dead zone is sought after them. A mix is rounded to 1 or 0, a lag and a dead zone to 0, if
    that raises the cost by less than `NUMBER` demands.
    """
    trials = MIX.values if 2 in free else MIX.values[:1]
    mixes = [np.array([start[0], 0.0, mix, 0.0]) for mix in trials]
    mix = min(mixes, key=along)[2]
    lags = [np.array([max(start[0], lag), lag, mix, 0.0]) for lag in LAG.values]
    best = min(lags, key=along)
    found = start
    if improves(along(mixes[0]), along(best), NUMBER):
        found = _descended(along, best, [k for k in free if k < 3])
    if 3 in free:
        zones = [np.array([*found[:2], mix, dead]) for dead in _DEAD for mix in (0.0, 0.5, 1.0)]
        best = min(zones, key=along)
        if improves(along(found), along(best), NUMBER):
            found = _descended(along, best, free)
    for k, plain in ((3, 0.0), (1, 0.0), (2, 0.0), (2, 1.0)):
        simpler = np.where(np.arange(_NUMBERS) == k, plain, found)
        if k in free and not improves(along(simpler), along(found), NUMBER):
            found = simpler
    return found


def _descended(along: Callable[[Array], float], best: Array, free: Sequence[int]) -> Array:
    """The numbers with the least cost near others, by a simplex of the free ones."""
    free = list(free)
    steps = np.diag([0.01, 0.01, 0.1 - 0.2 * (best[2] > 0.5), 0.03])[free]

    def placed(x: Array) -> Array:
        found = best.copy()
        found[free] = x
        return found

    corners = np.vstack([best, best + steps])[:, free]
    options = {"initial_simplex": corners, "xatol": 2e-3, "fatol": 1.0, "maxfev": 30 * len(free)}
    least = scipy.optimize.minimize(
        lambda x: along(placed(x)), corners[0], method="Nelder-Mead", options=options
    )
    return placed(least.x)


def _plausible(
    along: Callable[[Array], float], found: Array, free: Sequence[int], earliest: float
) -> tuple[list[Timing], Array]:
    """Timings that differ by the uncertainty of each number, and deviations of delay and lag [s].

    A number is changed in both directions until the cost rises as for two standard deviations, and
    the larger change is used, as the cost hardly depends on a small lag.
    """
    others = []
    least = along(found)
    now = _timing_of(found, earliest)
    sizes = np.zeros(_NUMBERS)
    for k in free:
        best = 0.0
        for side in (1, -1):
            step = side * _STEPS[k]
            rise = 0.0
            for _ in range(_DOUBLINGS):
                rise = along(found + step * np.eye(_NUMBERS)[k]) - least
                if rise >= _RISE:
                    break
                step *= 2
            if (
                np.isfinite(rise)
                and _timing_of(found + step * np.eye(_NUMBERS)[k], earliest) != now
            ):
                size = step * np.sqrt(_RISE / max(rise, _RISE))
                best = size if abs(size) > abs(best) else best
        sizes[k] = abs(best)
        others.append(_timing_of(found + best * np.eye(_NUMBERS)[k], earliest))
    # the cost hardly changes along delay − lag at a constant sum: both have the lag's deviation
    lag = 0.5 * sizes[1] if found[1] > 0 else 0.0
    deviation = np.array([np.hypot(0.5 * sizes[0], lag), lag])
    return [other for other in others if other is not None], deviation


def _drive_notes(timing: Timing, half: float, rotors: bool) -> list[Finding]:
    """Describes the drives, unless commands act at once, and those of rotors are their speeds.

    half [s] is half of the lag's 95 % interval.
    """
    found = []
    mix = timing.mix
    dead = timing.dead
    if mix != 1.0 or dead:
        u = f"x = (u − {dead:.2f})/{1 - dead:.2f}" if dead else "u"
        x = u[0]
        text = f"the rotors' thrust is {mix:.2f} {x}² + {1 - mix:.2f} {x} of the command u: "
        text += f"MOT_THST_EXPO (ArduPilot) or THR_MDL_FAC (PX4) = {mix:.2f}"
        if dead:
            text = text.replace("of the command u", f"with {u} of the command u")
            text += f", and the motors begin to turn at {dead:.2f} (MOT_SPIN_MIN, PWM_MIN)"
        found.append(Finding("note", "curve", "", text, data={"mix": mix, "dead zone": dead}))
    if timing.lag:
        who = "the rotors' speeds" if rotors else "the actuators"
        ends = [max(timing.lag + side * half, 0.0) for side in (-1, 1)]
        text = (
            f"{who} lag behind their commands by {timing.lag * 1e3:.0f} ms "
            f"(95 %: {1e3 * ends[0]:.0f} to {1e3 * ends[1]:.0f})"
        )
        data = {"seconds": timing.lag, "interval": ends}
        found.append(Finding("note", "lag", "", text, data=data))
    return found
