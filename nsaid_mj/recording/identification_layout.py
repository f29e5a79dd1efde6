"""Layout of an identification's recording: verdict and robot, commands, estimates, parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import rerun.blueprint as rrb

from ..calibration import words
from ..calibration.result import Identification
from .layout import RIGHT, beside, result, robot, whole
from .plots import Plots
from .scene import Camera
from .series import path

_FIRST, _PAGE = 6, 12  # joints on the first page, and on any other, at most


def blueprint(
    found: Identification, camera: Camera | None, blocks: Sequence[str], plots: Plots
) -> rrb.Blueprint:
    """Layout of a recording.

    Args:
        found: the identification.
        camera: of the robot; None leaves the 3D view out.
        blocks: blocks of parameters whose estimates along the log are in the recording.
        plots: makes the plots.
    """
    joints = range(len(found.joints))
    width = 1 / columns_of(len(joints))
    errors = [_error(joint.held_out) for joint in found.joints]
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
        camera: of the robot; None leaves the 3D view out.
        errors: one for each joint.
        view: the plot of a joint that takes a share of the window.
        name: of the pages.
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


def _error(value: float) -> float:
    return value if math.isfinite(value) else math.inf
