"""Panels of an identification: commands, residuals, intervals, correlations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...calibration import words
from ...calibration.result import Identification, Parameter
from ...calibration.timeline import history_times, own_shifts, training_shifts
from ..palette import COLOURS
from ..panels import AnyPanel, Comparison, Forest, HeatMap, Panel, Points

_MOST = 36  # parameters of the correlations, at most
_TOLD = {"identified", "known"}


def commands(result: Identification, validation: bool = False) -> list[AnyPanel]:
    """One figure for each joint: command, measured and predicted, and their difference."""
    curves = result.validation if validation else result.curves
    if curves is None or not len(curves.t):
        return []
    shifts = own_shifts(curves) if validation else training_shifts(result)
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


def forests(result: Identification, gains: bool) -> list[AnyPanel]:
    """Estimates with intervals and the values before the log: gains, or all others but links."""
    inertial = words.links(result.parameters)
    groups: dict[tuple[str, str], list[Parameter]] = {}
    for p in result.parameters:
        if p.block not in inertial and words.is_gain(p) == gains:
            block = p.label.partition(" of ")[0] if p.block.startswith("coupling") else p.block
            groups.setdefault((block, p.unit), []).append(p)
    return [_forest(block, unit, members) for (block, unit), members in groups.items()]


def _forest(block: str, unit: str, members: Sequence[Parameter]) -> Forest:
    value, low, high, prior = np.array([(p.value, p.low, p.high, p.prior) for p in members]).T
    firm = np.array([p.status in _TOLD for p in members])
    names = [words.of_joint(p) for p in members]
    before = [Points("before the log", prior)]
    title = block[:1].upper() + block[1:]
    return Forest(title, f"{block} [{unit}]", names, value, low, high, firm, before)


def correlations(result: Identification) -> list[AnyPanel]:
    """Correlation of gains, frictions and rotor inertias; empty if there are less than two."""
    inertial = words.links(result.parameters)
    chosen = [
        k
        for k, p in enumerate(result.parameters)
        if p.block not in inertial and result.covariance[k, k] > 0
    ]
    chosen.sort(key=lambda k: not words.is_gain(result.parameters[k]))
    chosen = chosen[:_MOST]
    if len(chosen) < 2:
        return []
    deviation = np.sqrt(np.diag(result.covariance)[chosen])
    r = result.covariance[np.ix_(chosen, chosen)] / np.outer(deviation, deviation)
    return [HeatMap("", [result.parameters[k].label for k in chosen], r)]


def histories(result: Identification) -> list[AnyPanel]:
    """Estimates along the log over the final ones: gains, frictions, rotor inertias."""
    if result.history is None:
        return []
    t, theta = history_times(result), result.history[1]
    inertial = words.links(result.parameters)
    panels: dict[str, Panel] = {}
    for k, p in enumerate(result.parameters):
        if p.block in inertial or not result.theta[k] > 0 or len(t) < 2:
            continue
        if not words.is_gain(p) and p.status not in _TOLD:
            continue
        panel = panels.setdefault(
            p.block,
            Panel(p.block[:1].upper() + p.block[1:], "estimate / final [–]", True, level=1.0),
        )
        name = p.label if p.block.startswith("coupling") else words.of_joint(p)
        panel.add(t, theta[:, k] / result.theta[k], name)
    gains_first = sorted(panels, key=lambda block: "gain" not in block)
    return [panels[block] for block in gains_first]
