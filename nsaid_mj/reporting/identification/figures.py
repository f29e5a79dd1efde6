"""Figures of an identification: commands, residuals, intervals, correlations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...calibration import words
from ...calibration.result import Curves, Identification, Parameter
from ...calibration.timeline import own_shifts, recording_shifts
from ...evaluation.confidence import INTERVAL
from ...parameters import Array, Indices
from ..drawings import forest, heat_map, local_rms, named_lines
from ..palette import COLOURS, GRID, INK
from ..panels import Forest, HeatMap, Panel, template_figure, thin
from ..plots import logarithmic, over_time, style, svg

_WIDTH = 4.3  # of a panel [inch]
_POINTS = 1400  # of a curve, at most
_MOST = 36  # parameters of the correlations, at most
_MEASURED, _PREDICTED, _RESIDUAL = COLOURS[8], COLOURS[0], COLOURS[1]
_LEGEND = [
    ("measured", _MEASURED, "-"),
    ("predicted", _PREDICTED, "-"),
    ("residual, rms over short intervals", _RESIDUAL, "-"),
]
_TOLD = {"identified", "known"}
_WIDEST = 2.0  # half-width of a drawn interval, of a gain's logarithm


def commands(result: Identification, validation: bool = False) -> list[dict[str, Any]]:
    """One figure for each joint: command, measured and predicted, and their difference."""
    curves = result.validation if validation else result.curves
    if curves is None or not len(curves.t):
        return []
    shifts = own_shifts(curves) if validation else recording_shifts(result.recordings)
    t = curves.t + shifts[curves.segment]
    found = []
    for j, fit in enumerate(result.joints):
        title = words.title_of(fit, validation)
        symbol, unit = words.quantity(result, j)
        label = f"{symbol} [{unit}]" if unit else symbol
        drawing = _command(curves, t, j, label, title)
        found.append(template_figure(title, drawing, _LEGEND))
    return found


def _command(curves: Curves, t: Array, j: int, label: str, title: str) -> str:
    """SVG of one joint's command and residual; rows that were not used are shaded."""
    with style():
        figure = Figure(figsize=(_WIDTH, 3.0))
        upper = figure.add_axes((0.16, 0.42, 0.81, 0.54))
        lower = figure.add_axes((0.16, 0.14, 0.81, 0.22), sharex=upper)
        residual = curves.measured[:, j] - curves.predicted[:, j]
        for axis, values, colour, width in (
            (upper, curves.measured[:, j], _MEASURED, 3.0),
            (upper, curves.predicted[:, j], _PREDICTED, 0.9),
        ):
            alpha = 0.45 if colour == _MEASURED else 1.0  # shows where the curves differ
            line = _line(t, values, curves.segment)
            axis.plot(*line, color=colour, linewidth=width, alpha=alpha)
        rows = thin(len(t), _POINTS)
        for axis in (upper, lower):
            axis.fill_between(
                t[rows], 0, 1, where=~curves.usable[rows, j], step="mid",
                transform=axis.get_xaxis_transform(), color=GRID, alpha=0.9, linewidth=0, zorder=0,
            )  # fmt: skip
            axis.grid(False, axis="x")
        for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(curves.segment)) + 1):
            used = part[curves.usable[part, j] & np.isfinite(residual[part])]
            if len(used):
                lower.plot(*local_rms(t[used], residual[used]), color=_RESIDUAL, linewidth=0.9)
        logarithmic(lower, most=4)
        upper.margins(x=0.0)
        upper.tick_params(labelbottom=False)
        upper.set_ylabel(label)
        lower.set_ylabel(label.replace(label.partition(" ")[0], "error", 1))
        lower.set_xlabel("t [s]")
        figure.align_ylabels([upper, lower])
        return svg(figure, title)


def _line(t: Array, values: Array, segment: Indices) -> tuple[Array, Array]:
    """Points of a line with a gap between segments: all, or extremes of short intervals."""
    values = np.where(np.abs(values) < 1e200, values, np.nan)
    times, drawn = [], []
    for part in np.split(np.arange(len(t)), np.flatnonzero(np.diff(segment)) + 1):
        rows = part[_extremes(values[part], max(2, _POINTS * len(part) // len(t)))]
        times += [t[rows], t[rows[-1:]]]
        drawn += [values[rows], [np.nan]]
    return np.concatenate(times), np.concatenate(drawn)


def _extremes(values: Array, points: int) -> Indices:
    """Indices of at most about `points` values that keep every peak."""
    n = len(values)
    if n <= points:
        return np.arange(n)
    width = -(-2 * n // points)
    padded = np.append(values, np.full(-n % width, values[-1])).reshape(-1, width)
    low, high = (
        f(np.where(np.isfinite(padded), padded, fill), axis=1)
        for f, fill in ((np.argmin, np.inf), (np.argmax, -np.inf))
    )
    start = np.arange(len(padded)) * width
    chosen = np.concatenate([[0, n - 1], start + low, start + high])
    return np.unique(np.minimum(chosen, n - 1))


def joints(result: Identification) -> dict[str, Any]:
    """NRMSE of every joint on a logarithmic axis, beside least squares and the mean."""
    kinds = [
        ("held out", "held_out", "o", COLOURS[0]),
        ("weighted least squares, held out", "least_squares", "|", COLOURS[1]),
        ("validation log", "validation", "D", COLOURS[3]),
    ]
    rows = np.arange(len(result.joints))
    legend = []
    with style():
        figure, axis = named_lines([j.name for j in result.joints], least=2.4)
        for name, key, marker, colour in kinds:
            values = np.array([getattr(j, key) for j in result.joints], dtype=float)
            if np.isfinite(values).any():
                axis.plot(
                    values, rows, marker, color=colour, markersize=9 if marker == "|" else 5,
                    markeredgewidth=1.8 if marker == "|" else 0.8,
                )  # fmt: skip
                legend.append((name, colour, "-"))
        axis.axvline(1, color=INK, linewidth=0.8, linestyle="--")
        axis.plot([1], [-0.75], alpha=0)
        logarithmic(axis, "x")
        axis.set_xlabel("NRMSE of the command (1: predicting the mean)")
        return template_figure(
            f"Prediction error per {words.rows_of(result)[0]}", svg(figure, "NRMSE"), legend
        )


def forests(result: Identification, gains: bool) -> list[dict[str, Any]]:
    """Estimates with intervals and the values before the log: gains, or all others but links."""
    inertial = words.links(result.parameters)
    groups: dict[tuple[str, str], list[Parameter]] = {}
    for p in result.parameters:
        if p.block not in inertial and words.is_gain(p) == gains:
            block = p.label.partition(" of ")[0] if p.block.startswith("coupling") else p.block
            groups.setdefault((block, p.unit), []).append(p)
    return [_forest(block, unit, members) for (block, unit), members in groups.items()]


def _forest(block: str, unit: str, members: Sequence[Parameter]) -> dict[str, Any]:
    value, low, high, prior = np.array([(p.value, p.low, p.high, p.prior) for p in members]).T
    told = np.array([p.status in _TOLD for p in members])
    legend = [("identified", COLOURS[0], "-")] if told.any() else []
    legend += [("not identified by itself", COLOURS[8], "--")] if (~told).any() else []
    title = block[:1].upper() + block[1:]
    panel = Forest(
        title, f"{block} [{unit}]", [words.of_joint(p) for p in members],
        value, low, high, told, prior, legend,
    )  # fmt: skip
    return template_figure(title, forest(panel), legend)


def correlations(result: Identification) -> dict[str, Any] | None:
    """Correlation of gains, frictions and rotor inertias; None if there are less than two."""
    inertial = words.links(result.parameters)
    chosen = [
        k
        for k, p in enumerate(result.parameters)
        if p.block not in inertial and result.covariance[k, k] > 0
    ]
    chosen.sort(key=lambda k: not words.is_gain(result.parameters[k]))
    chosen = chosen[:_MOST]
    if len(chosen) < 2:
        return None
    deviation = np.sqrt(np.diag(result.covariance)[chosen])
    r = result.covariance[np.ix_(chosen, chosen)] / np.outer(deviation, deviation)
    names = [result.parameters[k].label for k in chosen]
    panel = HeatMap("", names, r)
    return template_figure("", heat_map(panel), panel.legend, wide=True)


def histories(result: Identification) -> list[dict[str, Any]]:
    """A law's estimates along the log over the batch fit's: gains, frictions, rotor inertias.

    Gains are over their geometric mean, with intervals.
    """
    along = result.law
    if along is None or len(along.t) < 2:
        return []
    inertial, panels = words.links(result.parameters), dict[str, Panel]()
    gains = along.actuators.tolist() if along.gains else []
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = along.theta / result.theta
        common = (
            np.exp(np.mean(np.log(ratios[:, gains]), axis=1)) if gains else np.ones(len(ratios))
        )
    half = INTERVAL * along.deviation
    for k, p in enumerate(result.parameters):
        if p.block in inertial or not result.theta[k] > 0:
            continue
        if k not in gains and p.status not in _TOLD:
            continue
        label = "over the batch fit [–]"
        panel = panels.setdefault(
            p.block, Panel(p.block[:1].upper() + p.block[1:], label, True, level=1.0)
        )
        name, ratio, band = words.of_joint(p), ratios[:, k] / common, None
        if k in gains and np.isfinite(half).any():
            factor = np.exp(np.minimum(half[:, gains.index(k)], _WIDEST))
            band = ratio / factor, ratio * factor
        panel.add(along.t, ratio, p.label if p.block.startswith("coupling") else name, band)
    gains_first = sorted(panels, key=lambda block: "gain" not in block)
    drawn = [panels[block] for block in gains_first]
    return [template_figure(p.title, over_time(p), p.legend) for p in drawn]
