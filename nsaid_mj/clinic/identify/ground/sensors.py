"""Sensors of force or contact in the feet, if a log has them: compared with what the legs imply.

λ̂ of the balance tells each foot's normal force without any sensor, so that a sensor is checked
before it is believed: of which foot it is, and whether it follows that foot's load at all. One that
does also says where a foot bears load: a leg then counts as swinging only if both say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from ....base import Finding
from ....core import Array, number, zero_phase
from ...logs.matching import words
from ..problem import Mask
from .rows import GroundRows
from .stance import SMOOTH, Stance

_FIRST = 10  # columns of the IMU before those of the feet
_AGREES = 0.7  # correlation from which a sensor follows the implied force
_CLEAR = 0.2  # by which another foot's force must correlate better for two sensors to be swapped
_UNITREE = ("fr", "fl", "rr", "rl")
"""Order of the feet in Unitree's messages."""


class FootSensors(NamedTuple):
    """Sensors of feet, in the order of the feet."""

    names: tuple[str, ...]  # columns
    columns: tuple[int, ...]  # where they are among the readings beside the log
    together: Array  # (f,) correlations with the implied normal forces
    slope: Array  # (f,) N per unit
    zero: Array  # (f,) readings without load
    swapped: tuple[str, ...] = ()  # feet whose sensors were found in another order

    @property
    def believed(self) -> Mask:
        """(f,) whether a sensor follows the force on its foot."""
        return self.together >= _AGREES

    def findings(self, feet: Sequence[str]) -> Iterator[Finding]:
        """What the sensors are, and which disagree, in words."""
        data = {"correlation": dict(zip(feet, self.together.tolist(), strict=True))}
        if self.swapped:
            names = ", ".join(f"{foot} {name}" for foot, name in zip(feet, self.names, strict=True))
            text = "the feet's sensors are in another order than taken, by the forces that the legs"
            text += f" imply: {names}"
            lines = ", ".join(f'"{name}"' for name in self.names)
            remedy = f"They are used so. State it in map.toml: `[contacts]`, `force = [{lines}]`."
            yield Finding("warning", "foot_order", "", text, remedy)
        good = [f for f, ok in zip(feet, self.believed, strict=True) if ok]
        if good:
            units = ", ".join(
                f"{number(k, significant=2)} N per unit at {foot} (correlation {r:.2f})"
                for foot, k, r in zip(feet, self.slope, self.together, strict=True)
                if foot in good
            )
            text = f"foot sensors follow the forces that the legs imply: {units}; a leg counts as "
            text += "swinging only where its sensor says so, too"
            yield Finding("note", "foot_sensors", "", text, data=data)
        for foot, name, r in zip(feet, self.names, self.together, strict=True):
            if foot not in good:
                text = f"the sensor {name} does not follow the force that the legs imply on {foot} "
                text += f"(correlation {r:.2f}); it is not used"
                remedy = "Check the sensor, or the foot to which it belongs: `force` in [contacts]."
                yield Finding("warning", "foot_sensor", foot, text, remedy)


def sensors_of(rows: GroundRows, seen: Stance) -> FootSensors | None:
    """The sensors of the rows' feet, compared with the implied forces; None without any."""
    names = rows.recordings.contacts.force
    feet = [foot.name for foot in rows.ground.feet]
    if len(names) != len(feet):
        return None
    taken = list(_assigned(names, feet))
    read = [_smoothed(rows, k) for k in range(len(rows.motions))]
    values = np.concatenate(read)[:, taken]
    force = np.concatenate(seen.normal)
    count = len(feet)
    both = np.hstack([force, values + 1e-12])
    together = np.asarray(np.corrcoef(both, rowvar=False))[:count, count:]
    together = np.nan_to_num(together)  # of a sensor whose reading never changes
    best = scipy.optimize.linear_sum_assignment(-together)[1]
    own = np.diag(together)
    moved = [k for k in range(count) if best[k] != k]
    better = all(together[k, best[k]] > max(_AGREES, own[k] + _CLEAR) for k in moved)
    if moved and better:
        taken = [taken[k] for k in best]
        values = values[:, best]
        own = together[range(count), best]
    else:
        moved = []
    spread = np.maximum(values.std(axis=0), 1e-12)
    slope = own * force.std(axis=0) / spread
    zero = np.array(
        [
            np.median(x[np.abs(f) < seen.least]) if (np.abs(f) < seen.least).any() else x.min()
            for x, f in zip(values.T, force.T, strict=True)
        ]
    )
    return FootSensors(
        tuple(names[k] for k in taken),
        tuple(_FIRST + k for k in taken),
        own,
        slope,
        zero,
        tuple(feet[k] for k in moved),
    )


def with_sensors(rows: GroundRows, seen: Stance) -> tuple[Stance, FootSensors | None]:
    """The stance in which feet also bear load where their sensors say so, and the sensors."""
    found = sensors_of(rows, seen)
    if found is None or not found.believed.any():
        return seen, found
    touching = list(seen.touching)
    for number_, segment in enumerate(rows.recordings.segments):
        assert segment.imu is not None
        if len(touching[number_]) != len(segment.log.t):
            continue
        values = segment.imu[:, list(found.columns)]
        said = found.slope * (values - found.zero) > seen.least
        touching[number_] = touching[number_] | (said & found.believed)
    return seen._replace(touching=tuple(touching)), found


def _smoothed(rows: GroundRows, k: int) -> Array:
    """(M, f) readings at the times of a motion, as slow as the forces that are compared."""
    segment = rows.segments[k]
    assert segment.imu is not None
    values = segment.imu[:: rows.chosen.every, _FIRST:][: len(rows.motions[k].t)]
    rate = rows.chosen.rate / rows.chosen.every
    return zero_phase(values, min(SMOOTH, 0.4 * rate), rate) if len(values) > 8 else values


def _assigned(names: Sequence[str], feet: Sequence[str]) -> Sequence[int]:
    """The column of each foot: as the map lists them, by names, or by the order of messages."""
    own = [set(words(foot)) for foot in feet]
    shared = set.intersection(*own)
    apart = [foot - shared for foot in own]
    found = [
        [k for k, name in enumerate(names) if legs and legs <= set(words(name))] for legs in apart
    ]
    if all(len(each) == 1 for each in found):
        return [k for (k,) in found]
    last = [words(name)[-1] for name in names]
    ascending = last in ([*"0123"], [*"1234"])  # as a message has them, and not a map
    if ascending and sorted(map(sorted, apart)) == sorted([leg] for leg in _UNITREE):
        return [_UNITREE.index(next(iter(legs))) for legs in apart]
    return list(range(len(feet)))
