"""`nsaid compare --log … --models …`: model files judged on a robot's own logs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InvalidInput
from .grammar import CompareModels

if TYPE_CHECKING:
    from ..calibration.servos import Score


def compare_on_logs(chosen: CompareModels) -> int:
    """Executes the command and returns the exit code."""
    from ..calibration.servos import IDENTIFIED, compare_models, servo_logs
    from ..reporting.progress import Progress

    files = [model for model in chosen.models if model != IDENTIFIED]
    if not files or not chosen.log:
        expected = "a model file and a log, or more of them"
        raise InvalidInput("--models", expected, " ".join(chosen.models) or "none", _SUCH)
    for file in files:
        if not Path(file).is_file():
            raise InvalidInput("--models", "MJCF files, and `identified`", file, _SUCH)
    given = servo_logs(Path(files[0]), chosen.log, chosen.map)
    if given is None:
        expected = "an MJCF with position servos, and logs of targets and positions"
        remedy = "Models of other robots are judged by `nsaid identify --validate`."
        raise InvalidInput("--models", expected, files[0], remedy)
    with Progress("compare", quiet=chosen.quiet or chosen.json) as progress:
        scores = compare_models(given, chosen.models, progress.say)
    if chosen.json:
        print(json.dumps(document(given.robot.joints, scores), indent=2, allow_nan=False))
    elif not chosen.quiet:
        from rich.console import Console

        from ..reporting.identification.servos import print_scores

        print_scores(scores, Console())
    return 0


_SUCH = "Such as `nsaid compare --log log.csv --models a.xml b.xml identified`."


def document(joints: tuple[str, ...], scores: tuple[Score, ...]) -> list[dict[str, Any]]:
    """Scores as plain data for JSON: errors in mrad or mm; NaN becomes null."""
    found = []
    for score in scores:
        rows = (*(1e3 * score.errors), score.one_step)
        named = [
            {name: None if np.isnan(x) else float(x) for name, x in zip(joints, row, strict=True)}
            for row in rows
        ]
        keys = ("mae_0.2_s", "mae_2_s", "mae_whole_log", "one_step_nrmse")
        whole = dict(zip(keys, named, strict=True))
        found.append({"model": score.model, **whole, "seconds": score.seconds})
    return found
