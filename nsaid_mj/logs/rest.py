"""Rest detection: the speed below which a joint is at rest, and the times of motion."""

from collections.abc import Sequence

import numpy as np

from ..log import Log
from ..parameters import Array, number
from ..robot.findings import Finding
from ..robot.model import RobotModel
from . import signals
from .layout import Layout
from .mapping import Map
from .recordings import Segment
from .signals import Signal

_MARGIN = 4.0  # standard deviations of a velocity's noise that count as rest
_LOUD = 0.05  # such a margin, over a joint's speed, from which rest is hidden in the noise
_WINDOW = 0.2  # a robot moves if it does in most rows of such a window [s]


class Rest:
    """Speeds below which a robot's joints count as being at rest, on a grid of `rate` [Hz]."""

    def __init__(self, made: Layout, mapping: Map, robot: RobotModel, rate: float):
        self.rate = rate
        self._made = made
        self._own = np.array(
            [mapping.joints[j].rest if j in mapping.joints else 0.0 for j in robot.joints]
        )

    def limits(self, found: dict[str, Signal], logs: Sequence[Log]) -> Array:
        """(n,) speeds of one recording's joints [rad/s or m/s].

        Four standard deviations of the velocity's noise, and not less than its quantisation; for a
        joint that is ten times faster than its noise, at most a tenth of its speed, since fourth
        differences of few rows count a fast motion as noise. The limits of the map always apply.
        """
        made, derived = self._made, self._derived(found)
        deviations, steps = self._noise(found, derived)
        coupling = np.eye(len(steps)) if made.coupling is None else made.coupling
        spread = np.sqrt(coupling**2 @ np.square(deviations))
        limits = np.maximum(_MARGIN * spread, np.abs(coupling) @ steps)
        speeds = np.concatenate([self.speed(found, log) for log in logs])
        fast = np.quantile(np.abs(speeds), 0.95, axis=0)
        limits = np.where(fast > 10 * spread, np.minimum(limits, 0.1 * fast), limits)
        return np.maximum(limits, self._own)

    def speed(self, found: dict[str, Signal], log: Log) -> Array:
        """(N, n) velocities for rest detection: measured ones, or less noisy derivatives."""
        if not self._derived(found):
            return log.v
        return np.column_stack([signals.derivative(column, self.rate) for column in log.q.T])

    def _derived(self, found: dict[str, Signal]) -> bool:
        """Whether noise hides rest in the measured velocities, but not in the derivatives."""
        if any(velocity is None for velocity in self._made.velocities):
            return False  # the others' columns have their own units and delays
        fast = [
            float(np.quantile(np.abs(found[velocity.column.column].x), 0.95))
            for velocity in self._made.velocities
            if velocity is not None
        ]
        own, measured = (self._noise(found, derived)[0] for derived in (True, False))
        loud = _MARGIN * measured > _LOUD * np.array(fast)
        return bool((loud & (own < measured)).any() and (own <= measured).all())

    def _noise(self, found: dict[str, Signal], derived: bool) -> tuple[Array, Array]:
        """Standard deviations and smallest steps of the measured velocities, or the derivatives."""
        deviations, steps = [], []
        for position, velocity in zip(self._made.positions, self._made.velocities, strict=True):
            if velocity is None or derived:
                signal = found[position.column.column]
                sigma = signals.noise(signal.x)
                deviations.append(signals.derivative_noise(sigma, signal.rate, self.rate))
                steps.append(0.0)
            else:
                signal = found[velocity.column.column]
                deviations.append(signals.noise(signal.x))
                steps.append(signals.quantum(signal.x))
        return np.array(deviations), np.array(steps)


def rows_of(signal: Signal, start: float, end: float) -> tuple[int, int]:
    """First and last row, in the file, of the stretch between two times [s]."""
    first = np.searchsorted(signal.t, start - 1e-9)
    last = np.searchsorted(signal.t, end + 1e-9, side="right") - 1
    return int(signal.row[min(first, len(signal.row) - 1)]), int(signal.row[max(last, 0)])


def moving_part(moving: np.ndarray, rate: float) -> slice:
    """The slice from the first to the last window in which the robot moves in most rows."""
    width = max(1, round(_WINDOW * rate))
    share = np.convolve(moving, np.ones(width) / width, mode="same")
    often = np.flatnonzero(share > 0.5)
    if not len(often):
        return slice(0, 0)
    inside = np.flatnonzero(moving[often[0] : often[-1] + 1]) + often[0]
    return slice(int(inside[0]), int(inside[-1]) + 1) if len(inside) else slice(0, 0)


def cut_rest(file: str, reference: Signal, grid: Array, kept: slice) -> list[Finding]:
    """Reports the cuts at both ends of a stretch, whose part `kept` has motion.

    `reference` is a signal of the file, for its row numbers; grid (N,) are times [s].
    """
    findings = []
    whole = rows_of(reference, *grid[[0, -1]].tolist())
    if kept.stop == kept.start:
        text = f"the robot stands still in rows {whole[0]}–{whole[1]}, which were left out"
        findings.append(Finding("warning", "rest", file, text, data={"rows": list(whole)}))
        return findings
    inner = rows_of(reference, *grid[[kept.start, kept.stop - 1]].tolist())
    for a, b, when in ((whole[0], inner[0] - 1, "before"), (inner[1] + 1, whole[1], "after")):
        if b - a > 0.05 / reference.period:
            text = f"the robot stands still {when} its motion, in rows {a}–{b}, which were left out"
            findings.append(Finding("note", "rest", file, text, data={"rows": [a, b]}))
    return findings


def limits_stated(
    file: str, segments: Sequence[Segment], limits: Array, joints: Sequence[str]
) -> Finding:
    """Reports the speeds below which rows are not used, and the share of rows above."""
    usable = np.concatenate([segment.usable for segment in segments]).mean(axis=0)
    each = ", ".join(
        f"{joint} {number(limit, significant=2)} ({100 * share:.0f} %)"
        for joint, limit, share in zip(joints, limits, usable, strict=True)
    )
    text = "rows below these speeds [rad/s or m/s] are not used "
    text += f"(in brackets: share of rows used): {each}"
    data = {"limits": limits.tolist(), "share": usable.tolist()}
    return Finding("note", "rest_limits", file, text, data=data)
