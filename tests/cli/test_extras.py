"""Without the extras vehicles run, and whatever needs one of them says which to install."""

from __future__ import annotations

import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base import optional, pin
from nsaid_mj.base.errors import MissingPackage
from nsaid_mj.robots.assets import packed_robots
from nsaid_mj.robots.loading import load_robot

MISSING = ("pinocchio", "coal", "example_robot_data", "rerun", "rerun_cli")


def without(packages: tuple[str, ...], *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Runs `nsaid` where some packages cannot be imported, as if they were not installed."""
    code = (
        "import sys\n"
        f"sys.modules.update(dict.fromkeys({packages!r}))\n"
        "from nsaid_mj.cli import run_from_shell; run_from_shell()"
    )
    return subprocess.run(
        [sys.executable, "-c", code, *words], cwd=cwd, capture_output=True, text=True, check=False
    )


def test_a_vehicle_runs_without_any_extra_and_says_why_nothing_is_recorded(tmp_path: Path) -> None:
    short = ["--duration", "1", "--held-out", "0.5", "--pe-window", "0.5", "--out", "run"]
    done = without(MISSING, "run", "scalar_rov", *short, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "pip install 'nsaid-mj[view]'" in done.stdout
    assert {"summary.json", "record.arrow", "report.html"} <= {
        path.name for path in (tmp_path / "run").iterdir()
    }
    assert not (tmp_path / "run" / "run.rrd").exists()


@pytest.mark.parametrize(
    "command",
    [
        "excite double_pendulum --duration 2 --effort 0.004",
        "track track_bluerov2 --duration 1 --seeds 1 --laws conventional,composite",
    ],
)
def test_studies_without_rerun_leave_out_their_recording(tmp_path: Path, command: str) -> None:
    done = without(("rerun", "rerun_cli"), *command.split(), "--out", "made", cwd=tmp_path)
    assert done.returncode in (0, 1) and "Traceback" not in done.stderr, done.stderr
    made = {path.name for path in (tmp_path / "made").iterdir()}
    assert "report.html" in made and not any(name.endswith(".rrd") for name in made)


def test_what_records_is_imported_only_where_rerun_is_installed() -> None:
    """An identification took minutes, and then ended in a ModuleNotFoundError."""
    package = Path(__file__).parents[2] / "nsaid_mj"
    found = 0
    for path in package.rglob("*.py"):
        lines = path.read_text(encoding="utf-8").splitlines()
        for before, line in pairwise(lines):
            if re.match(r"\s+from \.[\w.]*recording(\.run)? import ", line):
                assert 'installed("rerun")' in before, (path, line)
                found += 1
    assert found > 4


@pytest.mark.parametrize(
    "command, extra",
    [
        ("run ur5 --duration 1", "arms"),
        ("run borinot --duration 1", "robots"),
        ("run arm --robot solo12 --duration 1", "robots"),
        ("identify tx40", "arms"),
        ("view run", "view"),
    ],
)
def test_a_command_that_needs_an_extra_names_it(tmp_path: Path, command: str, extra: str) -> None:
    if extra == "view":
        (tmp_path / "run").mkdir()
        (tmp_path / "run" / "run.rrd").touch()
    done = without(MISSING, *command.split(), cwd=tmp_path)
    assert done.returncode == 2
    assert f"pip install 'nsaid-mj[{extra}]'" in done.stderr
    assert "Traceback" not in done.stderr


HULLS = {"go2"}  # drawn as their collision shapes; see scripts/pack_robots.py


def test_list_shows_packed_robots_and_how_to_get_more(tmp_path: Path) -> None:
    said = without(MISSING, "list", cwd=tmp_path).stdout.partition("Robots")[2]
    assert all(name in said for name in packed_robots())
    assert "pip install 'nsaid-mj[robots]'" in said


OTHERS = {"servo_arm", "g1_legs"}  # which is ours; which is a part, see below


@pytest.mark.parametrize("name", sorted(set(packed_robots()) - OTHERS))
def test_a_packed_robot_moves_as_the_one_it_was_packed_from(name: str) -> None:
    theirs = pytest.importorskip("example_robot_data").load(name)
    free = theirs.model.joints[1].nv == 6
    ours = load_robot(name, "free" if free else "held")
    assert list(ours.model.names) == list(theirs.model.names)
    assert all(a == b for a, b in zip(ours.model.inertias, theirs.model.inertias, strict=True))
    assert all(
        a == b
        for a, b in zip(ours.model.jointPlacements, theirs.model.jointPlacements, strict=True)
    )
    first = 7 if free else 0  # a base has no limits
    assert (ours.model.upperPositionLimit == theirs.model.upperPositionLimit)[first:].all()
    shapes = theirs.collision_model if name in HULLS else theirs.visual_model
    drawn, whole = ours.visuals.visuals(), shapes.geometryObjects
    assert [mesh.name for mesh in drawn] == [g.name for g in whole]
    for mine, original in zip(drawn, whole, strict=True):
        assert 0 < len(mine.triangles) <= original.geometry.num_tris
        a, b = mine.vertices, original.geometry.vertices()
        assert (a.min(0) >= b.min(0) - 1e-6).all() and (a.max(0) <= b.max(0) + 1e-6).all()
        assert np.linalg.norm(np.ptp(a, axis=0)) > 0.75 * np.linalg.norm(np.ptp(b, axis=0))


def test_the_packed_biped_is_a_g1_whose_waist_and_arms_are_fixed() -> None:
    whole = pytest.importorskip("example_robot_data").load("g1").model
    upper = ("waist", "shoulder", "elbow", "wrist")
    fixed = [k for k, name in enumerate(whole.names) if any(part in name for part in upper)]
    theirs = pin.buildReducedModel(whole, fixed, pin.neutral(whole))
    ours = load_robot("g1_legs", "free").model
    assert list(ours.names) == list(theirs.names)
    assert all(a.isApprox(b, 1e-9) for a, b in zip(ours.inertias, theirs.inertias, strict=True))
    assert ours.jointPlacements[2] == theirs.jointPlacements[2]


def test_a_missing_library_of_the_system_is_named_in_one_sentence(monkeypatch):
    """As on slim images, where Pinocchio lacks libgomp."""

    def imported(name: str) -> None:
        raise ImportError("libgomp.so.1: cannot open shared object file: No such file or directory")

    monkeypatch.setattr(optional, "import_module", imported)
    with pytest.raises(MissingPackage) as caught:
        optional.require("pinocchio", "arms", "A robot with joints")
    said = str(caught.value)
    assert "libgomp.so.1" in said and "apt-get install libgomp1" in said and "\n" not in said
