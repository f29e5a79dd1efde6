"""run.rrd: a finished run, and its robot with forces or torques, link inertias and faults."""

from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from ...base import OutputFolder
from ...core import Array, FaultEvent, Indices, Log, ParameterSpace, SecondOrderSystem
from ...report import (
    Plots,
    Scene,
    drawable,
    spread,
)
from ...report import write_recording as write_file
from ..evaluation.curves import shared
from ..evaluation.figures import common_factor
from ..evaluation.page import brief, unobservable
from ..evaluation.run_result import RunResult
from ..evaluation.truth import Truth
from ..evaluation.verify import Verification
from ..loop import Run
from ..record import Record
from .contacts import ContactArrows
from .forces import FAILED, Arrows, drawing_words, mounts_of
from .inertia import ESTIMATED_INERTIA, REFERENCE, Inertias
from .layout import pages_of_run
from .torques import Arcs
from .torques import drawn as torques_drawn

_SHORT = "The run is too short for a verdict."


def write_run_recording(
    run: Run, result: RunResult, truth: Truth | None, checks: Verification | None = None
) -> Path:
    """Writes a run's recording atomically, and returns its path.

    Args:
        run: a finished run with at least one row, completed or not.
        result: what `evaluate` makes of it, with its curves.
        truth: true parameters of its plant; None leaves out everything that needs it.
        checks: of the paper's statements, for a separate page.
    """
    robot = RobotDrawing(run, truth)
    name = run.folder.resolve().name
    documents = {
        "result": brief(name, result).markdown(),
        "statements": (checks.items() if checks else ()) or _SHORT,
        "unknown": unobservable(result),
    }
    space = run.system.space
    plots = Plots.of(result.curves, float(run.record["t"][-1]))
    kind = "" if truth is None else _kind(space, shared(space, result.dimensions.r, truth.theta))
    pages = pages_of_run(
        space, robot.camera, plots, survey=robot.survey, drawn=robot.words, shared=kind
    )
    return write_file(
        run.folder / OutputFolder.RECORDING, name, pages, documents, plots.curves, robot.log
    )


def _kind(space: ParameterSpace, chosen: Indices) -> str:
    """A common noun for the chosen parameters; empty if there are none."""
    kinds = [block for block, place in space if place.start in chosen]
    if len(kinds) > 1:
        return "actuator parameter" if all(b.actuator for b in kinds) else "parameter"
    return kinds[0].name if kinds else ""


_LOOKS = 500  # rows of the record from which camera, arrows and arcs are set up
_FRAMES = 12000  # largest number of frames of the robot, and frames per second
_RATE = 30.0
_MARK = 0.1  # radius of a fault's marker, over half the vehicle's size
_ELLIPSOIDS = 300  # estimates of the links' inertias along a run, at most


class RobotDrawing:
    """Draws the robot of a finished run.

    Args:
        run: a finished run with at least one row.
        truth: true parameters of its plant; None leaves out everything that needs it.

    Attributes:
        camera: camera of the 3D view; None if there is nothing to draw.
        survey: camera on a vehicle's whole path; None for an arm.
    """

    def __init__(self, run: Run, truth: Truth | None):
        record = run.record
        system = run.system
        self._run = run
        self._truth = truth
        self._scene = scene = Scene(system, run.looks)
        some = _rows(record, spread(len(record), _LOOKS))
        theta = record.rows("theta_hat", -1) if truth is None else truth.theta
        self.camera = camera = None if scene.empty else scene.camera(some.q, some.v)
        self.survey = scene.survey(some.q) if camera and scene.vehicle else None
        self._links = Inertias.of(system) if camera else None
        self._efforts: Arrows | Arcs | ContactArrows | None = None
        if camera and system.structure.contacts and len(record) > 1:
            self._efforts = ContactArrows(system, camera.size, record.log, theta)
        elif camera and (mounts_of(system) or torques_drawn(system)):
            kind = Arcs if torques_drawn(system) else Arrows
            self._efforts = kind(system, camera.size, some, theta)

    @property
    def words(self) -> str:
        """Title of the view: what is drawn, in which colour."""
        kinds = [self._efforts.kind] if self._efforts else []
        kinds += ["inertia"] * bool(self._links)
        if not kinds:
            return drawing_words("")
        white = "nominal (white), " if self._truth is None else "true (white), "
        white = white if self._truth is not None or self._links else ""
        drawn = f"{white}estimated (orange): {' and '.join(kinds)}"
        drawn = drawn[0].upper() + drawn[1:]  # colours first: a narrow view cuts its title
        return drawing_words(drawn, self._efforts.magnified if self._efforts else None)

    def log(self, rec: rr.RecordingStream) -> None:
        """Logs everything."""
        record = self._run.record
        truth = self._truth
        t = record["t"]
        frames = _at_rate(record["t"], _RATE, _FRAMES)
        inside = isinstance(self._efforts, Arrows | ContactArrows) or self._links is not None
        failed = (path for event in self._run.faults for path in self._failed(event))
        changing = dict.fromkeys(failed, float(t[0]))
        self._scene.log_shapes(rec, self.camera, ghost=inside, changing=changing)
        self._scene.log_poses(rec, t[frames], record["q"][frames])
        self._log_faults(rec)
        if self._efforts:
            some = _at_rate(t, self._efforts.rate, self._efforts.frames)
            estimates = record.rows("theta_hat", some)
            _log_efforts(rec, self._efforts, _rows(record, some), estimates, truth)
        if self._links and self.camera:
            few = spread(len(t), _ELLIPSOIDS)
            size = self.camera.size
            self._links.log_frames(rec, t[frames], record["q"][frames])
            theta_hat = record.rows("theta_hat", few)
            self._links.log(rec, ESTIMATED_INERTIA, t[few], theta_hat, size)
            reference = self._run.prior[None] if truth is None else truth.theta_at(t[few])
            self._links.log(rec, REFERENCE, t[few][: len(reference)], reference, size)

    def _log_faults(self, rec: rr.RecordingStream) -> None:
        """Logs every fault at the time it was found; its part is red from then on.

        A vehicle's actuator gets a red ball where its force acts, an arm's joint a red link; a
        sensor of a vehicle has no place.
        """
        for number, event in enumerate(self._run.faults):
            rec.set_time("sim_time", duration=event.found)
            words = drawable(f"{event.in_words}, {100 * event.confidence:.4g} % sure")
            rec.log("faults", rr.TextLog(words, level=rr.TextLogLevel.WARN))
            if self.camera is None:
                continue
            places = _mounts(self._run.system, event)
            if len(places):
                ball = rr.Points3D(
                    places,
                    colors=[FAILED],
                    radii=[_MARK * self.camera.size],
                    labels=[drawable(event.part)],
                )
                rec.log(f"{Scene.BODY}/fault_{number}", ball)
            for path in self._failed(event):
                rec.log(path, rr.Mesh3D.from_fields(albedo_factor=FAILED))
        rec.reset_time()

    def _failed(self, event: FaultEvent) -> list[str]:
        """The entities of the meshes that a fault turns red."""
        return self._scene.paths_of(_links(self._run.system, event))


def _log_efforts(
    rec: rr.RecordingStream,
    drawn: Arrows | Arcs | ContactArrows,
    rows: Log,
    theta_hat: Array,
    truth: Truth | None,
) -> None:
    """Logs forces or torques under θ̂ and, if the truth is known, the commanded ones next to them.

    For the comparison θ̂ is multiplied by the `common_factor`.
    """
    commanded, estimated = drawn.paths
    if truth is None:
        drawn.log_style(rec, estimated)
        drawn.log(rec, estimated, rows, theta_hat, np.zeros(theta_hat.shape, bool))
        return
    true = truth.theta_at(rows.t)
    space = truth.system.space
    factor = common_factor(theta_hat, true, space.scale, space.actuators)
    drawn.log_style(rec, commanded, estimated)
    failed = changed(truth, rows.t)
    drawn.log(rec, commanded, rows, true, failed)
    drawn.log(rec, estimated, rows, theta_hat * factor[:, None], failed)


def changed(truth: Truth, t: Array) -> NDArray[np.bool_]:
    """(k, p) whether an actuator's parameter differs at times t (k,) from before any fault."""
    actuators = np.zeros(len(truth.initial), bool)
    actuators[truth.system.space.actuators] = True
    return (truth.theta_at(t) != truth.initial) & actuators


def _rows(record: Record, rows: Indices) -> Log:
    return Log.unchecked(*(record[column][rows] for column in Log._fields))


def _at_rate(t: Array, rate: float, most: int) -> Indices:
    """Indices of rows at about a rate [1/s], at most `most`, with the first and the last."""
    return spread(len(t), min(most, max(2, int((t[-1] - t[0]) * rate))))


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
    space = system.space
    found = []
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
