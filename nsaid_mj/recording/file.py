"""run.rrd: the recording of a finished run for the Rerun viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..evaluation import Truth, nullspace_of
from ..evaluation.verify import Verdict
from ..experiment.loop import Run
from ..parameters import ParameterSpace
from ..reporting.markdown import markdown, panels
from ..reporting.report import brief, statements, unobservable
from . import FILE
from .layout import blueprint
from .plots import Plots
from .robot import Robot
from .series import Indices, curves, intervals, shared, spread
from .stream import write as write_file

_POINTS = 4000  # of a curve, at most; more than the width of a screen
_SHORT = "The run is too short for a verdict."
_NUMBERS = 400_000  # entries of θ̂ over all curves, at most: a minute stays below 20 MB


def write(
    run: Run, summary: dict[str, Any], truth: Truth | None, verdicts: Sequence[Verdict] = ()
) -> Path:
    """Writes a run's recording atomically, and returns its path.

    Args:
        run: a finished run with at least one row, completed or not.
        summary: the content of its summary.json.
        truth: of its plant; None leaves out everything that needs it.
        verdicts: on the paper's statements, for a separate page.
    """
    t = run.record["t"]
    rows = spread(len(t), min(_POINTS, max(1000, _NUMBERS // run.system.p)))
    nullspace = nullspace_of(run, truth)
    robot = Robot(run, truth)
    shown = curves(run, nullspace, rows, truth) + intervals(run, summary, rows)
    name = run.folder.resolve().name
    documents = {
        "result": markdown(brief(name, summary, run.folder)),
        "statements": "\n".join(panels(statements(verdicts))) or _SHORT,
        "unknown": "\n".join(panels(unobservable(summary))),
    }
    space, plots = run.system.space, Plots(shown, float(t[-1]))
    kind = "" if truth is None else _kind(space, shared(space, nullspace.r, truth.theta))
    layout = blueprint(
        space, robot.camera, plots, survey=robot.survey, drawn=robot.words, shared=kind
    )
    return write_file(run.folder / FILE, name, layout, documents, [(t[rows], shown)], robot.log)


def _kind(space: ParameterSpace, chosen: Indices) -> str:
    """A common noun for the chosen parameters; empty if there are none."""
    kinds = [block for block, place in space if place.start in chosen]
    if len(kinds) > 1:
        return "actuator parameter" if all(b.actuator for b in kinds) else "parameter"
    return kinds[0].name if kinds else ""
