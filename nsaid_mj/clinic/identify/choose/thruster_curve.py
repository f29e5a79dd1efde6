"""The force of thrusters over their command, where a log shows another curve than the sheet's.

    force = thrust · F(u),  F(u) = ((|u| − d)/(1 − d))ᵉ for u > d, −r times that for u < −d, else 0

with the dead zone d, the exponent e and the ratio r of reverse to forward thrust, alike for all
thrusters of a vehicle; or the sheet's own curve, reversed r times as strong. F(1) is the sheet's.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy

from ....base import Finding
from ....core import Array, Column
from ....lab import INTERVAL
from .options import NUMBER, Criterion, Option, improves

SHEET = 0.0
"""In place of an exponent: the sheet's own curve."""

# a curve has three numbers, each of which must pay
_PAYS = Criterion("cost", 3 * NUMBER.worth)
EXPONENT = Option("exponent of the thrusters' curve", "timing", "1", (1.0, 1.5, 2.0), _PAYS)
DEAD_ZONE = Option("dead zone of the thrusters", "timing", "1", (0.02, 0.08), NUMBER)
REVERSE = Option("reverse over forward thrust", "timing", "1", (0.9, 0.96, 1.04, 1.1), NUMBER)

_GRID = np.linspace(-1.0, 1.0, 801)  # commands at which a curve is tabulated
_LIMITS = np.array([[0.0, 0.3], [0.7, 3.0], [np.log(0.5), np.log(2.0)]])
_STEPS = np.array([0.01, 0.05, 0.02])  # of dead zone, exponent and log r: first and for slopes
_CORRELATED = 2.0  # deviations that count as one, as residuals are correlated; see `timing._RISE`
_TOLD = np.array([0.04, 0.1, 0.05])  # deviations beyond which a log does not tell the curve
_LEAST = np.array([0.002, 0.01, 0.002])  # deviations that a simulated ROV's log does not reach


class ThrusterCurve(NamedTuple):
    """F(u) of a vehicle's thrusters."""

    dead: float = 0.0  # d, largest command without force
    exponent: float = SHEET  # e; `SHEET` for the sheet's curve
    reverse: float = (
        1.0  # r, reverse over forward thrust, over that of the sheet's curve if that is
    )

    def shares(self, u: Array, sheet: Array) -> Array:
        """(N,) F(u) at commands (N,), relative to the sheet's curve at 1; `sheet` is that of it."""
        if self.exponent == SHEET:
            return np.where(u < 0, self.reverse, 1.0) * curve_values(sheet, u)
        size = np.maximum(np.abs(u) - self.dead, 0.0) / (1 - self.dead)
        full = float(curve_values(sheet, np.ones(1))[0])
        return full * np.sign(u) * size**self.exponent * np.where(u < 0, self.reverse, 1.0)

    def as_sheets(self, u: Array, sheet: Array) -> Array:
        """(N,) commands at which the sheet's curve is this one at commands (N,)."""
        whole = curve_values(sheet, _GRID)
        rising = slice(int(np.argmin(whole)), int(np.argmax(whole)) + 1)
        return np.interp(self.shares(u, sheet), whole[rising], _GRID[rising])

    def column(self, column: Column) -> Column:
        """A thruster's column with this curve in place of the sheet's."""
        sheet = sheet_curve(column)
        table = Column.interpolated(_GRID, self.shares(_GRID, sheet))
        constants: dict[str, Any] = dict(column.constants) | {"curve": table}
        place = {"body": column.body, "dof": column.dof, "input": column.input}
        return Column(column.kind, column.parameter, **place, **constants)


def sheet_curve(column: Column) -> Array:
    """The curve of a thruster's column; without one in the sheet, the command itself."""
    return np.asarray(column.constants.get("curve", Column.polynomial(1.0)))


def curve_values(curve: Array, u: Array) -> Array:
    """(N,) values of a column's curve at commands (N,): a polynomial of u, u|u| …, or a table."""
    count = int(curve[0])
    if count < 0:
        points = curve[1 : 1 - count]
        return np.interp(u, points, curve[1 - count :])
    powers = np.arange(1, count + 1)
    return np.sign(u) * (np.abs(u)[:, None] ** powers @ curve[1 : count + 1])


TRIALS = (
    *(ThrusterCurve(d, e) for e in EXPONENT.values for d in (0.0, *DEAD_ZONE.values)),
    *(ThrusterCurve(reverse=r) for r in REVERSE.values),
)
"""First trials."""


def rough_curve(
    cost: Callable[[ThrusterCurve], float], best: ThrusterCurve
) -> tuple[ThrusterCurve, bool]:
    """The curve that minimises a cost, near the `best` of the first trials; whether a log tells it.

    A log of a single motion, or of small commands, does not.
    """
    free = _free(best)
    along = _along(cost, free)
    found = _descended(along, _numbers(best), free)
    deviation = np.diag(_deviations(along, found, free))
    return _curve(found, free), bool((deviation <= _TOLD)[free].all())


def fitted_curve(
    cost: Callable[[ThrusterCurve], float], near: ThrusterCurve
) -> tuple[ThrusterCurve, list[ThrusterCurve], list[Finding]]:
    """The curve that minimises a cost, equally plausible ones, and a note; the sheet's if it does.

    `cost` is that of the whole fit with a curve, `near` the curve from which the search starts.
    """
    sheet = ThrusterCurve()
    free = _free(near)
    along = _along(cost, free)
    found = _descended(along, _numbers(near), free)
    criterion = EXPONENT.criterion if len(free) == 3 else REVERSE.criterion
    if not improves(cost(sheet), along(found), criterion):
        return sheet, [], []
    deviation = _deviations(along, found, free)
    for k in (2, 0):  # a number that differs from none by less than its deviation is left out
        if len(free) == 3 and abs(found[k]) < 2 * deviation[k, k]:
            simpler = np.where(np.arange(3) == k, 0.0, found)
            rest = [other for other in free if other != k]
            simpler = _descended(along, simpler, rest)
            if not improves(along(simpler), along(found), NUMBER):
                found = simpler
    others = [
        _curve(np.clip(found + side * step, *_LIMITS.T), free)
        for step in deviation[:, free].T
        for side in (1, -1)
    ]
    return _curve(found, free), others, [_note(_curve(found, free), np.diag(deviation), free)]


def _free(curve: ThrusterCurve) -> list[int]:
    """Which of dead zone, exponent and log r a curve has."""
    return [2] if curve.exponent == SHEET else [0, 1, 2]


def _numbers(curve: ThrusterCurve) -> Array:
    """(3,) dead zone, exponent, log r."""
    return np.array([curve.dead, curve.exponent, np.log(curve.reverse)])


def _along(cost: Callable[[ThrusterCurve], float], free: Sequence[int]) -> Callable[[Array], float]:
    """The cost over the three numbers; infinite beyond their limits."""
    known: dict[ThrusterCurve, float] = {}

    def along(x: Array) -> float:
        if not ((x >= _LIMITS[:, 0]) & (x <= _LIMITS[:, 1]))[list(free)].all():
            return np.inf
        curve = _curve(x, free)
        if curve not in known:
            known[curve] = cost(curve)
        return known[curve]

    return along


def _curve(x: Array, free: Sequence[int]) -> ThrusterCurve:
    """The curve of three numbers: dead zone, exponent, log r."""
    if len(free) == 1:
        return ThrusterCurve(reverse=float(np.exp(x[2])))
    return ThrusterCurve(float(x[0]), float(x[1]), float(np.exp(x[2])))


def _descended(along: Callable[[Array], float], start: Array, free: Sequence[int]) -> Array:
    """The numbers (3,) with the least cost near others, by a simplex of the free ones."""

    def placed(x: Array) -> Array:
        found = start.copy()
        found[list(free)] = x
        return found

    corners = np.vstack([start, *(start + np.diag(_STEPS))[list(free)]])[:, list(free)]
    options = {"initial_simplex": corners, "xatol": 2e-3, "fatol": 0.5, "maxfev": 60}
    least = scipy.optimize.minimize(
        lambda x: along(placed(x)), corners[0], method="Nelder-Mead", options=options
    )
    return placed(least.x)


def _deviations(along: Callable[[Array], float], found: Array, free: Sequence[int]) -> Array:
    """(3, 3) changes of the numbers that count as one deviation, in columns of a square root.

    Row and column k belong to number k; the diagonal has the deviations of single ones.
    """
    count = len(free)
    steps = np.diag(_STEPS)[list(free)]
    inner = np.maximum(found, _LIMITS[:, 0] + _STEPS)  # differences stay inside the limits
    middle = along(inner)
    hessian = np.zeros((count, count))
    for i in range(count):
        hessian[i, i] = along(inner + steps[i]) + along(inner - steps[i]) - 2 * middle
    for i in range(count):
        for j in range(i):
            both = along(inner + steps[i] + steps[j]) + along(inner - steps[i] - steps[j])
            mixed = 0.5 * (both - 2 * middle - hessian[i, i] - hessian[j, j])
            hessian[i, j] = hessian[j, i] = mixed
    size = _STEPS[list(free)]
    values, axes = np.linalg.eigh(np.where(np.isfinite(hessian), hessian, 0.0))
    values = np.maximum(values, 1e-2)  # no log tells a curve to more than ten first steps
    covariance = (axes / values) @ axes.T * np.outer(size, size) * _CORRELATED**2
    own = np.maximum(np.sqrt(np.diag(covariance)), _LEAST[list(free)])
    changes = np.zeros((3, 3))
    for i, k in enumerate(free):  # what one deviation of number k implies of the others
        changes[list(free), k] = covariance[:, i] / np.sqrt(covariance[i, i])
        changes[k, k] = own[i]
    return changes


def _note(curve: ThrusterCurve, deviation: Array, free: Sequence[int]) -> Finding:
    """The curve in words and numbers with 95 % intervals."""
    half = INTERVAL * deviation
    data: dict[str, list[float]] = {}
    words = []
    if len(free) == 3:
        low = max(curve.dead - half[0], 0.0)
        data["dead zone"] = [curve.dead, low, curve.dead + half[0]]
        ends = curve.exponent - half[1], curve.exponent + half[1]
        data["exponent"] = [curve.exponent, *ends]
        words.append(f"dead zone {curve.dead:.3f} ({low:.3f} to {curve.dead + half[0]:.3f})")
        words.append(f"exponent {curve.exponent:.2f} ({ends[0]:.2f} to {ends[1]:.2f})")
    ends = curve.reverse * np.exp(-half[2]), curve.reverse * np.exp(half[2])
    data["reverse"] = [curve.reverse, *map(float, ends)]
    than = "" if len(free) == 3 else " over the sheet's"
    words.append(f"reverse thrust{than} {curve.reverse:.3f} ({ends[0]:.3f} to {ends[1]:.3f}) times")
    text = (
        f"the thrusters follow another curve than the sheet's: {', '.join(words)} the forward one"
    )
    if len(free) == 3:
        expo = flight_controllers_share(curve)
        data["expo"] = [expo]
        text += (
            f"; of a flight controller's curves MOT_THST_EXPO = THR_MDL_FAC = {expo:.2f} is nearest"
        )
    return Finding("note", "thruster_curve", "", text, data=data)


def flight_controllers_share(curve: ThrusterCurve) -> float:
    """The m of m u² + (1 − m) u that is nearest to a curve over its forward commands.

    ArduPilot calls it MOT_THST_EXPO, PX4 THR_MDL_FAC.
    """
    u = np.linspace(0.0, 1.0, 101)
    wanted = curve.shares(u, np.array([1.0, 1.0])) - u
    bend = u**2 - u
    return float(np.clip(wanted @ bend / (bend @ bend), 0.0, 1.0))
