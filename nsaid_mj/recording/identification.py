"""Recordings of identifications: logs with the robot moving, commands or positions, estimates."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..calibration import words
from ..calibration.result import Curves as Commands
from ..calibration.result import Identification, recording_shifts, shifts
from ..calibration.servos import Replayed, ServoIdentification
from ..evaluation.confidence import INTERVAL
from ..pages.identification import brief
from ..pages.identification.servos import brief as brief_of_servos
from ..pages.page import Page, Section, markdown
from ..pages.parameters import folds, table
from ..parameters import Array, Indices
from ..robot.model import RobotModel
from ..structure.joints import JointScales, moving_joints, positions, slides
from ..structure.multibody import Multibody
from ..structure.system import SecondOrderSystem
from .layout import RIGHT, beside, result, robot, whole
from .plots import Plots
from .scene import Camera, Scene
from .series import Curves, path
from .stream import write

_FRAMES, _RATE = 12000, 30.0  # largest number of frames of the robot, and frames per second
_POINTS = 30_000  # of a curve, at most; the viewer thins them by zoom
_FIRST, _PAGE = 6, 12  # joints on the first page, and on any other, at most


def record(result: Identification, file: Path) -> Path:
    """Writes a recording of the training logs, atomically, and returns its path.

    Logs are concatenated on the timeline `sim_time`; see `calibration.result.shifts`.

    Args:
        result: result of an identification.
        file: path of the recording, ending in .rrd.
    """
    shifts = recording_shifts(result.recordings)
    moving = zip(shifts, (segment.log for segment in result.recordings.segments), strict=True)
    camera, draw = moving_robot(result.robot, [(log.t + s, log.q, log.v) for s, log in moving])
    history = _history(result)
    commands = [_commands(result, result.curves, "")]
    if result.validation is not None:
        commands.append(_commands(result, result.validation, "validation/"))
    curves = [curve for _, some in commands for curve in some] + [curve for _, curve in history]
    ends = [float(times[-1]) for times, _ in commands if len(times)]
    plots = Plots(curves, max(ends) if ends else None)
    layout = _blueprint(result, camera, sorted({p for p, _ in history}), plots)

    every = Page("", None, sections=[Section("", folds(result))])
    documents = {"result": markdown(brief(result)), "parameters": markdown(every)}
    series = [*commands, (result.law.t, [c for _, c in history])] if result.law else commands
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
    scene = _scene(robot)
    total = sum(float(t[-1] - t[0]) for t, _, _ in motion)
    rate, parts = min(_RATE, _FRAMES / max(total, 1e-9)), []
    for t, q, v in motion:
        stride = max(1, round(1 / (float(np.median(np.diff(t))) * rate)))
        rows = np.unique(np.append(np.arange(0, len(t), stride), len(t) - 1))
        parts.append((t[rows], q[rows], v[rows]))
    t, q, v = (np.concatenate(part) for part in zip(*parts, strict=True))
    if robot.model is not None:
        q = positions(robot.model, q)
    t[:1] = np.minimum(t[:1], 0.0)  # where the plots begin, the robot is there already
    if scene is None or scene.empty:
        return None, lambda _: None
    some = np.unique(np.linspace(0, len(t) - 1, min(len(t), 500)).astype(int))
    camera = scene.camera(q[some], v[some])

    def draw(rec: rr.RecordingStream) -> None:
        scene.log_shapes(rec, camera)
        scene.log_poses(rec, t, q)

    return camera, draw


def _scene(robot: RobotModel) -> Scene | None:
    """The robot's meshes or joints; None if its shape is unknown."""
    system: SecondOrderSystem | None = robot.system
    if system is None and robot.model is not None and robot.model.njoints > 1:
        unit = np.ones(max(len(robot.joints), robot.model.nv))  # scales do not matter here
        scales = JointScales(unit, unit, unit, unit, unit, unit, unit)
        system = Multibody(robot.model, scales, unit)
    return None if system is None else Scene(system, robot.visuals)


def _commands(
    result: Identification, commands: Commands, prefix: str
) -> tuple[Array, list[Curves]]:
    """Measured and predicted command and residual of every joint, with gaps between logs.

    Returns:
        (N,) times [s], and the curves.
    """
    segment = commands.segment
    if not len(segment):
        return np.zeros(0), []
    t, (left, right) = lines(commands.t, segment, [commands.measured, commands.predicted])
    found = []
    for j, fit in enumerate(result.joints):
        measured, predicted = left[:, j : j + 1], right[:, j : j + 1]
        for name, label, values, color, pale in (
            ("measured", "measured", measured, 1, True),
            ("predicted", "predicted", predicted, 0, False),
            ("residual", "measured - predicted", measured - predicted, 2, False),
        ):
            kind = "residual" if name == "residual" else "command"
            entity = f"{prefix}{kind}/{path(fit.name)}" + ("" if name == "residual" else f"/{name}")
            found.append(Curves(entity, [label], values, pale=pale, color=color))
    return t, found


def lines(t: Array, segment: Indices, sides: Sequence[Array]) -> tuple[Array, list[Array]]:
    """Points of curves over several logs, thinned, with gaps between these.

    Args:
        t: (N,) times on the common axis [s].
        segment: (N,) number of the log.
        sides: (N, n) values each.

    Returns:
        (M,) times [s], and (M, n) values each, NaN after every log but the last.
    """
    stride = max(1, -(-len(segment) // _POINTS))
    last = np.append(np.flatnonzero(np.diff(segment)), len(segment) - 1)
    rows = np.unique(np.concatenate([np.arange(0, len(segment), stride), last]))
    gaps = np.flatnonzero(np.diff(segment[rows])) + 1  # a NaN after each log ends its line
    shown = np.insert(t[rows], gaps, t[rows][gaps - 1] + 1e-6)
    return shown, [np.insert(side[rows], gaps, np.nan, axis=0) for side in sides]


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
    joints = range(len(found.joints))
    width = 1 / columns_of(len(joints))
    held_out = (joint.held_out for joint in found.joints)
    errors = [error if math.isfinite(error) else math.inf for error in held_out]
    pages = joint_pages(camera, errors, partial(_command, found, plots), "Commands")
    pages += paged("Residuals", [_residual(found, j, plots) for j in joints])
    if found.validation is not None:
        checked = [_command(found, plots, j, width, "validation/") for j in joints]
        pages += paged("Validation", checked)
    gains = [p for p in found.gains if p.block in blocks]
    width = 1 / columns_of(len(gains))
    entities = {path("estimate", p.block, p.label): f"{p.label} [{p.unit}]" for p in gains}
    note = " and its 95 % interval, the common scale aside"
    views = [plots(entity, title + note, width) for entity, title in entities.items()]
    pages += paged("Gains along the log", views)
    rest = [b for b in blocks if b not in {p.block for p in gains}]
    width = 1 / columns_of(len(rest))
    units = {b: {p.unit for p in found.parameters if p.block == b} for b in rest}
    titles = {b: f"{b} [{min(units[b])}]" if len(units[b]) == 1 else b for b in rest}
    frictions = [plots(path("estimate", b), titles[b], width) for b in rest]
    pages += paged("Friction along the log", frictions)
    return whole(*pages, parameters())


def joint_pages(
    camera: Camera | None,
    errors: Sequence[float],
    view: Callable[[int, float], rrb.View],
    name: str,
) -> list[rrb.Container]:
    """Verdict and robot beside the joints with the largest errors; pages of all, if these are more.

    Args:
        camera: camera of the robot; None leaves the 3D view out.
        errors: one for each joint.
        view: the plot of a joint that takes a share of the window.
        name: name of the pages.
    """
    left: list[rrb.View | rrb.Container] = [result("Verdict")]
    left += [] if camera is None else [robot(camera, "Robot, as logged")]
    worst = sorted(sorted(range(len(errors)), key=lambda j: -errors[j])[:_FIRST])
    columns = 1 if len(worst) < 4 else 2
    grid = rrb.Grid(*[view(j, RIGHT / columns) for j in worst], grid_columns=columns)
    pages: list[rrb.Container] = [beside(left, grid, "Overview", [1, 1])]
    if len(errors) > _FIRST:
        width = 1 / columns_of(len(errors))
        pages += paged(name, [view(j, width) for j in range(len(errors))])
    return pages


def parameters() -> rrb.Horizontal:
    """The page with all parameters as text."""
    view = rrb.TextDocumentView(origin="/parameters", name="All parameters")
    return rrb.Horizontal(view, name="Parameters")


def _command(
    found: Identification, plots: Plots, j: int, width: float, prefix: str = ""
) -> rrb.TimeSeriesView:
    fit = found.joints[j]
    error = fit.validation if prefix else fit.held_out
    kind = "validation" if prefix else "held out"
    unit = words.quantity(found, j)[1]
    title = f"{fit.name}{f' [{unit}]' if unit else ''}: NRMSE {words.nrmse(error)} {kind}"
    return plots(f"{prefix}command/{path(fit.name)}", title, width)


def _residual(found: Identification, j: int, plots: Plots) -> rrb.TimeSeriesView:
    name, (_, unit) = found.joints[j].name, words.quantity(found, j)
    title = f"{name}: measured - predicted" + (f" [{unit}]" if unit else "")
    return plots(f"residual/{path(name)}", title, legend=False)


def paged(name: str, views: Sequence[rrb.View]) -> list[rrb.Container]:
    """Views on pages of at most a dozen each."""
    pages: list[rrb.Container] = []
    for start in range(0, len(views), _PAGE):
        some = views[start : start + _PAGE]
        title = name if len(views) <= _PAGE else f"{name} {start + 1} – {start + len(some)}"
        pages.append(rrb.Grid(*some, grid_columns=columns_of(len(some)), name=title))
    return pages


def columns_of(views: int) -> int:
    """Columns of a page of so many views."""
    return 1 if views < 3 else 2 if views <= 6 else 3


_FAILED = 10  # red: windows that the fit left out
_SHOWN = 20.0  # of a long log, around the cursor [s]: in minutes no motion can be seen


def record_servos(found: ServoIdentification, replayed: Replayed, file: Path) -> Path:
    """Writes a recording of the logs and their replay, atomically, and returns its path.

    Args:
        found: result of an identification of servos.
        replayed: the logs, and simulations of them with the exported model.
        file: path of the recording, ending in .rrd.
    """
    logs = replayed.logs
    moved = shifts([(log.source, log.t[0], log.t[-1]) for log in logs])
    times = [log.t + shift for log, shift in zip(logs, moved, strict=True)]
    motion = [
        (t, log.position, np.gradient(log.position, t, axis=0))
        for t, log in zip(times, logs, strict=True)
    ]
    camera, draw = moving_robot(found.robot, motion)
    t, curves = _servo_curves(found, replayed, np.concatenate(times))
    end = float(t[-1])
    layout = _servo_layout(found, camera, Plots(curves, end, _SHOWN if end > 2 * _SHOWN else None))
    by_joint = [
        Section(name, [table([p for p in found.parameters if p.label.endswith(f" of {name}")])])
        for name in found.robot.joints
    ]
    documents = {
        "result": markdown(brief_of_servos(found)),
        "parameters": markdown(Page("", None, sections=by_joint)),
    }
    return write(file, found.robot.name, layout, documents, [(t, curves)], draw)


def _servo_curves(
    found: ServoIdentification, replayed: Replayed, t: Array
) -> tuple[Array, list[Curves]]:
    """(M,) times [s], and of every joint target, positions, windows left out, and residual."""
    logs = replayed.logs
    segment = np.repeat(np.arange(len(logs)), [len(log.t) for log in logs])
    position = np.concatenate([log.position for log in logs])
    left_out = np.where(replayed.used[:, None] > 0, np.nan, position)
    sides = [
        np.concatenate([log.target for log in logs]), position,
        np.concatenate(replayed.simulated), left_out,
    ]  # fmt: skip
    times, (target, measured, simulated, masked) = lines(t, segment, sides)
    curves: list[Curves] = []
    for j, name in enumerate(found.robot.joints):
        own = path("position", name)
        for part, label, values, color, pale in (  # drawn in the order of their names
            ("command", "target", target, 8, True),
            ("measured", "measured", measured, 1, True),
            ("simulated", "simulated", simulated, 0, False),
            ("unused", "left out of the fit", masked, _FAILED, False),
        ):
            if np.isfinite(values).any():
                curves.append(
                    Curves(f"{own}/{part}", [label], values[:, j, None], pale=pale, color=color)
                )
        residual = 1e3 * (measured - simulated)[:, j, None]
        curves.append(Curves(path("residual", name), ["measured - simulated"], residual, color=2))
    return times, curves


def _servo_layout(found: ServoIdentification, camera: Camera | None, plots: Plots) -> rrb.Blueprint:
    """Verdict and robot beside the worst joints, all joints, residuals, and parameters."""
    servos, joints = found.servos, moving_joints(found.robot.model)
    units = ["m" if slides(joint) else "rad" for joint in joints]

    def positions(j: int, width: float) -> rrb.TimeSeriesView:
        error = f"error of the fit {1e3 * servos[j].error:.1f} m{units[j]}"
        title = f"{servos[j].name} [{units[j]}]: {error}"
        return plots(path("position", servos[j].name), title, width)

    pages = joint_pages(camera, [servo.error for servo in servos], positions, "Positions")
    residuals = [
        plots(path("residual", s.name), f"{s.name}: measured - simulated [m{unit}]", legend=False)
        for s, unit in zip(servos, units, strict=True)
    ]
    return whole(*pages, *paged("Residuals", residuals), parameters())
