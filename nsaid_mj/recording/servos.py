"""The recording of identified servos: targets, measured and simulated positions, the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun.blueprint as rrb

from ..calibration.result import shifts
from ..calibration.servos import Replayed, ServoIdentification
from ..parameters import Array
from ..reporting.identification.servos import brief
from ..reporting.markdown import markdown
from ..reporting.pages import Page, Section
from ..reporting.parameters import table
from ..structure.joints import moving_joints, slides
from .identification import joint_pages, lines, moving_robot, paged, parameters
from .layout import whole
from .plots import Plots
from .scene import Camera
from .series import Curves, path
from .stream import write

_FAILED = 10  # red: windows that the fit left out
_SHOWN = 20.0  # of a long log, around the cursor [s]: in minutes no motion can be seen


def record_servos(found: ServoIdentification, replayed: Replayed, file: Path) -> Path:
    """Writes a recording of the logs and their replay, atomically, and returns its path.

    Args:
        found: of an identification of servos.
        replayed: the logs, and how the exported model follows them.
        file: path of the recording, ending in .rrd.
    """
    logs = replayed.logs
    moved = shifts([(log.source, log.t[0], log.t[-1]) for log in logs])
    times = [log.t + shift for log, shift in zip(logs, moved, strict=True)]
    motion = [
        (t, log.position, np.gradient(log.position, t, axis=0))
        for t, log in zip(times, logs, strict=True)
    ]
    camera, draw = moving_robot(found.robot, motion)
    t, curves = _curves(found, replayed, np.concatenate(times))
    end = float(t[-1])
    layout = _blueprint(found, camera, Plots(curves, end, _SHOWN if end > 2 * _SHOWN else None))
    by_joint = [
        Section(name, [table([p for p in found.parameters if p.label.endswith(f" of {name}")])])
        for name in found.robot.joints
    ]
    documents = {
        "result": markdown(brief(found)),
        "parameters": markdown(Page("", None, sections=by_joint)),
    }
    return write(file, found.robot.name, layout, documents, [(t, curves)], draw)


def _curves(found: ServoIdentification, replayed: Replayed, t: Array) -> tuple[Array, list[Curves]]:
    """(M,) times [s], and of every joint target, positions, windows left out, and residual."""
    logs = replayed.logs
    segment = np.repeat(np.arange(len(logs)), [len(log.t) for log in logs])
    position = np.concatenate([log.position for log in logs])
    left_out = np.where(replayed.used[:, None] > 0, np.nan, position)
    sides = [
        np.concatenate([log.target for log in logs]), position,
        np.concatenate(replayed.simulated), left_out,
    ]  # fmt: skip
    times, (target, measured, simulated, masked) = lines(t, segment, sides)
    curves: list[Curves] = []
    for j, name in enumerate(found.robot.joints):
        own = path("position", name)
        for part, label, values, color, pale in (  # drawn in the order of their names
            ("command", "target", target, 8, True),
            ("measured", "measured", measured, 1, True),
            ("simulated", "simulated", simulated, 0, False),
            ("unused", "left out of the fit", masked, _FAILED, False),
        ):
            if np.isfinite(values).any():
                curves.append(
                    Curves(f"{own}/{part}", [label], values[:, j, None], pale=pale, color=color)
                )
        residual = 1e3 * (measured - simulated)[:, j, None]
        curves.append(Curves(path("residual", name), ["measured - simulated"], residual, color=2))
    return times, curves


def _blueprint(found: ServoIdentification, camera: Camera | None, plots: Plots) -> rrb.Blueprint:
    """Verdict and robot beside the worst joints, all joints, residuals, and parameters."""
    servos, joints = found.servos, moving_joints(found.robot.model)
    units = ["m" if slides(joint) else "rad" for joint in joints]

    def positions(j: int, width: float) -> rrb.TimeSeriesView:
        error = f"error of the fit {1e3 * servos[j].error:.1f} m{units[j]}"
        title = f"{servos[j].name} [{units[j]}]: {error}"
        return plots(path("position", servos[j].name), title, width)

    pages = joint_pages(camera, [servo.error for servo in servos], positions, "Positions")
    residuals = [
        plots(path("residual", s.name), f"{s.name}: measured - simulated [m{unit}]", legend=False)
        for s, unit in zip(servos, units, strict=True)
    ]
    return whole(*pages, *paged("Residuals", residuals), parameters())
