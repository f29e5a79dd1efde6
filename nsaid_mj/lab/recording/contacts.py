"""Forces of the ground on the feet, drawn as arrows at the contacts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ...core import GRAVITY, Array, Log, SecondOrderSystem
from ...report import Scene, drawable
from ..contacts import contact_forces

TRUE = f"{Scene.BODY}/contact/true"
IMPLIED = f"{Scene.BODY}/contact/implied"
_FEET = f"{Scene.BODY}/contact/feet"
_COLOURS = {TRUE: (226, 230, 240), IMPLIED: (255, 138, 30)}
_WEIGHT = 0.8  # length of an arrow of the robot's weight, over its size
_RADIUS = {TRUE: 0.02, IMPLIED: 0.012}  # of arrows, over the robot's size


class ContactArrows:
    """Arrows of the forces on the feet: those under the true θ, and those that θ̂ implies.

    Nobody measures these forces: they are what must act for the robot to move as it does.

    Args:
        system: the structure of a robot with contacts.
        size: half the robot's size [m].
        log: the whole motion, as accelerations are differences of its velocities.
        theta: (p,) parameters, whose weight sets the arrows' length.
    """

    kind = "contact forces"
    paths = (TRUE, IMPLIED)
    rate = 30.0  # arrows that are drawn per second, and at most
    frames = 4000
    magnified: Mapping[str, float] = {}

    def __init__(self, system: SecondOrderSystem, size: float, log: Log, theta: Array):
        self._system = system
        self._size = size
        self._log = log
        mass = sum(float(theta[part.start]) for part in system.structure.inertias)
        self._length = _WEIGHT * size / (GRAVITY * max(mass, 1e-9))

    def log_style(self, rec: rr.RecordingStream, *paths: str) -> None:
        """Logs colours and labels of true or implied forces."""
        labels = [drawable(contact.name) for contact in self._system.structure.contacts]
        for path in paths:
            style = rr.Arrows3D.from_fields(
                colors=[_COLOURS[path]],
                radii=[_RADIUS[path] * self._size],
                labels=labels,
                show_labels=False,
            )
            rec.log(path, style, static=True)
        feet = rr.Points3D.from_fields(radii=[0.04 * self._size], colors=[(60, 160, 255)])
        rec.log(_FEET, feet, static=True)

    def log(
        self,
        rec: rr.RecordingStream,
        path: str,
        rows: Log,
        theta: Array,
        failed: NDArray[np.bool_] | None = None,
    ) -> None:
        """Logs the forces at k rows of the motion in one batch, under theta (p,) or (k, p).

        `path` is TRUE or IMPLIED; faults (`failed`) do not change a foot.
        """
        some = np.searchsorted(self._log.t, rows.t)
        found = contact_forces(self._system, self._log, some, theta)
        count = [found.places.shape[1]] * len(some)
        time = rr.TimeColumn("sim_time", duration=rows.t)
        arrows = rr.Arrows3D.columns(
            origins=found.places.reshape(-1, 3),
            vectors=(self._length * found.force).reshape(-1, 3),
        )
        rec.send_columns(path, [time], arrows.partition(count))
        feet = rr.Points3D.columns(positions=found.places.reshape(-1, 3))
        rec.send_columns(_FEET, [time], feet.partition(count))
