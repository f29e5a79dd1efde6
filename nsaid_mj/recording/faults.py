"""Found faults in a recording: an entry in a log, and the failed part in red."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from ..identifiers.faults import FaultEvent
from ..parameters import Array
from ..system import SecondOrderSystem
from .scene import BODY, Camera, Scene
from .text import drawable

LOG = "faults"
_RED = (224, 49, 49)
_MARK = 0.1  # radius of a marker, over half the vehicle's size


def log_faults(
    rec: rr.RecordingStream,
    events: Sequence[FaultEvent],
    system: SecondOrderSystem,
    scene: Scene,
    camera: Camera | None,
) -> None:
    """Logs every event at the time it was found; its part is red from then on.

    A vehicle's actuator gets a red ball where its force acts, an arm's joint a red link; a sensor
    of a vehicle has no place.
    """
    for number, event in enumerate(events):
        rec.set_time("sim_time", duration=event.found)
        words = drawable(f"{event.in_words}, {100 * event.confidence:.4g} % sure")
        rec.log(LOG, rr.TextLog(words, level=rr.TextLogLevel.WARN))
        if camera is None:
            continue
        places = _mounts(system, event)
        if len(places):
            radius = _MARK * camera.size
            label = drawable(event.part)
            ball = rr.Points3D(places, colors=[_RED], radii=[radius], labels=[label])
            rec.log(f"{BODY}/fault_{number}", ball)
        for path in scene.paths_of(_links(system, event)):
            rec.log(path, rr.Mesh3D.from_fields(albedo_factor=_RED))
    rec.reset_time()


def failed_parts(
    events: Sequence[FaultEvent], system: SecondOrderSystem, scene: Scene
) -> list[str]:
    """The entities of the meshes that turn red."""
    return [path for event in events for path in scene.paths_of(_links(system, event))]


def _mounts(system: SecondOrderSystem, event: FaultEvent) -> Array:
    """(k, 3) points of application of the actuators that an event names, in the body frame [m]."""
    if system.mounts is None:
        return np.zeros((0, 3))
    names = [system.space.names[i] for i in system.space.actuators]
    rows = [system.mounts[i] for i, name in enumerate(names) if name in event.names]
    found = np.array([row for row in rows if np.isfinite(row).all()]).reshape(-1, 3)
    return np.unique(found, axis=0)


def _links(system: SecondOrderSystem, event: FaultEvent) -> list[str]:
    """Names of the links whose inertia, or joint's gain, friction or sensor, an event names."""
    space, found = system.space, []
    bodies = [block for block in space.blocks if block.geometry == "pseudo_inertia"]
    links = [block.labels[0].rpartition(" of ")[2] for block in bodies]
    for block in space.blocks:
        for i, name in enumerate(block.names):
            if name not in event.names:
                continue
            if block in bodies:
                found.append(links[bodies.index(block)])
            elif system.group == 0 and len(block) == len(links):  # one for each joint of an arm
                found.append(links[i])
    for name in event.names if event.kind == "bias" and len(links) == system.n else ():
        found.append(links[int(name.rpartition(" ")[2]) - 1])  # such as `position 2`
    return list(dict.fromkeys(found))
