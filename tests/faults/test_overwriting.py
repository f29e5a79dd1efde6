"""No command overwrites a file that it did not make, whatever --out says."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from nsaid_mj.base import InputFile
from nsaid_mj.base.errors import NotWritten
from nsaid_mj.base.files import OutputFile
from nsaid_mj.robots.assets import folder
from tests.support.faulty import shell

SHORT = ("--duration", "0.2", "--held-out", "0.5", "--pe-window", "0.1")
NAMES = (
    "report.html",
    "scenario.py",
    "motion.csv",
    "two.xml",
    "two.yaml",
    "map.toml",
    "map-new.toml",
    "run.rrd",
    "inspection.json",
    "compare.csv",
    "tracking.csv",
    "summary.txt",
)
"""Files of a user's, most by the names of ours; none is what a folder of ours is known by."""
URDF = folder("assets") / "robots" / "double_pendulum" / "double_pendulum.urdf"


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder full of a user's files, and a model."""
    for name in NAMES:
        (tmp_path / name).write_text(f"mine: {name}", encoding="utf-8")
    shutil.copy(URDF, tmp_path / "two.urdf")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def contents(desk: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in desk.iterdir() if path.is_file()}


@pytest.mark.parametrize(
    "words",
    [
        ("run", "scalar_rov", *SHORT),
        ("verify", "scalar_rov", *SHORT),
        ("excite", "--model", "two.urdf"),
        ("identify", "--model", "two.urdf", "--log", "motion.csv"),
        ("compare", "scalar_rov"),
        ("sweep", "scalar_rov"),
        ("montecarlo", "scalar_rov"),
        ("track", "track_ur5"),
    ],
    ids=lambda words: words[0],
)
def test_a_folder_of_other_files_is_refused_before_any_work(
    words: tuple[str, ...], desk: Path
) -> None:
    before = contents(desk)
    code, said = shell(*words, "--out", ".")
    assert code == 2 and "it holds other files" in said.err and "--out" in said.err
    assert contents(desk) == before


def test_an_input_is_not_overwritten_even_with_force(desk: Path) -> None:
    model = desk / "two.urdf"
    with InputFile.reading("two.urdf", "double_pendulum", None):
        with pytest.raises(NotWritten, match="a file that was read"):
            OutputFile(model).write_text("")
        OutputFile(desk / "other.yaml").write_text("other")
    assert model.read_bytes() == URDF.read_bytes()
    with pytest.raises(NotWritten, match="not written by nsaid-mj"):
        OutputFile(model).write_text("later")  # by another command, which does not read it


def test_a_folder_that_is_named_by_way_of_a_missing_one_is_not_taken_as_new(desk: Path) -> None:
    before = contents(desk)
    words = ("identify", "--model", "two.urdf", "--log", "motion.csv", "--out", "new/..")
    code, said = shell(*words)
    assert code == 2 and "it holds other files" in said.err
    assert contents(desk) == before


def test_an_edited_map_is_kept_and_the_same_map_is_not_written_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(URDF, "two.urdf")
    rows = "\n".join(f"{0.01 * i},{i % 7},{i % 5}" for i in range(300))
    Path("log.csv").write_text(f"time,joint1_pos,joint1_tau\n{rows}\n", encoding="utf-8")
    words = ("inspect", "log.csv", "--model", "two.urdf")
    shell(*words)
    first = Path("map.toml").read_text(encoding="utf-8")
    shell(*words)
    assert not Path("map-new.toml").exists()  # it would be the same
    for name in ("map.toml", "map-new.toml"):
        Path(name).write_text(f"{first}\n# edited\n", encoding="utf-8")
    shell(*words)
    assert Path("map.toml").read_text(encoding="utf-8").endswith("# edited\n")
    assert Path("map-new.toml").read_text(encoding="utf-8").endswith("# edited\n")
    assert Path("map-new-2.toml").read_text(encoding="utf-8") == first
