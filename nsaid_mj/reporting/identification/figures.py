"""Panels of an identification: commands, residuals, intervals, correlations."""

from __future__ import annotations

import numpy as np

from ...calibration import words
from ...calibration.result import Identification
from ...calibration.timeline import own_shifts, recording_shifts
from ...evaluation.confidence import INTERVAL
from ..palette import COLOURS
from ..panels import AnyPanel, Comparison, Forest, HeatMap, Panel, Points
from ..parameters import correlations

_WIDEST = 2.0  # half-width of a drawn interval, of a gain's logarithm


def commands(result: Identification, validation: bool = False) -> list[AnyPanel]:
    """One figure for each joint: command, measured and predicted, and their difference."""
    curves = result.validation if validation else result.curves
    if curves is None or not len(curves.t):
        return []
    shifts = own_shifts(curves) if validation else recording_shifts(result.recordings)
    t = curves.t + shifts[curves.segment]
    found: list[AnyPanel] = []
    for j, fit in enumerate(result.joints):
        symbol, unit = words.quantity(result, j)
        panel = Comparison(
            words.title_of(fit, validation), symbol, unit, t, curves.measured[:, j],
            curves.predicted[:, j], used=curves.usable[:, j], segment=curves.segment,
        )  # fmt: skip
        found.append(panel)
    return found


def joints(result: Identification) -> Forest:
    """NRMSE of every joint on a logarithmic axis, beside least squares and the mean."""
    held_out, least_squares, validation = (
        np.array([getattr(j, key) for j in result.joints], dtype=float)
        for key in ("held_out", "least_squares", "validation")
    )
    others = [Points("weighted least squares, held out", least_squares, "|", COLOURS[1])]
    if np.isfinite(validation).any():
        others.append(Points("validation log", validation, "D", COLOURS[3]))
    empty = np.full(len(held_out), np.nan)
    return Forest(
        f"Prediction error per {words.rows_of(result)[0]}",
        "NRMSE of the command (1: predicting the mean) [–]", [j.name for j in result.joints],
        held_out, empty, empty, np.ones(len(held_out), bool), others, "held out", 1.0,
    )  # fmt: skip


def correlated(result: Identification) -> list[HeatMap]:
    """Correlation of gains, frictions and rotor inertias; empty for fewer than two."""
    bodies, variance = result.bodies, np.diag(result.covariance)
    chosen = [
        k for k, p in enumerate(result.parameters) if p.block not in bodies and variance[k] > 0
    ]
    chosen.sort(key=lambda k: not result.parameters[k].is_gain)
    r = result.covariance[np.ix_(chosen, chosen)]
    deviation = np.sqrt(variance[chosen])
    labels = [result.parameters[k].label for k in chosen]
    return correlations(labels, r / np.outer(deviation, deviation))


def histories(result: Identification) -> list[AnyPanel]:
    """A law's estimates along the log over the batch fit's: gains, frictions, rotor inertias.

    Gains are over their geometric mean, with intervals.
    """
    along = result.law
    if along is None or len(along.t) < 2:
        return []
    bodies, panels = result.bodies, dict[str, Panel]()
    gains = along.actuators.tolist() if along.gains else []
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = along.theta / result.theta
        common = (
            np.exp(np.mean(np.log(ratios[:, gains]), axis=1)) if gains else np.ones(len(ratios))
        )
    half = INTERVAL * along.deviation
    for k, p in enumerate(result.parameters):
        if p.block in bodies or not result.theta[k] > 0:
            continue
        if k not in gains and not p.firm:
            continue
        label = "over the batch fit [–]"
        panel = panels.setdefault(
            p.block, Panel(p.block[:1].upper() + p.block[1:], label, True, level=1.0)
        )
        name, ratio, band = p.part, ratios[:, k] / common, None
        if k in gains and np.isfinite(half).any():
            factor = np.exp(np.minimum(half[:, gains.index(k)], _WIDEST))
            band = ratio / factor, ratio * factor
        panel.add(along.t, ratio, p.label if p.block.startswith("coupling") else name, band)
    gains_first = sorted(panels, key=lambda block: "gain" not in block)
    return [panels[block] for block in gains_first]
