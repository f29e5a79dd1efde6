"""`nsaid compare --log … --models …`: judges model files of an arm on its own logs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...base import CHOICES, InvalidInput, print_json
from ...robots import check_model
from .checks import check_logs, check_map

if TYPE_CHECKING:
    from ...robots import RobotModel
    from ..identify.comparison import Score
    from .given import ToCompare


_SUCH = "Such as `nsaid compare --log log.csv --models a.xml b.xml identified`."


def compare_on_logs(chosen: ToCompare) -> int:
    """Executes `nsaid compare` of model files on logs; returns the exit code."""
    files = [model for model in chosen.models if model not in CHOICES["fitted model"]]
    if not files or not chosen.log:
        expected = "a model file and a log, or more of them"
        raise InvalidInput("--models", expected, " ".join(chosen.models) or "none", _SUCH)
    for model in files:
        check_model(model)
    check_map(chosen.map)
    check_logs(chosen.log)
    robot, scores = _compared(chosen, files[0])
    if chosen.json:
        print_json(document(robot.joints, scores))
    elif not chosen.quiet:
        from rich.console import Console

        from ...report import print_page
        from ..servos.page import scores_page

        print_page(scores_page(scores, robot.small_unit), Console())
    return 0


def _compared(chosen: ToCompare, first: str) -> tuple[RobotModel, tuple[Score, ...]]:
    """The first model, and the scores."""
    from ...lab import Progress
    from ..identify.comparison import compare_arms, compare_servos
    from ..identify.identify import coupled, recordings_of
    from ..identify.models import load_robot_model
    from ..identify.result import Options
    from ..logs.mapping import read_map
    from ..servos.identify import servo_logs

    with Progress("compare", quiet=chosen.quiet or chosen.json) as progress:
        given = servo_logs(first, chosen.log, chosen.map)
        if given is not None:
            return given.robot, compare_servos(given, chosen.models, progress.say)
        robot = load_robot_model(first)
        if not robot.jointed:
            remedy = "Vehicles are judged by `nsaid identify --validate`."
            raise InvalidInput("--models", "models of an arm", first, remedy)
        mapping = None if chosen.map is None else read_map(chosen.map)
        recordings = recordings_of(chosen.log, mapping, robot)
        options = Options(coupled=coupled(mapping))
        return robot, compare_arms(robot, recordings, chosen.models, options, progress.say)


def document(joints: tuple[str, ...], scores: tuple[Score, ...]) -> list[dict[str, Any]]:
    """Scores as plain data for JSON: errors in mrad or mm; null where undefined or diverged."""
    import numpy as np

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
