"""Panels of an identification: commands, residuals, intervals, correlations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...calibration import words
from ...calibration.result import Identification, Parameter
from ...calibration.timeline import own_shifts, recording_shifts
from ...evaluation.confidence import INTERVAL
from ..palette import COLOURS
from ..panels import AnyPanel, Comparison, Forest, HeatMap, Panel, Points

_MOST = 36  # parameters of the correlations, at most
_TOLD = {"identified", "known"}
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
    return [panels[block] for block in gains_first]
