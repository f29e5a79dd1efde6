"""The recording of an identification: the log with the robot moving, commands and estimates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from ..calibration.links import positions
from ..calibration.result import Curves as Commands
from ..calibration.result import Identification
from ..calibration.timeline import own_shifts, recording_shifts
from ..evaluation.confidence import INTERVAL
from ..parameters import Array
from ..reporting.identification import brief
from ..reporting.markdown import markdown
from ..reporting.pages import Page, Section
from ..reporting.parameters import folds
from ..structure.joints import JointScales
from ..structure.multibody import Multibody
from ..system import SecondOrderSystem
from .identification_layout import blueprint
from .plots import Plots
from .scene import Scene
from .series import Curves, path
from .stream import Content, write

_FRAMES, _RATE = 12000, 30.0  # largest number of frames of the robot, and frames per second
_POINTS = 30_000  # of a curve, at most; the viewer thins them by zoom


def record(result: Identification, file: Path) -> Path:
    """Writes a recording of the training logs, atomically, and returns its path.

    Logs follow one another on the timeline `sim_time`; see `calibration.timeline`.

    Args:
        result: of an identification.
        file: path of the recording, ending in .rrd.
    """
    scene = _scene(result)
    t, q, v = _motion(result)
    camera = None
    if scene is not None and not scene.empty and len(t):
        some = np.unique(np.linspace(0, len(t) - 1, min(len(t), 500)).astype(int))
        camera = scene.camera(q[some], v[some])
    history = _history(result)
    commands = [_commands(result, result.curves, recording_shifts(result.recordings), "")]
    if result.validation is not None:
        checked = result.validation
        commands.append(_commands(result, checked, own_shifts(checked), "validation/"))
    curves = [curve for _, some in commands for curve in some] + [curve for _, curve in history]
    ends = [float(times[-1]) for times, _ in commands if len(times)]
    plots = Plots(curves, max(ends) if ends else None)
    layout = blueprint(result, camera, sorted({p for p, _ in history}), plots)

    def draw(rec: rr.RecordingStream) -> None:
        if scene is not None and camera is not None:
            scene.log_shapes(rec, camera)
            scene.log_poses(rec, t, q)

    every = Page("", None, sections=[Section("", folds(result))])
    documents = {"result": markdown(brief(result)), "parameters": markdown(every)}
    series = [*commands, (result.law.t, [c for _, c in history])] if result.law else commands
    return write(Content(result.robot.name, layout, documents, series, draw), file)


def _scene(result: Identification) -> Scene | None:
    """The robot's meshes or joints; None if nothing is known of its shape."""
    robot, n = result.robot, len(result.robot.joints)
    system: SecondOrderSystem | None = robot.system
    if system is None and robot.model is not None and robot.model.njoints > 1:
        unit = np.ones(max(n, robot.model.nv))  # scales do not matter: nothing is estimated here
        scales = JointScales(unit, unit, unit, unit, unit, unit, unit)
        system = Multibody(robot.model, scales, unit)
    return None if system is None else Scene(system, robot.visuals)


def _motion(result: Identification) -> tuple[Array, Array, Array]:
    """Times, positions and velocities of all segments, at the frames that are drawn."""
    shifts = recording_shifts(result.recordings)
    segments = result.recordings.segments
    total = sum(float(s.log.t[-1] - s.log.t[0]) for s in segments)
    rate = min(_RATE, _FRAMES / max(total, 1e-9))
    t, q, v = [], [], []
    for shift, segment in zip(shifts, segments, strict=True):
        log = segment.log
        stride = max(1, round(result.recordings.rate / rate))
        rows = np.unique(np.append(np.arange(0, len(log.t), stride), len(log.t) - 1))
        t.append(log.t[rows] + shift)
        q.append(log.q[rows])
        v.append(log.v[rows])
    joined = np.concatenate(q)
    if result.robot.model is not None:
        joined = positions(result.robot.model, joined)
    times = np.concatenate(t)
    times[:1] = np.minimum(times[:1], 0.0)  # where the plots begin, the robot is there already
    return times, joined, np.concatenate(v)


def _commands(
    result: Identification, commands: Commands, shifts: Array, prefix: str
) -> tuple[Array, list[Curves]]:
    """Measured and predicted command and residual of every joint, with gaps between logs.

    Returns:
        (N,) times [s], and the curves.
    """
    segment = commands.segment
    if not len(segment):
        return np.zeros(0), []
    stride = max(1, -(-len(segment) // _POINTS))
    last = np.append(np.flatnonzero(np.diff(segment)), len(segment) - 1)
    rows = np.unique(np.concatenate([np.arange(0, len(segment), stride), last]))
    t = commands.t[rows] + shifts[segment[rows]]
    gaps = np.flatnonzero(np.diff(segment[rows])) + 1  # a NaN after each segment ends its line
    t = np.insert(t, gaps, t[gaps - 1] + 1e-6)
    found = []
    for j, fit in enumerate(result.joints):
        measured, predicted = (
            np.insert(side[rows, j], gaps, np.nan)[:, None]
            for side in (commands.measured, commands.predicted)
        )
        for name, label, values, color, pale in (
            ("measured", "measured", measured, 1, True),
            ("predicted", "predicted", predicted, 0, False),
            ("residual", "measured - predicted", measured - predicted, 2, False),
        ):
            kind = "residual" if name == "residual" else "command"
            entity = f"{prefix}{kind}/{path(fit.name)}" + ("" if name == "residual" else f"/{name}")
            found.append(Curves(entity, [label], values, pale=pale, color=color))
    return t, found


def _history(result: Identification) -> list[tuple[str, Curves]]:
    """(block, curves) of a law's gains and frictions along the log, with the gains' intervals.

    Those of gains are of their ratios to the mean of all, as no motion tells the common scale.
    """
    if result.law is None:
        return []
    theta = result.law.theta
    found: list[tuple[str, Curves]] = []
    groups: dict[str, list[int]] = {}
    for k, parameter in enumerate(result.parameters):
        if parameter.block not in result.bodies:
            groups.setdefault(parameter.block, []).append(k)
    half = INTERVAL * result.law.deviation
    gains = {int(k): i for i, k in enumerate(result.law.actuators)}
    for block, members in groups.items():
        for color, k in enumerate(members):
            p = result.parameters[k]
            entity = path("estimate", block, p.label)
            name = f"{p.label} [{p.unit}]"
            found.append(
                (block, Curves(f"{entity}/value", [name], theta[:, k : k + 1], color=color))
            )
            if k in gains and np.isfinite(half).any():
                own = half[:, gains[k], None] * np.abs(theta[:, k : k + 1])
                ends = theta[:, k : k + 1] + np.hstack([-own, own])
                ends[~np.isfinite(ends)] = np.nan
                limits = ["lower end of the interval", "upper end"]
                interval = Curves(f"{entity}/interval", limits, ends, pale=True, color=8)
                found.append((block, interval))
    return found
