"""Names of columns, joints and files steer neither a terminal nor a document."""

from __future__ import annotations

import ast
import json
import math
from pathlib import Path

import pytest

import nsaid_mj
from nsaid_mj.base.errors import InvalidInput, printable
from nsaid_mj.base.files import OutputFile, print_json
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs import tables
from nsaid_mj.lab.record import Record
from nsaid_mj.robots.assets import folder
from nsaid_mj.robots.loading import load_robot
from tests.support.faulty import shell

PACKAGE = Path(nsaid_mj.__file__).parent
URDF = folder("assets") / "robots" / "double_pendulum" / "double_pendulum.urdf"


@pytest.mark.parametrize("name", ["q\x1b[31m", "\x9b2J", "q\u202e1", "[/red]", "{{ 7 }}"])
@pytest.mark.parametrize("flags", [(), ("--json",), ("--model", str(URDF))])
def test_a_columns_name_does_not_steer_the_terminal(name, flags, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{0.01 * k:.2f},{k % 7}\n" for k in range(100))
    Path("log.csv").write_text(f"t,{name}\n{rows}", encoding="utf-8")
    code, said = shell("inspect", "log.csv", *flags)
    assert code in (0, 1, 2)
    assert not any(control in said.out + said.err for control in "\x1b\x9b\u202e")
    if "--json" in flags:
        assert json.loads(said.out)["channels"][0]["name"] == printable(name)


def test_a_files_name_does_not_steer_the_terminal(tmp_path):
    code, said = shell("inspect", tmp_path / "\x1b[31mnone.csv")
    assert code == 2 and "\x1b" not in said.err and "none.csv" in said.err


@pytest.mark.parametrize("name", ["~.csv", "~no.such.user/log.csv"])
def test_a_name_that_begins_with_a_tilde_is_that_of_no_user(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path(name)
    path.parent.mkdir(exist_ok=True)
    path.write_text("t,q\n" + "".join(f"{0.01 * k:.2f},{k % 7}\n" for k in range(100)))
    code, said = shell("inspect", name)
    assert code in (0, 1) and "Traceback" not in said.err
    code, said = shell("inspect", name, "--model", "~none.urdf")
    assert code == 2 and "no such file" in said.err


def of_run(name):
    return Record.read(Path(name))


@pytest.mark.parametrize("read", [load_robot, load_robot_model, tables.read, of_run])
@pytest.mark.parametrize("end", ["", ".xml", ".toml"])
def test_a_name_that_is_too_long_for_the_system_is_refused(read, end):
    with pytest.raises(InvalidInput, match="too long"):
        read("a" * 300 + end)


@pytest.mark.parametrize("mesh", ["shell.stl", "a" * 300 + ".stl"])
def test_a_mesh_that_is_not_there_is_left_out_whatever_its_name(mesh, tmp_path):
    text = URDF.read_text(encoding="utf-8")
    shape = f'<visual><geometry><mesh filename="package://p/{mesh}"/></geometry></visual></link>'
    (tmp_path / "two.urdf").write_text(text.replace("</link>", shape), encoding="utf-8")
    found = load_robot_model(str(tmp_path / "two.urdf"))
    assert "mesh_missing" in {finding.code for finding in found.findings}
    text = f"""<mujoco><asset><mesh name="m" file="{mesh}"/></asset><worldbody><body>
    <joint axis="0 0 1"/><geom size="0.1"/><geom type="mesh" mesh="m"/></body></worldbody>
    </mujoco>"""
    (tmp_path / "one.xml").write_text(text, encoding="utf-8")
    found = load_robot_model(str(tmp_path / "one.xml"))
    assert "mesh_missing" in {finding.code for finding in found.findings}


def test_a_name_that_is_no_utf_8_does_not_keep_a_page_from_being_written(tmp_path):
    OutputFile(tmp_path / "page.html").write_text("of \udcff.urdf")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "of ?.urdf"


def test_a_folders_name_that_is_no_utf_8_can_be_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{0.01 * k:.2f},{k % 7}\n" for k in range(100))
    Path("log.csv").write_text(f"t,q\n{rows}", encoding="utf-8")
    code, said = shell("inspect", "log.csv", "--out", "\udcff")
    assert code in (0, 1) and "�/inspection.html" in said.out
    assert Path("\udcff").is_dir()


def test_printable_keeps_letters_of_all_scripts_lines_and_tabs():
    assert printable("Größe 名 q̇ [N·m]\n\t✔") == "Größe 名 q̇ [N·m]\n\t✔"


def test_json_on_the_standard_output_is_strict(capsys):
    print_json({"a": math.inf, "b": [math.nan, 1.0], "c": {"d": -math.inf}})
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": [None, 1.0], "c": {"d": None}}


def test_every_command_writes_strict_json():
    made = 0
    commands = [*PACKAGE.glob("*/commands/*.py"), *PACKAGE.glob("*/commands.py")]
    for path in (*(PACKAGE / "cli").glob("*.py"), *commands, PACKAGE / "clinic" / "session.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "json.dumps":
                made += 1
                strict = {k.arg: ast.unparse(k.value) for k in node.keywords}
                assert strict.get("allow_nan") == "False", f"{path}:{node.lineno}"
    assert made
