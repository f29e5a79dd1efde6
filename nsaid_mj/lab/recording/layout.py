"""Pages of a run's recording: plots, and first an overview with the robot and the result."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from ...core import Block, ParameterSpace
from ...report import Camera, Plots
from ..evaluation.labels import ParameterGroup, groups

_LINKS_ON_A_PAGE = 3
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


def pages_of_run(
    space: ParameterSpace,
    camera: Camera | None,
    plots: Plots,
    *,
    survey: Camera | None = None,
    drawn: str = "",
    shared: str = "",
) -> list[rrb.Container]:
    """Pages of a finished run, of the curves in its recording.

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
    return [overview, *estimates(space, plots, judged), theory, verdicts()]


def pages_of_live_run(
    space: ParameterSpace, camera: Camera | None, drawn: str = ""
) -> list[rrb.Container]:
    """Pages of a running run, without anything that needs the truth."""
    plots = Plots()
    views: list[rrb.View | rrb.Container] = [
        rrb.Vertical(
            plots("velocity_error", _ERROR),
            *[_estimate(plots, group, False, Plots.RIGHT) for group in _driven(space)[:2]],
            plots("excitation", _EXCITATION),
        )
    ]
    if camera is not None:
        views.insert(0, camera.view(drawn))
    return [rrb.Horizontal(*views, name="Overview"), *estimates(space, plots, judged=False)]


def estimates(space: ParameterSpace, plots: Plots, judged: bool = True) -> list[rrb.Container]:
    """Pages of θ̂: small blocks, actuators first, then a page per large block, then the links.

    `judged` is whether the plots also contain the true direction.
    """
    blocks = [block for block, _ in sorted(space, key=lambda item: not item[0].actuator)]
    links = [b for b in blocks if b.geometry == "pseudo_inertia"]
    links = links if len(links) > 1 else []  # a single body is an ordinary block
    large = [b for b in blocks if len(b) > Plots.MOST and b not in links]
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
    # the result is wide enough for its table
    left: list[rrb.View | rrb.Container] = [rrb.TextDocumentView(origin="/result", name="Result")]
    if camera is not None:
        left.insert(0, camera.view(drawn))
    if survey is not None:
        left[0] = rrb.Horizontal(left[0], survey.way(), column_shares=[3, 2])
    return Plots.beside(left, plots.column(story), "Overview", [3, 2])


def _driven(space: ParameterSpace) -> list[ParameterGroup]:
    """The first parameters of every block of actuators."""
    found = {group.block: group for group in reversed(groups(space))}
    return [found[block.name] for block in space.blocks if block.actuator]


def _estimate(
    plots: Plots, group: ParameterGroup, judged: bool, width: float
) -> rrb.TimeSeriesView:
    true = "; true direction (pale)" if judged else ""
    return plots(Plots.entity(*group.key), f"Estimate of {group.title}{true}", width)
