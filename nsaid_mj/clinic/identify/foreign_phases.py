"""Phases that only the residuals show: a hand moves an arm, it hits a table, its controller pauses.

A fit to a log with such a stretch is pulled towards it and explains neither part. So the windows
that fit worst are set aside and the rest is fitted again (least trimmed squares, Rousseeuw 1984).
A stretch is another phase if it is then far from all that is explained, and if not merely its
motion is new: speeds and commands must occur elsewhere, too. A structure that is wrong at high
speed, or everywhere a little, is wrong, and stays in the fit.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base import Finding
from ...core import Array, Indices, number
from ..logs.phases import Kind, LogPhase, phases_stated
from ..logs.preparation import SHORTEST
from ..logs.recordings import LogSegment, Recordings
from ..logs.signals import runs
from .fit import minimise, tempered
from .problem import FitProblem, Mask
from .result import Identification

_WELL = 0.05  # held-out NRMSE up to which nothing is looked for
_WINDOW = 0.25  # [s]
_KEPT = 0.7  # share of the windows to which the rest is fitted
_MOST = 0.34  # share of the windows, at most, of other phases
_MOST_CONTACT = 0.2  # the same of those whose commands do not betray them
_ROUNDS = 6
_FAR = 8.0  # residual of such a window over the usual one
_TOP = 0.1  # the same over the largest: what is smaller is looked at again without the larger
_NEAR = 4.0  # of those beside it, which the row filter smears
_LARGE = 0.15  # residual of such a window over the forces' deviation
_APART = 4.0  # residual of the phases over the largest usual ones
_BRIDGED = 2  # windows between two such that belong to them
_LEAST = 0.01  # least usual residual over the forces' deviation
_PER_PARAMETER = 3  # rows that must be left for every parameter
_IDLE = 0.05  # command over its large values, up to which a motor does nothing
_LASTING = 0.5  # least duration of a phase that is named after its commands [s]
_RARE = 0.005  # quantile of a velocity beyond which it hardly occurs
_FROZEN = 1e-3  # change over the same, up to which a command does not change
_WHY: dict[Kind, str] = {
    "moved by hand": "it moves while its commands are zero, unlike in the rest of the log",
    "paused controller": "its commands stand still, unlike in the rest of the log",
    "contact": "other forces act, as in contact; similar motion is explained elsewhere",
}


class ForeignPhase(NamedTuple):
    """A stretch of a segment in which other forces act."""

    segment: int
    start: float  # [s]
    end: float  # [s]
    kind: Kind


PASSES = 3
"""Fits, at most, each of which may reveal another phase."""


def foreign_phases(found: Identification) -> list[ForeignPhase]:
    """The other phases of the logs of a fit; none where it explains them well."""
    errors = np.array([joint.held_out for joint in found.joints])
    if found.robot.floating or not (errors > _WELL).any():  # forces of contact are no other phase
        return []
    problem = found.fitted.problem
    windows = _LogWindows(problem)
    foreign = windows.foreign(found.fitted.share, found.theta)
    if not foreign.any():
        return []
    named = _named(windows, foreign, found.recordings)
    # a vehicle that hits something lies still then; its other misfits are the structure's
    return [each for each in named if found.robot.jointed or each.kind != "contact"]


def foreign_in_validation(
    found: Identification, validation: Recordings | None
) -> list[ForeignPhase]:
    """Those of a validation log, on which the fit has no say: its commands must betray them."""
    problem = found.fitted.made.checked
    errors = [joint.validation or 0.0 for joint in found.joints]
    if validation is None or problem is None or not max(errors) > _WELL:
        return []
    windows = _LogWindows(problem)
    foreign = windows.far_from(found.theta)
    named = _named(windows, foreign, validation) if foreign.any() else []
    return [each for each in named if each.kind != "contact"]


def unfiltered(found: Identification) -> list[Finding]:
    """The finding about segments that are shorter than the filter of the rows; none without any."""
    recordings = found.recordings
    used = np.unique(found.fitted.problem.segment)
    lost = np.setdiff1d(np.arange(len(recordings.segments)), used)
    if not len(lost):
        return []
    logs = [segment.log for segment in recordings.segments]
    lengths = np.array([log.t[-1] - log.t[0] for log in logs])
    text = f"{len(lost)} of {len(logs)} stretches, {number(lengths[lost].sum(), significant=2)} of "
    text += f"{number(lengths.sum(), significant=3)} s, are shorter than the filter of the fit's "
    text += f"rows ({number(3 / found.cutoff, significant=2)} s at {number(found.cutoff)} Hz) and "
    text += "take no part in it"
    data = {"count": len(lost), "of": len(logs), "seconds": float(lengths[lost].sum())}
    level = "warning" if lengths[lost].sum() > 0.5 * lengths.sum() else "note"
    remedy = "Record longer stretches, or give a higher --cutoff."
    return [Finding(level, "short_stretch", "", text, remedy, data)]


class _LogWindows:
    """The rows of a problem in windows of a quarter of a second."""

    def __init__(self, problem: FitProblem):
        self.problem = problem
        numbers = np.zeros(len(problem.t), dtype=np.intp)
        self.segment: list[int] = []
        self.start: list[float] = []
        for segment in np.unique(problem.segment):
            rows = np.flatnonzero(problem.segment == segment)
            t = problem.t[rows] - problem.t[rows[0]]
            own = (t / _WINDOW).astype(int)
            numbers[rows] = len(self.start) + own
            count = int(own.max()) + 1
            self.segment += [int(segment)] * count
            self.start += (problem.t[rows[0]] + _WINDOW * np.arange(count)).tolist()
        self.of: Indices = numbers
        used = np.zeros(len(self.start))
        np.add.at(used, numbers, problem.usable.any(axis=1))
        self.used: Mask = used > 0

    def errors(self, theta: Array, kept: Mask) -> tuple[Array, Array]:
        """(K,), (K,) largest rms residual of every window: over the usual one, over the forces."""
        problem = self.problem
        squares = np.zeros((len(self.start), problem.Y.shape[1]))
        counts = np.zeros_like(squares)
        np.add.at(squares, self.of, np.where(problem.usable, problem.residual(theta), 0.0) ** 2)
        np.add.at(counts, self.of, problem.usable.astype(float))
        size = np.maximum(problem.forces(theta), 1e-300)
        share = np.sqrt(squares / np.maximum(counts, 1)) / size
        usual = np.array(
            [
                np.median(x[kept & (c > 0)]) if (kept & (c > 0)).any() else np.inf
                for x, c in zip(share.T, counts.T, strict=True)
            ]
        )
        return (share / np.maximum(usual, _LEAST)).max(axis=1), share.max(axis=1)

    def fitted(self, kept: Mask, share: Array, start: Array) -> Array:
        """(p,) θ of the windows kept."""
        usable = self.problem.usable & kept[self.of][:, None]
        own = replace(self.problem, usable=usable)
        return minimise(own, tempered(own, share), start).theta

    def foreign(self, share: Array, theta: Array) -> Mask:
        """(K,) windows of other phases."""
        none = np.zeros(len(self.start), dtype=bool)
        kept = self.used.copy()
        if self.problem.usable.sum() * _KEPT < _PER_PARAMETER * len(theta):
            return none
        for _ in range(_ROUNDS):
            far, _ = self.errors(theta, kept)
            closest = self.used & (far <= np.quantile(far[self.used], _KEPT))
            if (closest == kept).all():
                break
            kept = closest
            theta = self.fitted(kept, share, theta)
        found = self._stretches(*self.errors(theta, kept))
        if not found.any() or np.mean(found[self.used]) > _MOST:
            return none
        rest = self.used & ~found
        theta = self.fitted(rest, share, theta)
        far, large = self.errors(theta, rest)
        found = self._stretches(far, large)
        rest = self.used & ~found
        if not found.any() or np.mean(found[self.used]) > _MOST:
            return none
        apart = np.median(far[found & self.used]) > _APART * np.quantile(far[rest], 0.98)
        return found if apart else none

    def far_from(self, theta: Array) -> Mask:
        """(K,) windows far from the others under a θ that is not fitted to them."""
        return self._stretches(*self.errors(theta, self.used))

    def _stretches(self, far: Array, large: Array) -> Mask:
        """(K,) the windows in stretches far from the rest, with what lies between them."""
        top = _TOP * float(far[self.used].max())
        found = self.used & (far > max(_FAR, top)) & (large > _LARGE)
        segment = np.array(self.segment)
        for (_, a), (b, _) in itertools.pairwise(runs(found)):
            if segment[a - 1] == segment[b] and self.used[a:b].sum() <= _BRIDGED:
                found[a:b] = True
        for a, b in runs(found):
            for k in (a - 1, b):
                if 0 <= k < len(found) and segment[k] == segment[a] and far[k] > _NEAR:
                    found[k] = True
        return found


def _named(windows: _LogWindows, foreign: Mask, recordings: Recordings) -> list[ForeignPhase]:
    """The phases of windows, by what the commands do in them; only contacts that are plausible."""
    u = np.concatenate([segment.log.u for segment in recordings.segments])
    large = np.maximum(np.quantile(np.abs(u), 0.95, axis=0), 1e-300)
    segments = np.array(windows.segment)
    found = []
    for a, b in runs(foreign):
        for k in np.unique(segments[a:b]).tolist():
            own = np.flatnonzero(segments[a:b] == k) + a
            start = windows.start[own[0]]
            end = windows.start[own[-1]] + _WINDOW
            found.append(ForeignPhase(k, start, end, _kind(recordings, k, start, end, large)))
    contacts = [each for each in found if each.kind == "contact"]
    seconds = sum(each.end - each.start for each in contacts)
    whole = _WINDOW * float(windows.used.sum())
    if seconds > _MOST_CONTACT * whole or not _familiar(recordings, contacts):
        found = [each for each in found if each.kind != "contact"]
    return found


def _kind(recordings: Recordings, k: int, start: float, end: float, large: Array) -> Kind:
    """Of a stretch of a segment; `large` (n_u,) are large commands."""
    log = recordings.segments[k].log
    inside = log.u[(log.t >= start) & (log.t <= end)]
    middle = inside[len(inside) // 4 : max(len(inside) - len(inside) // 4, 1)]
    if end - start < _LASTING:
        return "contact"
    if np.all(np.abs(middle) <= _IDLE * large):
        return "moved by hand"
    if np.all(np.ptp(middle, axis=0) <= _FROZEN * large):
        return "paused controller"
    return "contact"


def _familiar(recordings: Recordings, phases: Sequence[ForeignPhase]) -> bool:
    """Whether most of the velocities in phases occur elsewhere, too."""
    inside = []
    outside = []
    for k, segment in enumerate(recordings.segments):
        t = segment.log.t
        own = np.zeros(len(t), dtype=bool)
        for phase in phases:
            if phase.segment == k:
                own |= (t >= phase.start) & (t <= phase.end)
        inside.append(segment.log.v[own])
        outside.append(segment.log.v[~own])
    here = np.concatenate(inside)
    there = np.concatenate(outside)
    if not len(here) or not len(there):
        return True
    low, high = np.quantile(there, [_RARE, 1 - _RARE], axis=0)
    return bool(np.mean(np.all((here >= low) & (here <= high), axis=1)) > 0.5)


def without(recordings: Recordings, foreign: Sequence[ForeignPhase]) -> Recordings:
    """The recordings cut at other phases, with a warning of what was left out."""
    if not foreign:
        return recordings
    segments: list[LogSegment] = []
    phases = list(recordings.phases)
    for k, segment in enumerate(recordings.segments):
        t = segment.log.t
        out = np.zeros(len(t), dtype=bool)
        for each in foreign:
            if each.segment == k:
                out |= (t >= each.start) & (t <= each.end)
                phases = _divided(phases, segment.source, each)
        segments += [
            _part(segment, a, b) for a, b in runs(~out) if (b - a) / recordings.rate >= SHORTEST
        ]
    findings = phases_stated(phases, "warning")
    findings += [finding for finding in recordings.findings if finding.code != "phases"]
    return replace(
        recordings, segments=tuple(segments), phases=tuple(phases), findings=tuple(findings)
    )


def _part(segment: LogSegment, a: int, b: int) -> LogSegment:
    """Some of a segment's samples."""
    first, last = segment.rows
    every = (last - first) / max(len(segment.log.t) - 1, 1)
    rows = (round(first + a * every), round(first + (b - 1) * every))
    imu = None if segment.imu is None else segment.imu[a:b]
    felt = None if segment.specific is None else segment.specific[a:b]
    log = segment.log.part(a, b)
    return LogSegment(log, segment.usable[a:b], segment.source, rows, imu, felt)


def _divided(phases: Sequence[LogPhase], source: str, foreign: ForeignPhase) -> list[LogPhase]:
    """The phases of logs, of which one is divided by another within it."""
    found: list[LogPhase] = []
    for phase in phases:
        t = phase.log.t
        a, b = np.searchsorted(t, [foreign.start, foreign.end]).tolist()
        if not phase.used or phase.source != source or a >= b:
            found.append(phase)
            continue
        if a > 0:
            found.append(phase._replace(log=phase.log.part(0, a)))
        found.append(LogPhase(foreign.kind, source, phase.log.part(a, b), _WHY[foreign.kind]))
        if b < len(t):
            found.append(phase._replace(log=phase.log.part(b, len(t))))
    return found
