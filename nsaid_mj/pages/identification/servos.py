"""The page of identified servos, and the table of models on their logs."""

from collections.abc import Sequence

import numpy as np

from ... import __version__
from ...calibration.comparison import Score
from ...calibration.servos import Replayed, ServoIdentification
from ...evaluation.panels import Comparison
from ...evaluation.result import Parameter, Result
from ...structure.joints import moving_joints, slides
from ..drawings import figures_of
from ..page import Cell, Figures, Page, Panel, Section, Table, Text, count

_SHOWN = {"T": 1e3, "f": 1e3, "kp": 1.0, "d": 1e3, "armature": 1.0}
# factor to the unit in the head
_HEADS = ("servo", "kv/kp [ms]", "f/kp [{rad}]", "kp [{kp}]", "delay [ms]", "armature [{armature}]",
          "error [{rad}]", "simple [{rad}]")  # fmt: skip
_UNITS = {"kp": ("N·m/rad", "N/m"), "armature": ("kg·m²", "kg"), "rad": ("mrad", "mm")}
# of hinges and slides
_REPLAYED = 30.0  # of a log that are drawn [s]
_PER_SERVO = 6  # parameters


def page(
    result: ServoIdentification, commands: Sequence[str] = (), replay: Replayed | None = None
) -> Page:
    """The page of identified servos.

    `commands` repeat the identification and show its recording; the first log of `replay` is drawn.
    """
    sections = [Section("Servos", _servos(result), brief=True)]
    return Page(
        heading=result.robot.name,
        result=result,
        eyebrow="identification of position servos from logs",
        lead=f"{count(len(result.servos), 'servo')}, each with its 95 % intervals.",
        sections=sections if replay is None else [*sections, _replay(result, replay)],
        commands=commands,
        versions={"nsaid-mj": __version__},
    )


def _replay(result: ServoIdentification, replay: Replayed) -> Section:
    """Positions of every joint, measured and simulated; windows left out of the fit are shaded."""
    log = replay.logs[0]
    t = log.t[log.t <= log.t[0] + _REPLAYED] - log.t[0]
    used, joints = replay.used[: len(t)] > 0, moving_joints(result.robot.model)
    panels = [
        Comparison(servo.name, "q", "m" if slides(joint) else "rad", t, log.position[: len(t), j],
                   replay.simulated[0][: len(t), j], used=used)
        for j, (servo, joint) in enumerate(zip(result.servos, joints, strict=True))
    ]  # fmt: skip
    note = "MuJoCo with the exported file, driven by the targets alone from the first position on"
    note += f"; the first {t[-1]:.0f} s." if len(t) < len(log.t) else "."
    note += "" if used.all() else " Shaded: left out of the fit, because of external forces."
    return Section(f"Replay of {log.source}", [Figures(figures_of(panels)), Text(note, note=True)])


def _servos(result: ServoIdentification) -> list[Panel]:
    """Every servo with its 95 % intervals."""
    lines: list[list[Cell]] = []
    for k, servo in enumerate(result.servos):
        own = result.parameters[_PER_SERVO * k : _PER_SERVO * (k + 1)]
        cells = [_cell(p) for p in own if p.name.partition("_")[0] in _SHOWN]
        lines.append([servo.name, *cells, f"{servo.error * 1e3:.1f}", f"{servo.simple * 1e3:.1f}"])
    kinds = sorted({slides(joint) for joint in moving_joints(result.robot.model)})
    units = {name: ", ".join(own[kind] for kind in kinds) for name, own in _UNITS.items()}
    heads = [head.format(**units) for head in _HEADS]
    panels: list[Panel] = [Table(heads, lines, spare=(7,))]
    if any(parameter.combination for parameter in result.parameters):
        panels.append(Text("~ only in combination with others; identification.json says which."))
    panels.append(Text("± in %; error: of the open-loop simulation; simple: of the delayed target "
                       "or a constant."))  # fmt: skip
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


def _cell(parameter: Parameter) -> str:
    """A value with its interval, or marked where only a combination is identified."""
    scale = _SHOWN[parameter.name.partition("_")[0]]
    if parameter.status != "identified":
        return f"~ {_number(scale * parameter.value)}"
    half = 50 * (parameter.high - parameter.low) / parameter.value
    return f"{_number(scale * parameter.value)} ±{half:.0f}"


def _number(x: float) -> str:
    """Three digits, all of them before the point from 1000 on."""
    return f"{x:.0f}" if x >= 1e3 else f"{x:.3g}"
