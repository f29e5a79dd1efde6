import re
from xml.etree import ElementTree

import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.urdf import write_urdf

from .urdfs import chain, joint, link
from .values import identified, same_inertias


@pytest.fixture
def there_and_back(tmp_path):
    def export(text, encoding="utf-8", **options):
        path, out = tmp_path / "arm.urdf", tmp_path / "calibrated.urdf"
        path.write_bytes(text.encode(encoding))
        robot = load_robot_model(str(path), **options)
        values = identified(robot)
        write_urdf(robot, values, out)
        return values, load_robot_model(str(out), **options), out.read_text(encoding="utf-8")

    return export


TOOL = (link("tool"), joint("weld", "link_3", "tool", kind="fixed"))
EMPTY = '<link name="link_3"/>'


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (chain(), {}),
        (chain(more=TOOL), {}),
        (chain(link_3=EMPTY), {}),
        (chain(link_3=EMPTY, more=TOOL), {}),
        (chain(), {"lock": ["joint_2"]}),
        (chain(joint_3=joint("joint_3", "link_2", "link_3", extra='<mimic joint="joint_2"/>')), {}),
        (chain(joint_1=joint("joint_1", "base", "link_1", extra='<dynamics damping="1"/>')), {}),
    ],
    ids=["plain", "welded", "empty", "empty welded", "locked", "mimic", "dynamics"],
)
def test_what_was_written_is_read_again(there_and_back, text, options):
    values, again, _ = there_and_back(text, **options)
    assert same_inertias(values.model, again.model)
    own = list(again.independent)  # what a follower has is its leader's when it is read
    led = np.eye(len(own)) if again.coupling is None else again.coupling.ratio
    assert np.allclose(again.damping[own], led.T**2 @ values.damping, rtol=1e-12)
    assert np.allclose(again.friction[own], abs(led.T) @ values.friction, rtol=1e-12)
    assert [f for f in again.findings if f.code != "coupled_joints"] == []


def test_everything_else_is_kept(there_and_back):
    odd = '<visual name="a > b"><geometry><box size="1 2 3"/></geometry></visual>'
    text = chain(link_2=link("link_2", visual=odd), more=("<!-- kept -->", "<gazebo>\t</gazebo>"))
    _, _, written = there_and_back(text)
    for kept in ("<!-- kept -->", "<gazebo>\t</gazebo>"):
        assert kept in written

    def rest(urdf):
        """What two documents of the same content have in common, comments included."""
        canonical = ElementTree.canonicalize(urdf, with_comments=True)
        changed = r"\s+|<!-- Cali.*?-->|<inertial>.*?</inertial>|<dynamics.*?</dynamics>"
        return re.sub(changed, "", canonical, flags=re.S)

    assert rest(written) == rest(text)


def test_the_comment_tells_gains_anchor_and_welded_links(there_and_back):
    values, _, written = there_and_back(chain(more=TOOL))
    assert f"joint_1: gain {values.gain[0]:.6g}" in written
    assert "mass of link_2 - - 1.2 kg, weighed" in written
    assert "delay of 12 ms" in written
    assert re.search(r"fixed to: tool\.", written)
    ElementTree.fromstring(written)


def test_the_comment_tells_joints_that_were_held(there_and_back):
    _, _, written = there_and_back(chain(more=TOOL), lock=["joint_2"])
    assert "Joints taken as fixed: joint_2." in written


def test_a_latin_1_file_is_written_as_utf_8(there_and_back):
    text = chain(more=("<!-- Stäubli -->",)).replace('"1.0"?', '"1.0" encoding="ISO-8859-1"?')
    _, again, written = there_and_back(text, encoding="latin-1")
    assert "Stäubli" in written and again.findings == ()


def test_an_example_robot_is_written(tmp_path):
    robot = load_robot_model("panda", lock=["panda_finger_joint1"])
    values, out = identified(robot), tmp_path / "panda.urdf"
    write_urdf(robot, values, out)
    again = load_robot_model(str(out), lock=["panda_finger_joint1"])
    assert same_inertias(values.model, again.model)


def test_a_vehicle_has_no_urdf(tmp_path):
    robot = load_robot_model("scalar_rov")
    with pytest.raises(InvalidInput, match="URDF"):
        write_urdf(robot, None, tmp_path / "a.urdf")  # pyright: ignore[reportArgumentType]
