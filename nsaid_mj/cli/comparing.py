"""`nsaid compare --log … --models …`: model files judged on a robot's own logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import tyro
from tyro.conf import arg

from ..errors import InvalidInput
from ..resources import print_json

if TYPE_CHECKING:
    from ..calibration.comparison import Score


_SUCH = "Such as `nsaid compare --log log.csv --models a.xml b.xml identified`."


@dataclass(frozen=True)
class CompareModels:
    """Compare model files of an arm on its own logs.

    Every model is simulated open loop from the commands, which are targets of position servos, or
    forces; errors of position are means over 0.2 s, 2 s and the whole log, beside those of what
    needs no model: the target itself, late, or a constant velocity.

    Attributes:
        log: log files or folders of them.
        models: files with the same joints; `identified` is fitted to the logs, and each half of
            them is predicted from the other.
        map: TOML file that says which columns are what.
        json: print only the scores of every joint, as JSON, to the standard output.
        quiet: print only errors.
    """

    log: Annotated[tuple[Path, ...], arg(metavar="FILE…")] = ()
    models: Annotated[tuple[str, ...], arg(metavar="FILE…")] = ()
    map: Path | None = None
    json: bool = False
    quiet: bool = False


def compare_on_logs(arguments: Sequence[str]) -> int:
    """Executes what follows `nsaid compare` where it begins with a flag; returns the exit code."""
    chosen = tyro.cli(CompareModels, prog="nsaid compare", args=list(arguments))
    from ..calibration.comparison import IDENTIFIED

    files = [model for model in chosen.models if model != IDENTIFIED]
    if not files or not chosen.log:
        expected = "a model file and a log, or more of them"
        raise InvalidInput("--models", expected, " ".join(chosen.models) or "none", _SUCH)
    joints, scores = _compared(chosen, files[0])
    if chosen.json:
        print_json(document(joints, scores))
    elif not chosen.quiet:
        from rich.console import Console

        from ..reporting.identification.servos import print_scores

        print_scores(scores, Console())
    return 0


def _compared(chosen: CompareModels, first: str) -> tuple[tuple[str, ...], tuple[Score, ...]]:
    """The joints of the first model, and the scores."""
    from ..calibration.comparison import compare_arms, compare_servos
    from ..calibration.identify import coupled, recordings_of
    from ..calibration.logs import read_map
    from ..calibration.models import load_robot_model
    from ..calibration.servos import servo_logs
    from ..calibration.structure import Options
    from ..reporting.progress import Progress

    with Progress("compare", quiet=chosen.quiet or chosen.json) as progress:
        given = servo_logs(first, chosen.log, chosen.map)
        if given is not None:
            return given.robot.joints, compare_servos(given, chosen.models, progress.say)
        robot = load_robot_model(first)
        if robot.system is not None:
            remedy = "Vehicles are judged by `nsaid identify --validate`."
            raise InvalidInput("--models", "models of an arm", first, remedy)
        mapping = None if chosen.map is None else read_map(chosen.map)
        recordings = recordings_of(chosen.log, mapping, robot)
        options = Options(coupled=coupled(mapping))
        say = progress.say
        return robot.joints, compare_arms(robot, recordings, chosen.models, options, say)


def document(joints: tuple[str, ...], scores: tuple[Score, ...]) -> list[dict[str, Any]]:
    """Scores as plain data for JSON: errors in mrad or mm; null where undefined or diverged."""
    found = []
    for score in scores:
        rows = (*(1e3 * score.errors), score.one_step)
        named = [
            {
                name: None if not np.isfinite(x) else float(x)
                for name, x in zip(joints, row, strict=True)
            }
            for row in rows
        ]
        keys = ("mae_0.2_s", "mae_2_s", "mae_whole_log", "one_step_nrmse")
        whole = dict(zip(keys, named, strict=True))
        found.append({"model": score.model, **whole, "seconds": score.seconds})
    return found
