"""The page of identified servos, and the table of models on their logs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ... import __version__
from ...core import Array
from ...report import (
    Cell,
    Comparison,
    Figures,
    Page,
    PageItem,
    Parameter,
    Result,
    Section,
    Table,
    Text,
    count,
    figures_of,
    robot_picture,
)
from ..identify.comparison import Score
from ..identify.curves import replays_of
from .export import servos_of_file
from .logs import ServoLog
from .result import UNTOLD, Replayed, ServoIdentification

_SHOWN = {"T": 1e3, "f": 1e3, "kp": 1.0, "d": 1e3, "armature": 1.0}
# factor to the unit in the cells
_HEADS = ("servo", "kv/kp", "f/kp", "kp", "delay", "armature", "error", "baseline")
_UNITS = {
    "T": ("ms", "ms"),
    "f": ("mrad", "mm"),
    "kp": ("N·m/rad", "N/m"),
    "d": ("ms", "ms"),
    "armature": ("kg·m²", "kg"),
}
# of hinges and slides
_REPLAYED = 30.0  # of a log that are drawn [s]
_PER_SERVO = 6  # parameters
_WIDE = 10.0  # upper end over the estimate, above which no interval is drawn


def servo_page(
    result: ServoIdentification, commands: Sequence[str] = (), replay: Replayed | None = None
) -> Page:
    """The page of identified servos.

    `commands` repeat the identification and show its recording; the first log of `replay` is drawn.
    """
    sections = [Section("Servos", _servos(result), brief=True)]
    if result.robot.source is not None:
        sections += compared(result, servos_of_file(result))
    if replay is not None:
        start = result.robot.system.position(replay.logs[0].position[:1])[0]
        sketch = robot_picture(result.robot.visuals, start, result.robot.name)
        sections[0] = replace(sections[0], beside=sketch)
        result = replace(result, curves=replays_of(result, replay))
        sections.append(_replay(result, replay.logs[0]))
    return Page(
        heading=result.robot.name,
        result=result,
        eyebrow="identification of position servos from logs",
        lead=f"{count(len(result.servos), 'servo')}, each with its 95 % intervals.",
        sections=sections,
        commands=commands,
        versions={"nsaid-mj": __version__},
    )


def compared(result: ServoIdentification, before: Array) -> list[Section]:
    """Identified numbers beside those of the user's file, (4, n) of `servos_of_file`."""
    title = "The model file's values, and the identified ones"
    return [
        Section(title, _changed(result, before)),
        Section("Intervals", _intervals(result, before)),
    ]


def _changed(result: ServoIdentification, before: Array) -> list[PageItem]:
    """What the exported file states in place of the user's: `before` (4, n) of `servos_of_file`."""
    lines: list[list[Cell]] = []
    for old, servo in zip(before.T, result.servos, strict=True):
        new = servo.kp, servo.kv, servo.armature, servo.friction
        pairs = zip(old.tolist(), new, strict=True)
        lines.append([servo.name, *(f"{_number(a)} → {_number(b)}" for a, b in pairs)])
    heads = ["servo", "kp", "kv", "armature", "frictionloss"]
    words = "In MuJoCo's units. What carries ~ above holds only in combination with the others."
    return [Table(heads, lines), Text(words, note=True)]


def _intervals(result: ServoIdentification, before: Array) -> list[PageItem]:
    """Every kind of number with its intervals, and the value that the user's file implies."""
    kp, kv, armature, friction = before
    with np.errstate(divide="ignore", invalid="ignore"):
        stated = {"T": kv / kp, "f": friction / kp, "kp": kp, "armature": armature}
    shown = []
    for k, p in enumerate(result.parameters):
        kind = p.name.partition("_")[0]
        if kind in _SHOWN:
            joint = k // _PER_SERVO
            what = p.label.partition(" of ")[0]
            label = f"{what} of {result.servos[joint].name}"
            prior = float(stated[kind][joint]) if kind in stated else np.nan
            wide = p.high > _WIDE * p.value  # an interval that hides all others
            high = np.nan if wide else p.high
            shown.append(replace(p, block=what, label=label, prior=prior, high=high))
    words = f"Lines are 95 % intervals, up to {_WIDE:g} times the estimate; ◇: the model file."
    note = Text(words, note=True)
    return [Figures(figures_of(Parameter.forests(shown))), note]


def _replay(result: ServoIdentification, log: ServoLog) -> Section:
    """Positions along the first log, measured and simulated; what the fit left out is shaded."""
    rows = slice(int(np.searchsorted(log.t, log.t[0] + _REPLAYED, side="right")))
    panels = [panel.first(rows.stop) for panel in result.curves if isinstance(panel, Comparison)]
    t = log.t[rows] - log.t[0]
    all_used = all(panel.used is None or panel.used.all() for panel in panels)
    note = "MuJoCo with the exported file, driven by the targets alone from the first position on"
    note += f"; the first {t[-1]:.0f} s." if len(t) < len(log.t) else "."
    note += "" if all_used else " Shaded: left out of the fit, because of external forces."
    return Section(f"Replay of {log.source}", [Figures(figures_of(panels)), Text(note, note=True)])


def _servos(result: ServoIdentification) -> list[PageItem]:
    """Every servo with its 95 % intervals."""
    lines: list[list[Cell]] = []
    slides = result.robot.system.slides
    for k, (servo, slide) in enumerate(zip(result.servos, slides, strict=True)):
        own = result.parameters[_PER_SERVO * k : _PER_SERVO * (k + 1)]
        cells = [_cell(p, slide) for p in own if p.name.partition("_")[0] in _SHOWN]
        small = _UNITS["f"][slide]
        errors = [f"{1e3 * error:.1f} {small}" for error in (servo.error, servo.simple)]
        lines.append([servo.name, *cells, *errors])
    panels: list[PageItem] = [Table(_HEADS, lines, spare=(7, 5))]
    told = [p.combination for p in result.parameters if p.combination]
    if any(words.startswith(UNTOLD) for words in told):
        text = "(…) not identifiable, since gravity does not load the joint: taken from the other "
        text += "joints, or from your file. kv/kp, f/kp and armature/kp do not depend on it."
        panels.append(Text(text))
    if not all(words.startswith(UNTOLD) for words in told):
        panels.append(Text("~ only in combination with others; identification.json says which."))
    panels.append(
        Text(
            "error: mean absolute error of the open-loop simulation; baseline: same for the "
            "delayed target, or a constant."
        )
    )
    return panels


def scores_page(scores: Sequence[Score], unit: str) -> Page:
    """The errors of models on logs, as means over all joints in a unit of 1/1000."""
    heads = ["model", *(f"{time} [{unit}]" for time in ("0.2 s", "2 s", "log"))]
    heads += ["one step [NRMSE]", "CPU [s]"]
    lines: list[list[Cell]] = []
    for score in scores:
        numbers = [*(1e3 * score.errors.mean(axis=1)), score.one_step.mean()]
        cells = ["–" if np.isnan(x) else f"{x:.2f}" if x < 1e4 else "diverges" for x in numbers]
        lines.append([score.model, *cells, f"{score.seconds:.1f}"])
    note = "Mean absolute errors of open-loop simulations that start again after this time; "
    note += "identified, sysid: each half of the logs is predicted from the other."
    return Page("", Result(), sections=[Section("", [Table(heads, lines), Text(note)], brief=True)])


def _cell(parameter: Parameter, slide: bool) -> str:
    """A value with its unit and interval, or marked where only a combination is identified."""
    name = parameter.name.partition("_")[0]
    scale = _SHOWN[name]
    value = f"{_number(scale * parameter.value)} {_UNITS[name][slide]}"
    if parameter.combination.startswith(UNTOLD):
        return f"({value})"
    if parameter.status != "identified":
        return f"~ {value}"
    half = 50 * (parameter.high - parameter.low) / parameter.value
    return f"{value} ±{half:.0f} %"


def _number(x: float) -> str:
    """Three digits, all of them before the point from 1000 on."""
    return f"{x:.0f}" if x >= 1e3 else f"{x:.3g}"
