"""What a user's files survive: names that are ours, inputs among the results, odd files to read."""

from __future__ import annotations

import os
import resource
import shutil
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from nsaid_mj import NsaidError
from nsaid_mj.base.errors import NotWritten
from nsaid_mj.base.files import OutputFile
from nsaid_mj.base.inputs import InputFile
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.tables import read_tables
from nsaid_mj.robots.assets import folder
from nsaid_mj.robots.loading import load_tree
from tests.support.faulty import Heard, shell

URDF = folder("assets") / "robots" / "double_pendulum" / "double_pendulum.urdf"
ROWS = "\n".join(f"{0.01 * i},{i % 7},{i % 5},{i % 3},{i % 4}" for i in range(300))
LOG = f"time,joint1_pos,joint2_pos,joint1_tau,joint2_tau\n{ROWS}\n"

WRITTEN = {
    "run scalar_rov": (
        *("record.arrow", "scenario.json", "summary.json", "report.html", "run.rrd"),
        *("verify.json", "faults.json"),
    ),
    "verify scalar_rov": ("record.arrow", "scenario.json", "summary.json", "report.html"),
    "live --model two.urdf": ("record.arrow", "scenario.json", "summary.json", "report.html"),
    "identify --model two.urdf --log log.csv": (
        *("identification.json", "report.html", "run.rrd", "calibrated.yaml", "sysid.yaml"),
        *("two.urdf", "two.xml"),
    ),
    "excite --model two.urdf": (
        *("design.json", "motion.csv", "scenario.json", "scenario.py", "report.html"),
        "design.rrd",
    ),
    "compare scalar_rov": ("compare.json", "compare.csv", "report.html"),
    "track track_ur5": ("tracking.json", "tracking.csv", "report.html"),
    "sweep scalar_rov": ("manifest.json", "rows.jsonl", "results.parquet", "report.html"),
    "montecarlo scalar_rov": ("manifest.json", "rows.jsonl", "report.html"),
}
"""Files that a command writes, the first of which marks a folder of its results."""

WORK = (
    "nsaid_mj.lab.run",
    "nsaid_mj.clinic.session.Session",
    "nsaid_mj.clinic.commands.identify._identify",
    "nsaid_mj.plans.excite.command._designed_in",
    "nsaid_mj.plans.studies.compare.compare",
    "nsaid_mj.plans.track.run.courses",
)
"""Functions that do the work of a command."""


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a model and a log, which is the home too; no command does its work."""
    shutil.copy(URDF, tmp_path / "two.urdf")
    (tmp_path / "log.csv").write_text(LOG, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    (tmp_path / "home").mkdir()

    def begin(*_: Any, **__: Any) -> None:
        raise ArithmeticError("the work began")

    for function in WORK:
        monkeypatch.setattr(function, begin)
    return tmp_path


def contents(desk: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in desk.iterdir() if path.is_file()}


def refused(*words: object) -> Heard:
    code, said = shell(*words)
    assert code == 2 and said.err.strip().startswith("nsaid: "), said.err
    assert "Traceback" not in said.err and "the work began" not in said.err
    return said


# -- only what is ours is replaced ---------------------------------------------------------------


@pytest.mark.parametrize("force", [False, True], ids=["", "force"])
@pytest.mark.parametrize(
    "words,name", [(words, name) for words, names in WRITTEN.items() for name in names]
)
def test_a_name_marks_nothing_as_ours(words: str, name: str, force: bool, desk: Path) -> None:
    out = desk / "mine"
    out.mkdir()
    for file in {name, WRITTEN[words][0]}:
        (out / file).write_text(f"mine: {file}", encoding="utf-8")
    before = contents(out)
    command, *rest = words.split()
    flags = ["--force"] if force and command not in ("sweep", "montecarlo") else []
    refused(command, *rest, "--out", "mine", *flags)
    assert contents(out) == before


@pytest.mark.parametrize("words", list(WRITTEN)[:-2])
def test_the_default_folder_is_another_than_one_with_a_users_files(words: str, desk: Path) -> None:
    command, title, *_ = words.split()
    law = {"run": "-paper", "verify": "-paper", "live": "-live-memory"}.get(command, f"-{command}")
    title = "two" if "two.urdf" in words else title
    out = desk / "runs" / f"{title}{law}"
    out.mkdir(parents=True)
    (out / WRITTEN[words][0]).write_text("mine", encoding="utf-8")
    _, said = shell(*words.split())
    assert "the work began" in said.err
    assert contents(out) == {WRITTEN[words][0]: b"mine"}


def test_a_file_of_ours_is_replaced_until_it_is_edited(tmp_path: Path) -> None:
    file = tmp_path / "report.html"
    OutputFile(file).write_text("first")
    OutputFile(file).write_text("second")
    assert file.read_text(encoding="utf-8") == "second"
    file.write_text("second, and a remark", encoding="utf-8")
    with pytest.raises(NotWritten, match="has been changed since"):
        OutputFile(file).write_text("third")
    assert file.read_text(encoding="utf-8") == "second, and a remark"


@pytest.mark.parametrize("name", [".report.html.part", ".nsaid-mj.json"])
def test_hidden_files_of_the_users_are_kept(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine", encoding="utf-8")
    OutputFile(tmp_path / "report.html").write_text("words")
    assert (tmp_path / name).read_text(encoding="utf-8") == "mine"
    assert {path.name for path in tmp_path.iterdir()} <= {name, "report.html", ".nsaid-mj.json"}


# -- what was read is not replaced ---------------------------------------------------------------


SPELLED: dict[str, Callable[[Path], Path]] = {
    "same": lambda file: file,
    "roundabout": lambda file: file.parent / "sub" / ".." / file.name,
    "hard link": lambda file: linked(file, os.link),
    "symbolic link": lambda file: linked(file, os.symlink),
    "folder's link": lambda file: linked(file.parent, os.symlink) / file.name,
}


def linked(file: Path, link: Callable[[Path, Path], object]) -> Path:
    other = file.parent.parent / "elsewhere"
    link(file, other)
    return other


@pytest.mark.parametrize("spelled", SPELLED)
def test_a_file_that_was_read_is_kept_by_whatever_path(spelled: str, tmp_path: Path) -> None:
    (tmp_path / "a" / "sub").mkdir(parents=True)
    file = tmp_path / "a" / "log.csv"
    OutputFile(file).write_text("mine")
    with InputFile.reading(file), pytest.raises(NotWritten, match="a file that was read"):
        OutputFile(SPELLED[spelled](file)).write_text("lost")
    assert file.read_text(encoding="utf-8") == "mine"


INCLUDED = """<mujoco><worldbody><body><joint name="a" axis="0 1 0"/>
<geom type="{kind}" size=".1"/></body></worldbody></mujoco>"""
MAIN = """<mujoco><compiler meshdir="meshes"/><asset><mesh name="m" file="part.obj"/></asset>
<include file="body.xml"/></mujoco>"""
MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def mjcf(desk: Path) -> dict[str, Path]:
    """The files of an MJCF with an include and a mesh, written by us."""
    (desk / "meshes").mkdir()
    files = {name: desk / name for name in ("main.xml", "body.xml", "meshes/part.obj")}
    for file, text in zip(
        files.values(), (MAIN, INCLUDED.format(kind="sphere"), MESH), strict=True
    ):
        OutputFile(file).write_text(text)
    return files


@pytest.mark.parametrize("name", ["main.xml", "body.xml", "meshes/part.obj"])
def test_a_models_other_files_are_kept_too(name: str, tmp_path: Path) -> None:
    file = mjcf(tmp_path)[name]
    before = file.read_bytes()
    with InputFile.reading():
        load_tree(str(tmp_path / "main.xml"))
        with pytest.raises(NotWritten, match="a file that was read"):
            OutputFile(file).write_text("lost")
    assert file.read_bytes() == before


# -- only regular files are read -----------------------------------------------------------------


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _zeros(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _itself(path: Path) -> None:
    path.symlink_to(path.name)


def _folder(path: Path) -> None:
    path.mkdir()


def _huge(path: Path) -> None:
    path.touch()
    os.truncate(path, 3 << 30)


ODD = {"pipe": _fifo, "zeros": _zeros, "itself": _itself, "folder": _folder, "huge": _huge}

READ = {
    "identify --model two.urdf --log log.csv --map ODD": "map.toml",
    "inspect log.csv --map ODD": "map.toml",
    "excite --model two.urdf --limits ODD": "limits.toml",
    "identify --model two.urdf --log ODD": "other.csv",
    "run ODD": "script.py",
    "run scalar_rov --excitation designed:design": "design/scenario.json",
    "sweep scalar_rov --out design": "design/manifest.json",
    "report design": "design/manifest.json",
    "report ./design": "design/rows.jsonl",
    "view design": "design/record.arrow",
}


@pytest.fixture
def bounded() -> Iterator[None]:
    """Five seconds, and 1.5 GB more than now."""

    def late(*_: object) -> None:
        pytest.fail("it hangs")

    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    limits = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + (3 << 29), limits[1]))
    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, 5.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, limits)


@pytest.mark.usefixtures("bounded")
@pytest.mark.parametrize("kind", ODD)
@pytest.mark.parametrize("words", READ)
def test_odd_files_end_typed(words: str, kind: str, desk: Path) -> None:
    mjcf(desk)
    file = desk / READ[words]
    (desk / "design").mkdir()
    file.parent.mkdir(parents=True, exist_ok=True)
    if file.name == "rows.jsonl":
        manifest = '{"vary": {}, "script": "scalar_rov", "arguments": [], "runs": 1}'
        (desk / "design" / "manifest.json").write_text(manifest, encoding="utf-8")
    file.unlink(missing_ok=True)
    ODD[kind](file)
    if words.startswith("sweep") and kind in ("zeros", "itself"):
        pytest.skip("a link is replaced, not what it points to")
    refused(*(READ[words] if word == "ODD" else word for word in words.split()))


MODELS = {
    "arm.urdf": "arm.urdf",
    "arm.xml": "arm.xml",
    "arm.mjb": "arm.mjb",
    "vehicle.toml": "vehicle.toml",
    "main.xml": "body.xml",
    "./main.xml": "meshes/part.obj",
}


@pytest.mark.usefixtures("bounded")
@pytest.mark.parametrize("kind", ODD)
@pytest.mark.parametrize("model", MODELS)
def test_odd_files_of_a_model_end_typed(model: str, kind: str, desk: Path) -> None:
    mjcf(desk)
    file = desk / MODELS[model]
    file.unlink(missing_ok=True)
    ODD[kind](file)
    with suppress(NsaidError):  # a mesh may be missing
        load_robot_model(model)


@pytest.mark.usefixtures("bounded")
@pytest.mark.parametrize("kind", ODD)
@pytest.mark.parametrize("name", ["meta/info.json", "data/0.parquet"])
def test_odd_files_of_a_data_set_end_typed(name: str, kind: str, desk: Path) -> None:
    (desk / "set" / "meta").mkdir(parents=True)
    (desk / "set" / "data").mkdir()
    info = '{"features": {"action": {"dtype": "float32", "shape": [1]}}}'
    (desk / "set" / "meta" / "info.json").write_text(info, encoding="utf-8")
    (desk / "set" / name).unlink(missing_ok=True)
    ODD[kind](desk / "set" / name)
    with pytest.raises(NsaidError):
        read_tables(["set"])


@pytest.mark.parametrize(
    "words",
    [
        "run scalar_rov",
        "identify --model two.urdf --log log.csv",
        "excite --model=~/two.urdf",
        "track track_ur5",
    ],
)
def test_the_home_is_meant_by_a_tilde_everywhere(words: str, desk: Path) -> None:
    shutil.copy(URDF, desk / "home" / "two.urdf")
    (desk / "home" / "out").mkdir()
    (desk / "home" / "out" / "thesis.tex").write_text("mine", encoding="utf-8")
    refused(*words.split(), "--out=~/out")
    assert not (desk / "~").exists()


def test_what_a_command_wrote_it_may_read_and_write_again(tmp_path: Path) -> None:
    """An exported model is tried, and written again with another integrator."""
    mine = tmp_path / "mine.xml"
    mine.write_text("<a/>", encoding="utf-8")
    ours = tmp_path / "ours.xml"
    with InputFile.reading():
        OutputFile(ours).write_text("<a/>")
        assert InputFile(ours).read() == InputFile(mine).read()
        OutputFile(ours).write_text("<b/>")
        with pytest.raises(NotWritten):
            OutputFile(mine).write_text("<b/>")
    assert ours.read_text(encoding="utf-8") == "<b/>"
