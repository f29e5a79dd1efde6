"""Recordings of identifications: logs with the robot moving, commands or positions, estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..calibration import words
from ..calibration.result import Curves as Commands
from ..calibration.result import Identification, recording_shifts, shifts
from ..evaluation.confidence import INTERVAL
from ..pages.page import Text, panels
from ..pages.parameters import folds, table
from ..parameters import Array, Indices
from ..robot.model import RobotModel
from ..structure.joints import moving_joints, slides
from .layout import RIGHT, beside, result, robot, whole
from .plots import Plots
from .scene import Camera, Scene
from .series import Curves, path
from .stream import write

if TYPE_CHECKING:
    from ..calibration.servos import Replayed, ServoIdentification

_FRAMES, _RATE = 12000, 30.0  # largest number of frames of the robot, and frames per second
_POINTS = 30_000  # of a curve, at most; the viewer thins them by zoom
_FIRST, _PAGE = 6, 12  # joints on the first page, and on any other, at most


def record(result: Identification, file: Path, document: str) -> Path:
    """Writes a recording of the training logs, atomically, and returns its path.

    Logs are concatenated on the timeline `sim_time`; see `calibration.result.shifts`.

    Args:
        result: result of an identification.
        file: path of the recording, ending in .rrd.
        document: the result in Markdown.
    """
    shifts = recording_shifts(result.recordings)
    moving = zip(shifts, (segment.log for segment in result.recordings.segments), strict=True)
    camera, draw = moving_robot(result.robot, [(log.t + s, log.q, log.v) for s, log in moving])
    series = [_commands(result, result.predictions, "")]
    if result.validation is not None:
        series.append(_commands(result, result.validation, "validation/"))
    ends = [float(times[-1]) for times, _ in series if len(times)]
    history = _history(result)
    if result.law is not None:
        series.append((result.law.t, [curve for _, curve in history]))
    plots = Plots([c for _, curves in series for c in curves], max(ends) if ends else None)
    layout = _blueprint(result, camera, sorted({block for block, _ in history}), plots)
    documents = {"result": document, "parameters": "\n".join(panels(folds(result)))}
    return write(file, result.robot.name, layout, documents, series, draw)


def moving_robot(
    robot: RobotModel, motion: Sequence[tuple[Array, Array, Array]]
) -> tuple[Camera | None, Callable[[rr.RecordingStream], None]]:
    """The camera, and a function that draws a robot moving as in logs, at some frames.

    Args:
        robot: the model.
        motion: for every log its times (N,) [s], positions (N, n) or a vehicle's (N, m), and
            velocities (N, n).

    Returns:
        The camera, None if the robot's shape is unknown, and a function of a recording.
    """
    system = robot.system
    scene = Scene(system, robot.visuals)
    total = sum(float(t[-1] - t[0]) for t, _, _ in motion)
    rate, parts = min(_RATE, _FRAMES / max(total, 1e-9)), []
    for t, q, v in motion:
        stride = max(1, round(1 / (float(np.median(np.diff(t))) * rate)))
        rows = np.unique(np.append(np.arange(0, len(t), stride), len(t) - 1))
        parts.append((t[rows], q[rows], v[rows]))
    t, q, v = (np.concatenate(part) for part in zip(*parts, strict=True))
    if robot.jointed:
        q = system.position(q)
    t[:1] = np.minimum(t[:1], 0.0)  # where the plots begin, the robot is there already
    if scene.empty:
        return None, lambda _: None
    some = np.unique(np.linspace(0, len(t) - 1, min(len(t), 500)).astype(int))
    camera = scene.camera(q[some], v[some])

    def draw(rec: rr.RecordingStream) -> None:
        scene.log_shapes(rec, camera)
        scene.log_poses(rec, t, q)

    return camera, draw


def _commands(
    result: Identification, commands: Commands, prefix: str
) -> tuple[Array, list[Curves]]:
    """(N,) times [s], and measured and predicted command and residual of every joint."""
    if not len(commands.segment):
        return np.zeros(0), []
    sides = {"measured": commands.measured, "predicted": commands.predicted}
    names, own = [fit.name for fit in result.joints], (f"{prefix}command", f"{prefix}residual")
    return _compared(commands.t, commands.segment, sides, names, *own)


_LOOKS = {  # label, colour and paleness of curves, which are drawn in the order of their names
    "command": ("target", 8, True),
    "measured": ("measured", 1, True),
    "predicted": ("predicted", 0, False),
    "simulated": ("simulated", 0, False),
    "unused": ("left out of the fit", 10, False),  # red
}


def _compared(
    t: Array, segment: Indices, sides: Mapping[str, Array], names: Sequence[str],
    entity: str, residual: str, factor: float = 1.0,
) -> tuple[Array, list[Curves]]:  # fmt: skip
    """Curves of joints over several logs, thinned, and residuals measured - computed.

    t (N,) are times on the common axis [s], `segment` (N,) the numbers of the logs, `sides` (N, n)
    values by name in `_LOOKS`. Residuals are multiplied by a factor. Returns (M,) times [s], and
    the curves, which are NaN after every log but the last.
    """
    stride = max(1, -(-len(segment) // _POINTS))
    last = np.append(np.flatnonzero(np.diff(segment)), len(segment) - 1)
    rows = np.unique(np.concatenate([np.arange(0, len(segment), stride), last]))
    gaps = np.flatnonzero(np.diff(segment[rows])) + 1  # a NaN after each log ends its line
    shown = {side: np.insert(x[rows], gaps, np.nan, axis=0) for side, x in sides.items()}
    computed = "simulated" if "simulated" in sides else "predicted"
    curves: list[Curves] = []
    for j, name in enumerate(names):
        for side, values in shown.items():
            label, color, pale = _LOOKS[side]
            if np.isfinite(values).any():
                own = f"{entity}/{path(name)}/{side}"
                curves.append(Curves(own, [label], values[:, j, None], pale=pale, color=color))
        difference = factor * (shown["measured"] - shown[computed])[:, j, None]
        own, label = f"{residual}/{path(name)}", f"measured - {computed}"
        curves.append(Curves(own, [label], difference, color=2))
    return np.insert(t[rows], gaps, t[rows][gaps - 1] + 1e-6), curves


def _history(result: Identification) -> list[tuple[str, Curves]]:
    """(block, curves) of a law's gains and frictions along the log, with the gains' intervals.

    Gains have intervals relative to the mean of all, as the common scale is unobservable.
    """
    if result.law is None:
        return []
    theta = result.law.theta
    found: list[tuple[str, Curves]] = []
    groups: dict[str, list[int]] = {}
    for k, parameter in enumerate(result.parameters):
        if parameter.block not in result.bodies:
            groups.setdefault(parameter.block, []).append(k)
    half = INTERVAL * result.law.deviation
    gains = {int(k): i for i, k in enumerate(result.law.actuators)}
    for block, members in groups.items():
        for color, k in enumerate(members):
            p = result.parameters[k]
            entity = path("estimate", block, p.label)
            name = f"{p.label} [{p.unit}]"
            found.append(
                (block, Curves(f"{entity}/value", [name], theta[:, k : k + 1], color=color))
            )
            if k in gains and np.isfinite(half).any():
                own = np.where(half[:, gains[k]] < words.UNKNOWN, half[:, gains[k]], np.nan)
                ends = theta[:, k, None] * np.exp(np.stack([-own, own], axis=1))
                names = ["95 % interval"] * 2
                interval = Curves(f"{entity}/interval", names, ends, True, color=8, alike=True)
                found.append((block, interval))
    return found


def _blueprint(
    found: Identification, camera: Camera | None, blocks: Sequence[str], plots: Plots
) -> rrb.Blueprint:
    """Layout of a recording.

    Args:
        found: the identification.
        camera: camera of the robot; None leaves the 3D view out.
        blocks: blocks of parameters whose estimates along the log are in the recording.
        plots: makes the plots.
    """
    units = [words.quantity(found, j)[1] for j in range(len(found.joints))]
    joints = [
        (fit.name, unit, fit.held_out, f"NRMSE {words.nrmse(fit.held_out)} held out")
        for fit, unit in zip(found.joints, units, strict=True)
    ]
    pages = joint_pages(camera, plots, joints, "command", "predicted")
    if found.validation is not None:
        checked = [
            (fit.name, unit, 0.0, f"NRMSE {words.nrmse(fit.validation)} validation")
            for fit, unit in zip(found.joints, units, strict=True)
        ]
        pages += paged("Validation", plots, _titles("validation/command", checked))
    gains = [p for p in found.gains if p.block in blocks]
    note = " and its 95 % interval, the common scale aside"
    shown = [(path("estimate", p.block, p.label), f"{p.label} [{p.unit}]{note}") for p in gains]
    pages += paged("Gains along the log", plots, shown)
    rest = [b for b in blocks if b not in {p.block for p in gains}]
    kinds = {b: {p.unit for p in found.parameters if p.block == b} for b in rest}
    shown = [
        (path("estimate", b), f"{b} [{min(of)}]" if len(of) == 1 else b) for b, of in kinds.items()
    ]
    pages += paged("Friction along the log", plots, shown)
    return whole(*pages, parameters())


_Joint = tuple[str, str, float, str]  # name, unit, error, and the error in words


def _titles(entity: str, joints: Sequence[_Joint]) -> list[tuple[str, str]]:
    """Entities and titles of the joints' plots."""
    return [
        (f"{entity}/{path(name)}", f"{name}{f' [{unit}]' if unit else ''}: {error}")
        for name, unit, _, error in joints
    ]


def joint_pages(
    camera: Camera | None,
    plots: Plots,
    joints: Sequence[_Joint],
    entity: str,
    computed: str,
    prefix: str = "",
) -> list[rrb.Container]:
    """Verdict and robot beside the joints with the largest errors; pages of all, if these are more.

    Residuals, measured - computed, in units with a prefix, have pages of their own.
    """
    shown = _titles(entity, joints)
    left: list[rrb.View | rrb.Container] = [result("Verdict")]
    left += [] if camera is None else [robot(camera, "Robot, as logged")]
    errors = [-error if math.isfinite(error) else -math.inf for _, _, error, _ in joints]
    worst = sorted(np.argsort(errors, kind="stable")[:_FIRST].tolist())
    columns = 1 if len(worst) < 4 else 2
    views = [plots(entity, title, RIGHT / columns) for entity, title in (shown[j] for j in worst)]
    grid = rrb.Grid(*views, grid_columns=columns)
    pages: list[rrb.Container] = [beside(left, grid, "Overview", [1, 1])]
    if len(joints) > _FIRST:
        pages += paged(f"{entity.capitalize()}s", plots, shown)
    units = [(name, unit and f" [{prefix}{unit}]") for name, unit, *_ in joints]
    residuals = [(f"residual/{path(j)}", f"{j}: measured - {computed}{unit}") for j, unit in units]
    return pages + paged("Residuals", plots, residuals, legend=False)


def parameters() -> rrb.Horizontal:
    """The page with all parameters as text."""
    view = rrb.TextDocumentView(origin="/parameters", name="All parameters")
    return rrb.Horizontal(view, name="Parameters")


def paged(
    name: str, plots: Plots, shown: Sequence[tuple[str, str]], legend: bool = True
) -> list[rrb.Container]:
    """Plots of entities with titles, on pages of at most a dozen each."""
    pages: list[rrb.Container] = []
    for start in range(0, len(shown), _PAGE):
        some = shown[start : start + _PAGE]
        width = 1 / columns_of(len(shown))
        views = [plots(entity, told, width, legend) for entity, told in some]
        title = name if len(shown) <= _PAGE else f"{name} {start + 1} – {start + len(some)}"
        pages.append(rrb.Grid(*views, grid_columns=columns_of(len(some)), name=title))
    return pages


def columns_of(views: int) -> int:
    """Columns of a page of so many views."""
    return 1 if views < 3 else 2 if views <= 6 else 3


_SHOWN = 20.0  # of a long log, around the cursor [s]: in minutes no motion can be seen


def record_servos(
    found: ServoIdentification, replayed: Replayed, file: Path, document: str
) -> Path:
    """Writes a recording of the logs and their replay, atomically, and returns its path.

    Args:
        found: result of an identification of servos.
        replayed: the logs, and simulations of them with the exported model.
        file: path of the recording, ending in .rrd.
        document: the result in Markdown.
    """
    logs = replayed.logs
    moved = shifts([(log.source, log.t[0], log.t[-1]) for log in logs])
    times = [log.t + shift for log, shift in zip(logs, moved, strict=True)]
    motion = [
        (t, log.position, np.gradient(log.position, t, axis=0))
        for t, log in zip(times, logs, strict=True)
    ]
    camera, draw = moving_robot(found.robot, motion)
    position = np.concatenate([log.position for log in logs])
    sides = {
        "command": np.concatenate([log.target for log in logs]),
        "measured": position,
        "simulated": np.concatenate(replayed.simulated),
        "unused": np.where(replayed.used[:, None] > 0, np.nan, position),
    }
    segment, names = np.repeat(np.arange(len(logs)), list(map(len, times))), found.robot.joints
    series = _compared(np.concatenate(times), segment, sides, names, "position", "residual", 1e3)
    t, curves = series
    plots = Plots(curves, float(t[-1]), _SHOWN if t[-1] > 2 * _SHOWN else None)
    units = ["m" if slides(joint) else "rad" for joint in moving_joints(found.robot.model)]
    joints = [
        (servo.name, unit, servo.error, f"error of the fit {1e3 * servo.error:.1f} m{unit}")
        for servo, unit in zip(found.servos, units, strict=True)
    ]
    pages = joint_pages(camera, plots, joints, "position", "simulated", "m")
    by_joint = [
        panel
        for name in names
        for panel in (
            Text(name, head=True),
            table([p for p in found.parameters if p.label.endswith(f" of {name}")]),
        )
    ]
    documents = {"result": document, "parameters": "\n".join(panels(by_joint))}
    layout = whole(*pages, parameters())
    return write(file, found.robot.name, layout, documents, [series], draw)
