"""`nsaid inspect`: the contents of a log, a first map of it, and a picture."""

from __future__ import annotations

from dataclasses import asdict
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InvalidInput, printable
from ..resources import print_json, reading
from .folders import check_writable
from .grammar import Inspect, names_in
from .process import EXPLAINED, UNUSABLE

if TYPE_CHECKING:
    from ..calibration.logs.inspection import Inspection

MAP, PICTURE = "map.toml", "inspection.png"


def inspect_log(chosen: Inspect) -> int:
    """Executes the command and returns the exit code: unusable where `identify` would refuse."""
    if not chosen.logs:
        raise InvalidInput("logs", "one or more files", "none", "Such as `nsaid inspect log.csv`.")
    check_writable(chosen.out)
    from ..calibration.logs import limited_to, read_map, read_tables
    from ..calibration.logs.inspection import inspect

    mapping = read_map(chosen.map) if chosen.map else None
    robot = None
    if chosen.model is not None:
        from ..calibration.models import load_robot_model

        kept = names_in(chosen.joints) or None
        robot = load_robot_model(chosen.model, names_in(chosen.lock), kept)
    with limited_to(chosen.limit * 1e9):
        tables = read_tables(chosen.logs, mapping)
    found = inspect(tables, mapping, robot)
    with reading(*chosen.logs, chosen.map, chosen.model):
        files = _write(found, chosen)
    if chosen.json:
        print_json(document(found))
    else:
        from rich.console import Console

        from ..reporting.inspection import print_inspection

        print_inspection(found, Console(highlight=False))
        for path in files:
            print(printable(str(path)))
    refused = any(f.level == "refusal" or f.code == "unmatched" for f in found.findings)
    return UNUSABLE if refused else EXPLAINED


def document(found: Inspection) -> dict[str, object]:
    """Figures and findings as plain data."""
    return {name: [asdict(x) for x in getattr(found, name)] for name in ("channels", "findings")}


def _write(found: Inspection, chosen: Inspect) -> list[Path]:
    """Writes the picture and, if a model is given and no map, a first map; returns the files.

    An existing map may have been edited by hand and is kept: a new one that differs gets another
    name, and so does the picture beside one that is not ours.
    """
    from ..calibration.logs.first_map import first_map
    from ..reporting.inspection import draw
    from ..reporting.plots import is_own
    from ..resources import write_text

    chosen.out.mkdir(parents=True, exist_ok=True)
    names = chain((PICTURE,), map("inspection-{}.png".format, count(2)))
    paths = (chosen.out / name for name in names)
    files = [draw(found, next(p for p in paths if not p.exists() or is_own(p)))]
    if found.robot is not None and chosen.map is None:
        text, names = first_map(found.tables, found.robot), map("map-new-{}.toml".format, count(2))
        paths = (chosen.out / name for name in chain((MAP, "map-new.toml"), names))
        path = next(p for p in paths if not p.exists() or p.read_bytes() == text.encode())
        write_text(path, text)
        files.append(path)
    return files
