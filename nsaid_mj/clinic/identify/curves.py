"""What is drawn of an identification, as data: errors, predictions, a law's estimates.

Page and recording draw the same panels; those that are no part of a page are marked.
"""

from dataclasses import replace

import numpy as np

from ...lab import INTERVAL
from ...report import COLOURS, Comparison, Forest, Panel, Points
from ..servos.result import Replayed, ServoIdentification
from . import wording
from .result import Identification, shifts

_WIDEST = 2.0  # half-width of a drawn interval, of a gain's logarithm


def with_curves(result: Identification) -> Identification:
    """An identification with everything that is drawn of it; the first panel has the errors."""
    panels = (
        errors_of(result),
        *commands_of(result),
        *commands_of(result, validation=True),
        *histories_of(result),
        *_estimates_of(result),
    )
    return replace(result, curves=panels)


def errors_of(result: Identification) -> Forest:
    """NRMSE of every joint on a logarithmic axis, beside least squares and the mean."""
    held_out, *others = (
        (one.name, 100 * np.array(list(one.values.values()), dtype=float))
        for one in result.statistics
    )
    looks = (("|", COLOURS[1]), ("D", COLOURS[3]))
    points = [Points(*other, *look) for other, look in zip(others, looks, strict=False)]
    values = held_out[1]
    certain = np.ones(len(result.joints), bool)
    empty = np.full(len(values), np.nan)
    return Forest(
        f"Prediction error per {wording.rows_of(result)[0]}",
        "NRMSE of the command (100: predicting the mean) [%]",
        [j.name for j in result.joints],
        values,
        empty,
        empty,
        certain,
        points,
        held_out[0],
        100.0,
    )


def commands_of(result: Identification, validation: bool = False) -> tuple[Comparison, ...]:
    """One figure for each joint: command, measured and predicted, and their difference."""
    curves = result.validation if validation else result.predictions
    if curves is None or not len(curves.t):
        return ()
    found = []
    for j, fit in enumerate(result.joints):
        symbol, unit = wording.quantity(result, j)
        panel = Comparison(
            wording.title_of(fit, validation),
            symbol,
            unit,
            curves.t,
            curves.measured[:, j],
            curves.predicted[:, j],
            used=curves.usable[:, j],
            segment=curves.segment,
            key=("validation", "command", fit.name) if validation else ("command", fit.name),
        )
        found.append(panel)
    return tuple(found)


def histories_of(result: Identification) -> tuple[Panel, ...]:
    """A law's estimates along the log over the batch fit's: gains, frictions, rotor inertias.

    Gains are over their geometric mean, with intervals.
    """
    along = result.law
    if along is None or len(along.t) < 2:
        return ()
    bodies = result.bodies
    panels = dict[str, Panel]()
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
        title = p.block[:1].upper() + p.block[1:]
        label = "over the batch fit [–]"
        own = Panel(title, label, True, level=1.0, key=("relative", p.block))
        panel = panels.setdefault(p.block, own)
        name = p.part
        ratio = ratios[:, k] / common
        band = None
        if k in gains and np.isfinite(half).any():
            factor = np.exp(np.minimum(half[:, gains.index(k)], _WIDEST))
            band = ratio / factor, ratio * factor
        panel.add(along.t, ratio, p.label if p.block.startswith("coupling") else name, band)
    gains_first = sorted(panels, key=lambda block: "gain" not in block)
    return tuple(panels[block] for block in gains_first)


def _estimates_of(result: Identification) -> list[Panel]:
    """A law's estimates along the log with units, by block, for recordings.

    Gains have intervals relative to the mean of all, as the common scale is unobservable.
    """
    along = result.law
    if along is None:
        return []
    half = INTERVAL * along.deviation
    gains = {int(k): i for i, k in enumerate(along.actuators)}
    panels: dict[str, Panel] = {}
    for k, p in enumerate(result.parameters):
        if p.block in result.bodies:
            continue
        own = Panel(f"{p.block} along the log", p.block, key=("estimate", p.block), page=False)
        panel = panels.setdefault(p.block, own)
        value = along.theta[:, k]
        band = None
        if k in gains and np.isfinite(half).any():
            width = half[:, gains[k]]
            width = np.where(width < wording.UNKNOWN, width, np.nan)
            band = value * np.exp(-width), value * np.exp(width)
        panel.add(along.t, value, f"{p.label} [{p.unit}]", band, part=(p.label, "value"))
    return list(panels.values())


def replays_of(result: ServoIdentification, replayed: Replayed) -> tuple[Comparison, ...]:
    """Positions of every joint along all logs, measured and simulated with the exported file."""
    logs = replayed.logs
    slides = result.robot.system.slides
    moved = shifts([(log.source, log.t[0], log.t[-1]) for log in logs])
    t = np.concatenate([log.t + shift for log, shift in zip(logs, moved, strict=True)])
    measured = np.concatenate([log.position for log in logs])
    target = np.concatenate([log.target for log in logs])
    simulated = np.concatenate(replayed.simulated)
    segment = np.repeat(np.arange(len(logs)), [len(log.t) for log in logs])
    return tuple(
        Comparison(
            servo.name,
            "q",
            "m" if slide else "rad",
            t,
            measured[:, j],
            simulated[:, j],
            used=replayed.used > 0,
            segment=segment,
            key=("position", servo.name),
            computed="simulated",
            target=target[:, j],
        )
        for j, (servo, slide) in enumerate(zip(result.servos, slides, strict=True))
    )
