"""Plots over time in the viewer, with space for their legends beside the curves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from ..panels import AnyPanel
from .lines import LOGARITHM, PALETTE, Lines, lines_of, path
from .text import drawable

_WINDOW = 1600.0  # assumed width of the window, and of a plot's axis [pixels]
_AXIS = 60.0
_LETTER = 7.0  # of a legend [pixels], and its largest share of a plot
_MARGIN = 55.0
_WIDEST = 0.6
_CLEAR = 1.06  # of the time axis over the run, so that its last label is not cut
_LINE = 23.0  # heights in a legend, and of a view's title [pixels]
_PADDING = 16.0
_HEAD = 30.0
_BEYOND = 0.06  # of an axis beyond its outer labels, so that they are not cut
_TALLEST = 0.78  # a legend's largest share of a plot; height of all views [pixels]
_HEIGHT = 906.0
_KEY = 40.0  # height of the key of a page's comparisons [pixels]
_ROOMY = 230.0  # heights of a view with a short legend, where there is space [pixels]
_LEAST = 140.0
_WHOLE_RUN = rr.TimeRange(  # the default is a minute around the cursor
    start=rr.TimeRangeBoundary.infinite(), end=rr.TimeRangeBoundary.infinite()
)


KEY = "key"
"""Entity of the text that explains the colours of comparisons."""


class Plots:
    """Makes plots whose legends stand beside the curves, in an empty part of the time axis.

    Args:
        curves: lines of the recording, whose names are in the legends.
        end: end of the run [s]; None if unknown, as in a running one.
        window: time that a plot shows, most of it after the cursor [s]; None for the whole run.

    Attributes:
        curves: as given.
        RIGHT: share of the window that the first page's plots take.
        MOST: number of curves from which on colours repeat in a plot.
    """

    RIGHT = 0.6
    MOST = len(PALETTE)

    def __init__(
        self,
        curves: Sequence[Lines] = (),
        end: float | None = None,
        window: float | None = None,
    ):
        self.curves = curves
        self._end = end
        self._window = window
        self._entries: dict[Any, int] = {}  # in the legend of a view
        self._until: dict[Any, float] = {}  # end of a view's time axis [s]
        self._compared: set[Any] = set()  # views of measured and computed values

    @classmethod
    def of(
        cls, panels: Iterable[AnyPanel], end: float | None, window: float | None = None
    ) -> Plots:
        """Plots of the lines of panels."""
        return cls(lines_of(panels), end, window)

    @staticmethod
    def entity(*parts: str, logarithm: bool = False) -> str:
        """The entity of curves, from the parts of a panel's key.

        Of a panel with a logarithmic axis, `logarithm` is that of the powers of ten of its values.
        """
        return (LOGARITHM if logarithm else "") + path(*parts)

    def __call__(
        self, entity: str, title: str, width: float = 0.5, legend: bool = True
    ) -> rrb.TimeSeriesView:
        """A plot of all curves below an entity; `width` is its share of the window."""
        curves = self._below(entity)
        names = [name for curve in curves for name in curve.names]
        longest = max((len(name) for name in names), default=0)
        compared = any(curve.compared for curve in curves)
        legend = legend and len(set(names)) > 1 and not compared
        until = None if self._end is None else _CLEAR * self._end
        if self._end is not None and legend:
            share = (_LETTER * longest + _MARGIN) / (_WINDOW * width - _AXIS)
            until = self._end / (1 - min(share, _WIDEST))
        decades = self._decades(entity) if entity.startswith(LOGARITHM) else None
        view = rrb.TimeSeriesView(
            origin=f"/{entity}",
            name=drawable(title),
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=legend),
            axis_x=rr.blueprint.archetypes.TimeAxis(view_range=self._span(until)),
            axis_y=None if decades is None else rrb.ScalarAxis(range=decades),
        )
        self._entries[view.id] = len(set(names)) if legend else 0
        if compared:
            self._compared.add(view.id)
        if until is not None:
            self._until[view.id] = until
        return view

    def align(self, views: Sequence[rrb.View]) -> None:
        """Gives plots that stand together the same time axis, with space for the widest legend."""
        until = max((self._until.get(view.id, 0.0) for view in views), default=0.0)
        if until > 0:
            for view in views:
                axis = rr.blueprint.archetypes.TimeAxis(view_range=self._span(until))
                view.properties["TimeAxis"] = axis

    def column(self, views: Sequence[rrb.View]) -> rrb.Vertical:
        """Views below each other over one time axis; those with long legends are higher."""
        self.align(views)
        return rrb.Vertical(*views, row_shares=self.heights(*[[view] for view in views]))

    def _span(self, until: float | None) -> rr.TimeRange:
        """The times that a plot shows: a window, the time to `until` [s], or the whole run."""
        if self._window is not None:
            return rr.TimeRange(
                start=rr.TimeRangeBoundary.cursor_relative(seconds=-0.2 * self._window),
                end=rr.TimeRangeBoundary.cursor_relative(seconds=0.8 * self._window),
            )
        if until is None:
            return _WHOLE_RUN
        return rr.TimeRange(
            start=rr.TimeRangeBoundary.absolute(seconds=0.0),
            end=rr.TimeRangeBoundary.absolute(seconds=until),
        )

    def shows(self, entity: str, least: int = 1) -> bool:
        """Whether there are curves below an entity, as many as `least`."""
        return len(self._below(entity)) >= least

    def moving(self, entity: str) -> bool:
        """Whether any curve below an entity differs from 0."""
        return any(np.any(curve.values != 0) for curve in self._below(entity))

    def unit(self, entity: str) -> str:
        """The unit of the curves below an entity."""
        curves = self._below(entity)
        names = [name for curve in curves for name in curve.names]
        return names[0].rpartition("[")[2].removesuffix("]") if names else "log₁₀"

    def heights(self, *rows: Sequence[rrb.View]) -> list[float]:
        """Shares of the height of rows of views, which leave space for their legends."""
        entries = [max(self._entries.get(view.id, 0) for view in row) for row in rows]
        legends = [_HEAD + (_LINE * count + _PADDING) / _TALLEST for count in entries]
        roomy = [max(_ROOMY, legend) for legend in legends]
        return roomy if sum(roomy) <= _HEIGHT else [max(_LEAST, legend) for legend in legends]

    def grid(self, views: Sequence[rrb.View], columns: int, name: str = "") -> rrb.Container:
        """A page of views in columns, over one time axis; rows with long legends are higher.

        Above comparisons stands one key of their colours.
        """
        self.align(views)
        rows = [views[k : k + columns] for k in range(0, len(views), columns)]
        heights = self.heights(*rows)
        grid = rrb.Grid(*views, grid_columns=columns, row_shares=heights, name=name or None)
        if not any(view.id in self._compared for view in views):
            return grid
        key = rrb.TextDocumentView(origin=f"/{KEY}", name="Key", titlebar=False)
        return rrb.Vertical(key, grid, row_shares=[_KEY, _HEIGHT - _KEY], name=name or None)

    @classmethod
    def beside(
        cls,
        left: Sequence[rrb.View | rrb.Container],
        right: rrb.Container,
        name: str,
        shares: list[float],
    ) -> rrb.Horizontal:
        """A page with robot and texts, `shares` of its height each, on the left of its plots."""
        if not left:
            return rrb.Horizontal(right, name=name)
        column = rrb.Vertical(*left, row_shares=shares[: len(left)])
        return rrb.Horizontal(column, right, column_shares=[1 - cls.RIGHT, cls.RIGHT], name=name)

    def _decades(self, entity: str) -> tuple[float, float] | None:
        """The powers of ten that enclose all curves below an entity; None if unknown."""
        values = [lines.values for lines in self._below(entity) if len(lines.values)]
        ends = [f(v) for v in values if np.isfinite(v).any() for f in (np.nanmin, np.nanmax)]
        if not ends:
            return None
        low = float(np.floor(min(ends)))
        high = float(np.ceil(max(ends)))
        beyond = _BEYOND * (high - low)
        return low - beyond, high + beyond

    def _below(self, entity: str) -> list[Lines]:
        return [c for c in self.curves if f"{c.path}/".startswith(f"{entity}/")]
