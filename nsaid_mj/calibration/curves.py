"""What the page of an identification draws, as data: errors, predictions, a law's estimates."""

import numpy as np

from ..evaluation.confidence import INTERVAL
from ..evaluation.panels import COLOURS, Comparison, Forest, Panel, Points
from . import words
from .result import Identification

_WIDEST = 2.0  # half-width of a drawn interval, of a gain's logarithm


def errors_of(result: Identification) -> Forest:
    """NRMSE of every joint on a logarithmic axis, beside least squares and the mean."""
    held_out, *others = (
        (figure.name, 100 * np.array(list(figure.values.values()), dtype=float))
        for figure in result.figures
    )
    looks = (("|", COLOURS[1]), ("D", COLOURS[3]))
    points = [Points(*other, *look) for other, look in zip(others, looks, strict=False)]
    values, certain = held_out[1], np.ones(len(result.joints), bool)
    empty = np.full(len(values), np.nan)
    return Forest(
        f"Prediction error per {words.rows_of(result)[0]}",
        "NRMSE of the command (100: predicting the mean) [%]", [j.name for j in result.joints],
        values, empty, empty, certain, points, held_out[0], 100.0,
    )  # fmt: skip


def commands_of(result: Identification, validation: bool = False) -> tuple[Comparison, ...]:
    """One figure for each joint: command, measured and predicted, and their difference."""
    curves = result.validation if validation else result.predictions
    if curves is None or not len(curves.t):
        return ()
    found = []
    for j, fit in enumerate(result.joints):
        symbol, unit = words.quantity(result, j)
        panel = Comparison(
            words.title_of(fit, validation), symbol, unit, curves.t, curves.measured[:, j],
            curves.predicted[:, j], used=curves.usable[:, j], segment=curves.segment,
        )  # fmt: skip
        found.append(panel)
    return tuple(found)


def histories_of(result: Identification) -> tuple[Panel, ...]:
    """A law's estimates along the log over the batch fit's: gains, frictions, rotor inertias.

    Gains are over their geometric mean, with intervals.
    """
    along = result.law
    if along is None or len(along.t) < 2:
        return ()
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
    return tuple(panels[block] for block in gains_first)
