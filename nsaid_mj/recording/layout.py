"""Layout of the viewer: tabs of plots, the first of which shows the essentials of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

import rerun as rr
import rerun.blueprint as rrb

from ..parameters import Block, ParameterSpace
from .scene import CENTRE, PATH, ROBOT, TRAIL, Camera
from .series import PALETTE, path
from .text import drawable

_LINKS_ON_A_PAGE = 6
_MARK = (255, 255, 255)


def blueprint(
    space: ParameterSpace,
    camera: Camera | None,
    *,
    survey: Camera | None = None,
    magnified: Mapping[str, float] | None = None,
    farthest: float,
    shared: str = "",
    rivals: bool = False,
    conserves: bool = False,
) -> rrb.Blueprint:
    """Layout of a finished run whose truth is known.

    Args:
        space: the parameters.
        camera: of the robot; None leaves the 3D view out.
        survey: camera on a vehicle's whole path; None leaves the path out.
        magnified: magnification of some actuators' force arrows, by name of the kind; None if no
            forces are drawn.
        farthest: largest ‖θ̄_P⊥‖/‖θ̂‖ in the recording.
        shared: the kind of parameters compared by relative gain ("motor gain"); empty if none.
        rivals: whether the recording contains rivals.
        conserves: whether the law conserves θ̂ᵀ Γ⁻¹ θ̂.
    """
    story = [
        plot("distance", "Distance to the true set  ‖θ̄_P⊥‖ / ‖θ̂‖  [1]", (0.0, 1.05 * farthest))
    ]
    if shared:
        title = f"{shared.capitalize()}s, estimate / truth, relative to the mean  (1 = exact)"
        story.append(plot("share", title))
    if shared and rivals:
        title = f"Largest error of a {shared}, relative to the mean  [%]"
        story.append(plot("share_error", title))
    elif len(space.actuators) > 1:
        story.append(_estimate(max((b for b, _ in space if b.actuator), key=len).name))
    else:
        story.append(_log_distance())
    story.append(plot("velocity_error", "Velocity error  Δv = v̂ − v"))
    drawn = "commanded (white), estimated (orange)"
    overview = _overview(camera, survey, drawn, magnified, story)
    certificates = rrb.Grid(
        _log_distance(),
        plot("theta_perp", "Components of  θ̄_P⊥  (40)", legend=False),
        plot("lyapunov", "Lyapunov function  V  (66)  [J]"),
        *([_conserved()] if conserves else []),
        plot("velocity_rms", "Velocity error, rms over all velocities"),
        plot("excitation", "Persistence of excitation over a window  ε₀  [N·m·s]"),
        plot("velocity", "Measured velocity  v"),
        plot("command", "Command  u"),
        grid_columns=2,
        name="Theory and excitation",
    )
    return whole(overview, *estimates(space), certificates)


def measured_blueprint(
    space: ParameterSpace,
    camera: Camera | None,
    *,
    survey: Camera | None = None,
    magnified: Mapping[str, float] | None = None,
    forces: bool = False,
    conserves: bool = False,
) -> rrb.Blueprint:
    """Layout of a finished run whose truth is unknown: predictions against measurements.

    Args:
        space: the parameters.
        camera: of the robot; None leaves the 3D view out.
        survey: camera on a vehicle's whole path; None leaves the path out.
        magnified: magnification of some actuators' force arrows, by name of the kind; None if no
            forces are drawn.
        forces: whether the recording contains the two sides of the force balance.
        conserves: whether the law conserves θ̂ᵀ Γ⁻¹ θ̂.
    """
    story = [plot("velocity", "Velocity, measured  v and predicted  v̂ (pale)")]
    if forces:
        story.append(plot("force", "Force balance under θ̂: motion, actuators (pale)"))
    story.append(plot("velocity_error", "Velocity error  Δv = v̂ − v"))
    story += [_estimate(block.name, False) for block, _ in space if block.actuator][:1]
    certificates = [
        plot("velocity_rms", "Velocity error, rms over all velocities"),
        plot("excitation", "Persistence of excitation over a window  ε₀  [N·m·s]"),
        plot("command", "Command  u"),
    ]
    if conserves:
        certificates.insert(0, _conserved())
    overview = _overview(camera, survey, "estimated (orange)", magnified, story)
    theory = rrb.Grid(*certificates, grid_columns=2, name="Theory and excitation")
    return whole(overview, *estimates(space, judged=False), theory)


def live_blueprint(
    space: ParameterSpace, camera: Camera | None, magnified: Mapping[str, float] | None = None
) -> rrb.Blueprint:
    """Layout of a running run, without anything that needs the truth."""
    plots = [
        plot("velocity_error", "Velocity error  Δv = v̂ − v"),
        *[_estimate(block.name, False) for block, _ in space if block.actuator][:2],
        plot("excitation", "Persistence of excitation over a window  ε₀  [N·m·s]"),
    ]
    views: list[rrb.View | rrb.Container] = [rrb.Vertical(*plots)]
    if camera is not None:
        views.insert(0, robot(camera, _forces("estimated (orange)", magnified)))
    overview = rrb.Horizontal(*views, name="Overview")
    return whole(overview, *estimates(space, judged=False), play_state="following")


def estimates(space: ParameterSpace, judged: bool = True) -> list[rrb.Grid]:
    """Pages of θ̂: small blocks, actuators first, then a page per large block, then the links.

    Args:
        space: the parameters.
        judged: whether the plots also contain the true direction.
    """
    blocks = [block for block, _ in sorted(space, key=lambda item: not item[0].actuator)]
    links = [b for b in blocks if b.geometry == "pseudo_inertia"]
    links = links if len(links) > 1 else []  # a single body is an ordinary block
    large = [b for b in blocks if len(b) > len(PALETTE)]
    small = [b for b in blocks if b not in links + large]
    pages = [_estimate_page("Estimate", small, judged)] if small else []
    pages += [_estimate_page(b.name.capitalize(), [b], judged) for b in large]
    for start in range(0, len(links), _LINKS_ON_A_PAGE):
        some = links[start : start + _LINKS_ON_A_PAGE]
        name = "Links"
        if len(links) > len(some):
            name = f"{some[0].name.capitalize()} – {some[-1].name.split()[-1]}"
        pages.append(_estimate_page(name, some, judged))
    return pages


_WHOLE_RUN = rr.TimeRange(  # the default is a minute around the cursor
    start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite()
)


def plot(
    entity: str, title: str, span: tuple[float, float] | None = None, legend: bool = True
) -> rrb.TimeSeriesView:
    """One plot over the whole run; `span` is the range of its vertical axis, None to fit it."""
    return rrb.TimeSeriesView(
        origin=f"/{entity}",
        name=drawable(title),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
        axis_y=rrb.ScalarAxis(range=span) if span else None,
        axis_x=rr.blueprint.archetypes.TimeAxis(view_range=_WHOLE_RUN),
    )


def robot(camera: Camera, name: str) -> rrb.Spatial3DView:
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
        "Path",
        {
            TRAIL: [
                _period(rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.cursor_relative()),
                rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(1.5)),
            ],
            CENTRE: [rr.Points3D.from_fields(radii=rr.Radius.ui_points(5.0), colors=[_MARK])],
        },
        [f"/{TRAIL}", f"/{CENTRE}"],
    )


def _forces(which: str, magnified: Mapping[str, float] | None) -> str:
    if magnified is None:
        return "Robot, simulated by MuJoCo"
    longer = [f"{kind} magnified {times:g} ×" for kind, times in magnified.items()]
    return drawable(f"Forces: {'; '.join([which, *longer])}")


def _space(
    camera: Camera, name: str, overrides: dict[str, Any], contents: str | list[str] = f"/{ROBOT}/**"
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
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


def result(name: str = "Result") -> rrb.TextDocumentView:
    """The panel with the result as text."""
    return rrb.TextDocumentView(origin="/result", name=name)


def _overview(
    camera: Camera | None,
    survey: Camera | None,
    drawn: str,
    magnified: Mapping[str, float] | None,
    story: Sequence[rrb.View],
) -> rrb.Horizontal:
    """The first page: robot and result on the left, the main plots on the right."""
    below: rrb.View | rrb.Container = result()
    if survey is not None:
        below = rrb.Horizontal(way(survey), below, column_shares=[2, 3])
    left: list[rrb.View | rrb.Container] = [below]
    if camera is not None:
        left.insert(0, robot(camera, _forces(drawn, magnified)))
    return rrb.Horizontal(
        rrb.Vertical(*left, row_shares=[3, 2][: len(left)]),
        rrb.Grid(*story, grid_columns=2 if len(story) > 3 else 1),
        column_shares=[2, 3],
        name="Overview",
    )


def _conserved() -> rrb.TimeSeriesView:
    return plot("conserved", "Relative drift of the conserved quantity  (30)  [log₁₀]")


def _log_distance() -> rrb.TimeSeriesView:
    return plot("log_distance", "Distance to the true set  log₁₀ (‖θ̄_P⊥‖ / ‖θ̂‖)")


def _estimate_page(name: str, blocks: Sequence[Block], judged: bool) -> rrb.Grid:
    plots = [_estimate(block.name, judged) for block in blocks]
    return rrb.Grid(*plots, grid_columns=min(len(plots), 2 if len(plots) <= 6 else 3), name=name)


def _estimate(block: str, judged: bool = True) -> rrb.TimeSeriesView:
    true = " and its true direction (pale)" if judged else ""
    return plot(path("estimate", block), f"Estimate of {block}{true}, / scale")


def whole(
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
