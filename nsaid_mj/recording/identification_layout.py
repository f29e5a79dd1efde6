"""Layout of an identification's recording: verdict and robot, commands, estimates, parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

import rerun.blueprint as rrb

from ..calibration import words
from ..calibration.result import Identification
from .layout import RIGHT, beside, result, robot, whole
from .plots import Plots
from .scene import Camera
from .series import path

FIRST = 6
"""Joints on the first page, at most."""
_PAGE = 12  # and on any other


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
    left: list[rrb.View | rrb.Container] = [result("Verdict")]
    if camera is not None:
        left.append(robot(camera, "Robot, as logged"))
    worst = sorted(range(len(found.joints)), key=lambda j: -_error(found.joints[j].held_out))[
        :FIRST
    ]
    columns = 1 if len(worst) < 4 else 2
    first = [_command(found, j, plots, RIGHT / columns) for j in sorted(worst)]
    joints = range(len(found.joints))
    width = 1 / columns_of(len(joints))
    grid = rrb.Grid(*first, grid_columns=columns)
    overview = beside(left, grid, "Overview", [1, 1])
    pages: list[rrb.Container] = [overview]
    if len(found.joints) > FIRST:
        pages += paged("Commands", [_command(found, j, plots, width) for j in joints])
    pages += paged("Residuals", [_residual(found, j, plots) for j in joints])
    if found.validation is not None:
        checked = [_command(found, j, plots, width, "validation/") for j in joints]
        pages += paged("Validation", checked)
    gains = [p for p in found.gains if p.block in blocks]
    pages += paged(
        "Gains along the log",
        [
            plots(
                path("estimate", p.block, p.label),
                _title(f"{p.label}", p.unit),
                1 / columns_of(len(gains)),
            )
            for p in gains
        ],
    )
    rest = [b for b in blocks if b not in {p.block for p in gains}]
    width = 1 / columns_of(len(rest))
    units = {b: {p.unit for p in found.parameters if p.block == b} for b in rest}
    titles = {b: f"{b} [{min(units[b])}]" if len(units[b]) == 1 else b for b in rest}
    frictions = [plots(path("estimate", b), titles[b], width) for b in rest]
    pages += paged("Friction along the log", frictions)
    return whole(*pages, parameters())


def parameters() -> rrb.Horizontal:
    """The page with all parameters as text."""
    view = rrb.TextDocumentView(origin="/parameters", name="All parameters")
    return rrb.Horizontal(view, name="Parameters")


def _command(
    found: Identification, j: int, plots: Plots, width: float, prefix: str = ""
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


def _title(label: str, unit: str) -> str:
    return f"{label} [{unit}] and its 95 % interval, the common scale aside"


def _error(value: float) -> float:
    return value if math.isfinite(value) else math.inf
