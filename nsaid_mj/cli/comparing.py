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
    from ..calibration.servos import Score


_SUCH = "Such as `nsaid compare --log log.csv --models a.xml b.xml identified`."


@dataclass(frozen=True)
class CompareModels:
    """Compare model files of a servo arm on its own logs of targets and positions.

    Every model is simulated open loop from the targets; errors of position are means over 0.2 s,
    2 s and the whole log, beside those of the target itself, late.

    Attributes:
        log: log files or folders of them.
        models: MJCF files with the same joints; `identified` is fitted to the logs, and each half
            of them is predicted from the other.
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
        print_json(document(given.robot.joints, scores))
    elif not chosen.quiet:
        from rich.console import Console

        from ..reporting.identification.servos import print_scores

        print_scores(scores, Console())
    return 0


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
