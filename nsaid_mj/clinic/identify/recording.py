"""Recordings of identifications: logs with the robot moving, commands or positions, estimates."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ...core import Array
from ...report import (
    Camera,
    Comparison,
    Page,
    ParameterTables,
    Plots,
    Scene,
    Text,
    write_recording,
)
from ...report import Panel as Curves
from ...robots import RobotModel
from . import wording
from .ground.poses import poses
from .result import Identification, recording_shifts

if TYPE_CHECKING:
    from ..servos.result import Replayed

_FRAMES = 12000  # largest number of frames of the robot, and frames per second
_RATE = 30.0
_FIRST = 6  # joints on the first page, and on any other, at most
_PAGE = 12


def record(page: Page, file: Path) -> Path:
    """Writes a recording of the training logs, atomically, and returns its path.

    Logs are concatenated on the timeline `sim_time`; see `clinic.identify.result.shifts`.

    Args:
        page: the page of an identification.
        file: path of the recording, ending in .rrd.
    """
    result = page.result
    assert isinstance(result, Identification)
    moved = recording_shifts(result.recordings)
    motion = []
    for shift, segment in zip(moved, result.recordings.segments, strict=True):
        q = segment.log.q
        v = segment.log.v
        if result.robot.floating:
            q, v = poses(result.robot, result.recordings, segment)
        motion.append((segment.log.t + shift, q, v))
    camera, draw = moving_robot(result.robot, motion)
    ends = [float(p.t[-1]) for p in result.curves if isinstance(p, Comparison) and len(p.t)]
    plots = Plots.of(result.curves, max(ends) if ends else None)
    pages = _pages(result, camera, plots)
    documents = {"result": page.markdown(), "parameters": ParameterTables(result).folds()}
    return write_recording(file, result.robot.name, pages, documents, plots.curves, draw)


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
    rate = min(_RATE, _FRAMES / max(total, 1e-9))
    parts = []
    for t, q, v in motion:
        stride = max(1, round(1 / (float(np.median(np.diff(t))) * rate)))
        rows = np.unique(np.append(np.arange(0, len(t), stride), len(t) - 1))
        parts.append((t[rows], q[rows], v[rows]))
    t, q, v = (np.concatenate(part) for part in zip(*parts, strict=True))
    if robot.held:
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


def _pages(found: Identification, camera: Camera | None, plots: Plots) -> list[rrb.Container]:
    """Pages of a recording.

    Args:
        found: the identification, with its curves.
        camera: camera of the robot; None leaves the 3D view out.
        plots: makes the plots.
    """
    units = [wording.quantity(found, j)[1] for j in range(len(found.joints))]
    joints = [
        (fit.name, unit, fit.held_out, f"NRMSE {wording.nrmse(fit.held_out)} held out")
        for fit, unit in zip(found.joints, units, strict=True)
    ]
    pages = joint_pages(camera, plots, joints, "command", "predicted")
    if found.validation is not None:
        checked = [
            (fit.name, unit, 0.0, f"NRMSE {wording.nrmse(fit.validation)} validation")
            for fit, unit in zip(found.joints, units, strict=True)
        ]
        pages += paged("Validation", plots, _titles("validation/command", checked))
    over_time = [panel for panel in found.curves if isinstance(panel, Curves)]
    blocks = sorted(panel.key[1] for panel in over_time if not panel.page)
    gains = [p for p in found.gains if p.block in blocks]
    note = " and its 95 % interval, the common scale aside"
    shown = [
        (Plots.entity("estimate", p.block, p.label), f"{p.label} [{p.unit}]{note}") for p in gains
    ]
    pages += paged("Gains along the log", plots, shown)
    rest = [b for b in blocks if b not in {p.block for p in gains}]
    kinds = {b: {p.unit for p in found.parameters if p.block == b} for b in rest}
    shown = [
        (Plots.entity("estimate", b), f"{b} [{min(of)}]" if len(of) == 1 else b)
        for b, of in kinds.items()
    ]
    pages += paged("Friction along the log", plots, shown)
    relative = [
        (Plots.entity(*panel.key, logarithm=True), f"{panel.title} over the batch fit, log₁₀")
        for panel in over_time
        if panel.page
    ]
    pages += paged("Over the batch fit", plots, relative)
    return [*pages, parameters()]


_Joint = tuple[str, str, float, str]  # name, unit, error, and the error in words


def _titles(entity: str, joints: Sequence[_Joint]) -> list[tuple[str, str]]:
    """Entities and titles of the joints' plots."""
    return [
        (f"{entity}/{Plots.entity(name)}", f"{name}{f' [{unit}]' if unit else ''}: {error}")
        for name, unit, _, error in joints
    ]


def joint_pages(
    camera: Camera | None,
    plots: Plots,
    joints: Sequence[_Joint],
    entity: str,
    computed: str,
) -> list[rrb.Container]:
    """Verdict and robot beside the joints with the largest errors; pages of all, if these are more.

    Residuals, measured - computed, have pages of their own.
    """
    shown = _titles(entity, joints)
    left: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="/result", name="Verdict")]
    left += [] if camera is None else [camera.view("Robot, as logged")]
    errors = [-error if math.isfinite(error) else -math.inf for _, _, error, _ in joints]
    worst = sorted(np.argsort(errors, kind="stable")[:_FIRST].tolist())
    columns = 1 if len(worst) < 4 else 2
    large = [shown[j] for j in worst]
    grid = plots.grid([plots(of, name, Plots.RIGHT / columns) for of, name in large], columns)
    pages: list[rrb.Container] = [Plots.beside(left, grid, "Overview", [1, 1])]
    if len(joints) > _FIRST:
        pages += paged(f"{entity.capitalize()}s", plots, shown)
    units = [(name, unit and f" [{unit}]") for name, unit, *_ in joints]
    residuals = [
        (f"residual/{Plots.entity(j)}", f"{j}: measured - {computed}{unit}") for j, unit in units
    ]
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
        pages.append(plots.grid(views, columns_of(len(some)), title))
    return pages


def columns_of(views: int) -> int:
    """Columns of a page of so many views."""
    return 1 if views < 3 else 2 if views <= 6 else 3


_SHOWN = 20.0  # of a long log, around the cursor [s]: in minutes no motion can be seen


def record_servos(page: Page, replayed: Replayed, file: Path) -> Path:
    """Writes a recording of the logs and their replay, atomically, and returns its path.

    Args:
        page: the page of an identification of servos, with the replay.
        replayed: the logs, and simulations of them with the exported model.
        file: path of the recording, ending in .rrd.
    """
    from ..servos.result import ServoIdentification

    found = page.result
    assert isinstance(found, ServoIdentification)
    comparisons = [panel for panel in found.curves if isinstance(panel, Comparison)]
    t = comparisons[0].t
    logs = replayed.logs
    times = np.split(t, np.cumsum([len(log.t) for log in logs])[:-1])
    motion = [
        (own, log.position, np.gradient(log.position, own, axis=0))
        for own, log in zip(times, logs, strict=True)
    ]
    camera, draw = moving_robot(found.robot, motion)
    plots = Plots.of(comparisons, float(t[-1]), _SHOWN if t[-1] > 2 * _SHOWN else None)
    joints = [
        (
            servo.name,
            panel.unit,
            servo.error,
            f"error of the fit {1e3 * servo.error:.1f} m{panel.unit}",
        )
        for servo, panel in zip(found.servos, comparisons, strict=True)
    ]
    pages = joint_pages(camera, plots, joints, "position", "simulated")
    tables = ParameterTables(found)
    by_joint = [
        panel
        for name in found.robot.joints
        for panel in (
            Text(name, head=True),
            tables.of([p for p in found.parameters if p.label.endswith(f" of {name}")]),
        )
    ]
    documents = {"result": page.markdown(), "parameters": by_joint}
    pages.append(parameters())
    return write_recording(file, found.robot.name, pages, documents, plots.curves, draw)
