"""How far the laws that see a log once stay from the batch fit, on real and on simulated logs.

    python -m scripts.laws_on_logs FOLDER [--simulated ur5,panda] [--laws efficient,memory]

Every folder below FOLDER with a model (.urdf or .xml) and logs (.csv or .csv.gz) is identified by
every law; its map is its own map.toml, or that of the packed robot of its name. Simulated logs are
those of scripts/calibration.py, 20 s each. Prints a table for docs/results.md: the largest
deviation of a gain's ratio to the others from the batch fit, the share of the gains whose interval
contains the batch fit's, the prediction of the log's last fifth by the estimate before it, and the
time. Laws for which a log is not suited are told with the reason.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from nsaid_mj.calibration.data import RobotModel
from nsaid_mj.calibration.identify import identify
from nsaid_mj.calibration.law import LAWS, follow_log
from nsaid_mj.calibration.law_result import AlongLog
from nsaid_mj.cli.commands import command
from nsaid_mj.errors import NsaidError
from nsaid_mj.resources import asset
from scripts.calibration import Simulated, nominal_model

HEADS = ("log", "law", "largest deviation of a gain's ratio", "gains whose interval holds the "
         "batch fit's", "told apart", "misfit", "NRMSE of the last fifth", "time [s]")  # fmt: skip


def lines(
    name: str, laws: list[str], model: str | RobotModel, logs: list[Path], mapping: Path | None
) -> Iterator[list[str]]:
    """Rows of the table; the reason where a law cannot follow the log."""
    found = identify(model, logs, mapping=mapping)
    for law in laws:
        if law == "batch":
            worst = max(joint.held_out for joint in found.joints)
            yield [name, law, "", "", "", found.explains, f"{worst:.3f}", f"{found.seconds:.0f}"]
            continue
        try:
            with tempfile.TemporaryDirectory() as folder:
                yield [name, law, *figures(follow_log(law, found, Path(folder)))]
        except NsaidError as error:
            yield [name, law, str(error)]


def figures(along: AlongLog) -> list[str]:
    """The columns of a law that has followed a log."""
    apart = max((abs(g.law / g.batch - 1) for g in along.gains), default=np.nan)
    stated = [g for g in along.gains if np.isfinite(g.half)]
    covered = f"{sum(g.covers for g in stated)} of {len(stated)}" if stated else "no intervals"
    halves = f", ± {np.median([g.half for g in stated]):.0%}" if stated else ""
    last = f"{np.nanmax(along.last):.3f} (batch {np.nanmax(along.batch_last):.3f})"
    status = "" if along.completed else f", ended at {along.run.ending.time:.1f} s"
    return [
        f"{apart:.0%}{status}", covered + halves,
        str(sum(g.apart for g in along.gains)) if stated else "–",
        along.misfit or "–", last, f"{along.seconds:.1f}",
    ]  # fmt: skip


def recorded(folder: Path) -> list[tuple[str, Path, list[Path], Path | None]]:
    """Name, model, logs and map of every folder that has a model and logs."""
    found = []
    for place in sorted(path for path in folder.iterdir() if path.is_dir()):
        models = sorted([*place.glob("*.urdf"), *place.glob("*.xml")])
        logs = [p for p in sorted([*place.glob("*.csv"), *place.glob("*.csv.gz")])
                if "parameters" not in p.name]  # fmt: skip
        maps = [place / "map.toml", asset(place.name, "map.toml")]
        if models and logs:
            mapping = next((path for path in maps if path.is_file()), None)
            found.append((place.name, models[0], logs, mapping))
    return found


def servo_line(name: str, model: Path, log: Path) -> list[str] | None:
    """The row of a servo's log, which only its own fit can use; None of a log of forces."""
    from nsaid_mj.calibration.servos import servo_logs

    if servo_logs(str(model), [log]) is None:
        return None
    words = ["identify", "--model", str(model), "--log", str(log), "--law", "efficient"]
    with tempfile.TemporaryDirectory() as out:
        try:
            command([*words, "--out", out, "--force", "--quiet"])
        except NsaidError as error:
            return [f"{name}, {log.name}", "all but batch", str(error)]
    return [f"{name}, {log.name}", "all but batch", "not refused"]


def main() -> None:
    """Prints the table as it grows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--simulated", default="ur5,panda")
    parser.add_argument("--laws", default=",".join(LAWS))
    arguments = parser.parse_args()
    laws = arguments.laws.split(",")
    print(f"| {' | '.join(HEADS)} |")
    print("|---" * len(HEADS) + "|")

    def show(row: list[str]) -> None:
        print("| " + " | ".join([*row, *[""] * (len(HEADS) - len(row))]) + " |", flush=True)

    for name, model, logs, mapping in recorded(arguments.folder):
        servos = [row for log in logs if (row := servo_line(name, model, log))]
        for row in servos:
            show(row)
        if not servos:
            for row in lines(name, laws, str(model), logs, mapping):
                show(row)
    for name in filter(None, arguments.simulated.split(",")):
        simulated = Simulated(name, 0, 20.0)
        with tempfile.TemporaryDirectory() as place:
            log = simulated.write(Path(place) / "log.csv")
            for row in lines(f"{name}, simulated", laws, nominal_model(simulated, 0), [log], None):
                show(row)


if __name__ == "__main__":
    main()
