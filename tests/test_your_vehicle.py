"""The files and commands of docs/your_vehicle.md work as the page says."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.lab.plants.vehicles import BlueROV2Plant
from tests.support.faulty import CHECKOUT, shell

PAGE = (CHECKOUT / "docs" / "your_vehicle.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r'^```(\w+)(?: title="(\S+)")?\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)
COMMANDS = [line for kind, _, text in BLOCKS if kind == "sh" for line in text.splitlines()]
SHORT = "--duration 3 --held-out 1 --pe-window 1 --quiet"


def written(folder: Path, *, without: str = "") -> Path:
    """The page's files, in an empty folder; returns that of the vehicle."""
    for _, name, text in BLOCKS:
        if name and name != without:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    return folder / "hexa"


def test_the_page_has_three_files_two_commands_and_one_python_block():
    assert [name for _, name, _ in BLOCKS if name] == [
        "hexa/vehicle.toml",
        "hexa/model.xml",
        "hexa/hexa.py",
    ]
    assert len(COMMANDS) == 2 + 2  # of a log of one's own
    own = ["toml", "sh", "sh", "python", "sh", "toml"]
    assert [kind for kind, name, _ in BLOCKS if not name] == own


def test_every_command_of_the_page_completes_and_its_python_prints_what_it_says(
    tmp_path, monkeypatch, capsys
):
    written(tmp_path)
    monkeypatch.chdir(tmp_path)
    for command in COMMANDS[:2]:
        program, *words = shlex.split(f"{command} {SHORT}")
        assert program == "nsaid"
        code, said = shell(*words)
        assert (code, said.err) == (0, ""), command
    (reading,) = [text for kind, name, text in BLOCKS if kind == "python" and not name]
    exec(compile(reading, "the page", "exec"), {})
    status, sizes, *_ = capsys.readouterr().out.splitlines()
    assert status == "completed" and sizes == "6 43"
    both = [
        json.loads((tmp_path / "runs" / name / "summary.json").read_text())
        for name in ("hexa", "hexa_by_flag")
    ]
    assert both[0]["theta_perp_ratio"] == both[1]["theta_perp_ratio"]  # the same vehicle
    assert both[0]["theta_perp_ratio"] < 0.5 * both[0]["theta_perp_ratio_initial"]


def test_six_thrusters_give_six_columns_and_the_sheets_numbers(tmp_path):
    p = BlueROV2Plant(vehicle=str(written(tmp_path)), spread=0.0).build(1e-2, 0)
    space, theta = p.system.space, p.truth
    assert p.system.n_u == 6 and len(space) == 43
    np.testing.assert_allclose(theta[space["thruster gain"]], 40.0)
    np.testing.assert_allclose(theta[space["quadratic drag"]], [18, 22, 37, 1.5, 1.5, 1.5])
    assert {mesh.name for mesh in p.visuals()} == {"float", "hull"}


def test_a_vehicle_without_a_model_is_drawn_as_a_box(tmp_path):
    folder = written(tmp_path, without="hexa/model.xml")
    (box,) = BlueROV2Plant(vehicle=str(folder)).build(1e-2, 0).visuals()
    np.testing.assert_allclose(np.ptp(box.vertices, axis=0), [0.46, 0.34, 0.25])


def test_a_vehicle_without_model_or_size_is_drawn_as_a_box_of_its_inertia(tmp_path):
    sheet = written(tmp_path, without="hexa/model.xml") / "vehicle.toml"
    text = sheet.read_text(encoding="utf-8")
    sheet.write_text(re.sub(r"^size.*$", "", text, flags=re.MULTILINE), encoding="utf-8")
    plant = BlueROV2Plant(vehicle=str(sheet), spread=0.0).build(1e-2, 0)
    (box,) = plant.visuals()
    sides, model = np.ptp(box.vertices, axis=0), plant.model
    assert sorted(model.body_inertia[1]) == pytest.approx(
        sorted(model.body_mass[1] / 12 * ((sides**2).sum() - sides**2)), rel=1e-6
    )


@pytest.mark.parametrize(
    "old, new, expected",
    [
        ('name="vehicle"', 'name="hull"', "one body, called vehicle"),
        ('<freejoint name="pose"/>', '<joint name="pose" type="hinge"/>', "the joints"),
        ('type="box"', 'type="bx"', "a model that MuJoCo can load"),
        ("</worldbody>", '<body name="tail"/></worldbody>', "one body"),
        (
            "</worldbody>",
            '</worldbody><actuator><motor name="m" body="vehicle"/></actuator>',
            "a model that MuJoCo can load|no actuators",
        ),
    ],
)
def test_a_model_that_does_not_fit_the_sheet_is_refused(tmp_path, old, new, expected):
    folder = written(tmp_path)
    model = folder / "model.xml"
    text = model.read_text(encoding="utf-8")
    assert old in text
    model.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InvalidInput, match=expected) as caught:
        BlueROV2Plant(vehicle=str(folder)).build(1e-2, 0)
    assert caught.value.name == str(model)


def test_mass_damping_and_medium_of_model_xml_are_ignored(tmp_path):
    """Only looks come from model.xml: the motion is that of the sheet, to the bit."""
    folder, ends = written(tmp_path), []
    model = folder / "model.xml"
    text = model.read_text(encoding="utf-8")
    other = (
        text.replace('mass="0"', 'mass="7"')
        .replace("<freejoint", '<joint type="free" damping="5" armature="2" frictionloss="1"')
        .replace(
            "<worldbody>",
            '<option density="900" gravity="0 0 -3"/><compiler inertiafromgeom="true"/><worldbody>',
        )
    )
    for xml in (text, other):
        model.write_text(xml, encoding="utf-8")
        p = BlueROV2Plant(vehicle=str(folder)).build(1e-2, 4)
        with p.running():
            p.reset(np.full(6, 0.1), np.full(6, 0.2))
            for _ in range(50):
                p.step(np.full(6, 0.3))
            ends.append(np.concatenate(p.coordinates()))
    assert (ends[0] == ends[1]).all()
