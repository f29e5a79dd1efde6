"""How the viewer arranges a run: pages as tabs, the first one tells the story without a click."""

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
    """The arrangement of a run that has ended.

    Args:
        space: the parameters.
        camera: where the robot is seen from; None leaves the 3D view out.
        survey: where a vehicle's whole way is seen from; None leaves it out.
        magnified: how many times longer than the others' some actuators' arrows are; None where
            no forces are drawn.
        farthest: the largest ‖θ̄_P⊥‖/‖θ̂‖ there is to see.
        shared: what the shares are of ("motor gain"), "" where there are none.
        rivals: whether there are rivals to compare with.
        conserves: whether the law's quantity is conserved.
    """
    story = [
        plot("distance", "Distance to the true set  ‖θ̄_P⊥‖ / ‖θ̂‖  [1]", (0.0, 1.05 * farthest))
    ]
    if shared:
        story.append(plot("share", f"Share of each {shared}, estimate / truth  (1 = right)"))
    if shared and rivals:
        story.append(plot("share_error", f"Largest error of a {shared}'s share  [%]"))
    elif len(space.actuators) > 1:
        story.append(_estimate(max((b for b, _ in space if b.actuator), key=len).name))
    else:
        story.append(_log_distance())
    story.append(plot("velocity_error", "Velocity error  Δv = v̂ − v"))
    drawn = "commanded (white), estimated (orange)"
    overview = _overview(camera, survey, drawn, magnified, story)
    certificates = rrb.Grid(
        _log_distance(),
        plot("theta_perp", "Components  θ̄_P⊥  (40)", legend=False),
        plot("lyapunov", "Lyapunov function  V  (66)  [J]"),
        *([_conserved()] if conserves else []),
        plot("velocity_rms", "Velocity error, rms over the velocities"),
        plot("excitation", "Persistence of excitation over a window  ε₀  [N·m·s]"),
        plot("velocity", "Measured velocity  v"),
        plot("command", "Command  u"),
        grid_columns=2,
        name="Proof and excitation",
    )
    return _whole(overview, *estimates(space), certificates)


def measured_blueprint(
    space: ParameterSpace,
    camera: Camera | None,
    *,
    survey: Camera | None = None,
    magnified: Mapping[str, float] | None = None,
    forces: bool = False,
    conserves: bool = False,
) -> rrb.Blueprint:
    """The arrangement of a run whose truth nobody knows: predictions against measurements.

    Args:
        space: the parameters.
        camera: where the robot is seen from; None leaves the 3D view out.
        survey: where a vehicle's whole way is seen from; None leaves it out.
        magnified: how many times longer than the others' some actuators' arrows are; None where
            no forces are drawn.
        forces: whether the two sides of the force balance are there to be compared.
        conserves: whether the law's quantity is conserved.
    """
    story = [plot("velocity", "Measured velocity  v, predicted  v̂ (pale)")]
    if forces:
        story.append(plot("force", "Force that the motion takes, actuators give (pale), under θ̂"))
    story.append(plot("velocity_error", "Velocity error  Δv = v̂ − v"))
    story += [_estimate(block.name, False) for block, _ in space if block.actuator][:1]
    certificates = [
        plot("velocity_rms", "Velocity error, rms over the velocities"),
        plot("excitation", "Persistence of excitation over a window  ε₀  [N·m·s]"),
        plot("command", "Command  u"),
    ]
    if conserves:
        certificates.insert(0, _conserved())
    overview = _overview(camera, survey, "estimated (orange)", magnified, story)
    proof = rrb.Grid(*certificates, grid_columns=2, name="Proof and excitation")
    return _whole(overview, *estimates(space, judged=False), proof)


def live_blueprint(
    space: ParameterSpace, camera: Camera | None, magnified: Mapping[str, float] | None = None
) -> rrb.Blueprint:
    """The arrangement of a run that goes on: what can be known without the truth."""
    plots = [
        plot("velocity_error", "Velocity error  Δv = v̂ − v"),
        *[_estimate(block.name, False) for block, _ in space if block.actuator][:2],
        plot("excitation", "Persistence of excitation over a window  ε₀  [N·m·s]"),
    ]
    views: list[rrb.View | rrb.Container] = [rrb.Vertical(*plots)]
    if camera is not None:
        views.insert(0, robot(camera, _forces("estimated (orange)", magnified)))
    overview = rrb.Horizontal(*views, name="Overview")
    return _whole(overview, *estimates(space, judged=False), play_state="following")


def estimates(space: ParameterSpace, judged: bool = True) -> list[rrb.Grid]:
    """Pages of θ̂ by block: actuators first, then the others, large ones, and links.

    Args:
        space: the parameters.
        judged: whether the true direction is shown beside them.
    """
    blocks = [block for block, _ in sorted(space, key=lambda item: not item[0].actuator)]
    links = [b for b in blocks if b.geometry == "pseudo_inertia"]
    links = links if len(links) > 1 else []  # a single body is a block as any other
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


_WHOLE_RUN = rr.TimeRange(  # by itself a plot shows a minute about the cursor
    start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite()
)


def plot(
    entity: str, title: str, span: tuple[float, float] | None = None, legend: bool = True
) -> rrb.TimeSeriesView:
    """One plot over the time of the run; `span` is what its axis shows, None what there is."""
    return rrb.TimeSeriesView(
        origin=f"/{entity}",
        name=drawable(title),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
        axis_y=rrb.ScalarAxis(range=span) if span else None,
        axis_x=rr.blueprint.archetypes.TimeAxis(view_range=_WHOLE_RUN),
    )


def robot(camera: Camera, name: str) -> rrb.Spatial3DView:
    """The robot, on its ground; a vehicle with its last way bright."""
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
    """A vehicle's whole way until now, and a mark where it is."""
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
        return "Robot, as MuJoCo moves it"
    longer = [f"{kind} {times:g} × as long" for kind, times in magnified.items()]
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


def result() -> rrb.TextDocumentView:
    """What came out, in words."""
    return rrb.TextDocumentView(origin="/result", name="Result")


def _overview(
    camera: Camera | None,
    survey: Camera | None,
    drawn: str,
    magnified: Mapping[str, float] | None,
    story: Sequence[rrb.View],
) -> rrb.Horizontal:
    """The first page: the robot and the result on the left, the plots that matter on the right."""
    told: rrb.View | rrb.Container = result()
    if survey is not None:
        told = rrb.Horizontal(way(survey), told, column_shares=[2, 3])
    left: list[rrb.View | rrb.Container] = [told]
    if camera is not None:
        left.insert(0, robot(camera, _forces(drawn, magnified)))
    return rrb.Horizontal(
        rrb.Vertical(*left, row_shares=[3, 2][: len(left)]),
        rrb.Grid(*story, grid_columns=2 if len(story) > 3 else 1),
        column_shares=[2, 3],
        name="Overview",
    )


def _conserved() -> rrb.TimeSeriesView:
    return plot("conserved", "Drift of the conserved  ‖θ̂‖² under Γ⁻¹  (30), relative, log₁₀")


def _log_distance() -> rrb.TimeSeriesView:
    return plot("log_distance", "Distance to the true set  log₁₀ (‖θ̄_P⊥‖ / ‖θ̂‖)")


def _estimate_page(name: str, blocks: Sequence[Block], judged: bool) -> rrb.Grid:
    plots = [_estimate(block.name, judged) for block in blocks]
    return rrb.Grid(*plots, grid_columns=min(len(plots), 2 if len(plots) <= 6 else 3), name=name)


def _estimate(block: str, judged: bool = True) -> rrb.TimeSeriesView:
    beside = " and its true direction (pale)" if judged else ""
    return plot(path("estimate", block), f"Estimate of {block}{beside}, / scale")


def _whole(
    *pages: rrb.Container, play_state: Literal["playing", "following"] = "playing"
) -> rrb.Blueprint:
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
