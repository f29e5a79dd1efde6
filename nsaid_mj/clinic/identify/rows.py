"""Rows of a fit: the regressor W (10) of a robot's system along its logs, through the row filter.

The same system's columns drive the laws: no force is written a second time for logs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...core import Array, Block, Column, ParameterSpace, Rotor, SecondOrderSystem
from ..logs.recordings import LogSegment, Recordings
from .smoothing import Filter, Smooth

_BLOCK = 500  # rows whose regressors are computed at once: an hour of them would fill the memory

Pick = Callable[[Array], Array]
"""Takes (N, ...) entries of regressors (N, n, p)."""


class Rows:
    """The segments of logs that are long enough for the row filter, and their smoothed motion.

    `smooth` smooths a segment's motion.

    Attributes:
        recordings: all segments.
        chosen: the filters.
        segments: those with rows.
        motions: their smoothed motion, at the rate at which regressors are computed.
        usable: (N, n) whether a row may be used.
        t: (N,) times of the rows [s].
        segment: (N,) number of the segment of each row.
    """

    def __init__(
        self,
        recordings: Recordings,
        chosen: Filter,
        smooth: Callable[[LogSegment, Filter], Smooth],
    ):
        self.recordings = recordings
        self.chosen = chosen
        self.segments: list[LogSegment] = []
        self.motions: list[Smooth] = []
        numbers = []
        centres = []
        for number, segment in enumerate(recordings.segments):
            motion = smooth(segment, chosen)
            rows = chosen.centres(len(motion.t))
            if len(rows):
                self.segments.append(segment)
                self.motions.append(motion)
                centres.append(rows)
                numbers.append(np.full(len(rows), number))
        pairs = list(zip(self.motions, centres, strict=True))
        self.usable = np.concatenate([motion.usable[rows] for motion, rows in pairs])
        self.t = np.concatenate([motion.t[rows] for motion, rows in pairs])
        self.segment = np.concatenate(numbers)

    def joined(self, function: Callable[[Smooth], Array]) -> Array:
        """(N, ...) rows of a function of the smoothed motion."""
        return np.concatenate([self.chosen.rows(function(motion)) for motion in self.motions])

    def regressor(
        self,
        system: SecondOrderSystem,
        pick: Pick,
        commands: Sequence[Array] | None = None,
        free: Sequence[Array] | None = None,
    ) -> Array:
        """(N, ...) rows of the picked entries of a system's W(t, x, v, v̇).

        Positions of the smoothed motion are those of the system. `commands` are (M, n_u) of every
        motion, at its times; None for 0. `free` are (M, n, n) E of every motion, by which its W is
        multiplied before the filter; None for W as it is.
        """
        found = []
        half = self.chosen.filter.half
        for number, motion in enumerate(self.motions):
            centres = self.chosen.centres(len(motion.t))
            for first in range(0, len(centres), _BLOCK):
                some = centres[first : first + _BLOCK]
                part = slice(some[0] - half, some[-1] + half + 1)
                v = motion.v[part]
                x = np.hstack([motion.q[part], v])
                u = np.zeros((len(v), system.n_u))
                if commands is not None:
                    u = commands[number][part]
                W = system.regressor(motion.t[part], x, v, motion.a[part], u)
                if free is not None:
                    W = free[number][part] @ W
                found.append(self.chosen.rows(pick(W)))
        return np.concatenate(found)


def unrolled(system: SecondOrderSystem) -> SecondOrderSystem:
    """The system with an angle as the position of every joint, also of those without limits.

    Their positions are (cos, sin), while a log's angles continue across whole turns.
    """
    bodies = [
        replace(body, joint="hinge") if body.joint == "circle" else body
        for body in system.structure.bodies
    ]
    return system.rebuilt(replace(system.structure, bodies=bodies), system.space)


def with_columns(
    system: SecondOrderSystem, columns: Sequence[Column], rotors: Sequence[Rotor], p: int
) -> SecondOrderSystem:
    """A system with further columns and rotors, of p parameters without names."""
    unnamed = Block("unnamed", tuple(map(str, range(p))), ("1",) * p, np.ones(p), "free")
    own = system.structure
    more = {"columns": [*own.columns, *columns], "rotors": [*own.rotors, *rotors]}
    return system.rebuilt(replace(own, p=p, **more), ParameterSpace((unnamed,)))
