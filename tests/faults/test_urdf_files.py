"""A URDF that cannot be read as it is meant is refused with its cause, or its change is told."""

from pathlib import Path

import pytest

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.robots.assets import packed_robots
from nsaid_mj.robots.errors import BadRobot, MimicIgnored
from nsaid_mj.robots.loading import load_robot

_LIMIT = 'lower="-1" upper="1" effort="1" velocity="1"'


def link(name: str, mass: str = "1", moment: str = "0.01") -> str:
    return (
        f'<link name="{name}"><inertial><mass value="{mass}"/><origin xyz="0.1 0 0"/><inertia '
        f'ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(
    name: str,
    parent: str,
    child: str,
    kind: str = "revolute",
    limit: str = _LIMIT,
    more: str = "",
) -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.2 0 0"/><axis xyz="0 0 1"/><limit {limit}/>{more}</joint>'
    )


def robot(*parts: str) -> str:
    return f'<robot name="r"><link name="base"/>{"".join(parts)}</robot>'


def welded(mass: str = "5", moment: str = "0.01") -> str:
    """A moving link of 1 kg with a tool welded to it."""
    tool = link("tool", mass, moment)
    return robot(link("l1"), joint("j1", "base", "l1"), tool, joint("weld", "l1", "tool", "fixed"))


ONE = link("l1") + joint("j1", "base", "l1")
LOOP = f'<robot name="r">{link("a")}{link("b")}{joint("j1", "a", "b")}{joint("j2", "b", "a")}'
MIMIC = link("l2") + joint("j2", "l1", "l2", more='<mimic joint="j1" multiplier="2"/>')
BAD: dict[str, tuple[str, str]] = {
    "mass nan": (welded("nan"), "link tool: its mass is 'nan'"),
    "mass inf": (welded("inf"), "link tool: its mass is 'inf'"),
    "mass with a unit": (welded("5kg"), "link tool: its mass is '5kg'"),
    "mass with a comma": (welded("5,0"), "link tool: its mass is '5,0'"),
    "no mass": (welded(""), "link tool: its mass is ''"),
    "mass beyond bounds": (welded("1e300"), "link tool: its mass is '1e300'"),
    "moving mass nan": (robot(ONE.replace('"1"/><or', '"nan"/><or')), "link l1: its mass is 'nan'"),
    "loop": (f"{LOOP}</robot>", "links form a loop, a → b → a"),
    "own parent": (robot(link("a"), joint("j", "a", "a")), "links form a loop, a → a"),
    "two parents": (robot(ONE, joint("j2", "base", "l1")), "already has the parent base"),
    "two roots": (robot(ONE, link("l9")), "the links base and l9 both have no parent"),
    "no such link": (robot(ONE, joint("j2", "l1", "l9")), "its child link 'l9' does not exist"),
    "two of a name": (robot(ONE, ONE), "two links have this name"),
    "reversed": (
        robot(ONE.replace('lower="-1" upper="1"', 'lower="1" upper="-1"')),
        "joint j1: its lower limit 1 is above its upper limit -1",
    ),
    "limit nan": (robot(ONE.replace('lower="-1"', 'lower="nan"')), "its limit lower is 'nan'"),
    "no limit": (robot(ONE.replace(f"<limit {_LIMIT}/>", "")), "it has no <limit>"),
    "kind": (robot(ONE.replace("revolute", "screw")), "its type is 'screw'"),
    "no axis": (robot(ONE.replace("0 0 1", "0 0 0")), "its axis is 0 0 0"),
    "axis": (robot(ONE.replace("0 0 1", "z")), 'its <axis xyz="z"> is not three numbers'),
    "origin": (robot(ONE.replace("0.2 0 0", "nan 0 0")), '<origin xyz="nan 0 0">'),
    "far": (robot(ONE.replace("0.1 0 0", "1e200 0 0")), "link l1"),
    "mimic": (robot(ONE, MIMIC.replace('"2"', '"x"')), '<mimic multiplier="x"> is not a number'),
    "xacro": (
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="m"/></robot>',
        "it has xacro macros",
    ),
    "no XML": ("this is no robot", "it is not XML"),
    "empty": ("", "it is not XML"),
}
STRICT = {  # refused by a simulation; an identification moves them inside the cone, and says so
    "mass negative": (welded("-0.5"), "link tool: its mass is -0.5 kg"),
    "inertia nan": (welded(moment="nan"), "link tool: its inertia has ixx='nan'"),
    "inertia with a comma": (welded(moment="0,1"), "link tool: its inertia has ixx='0,1'"),
    "inertia negative": (welded(moment="-1"), "link tool: its moments of inertia are -1"),
}


def written(folder: Path, urdf: str | bytes) -> str:
    path = folder / "r.urdf"
    path.write_bytes(urdf if isinstance(urdf, bytes) else urdf.encode())
    return str(path)


@pytest.mark.parametrize("which", [*BAD, *STRICT])
def test_a_simulation_refuses_a_bad_urdf_and_names_the_cause(which, tmp_path, capfd):
    urdf, reason = (BAD | STRICT)[which]
    with pytest.raises(BadRobot) as caught:
        load_robot(written(tmp_path, urdf))
    assert reason in str(caught.value)
    assert capfd.readouterr() == ("", "")  # Pinocchio's own parser writes to the terminal


@pytest.mark.parametrize("which", BAD)
def test_an_identification_refuses_a_bad_urdf_and_names_the_cause(which, tmp_path):
    urdf, reason = BAD[which]
    with pytest.raises(BadRobot) as caught:
        load_robot_model(written(tmp_path, urdf))
    assert reason in str(caught.value)


@pytest.mark.parametrize("which", STRICT)
def test_an_identification_tells_which_inertial_it_changed(which, tmp_path):
    found = load_robot_model(written(tmp_path, STRICT[which][0])).findings
    assert [finding.where for finding in found] == ["link tool"]


def test_the_links_of_a_good_urdf_are_merged(tmp_path):
    path = written(tmp_path, welded())
    assert load_robot(path).model.inertias[1].mass == pytest.approx(6.0)
    assert load_robot_model(path).model.inertias[1].mass == pytest.approx(6.0)


def test_a_simulation_tells_of_joints_that_should_follow_others(tmp_path):
    with pytest.warns(MimicIgnored, match="j2"):
        assert load_robot(written(tmp_path, robot(ONE, MIMIC))).model.nv == 2


EFFORT = 'lower="-1" upper="1" velocity="1" effort="{}"'


@pytest.mark.parametrize("efforts,passive", [((5, 0), ["j2"]), ((0, 0), []), ((5, 5), [])])
def test_a_joint_without_effort_gets_no_motor_if_another_has_one(efforts, passive, tmp_path):
    limits = [EFFORT.format(effort) for effort in efforts]
    arm = robot(
        link("l1") + joint("j1", "base", "l1", limit=limits[0]),
        link("l2") + joint("j2", "l1", "l2", limit=limits[1]),
    )
    plant = ArmPlant(written(tmp_path, arm)).build(1e-3, 0)
    assert plant.model.nu == plant.system.n_u == 2 - len(passive)
    gains = [plant.system.space.labels[i] for i in plant.system.space.actuators]
    assert gains == [f"gain of {name}" for name in ("j1", "j2") if name not in passive]


def test_a_packed_robot_says_nothing_of_its_mimics(recwarn):
    assert "mimic" in packed_robots()["panda"].read_text(encoding="utf-8")
    load_robot("panda")
    assert not [w for w in recwarn if issubclass(w.category, MimicIgnored)]


@pytest.mark.parametrize("codec", ["latin-1", "utf-8", "utf-8-sig", "utf-16"])
def test_names_survive_the_encodings_of_a_urdf(codec, tmp_path):
    path = written(tmp_path, robot(ONE).replace("j1", "gélenk").encode(codec))
    assert list(load_robot(path).model.names)[1:] == ["gélenk"]
    assert load_robot_model(path).joints == ("gélenk",)


@pytest.mark.parametrize("name", ["world", "universe", "root_joint"])
@pytest.mark.parametrize("old", ["j1", "l1", "base"])
def test_names_that_engines_reserve_can_be_used(name, old, tmp_path):
    path = written(tmp_path, robot(ONE).replace(f'"{old}"', f'"{name}"'))
    plant = ArmPlant(path).build(1e-3, 0)
    assert plant.system.n == 1 and load_robot_model(path).model.nv == 1


@pytest.mark.filterwarnings("ignore:Inertia matrix is too close to singular")  # of MuJoCo
def test_next_to_no_inertia_is_told_and_leaves_no_file(tmp_path, monkeypatch):
    """MuJoCo writes its warnings into the current folder, unless somebody takes them."""
    path = tmp_path / "light.urdf"
    light, heavy = link("l1", "1e-14", "3e-14"), link("l2", "1", "1000")
    text = robot(light, joint("j1", "base", "l1"), heavy, joint("j2", "l1", "l2"))
    centred = text.replace('xyz="0.1 0 0"', 'xyz="0 0 0"').replace('xyz="0.2 0 0"', 'xyz="0 0 0"')
    path.write_text(centred, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadRobot, match="mass matrix is singular"):
        ArmPlant(str(path), armature=0.0).build(1e-3, 0)
    assert list(tmp_path.iterdir()) == [path]
