import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.errors import InvalidInput, UnknownName
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.urdf import write_urdf

from .urdfs import chain, joint, link, robot
from .values import identified


@pytest.fixture
def load(tmp_path):
    def write_and_load(text, encoding="utf-8", **options):
        path = tmp_path / "arm.urdf"
        path.write_bytes(text.encode(encoding))
        return load_robot_model(str(path), **options)

    return write_and_load


def codes(model):
    return [finding.code for finding in model.findings]


def test_joints_friction_and_limits_come_from_the_file(load):
    dynamics = '<dynamics damping="0.7" friction="0.4"/>'
    model = load(chain(joint_2=joint("elbow", "link_1", "link_2", extra=dynamics)))
    assert model.kind == "urdf" and model.name == "arm"
    assert model.joints == ("joint_1", "elbow", "joint_3")
    assert model.damping.tolist() == [0, 0.7, 0]
    assert model.friction.tolist() == [0, 0.4, 0]
    assert model.limits.tolist() == [30] * 3
    assert model.gain.tolist() == [1] * 3
    assert model.findings == ()


def test_a_world_that_is_not_among_the_links_is_the_one_that_does_not_move(load):
    weld = joint("weld", "world", "base", kind="fixed")
    model = load(chain(more=[weld]))
    assert model.joints == ("joint_1", "joint_2", "joint_3")
    with pytest.raises(BadRobot, match="parent link 'wrld' does not exist"):
        load(chain(more=[weld.replace("world", "wrld")]))


def test_the_dynamics_are_pinocchios(load, tmp_path):
    ours = load(chain()).model
    theirs = pin.buildModelFromUrdf(str(tmp_path / "arm.urdf"))
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 3))
    assert np.array_equal(
        pin.rnea(ours, ours.createData(), q, v, a),
        pin.rnea(theirs, theirs.createData(), q, v, a),
    )


def test_friction_of_the_joints_that_are_left_is_kept(load):
    dynamics = '<dynamics damping="0.7" friction="0.4"/>'
    text = chain(joint_3=joint("joint_3", "link_2", "link_3", extra=dynamics))
    model = load(text, lock=["joint_2"])
    assert (model.damping.tolist(), model.friction.tolist()) == ([0, 0.7], [0, 0.4])


@pytest.mark.parametrize("options", [{"lock": ["joint_2"]}, {"joints": ["joint_3", "joint_1"]}])
def test_locked_joints_are_fixed_at_zero(load, options):
    whole, less = load(chain()).model, load(chain(), **options)
    assert less.joints == ("joint_1", "joint_3")
    q, v, a = np.random.default_rng(0).uniform(-1, 1, (3, 2))
    spread = np.insert(q, 1, 0), np.insert(v, 1, 0), np.insert(a, 1, 0)
    expected = pin.rnea(whole, whole.createData(), *spread)[[0, 2]]
    assert np.allclose(pin.rnea(less.model, less.model.createData(), q, v, a), expected, atol=1e-12)


def test_a_joint_that_cannot_be_at_zero_is_locked_at_the_nearest_limit(load):
    text = chain(joint_2=joint("joint_2", "link_1", "link_2", limits=(0.5, 2)))
    whole, less = load(text).model, load(text, lock=["joint_2"]).model
    q = np.array([0.3, -0.4])
    expected = pin.computeGeneralizedGravity(whole, whole.createData(), np.insert(q, 1, 0.5))
    found = pin.computeGeneralizedGravity(less, less.createData(), q)
    assert np.allclose(found, expected[[0, 2]], atol=1e-12)


def test_unknown_and_contradictory_joints_are_refused(load):
    with pytest.raises(UnknownName, match="joint_2"):
        load(chain(), lock=["joint2"])
    with pytest.raises(InvalidInput, match="joint_1"):
        load(chain(), lock=["joint_1"], joints=["joint_1", "joint_2"])
    with pytest.raises(BadRobot, match="no joint moves"):
        load(chain(), joints=[])


def test_a_mimic_joint_follows_its_leader(load):
    mimic = '<mimic joint="joint_2" multiplier="-2" offset="0.3"/>'
    text = chain(joint_3=joint("joint_3", "link_2", "link_3", extra=mimic))
    model = load(text)
    assert model.leaders == ("joint_1", "joint_2") and model.followers == ("joint_3",)
    (finding,) = model.findings
    assert finding.code == "coupled_joints" and "joint_3 = -2 · joint_2" in str(finding)
    assert model.coupling.ratio.tolist() == [[1, 0], [0, 1], [0, -2]]
    assert model.coupling.offset.tolist() == [0, 0, 0.3]
    assert model.passive == ("joint_3",)
    welded = load(text, lock=["joint_3"])
    assert welded.joints == ("joint_1", "joint_2") and welded.coupling is None
    (finding,) = welded.findings
    assert finding.code == "mimic_joint" and "joint_3" in str(finding)
    whole = load(chain()).model
    q = np.array([0.4, -0.2])
    gravity = pin.computeGeneralizedGravity(whole, whole.createData(), np.append(q, 0.3))
    found = pin.computeGeneralizedGravity(welded.model, welded.model.createData(), q)
    assert np.allclose(found, gravity[:2], atol=1e-12)
    assert load(text, lock=["joint_2"]).findings == ()


def test_mimic_joints_in_a_circle_are_refused(load):
    def follows(name):
        return f'<mimic joint="{name}"/>'

    one = joint("joint_2", "link_1", "link_2", extra=follows("joint_3"))
    two = joint("joint_3", "link_2", "link_3", extra=follows("joint_2"))
    with pytest.raises(BadRobot, match="circle"):
        load(chain(joint_2=one, joint_3=two))


def test_a_locked_mimic_joint_on_the_circle_is_welded_at_its_offset(load):
    mimic = '<mimic joint="joint_2" offset="0.3"/>'
    turning = joint("joint_2", "link_1", "link_2", kind="continuous")
    follows = joint("joint_3", "link_2", "link_3", kind="continuous", extra=mimic)
    model = load(chain(joint_2=turning, joint_3=follows), lock=["joint_3"]).model
    assert list(model.names)[1:] == ["joint_1", "joint_2"]
    whole = load(chain(joint_2=turning)).model
    angles = np.array([0.4, -0.2])
    q = pin.integrate(whole, pin.neutral(whole), np.append(angles, 0.3))
    gravity = pin.computeGeneralizedGravity(whole, whole.createData(), q)
    q = pin.integrate(model, pin.neutral(model), angles)
    found = pin.computeGeneralizedGravity(model, model.createData(), q)
    assert np.allclose(found, gravity[:2], atol=1e-12)


def test_a_mimic_joint_without_a_leader_moves_freely(load):
    def following(name, **mimic):
        attributes = "".join(f' {k}="{v}"' for k, v in mimic.items())
        extra = f'<mimic joint="{name}"{attributes}/>'
        return chain(joint_3=joint("joint_3", "link_2", "link_3", extra=extra))

    assert load(following("none")).joints == ("joint_1", "joint_2", "joint_3")
    with pytest.raises(BadRobot, match="joint_3"):
        load(following("joint_1", multiplier="fast"))


def test_xacro_macros_are_refused(load):
    text = chain().replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert len(load(text).joints) == 3
    with pytest.raises(BadRobot, match=r"xacro arm\.urdf"):
        load(text.replace("</robot>", '<xacro:include filename="a"/></robot>'))


def test_missing_meshes_are_noted_and_found_ones_drawn(load, tmp_path):
    def visual(file):
        return f'<visual><geometry><mesh filename="{file}"/></geometry></visual>'

    (tmp_path / "shapes").mkdir()
    triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    (tmp_path / "shapes" / "part.obj").write_text(triangle)
    model = load(
        chain(
            link_1=link("link_1", visual=visual("package://arm_description/shapes/part.obj")),
            link_2=link("link_2", visual=visual("package://arm_description/shapes/none.obj")),
        )
    )
    (finding,) = model.findings
    assert (finding.level, finding.code) == ("note", "mesh_missing")
    assert "none.obj" in str(finding) and "ROS_PACKAGE_PATH" in finding.remedy
    (mesh,) = model.visuals.visuals()
    assert mesh.vertices.shape == (3, 3)
    assert model.visuals.poses(np.zeros((2, 3)))[0].shape == (2, 1, 3)


def test_meshes_are_found_in_the_ros_package_path(load, tmp_path, monkeypatch):
    folder = tmp_path / "elsewhere" / "arm_description"
    folder.mkdir(parents=True)
    (folder / "part.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(folder.parent))
    file = "package://arm_description/part.obj"
    visual = f'<visual><geometry><mesh filename="{file}"/></geometry></visual>'
    assert load(chain(link_1=link("link_1", visual=visual))).findings == ()


def zeros(value="0"):
    entries = " ".join(f'{k}="{value}"' for k in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
    return f"<inertia {entries}/>"


@pytest.mark.parametrize(
    "inertia",
    [
        zeros(),
        zeros("abc"),
        "",
        '<inertia ixx="1" iyy="1" izz="3" ixy="0" ixz="0" iyz="0"/>',
        '<inertia ixx="-1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>',
    ],
    ids=["zero", "unreadable", "missing", "triangle", "negative"],
)
def test_an_unphysical_inertia_is_moved_inside_the_cone_and_told(load, inertia):
    model = load(chain(link_2=link("link_2", inertia=inertia)))
    (finding,) = model.findings
    assert (finding.level, finding.code, finding.where) == (
        "warning",
        "inertia_moved",
        "link link_2",
    )
    assert finding.data["moments_before"] != finding.data["moments_after"]
    for i in range(1, 4):
        phi = model.model.inertias[i].toDynamicParameters()
        P = pin.PseudoInertia.FromDynamicParameters(phi).toMatrix()
        assert np.linalg.eigvalsh(P)[0] > 0
    assert model.model.inertias[2].mass == 1.0


def test_a_bad_inertial_is_found_behind_a_fixed_joint_although_the_sum_is_good(load):
    tool = [link("tool", inertia=zeros()), joint("weld", "link_3", "tool", kind="fixed")]
    (finding,) = load(chain(more=tool)).findings
    assert finding.where == "link tool"


def test_a_massless_link_that_moves_gets_a_little_mass(load):
    model = load(chain(link_3=link("link_3", mass="")))
    (finding,) = model.findings
    assert finding.where == "link link_3"
    assert finding.data["mass_before"] == 0
    assert finding.data["mass_after"] == model.model.inertias[3].mass == pytest.approx(0.002)


def test_a_massless_tool_frame_is_nothing_to_tell(load):
    tool = [link("tool", mass=""), joint("weld", "link_3", "tool", kind="fixed")]
    assert load(chain(more=tool)).findings == ()


@pytest.mark.parametrize("mass", ["nan", "inf", "heavy", " "])
def test_a_mass_that_is_no_number_is_refused(load, mass):
    with pytest.raises(BadRobot, match="link link_2"):
        load(chain(link_2=link("link_2", mass=mass)))


def test_a_latin_1_file_is_read(load):
    text = chain().replace("</robot>", "<!-- Stäubli --></robot>")
    assert codes(load(text, encoding="latin-1")) == ["encoding"]
    declared = text.replace('"1.0"?', '"1.0" encoding="ISO-8859-1"?')
    assert codes(load(declared, encoding="latin-1")) == []


def test_names_of_the_engines_own_do_no_harm(load):
    text = robot(
        link("base", mass=""),
        link("universe"),
        link("world"),
        joint("world", "base", "universe"),
        joint("base", "universe", "world"),
    )
    assert load(text).joints == ("world", "base")


def test_a_joint_of_several_degrees_of_freedom_is_refused_until_it_is_locked(load):
    text = chain(joint_2=joint("joint_2", "link_1", "link_2", kind="planar"))
    with pytest.raises(BadRobot, match="--lock joint_2"):
        load(text)
    assert load(text, lock=["joint_2"]).joints == ("joint_1", "joint_3")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("<robot", "not XML"),
        ("<sdf/>", "neither <robot> nor <mujoco>"),
        ("<robot name='a'/>", "it has no link"),
    ],
)
def test_files_of_another_kind_are_refused(load, text, reason):
    with pytest.raises(BadRobot, match=reason):
        load(text)


def test_a_packed_robot_is_known_by_its_folder(tmp_path, monkeypatch):
    (tmp_path / "tx7").mkdir()
    (tmp_path / "tx7" / "tx7.urdf").write_text(chain())
    for module in (
        "nsaid_mj.robots.assets",
        "nsaid_mj.robots.files",
    ):
        monkeypatch.setattr(f"{module}.folder", lambda _: tmp_path)
    model = load_robot_model("tx7")
    assert (model.name, model.source, model.kind) == ("tx7", None, "urdf")
    write_urdf(model, identified(model), tmp_path / "calibrated.urdf")
    with pytest.raises(UnknownName, match="Did you mean tx7"):
        load_robot_model("tx8")


def test_example_robots_are_known_by_name():
    model = load_robot_model("panda", joints=[f"panda_joint{i}" for i in range(1, 8)])
    assert model.source is None and model.name == "panda" and len(model.joints) == 7
    assert load_robot_model("solo12").findings[-1].code == "base_held"
    with pytest.raises(UnknownName, match="ur5"):
        load_robot_model("ur55")
    with pytest.raises(BadRobot, match="folder"):
        load_robot_model("")
    with pytest.raises(BadRobot, match="no such file"):
        load_robot_model("ur55.urdf")
