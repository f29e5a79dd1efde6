"""Layout of the viewer: tabs of plots, the first of which is an overview of the run."""

from collections.abc import Sequence
from typing import Any, Literal

import rerun as rr
import rerun.blueprint as rrb

from ...core import Block, ParameterSpace
from ..labels import ParameterGroup, groups
from .lines import PALETTE, path
from .plots import Plots
from .scene import MARK, PATH, ROBOT, TRAIL, Camera

_LINKS_ON_A_PAGE = 3
_MARK = (255, 255, 255)
_ERROR = "Velocity error Δv: predicted − measured"
_EXCITATION = "Persistence of excitation over a window [N·m·s]"
_CHECKS = {
    "theta_perp": "Components of the error along observable directions [–]",
    "lyapunov": "Lyapunov function [J]",
    "log_conserved": "Relative drift of the conserved quantity (30) [log₁₀]",
    "velocity_error": _ERROR,
    "excitation": _EXCITATION,
    "velocity": "Measured velocity",
    "command": "Command",
}
"""Titles of the plots of theory and excitation, by entity."""


def blueprint(
    space: ParameterSpace,
    camera: Camera | None,
    plots: Plots,
    *,
    survey: Camera | None = None,
    drawn: str = "",
    shared: str = "",
) -> rrb.Blueprint:
    """Layout of a finished run, of the curves in its recording.

    Without the truth, the first page compares predictions with measurements instead of showing
    distances.

    Args:
        space: the parameters.
        camera: camera of the robot; None leaves the 3D view out.
        plots: makes the plots.
        survey: camera on a vehicle's whole path; None leaves the path out.
        drawn: what is drawn on the robot, in words.
        shared: the kind of parameters compared by relative gain ("motor gain"); empty if none.
    """
    judged = plots.shows("log_distance")
    story = {
        "velocity": "Velocity, measured (wide) and predicted (thin, pale)",
        "force": "Forces that the motion needs, and of the actuators (pale)",
        "gains_over_prior": "Actuators relative to the prior, over their mean",
    }
    if judged:
        story = {
            "log_distance": "Distance to the true set, as a power of ten: −2 is 1 %, −4 is 0.01 %",
            "share": f"{shared.capitalize()}s: estimate / truth, relative to the mean (1 is exact)",
        }
        if plots.shows("share_error", 2):  # of rivals, too
            story["share_error"] = f"Error of {shared} ratios [%]"
    story["limbs"] = "Scale of each limb: mean of its gains' ratios, over that of all"
    story["contact"] = "Upward forces on the feet, implied by the motion, and true (pale) [N]"
    if not plots.shows("contact"):  # on the ground v̂ is v
        unit = plots.unit("log_velocity_rms")
        story["log_velocity_rms"] = f"Velocity error, rms over short intervals [{unit}]"
    views = [plots(entity, story[entity], Plots.RIGHT) for entity in story if plots.shows(entity)]
    views += [] if judged else [_estimate(plots, g, False, Plots.RIGHT) for g in _driven(space)[:1]]
    checks = [
        plots(entity, title, 0.5, entity != "theta_perp")
        for entity, title in _CHECKS.items()
        if plots.shows(entity) and entity not in story
        if entity != "excitation" or plots.moving(entity)
    ]
    theory = plots.grid(checks, 2 if len(checks) <= 6 else 3, "Theory and excitation")
    overview = _overview(camera, survey, drawn, views, plots)
    return whole_blueprint(overview, *estimates(space, plots, judged), theory, verdicts())


def live_blueprint(space: ParameterSpace, camera: Camera | None, drawn: str = "") -> rrb.Blueprint:
    """Layout of a running run, without anything that needs the truth."""
    plots = Plots()
    views: list[rrb.View | rrb.Container] = [
        rrb.Vertical(
            plots("velocity_error", _ERROR),
            *[_estimate(plots, group, False, Plots.RIGHT) for group in _driven(space)[:2]],
            plots("excitation", _EXCITATION),
        )
    ]
    if camera is not None:
        views.insert(0, robot_view(camera, drawn))
    overview = rrb.Horizontal(*views, name="Overview")
    pages = estimates(space, plots, judged=False)
    return whole_blueprint(overview, *pages, play_state="following")


def estimates(space: ParameterSpace, plots: Plots, judged: bool = True) -> list[rrb.Container]:
    """Pages of θ̂: small blocks, actuators first, then a page per large block, then the links.

    `judged` is whether the plots also contain the true direction.
    """
    blocks = [block for block, _ in sorted(space, key=lambda item: not item[0].actuator)]
    links = [b for b in blocks if b.geometry == "pseudo_inertia"]
    links = links if len(links) > 1 else []  # a single body is an ordinary block
    large = [b for b in blocks if len(b) > len(PALETTE) and b not in links]
    small = [b for b in blocks if b not in links + large]
    found = groups(space)

    def page(name: str, some: Sequence[Block], columns: int = 0) -> rrb.Container:
        members = [group for block in some for group in found if group.block == block.name]
        columns = columns or min(len(members), 2 if len(members) <= 6 else 3)
        views = [_estimate(plots, group, judged, 1 / columns) for group in members]
        return plots.grid(views, columns, name)

    pages = [page("Estimate", small)] if small else []
    pages += [page(b.name.capitalize(), [b]) for b in large]
    for start in range(0, len(links), _LINKS_ON_A_PAGE):
        some = links[start : start + _LINKS_ON_A_PAGE]
        name = "Links" if len(some) > 1 else some[0].name.capitalize()
        if 1 < len(some) < len(links):
            name = f"{some[0].name.capitalize()} – {some[-1].name.split()[-1]}"
        pages.append(page(name, some, 3))
    return pages


def robot_view(camera: Camera, name: str) -> rrb.Spatial3DView:
    """The robot above the ground grid; the most recent part of a vehicle's path is bright."""
    since = rr.TimeRangeBoundary.cursor_relative(seconds=-camera.trail)
    return _space(
        camera,
        name,
        {
            PATH: _period(rr.TimeRangeBoundary.infinite(), since),
            TRAIL: _period(since, rr.TimeRangeBoundary.cursor_relative()),
        },
    )


def way(camera: Camera) -> rrb.Spatial3DView:
    """A vehicle's path so far, and a mark at its position."""
    return _space(
        camera,
        f"Path, grid of {camera.grid:g} m",
        {
            TRAIL: [
                _period(rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.cursor_relative()),
                rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(1.5)),
            ],
            MARK: [rr.Points3D.from_fields(radii=rr.Radius.ui_points(5.0), colors=[_MARK])],
        },
        [f"/{TRAIL}", f"/{MARK}"],
    )


def _space(
    camera: Camera,
    name: str,
    overrides: dict[str, Any],
    contents: Sequence[str] = (f"/{ROBOT}/**", f"-/{MARK}"),
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="/",
        contents=list(contents),
        name=name,
        background=rrb.Background(color=(27, 32, 41)),
        line_grid=rrb.LineGrid3D(
            visible=True,
            spacing=camera.grid,
            plane=rr.components.Plane3D.XY.with_distance(camera.ground),
            stroke_width=1.0,
            color=(90, 100, 120, 120),
        ),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=camera.position,
            look_target=camera.target,
            tracking_entity=camera.follows or None,
        ),
        overrides={f"/{entity}": override for entity, override in overrides.items()},
    )


def _period(start: rr.TimeRangeBoundary, end: rr.TimeRangeBoundary) -> rrb.VisibleTimeRanges:
    return rrb.VisibleTimeRanges(timeline="sim_time", start=start, end=end)


def result_view(name: str = "Result") -> rrb.TextDocumentView:
    """The panel with the result as text."""
    return rrb.TextDocumentView(origin="/result", name=name)


def verdicts() -> rrb.Horizontal:
    """The page with the paper's statements, and with what cannot be known."""
    return rrb.Horizontal(
        rrb.TextDocumentView(origin="/statements", name="The paper's statements on this run"),
        rrb.TextDocumentView(origin="/unknown", name="What cannot be known from motion"),
        name="Verdicts",
    )


def _overview(
    camera: Camera | None,
    survey: Camera | None,
    drawn: str,
    story: Sequence[rrb.View],
    plots: Plots,
) -> rrb.Horizontal:
    """The first page: robot and result on the left, the main plots on the right."""
    left: list[rrb.View | rrb.Container] = [result_view()]  # wide enough for its table
    if camera is not None:
        left.insert(0, robot_view(camera, drawn))
    if survey is not None:
        left[0] = rrb.Horizontal(left[0], way(survey), column_shares=[3, 2])
    return views_beside(left, plots.column(story), "Overview", [3, 2])


def views_beside(
    left: Sequence[rrb.View | rrb.Container], right: rrb.Container, name: str, shares: list[float]
) -> rrb.Horizontal:
    """A page with robot and texts, `shares` of its height each, on the left of its plots."""
    if not left:
        return rrb.Horizontal(right, name=name)
    column = rrb.Vertical(*left, row_shares=shares[: len(left)])
    return rrb.Horizontal(column, right, column_shares=[1 - Plots.RIGHT, Plots.RIGHT], name=name)


def _driven(space: ParameterSpace) -> list[ParameterGroup]:
    """The first parameters of every block of actuators."""
    found = {group.block: group for group in reversed(groups(space))}
    return [found[block.name] for block in space.blocks if block.actuator]


def _estimate(
    plots: Plots, group: ParameterGroup, judged: bool, width: float
) -> rrb.TimeSeriesView:
    true = "; true direction (pale)" if judged else ""
    return plots(path(*group.key), f"Estimate of {group.title}{true}", width)


def whole_blueprint(
    *pages: rrb.Container, play_state: Literal["playing", "following"] = "playing"
) -> rrb.Blueprint:
    """Pages as tabs, the first one open, without the viewer's panels."""
    return rrb.Blueprint(
        rrb.Tabs(*pages, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed", timeline="sim_time", play_state=play_state, loop_mode="all"
        ),
        auto_views=False,
        auto_layout=False,
    )
