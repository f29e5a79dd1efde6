import mujoco
import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.base.errors import UnknownName
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.errors import BadRobot

ARM = """
<mujoco model="arm">
  <default>
    <joint damping="0.5" frictionloss="0.2" armature="0.1"/>
    <default class="wrist"><joint damping="0.1" armature="0.01" range="-1 1"/></default>
  </default>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0"/><geom size="0.1" pos="0.2 0 0"/>
      <body name="fore" pos="0.4 0 0"><joint name="elbow" axis="0 1 0"/>
        <geom size="0.1" pos="0.2 0 0"/>
        <body name="hand" pos="0.4 0 0"><joint name="wrist" class="wrist" axis="1 0 0"/>
          <geom type="box" size="0.1 0.2 0.05"/>{inside}
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="m1" joint="shoulder" gear="50" ctrlrange="-2 2"/>
    <general name="m2" joint="elbow" gear="2" gainprm="30" forcerange="-60 60"/>
    {actuator}
  </actuator>
  {more}
</mujoco>
"""
SERVO = '<position name="m3" joint="wrist" kp="100" forcerange="-12 12"/>'


@pytest.fixture
def load(tmp_path):
    def write_and_load(text, **options):
        path = tmp_path / "arm.xml"
        path.write_text(text)
        return load_robot_model(str(path), **options)

    return write_and_load


def arm(inside="", actuator=SERVO, more=""):
    return ARM.format(inside=inside, actuator=actuator, more=more)


def found(model):
    return {finding.code: finding for finding in model.findings}


def test_joints_and_motors_come_from_the_file(load):
    model = load(arm())
    assert (model.kind, model.name) == ("mjcf", "arm")
    assert model.joints == ("shoulder", "elbow", "wrist")
    assert model.damping.tolist() == [0.5, 0.5, 0.1]
    assert model.friction.tolist() == [0.2, 0.2, 0.2]
    assert model.rotor.tolist() == [0.1, 0.1, 0.01]
    assert model.gain.tolist() == [50, 60, 1]
    assert model.limits.tolist() == [2, 2, 12]
    assert found(model)["servo"].where == "wrist"
    assert "50, 60" in found(model)["command"].text


def test_a_joint_without_an_actuator_is_told(load):
    assert found(load(arm(actuator="")))["no_actuator"].where == "wrist"


def test_bodies_are_drawn(load):
    model = load(arm())
    assert len(model.visuals.visuals()) == 3
    places, _ = model.visuals.poses(np.zeros((1, 3)))
    assert np.allclose(places[0], [[0.2, 0, 0], [0.6, 0, 0], [0.8, 0, 0]])


def test_an_included_file_is_read(load, tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "arm.xml").write_text(arm())
    model = load('<mujoco model="scene"><include file="parts/arm.xml"/></mujoco>')
    assert model.joints == ("shoulder", "elbow", "wrist")


def test_a_compiled_file_is_read(tmp_path):
    path = tmp_path / "arm.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(arm()), str(path))
    assert load_robot_model(str(path)).joints == ("shoulder", "elbow", "wrist")


@pytest.mark.parametrize("lock", [["shoulder"], ["elbow"], ["elbow", "wrist"]])
def test_bodies_may_have_the_names_of_joints(load, lock):
    text = arm()
    expected = load(text, lock=lock).model
    for body, joint in {"upper": "wrist", "fore": "elbow", "hand": "universe"}.items():
        text = text.replace(f'body name="{body}"', f'body name="{joint}"')
    model = load(text, lock=lock)
    assert [frame.name for frame in model.model.frames if frame.type == pin.FrameType.BODY] == [
        "wrist",
        "elbow",
        "universe",
    ]
    assert list(model.model.inertias) == list(expected.inertias)
    assert list(model.model.jointPlacements) == list(expected.jointPlacements)
    assert len(model.visuals.parts) == 3


def test_locked_joints_are_merged(load):
    model = load(arm(), lock=["elbow"])
    assert model.joints == ("shoulder", "wrist")
    assert model.rotor.tolist() == [0.1, 0.01]
    assert model.gain.tolist() == [50, 1]
    whole = load(arm()).model
    q, v = np.array([0.3, -0.2]), np.array([0.5, 0.7])
    expected = pin.nonLinearEffects(
        whole, whole.createData(), np.insert(q, 1, 0), np.insert(v, 1, 0)
    )
    bias = pin.nonLinearEffects(model.model, model.model.createData(), q, v)
    assert np.allclose(bias, expected[[0, 2]], atol=1e-12)
    with pytest.raises(UnknownName, match="elbow"):
        load(arm(), lock=["elbo"])


@pytest.mark.parametrize(
    ("more", "part"),
    [
        ('<equality><joint joint1="wrist" joint2="elbow"/></equality>', "equality constraint"),
        (
            '<tendon><fixed name="t" stiffness="1"><joint joint="elbow" coef="1"/>'
            '<joint joint="wrist" coef="1"/></fixed></tendon>',
            "tendon t",
        ),
        ('<equality><connect body1="hand" body2="upper" anchor="0 0 0"/></equality>', "equality"),
    ],
)
def test_coupled_joints_are_refused_until_they_are_locked(load, more, part):
    with pytest.raises(BadRobot, match=part) as caught:
        load(arm(more=more))
    assert "--lock" in caught.value.remedy
    assert load(arm(more=more), lock=["elbow", "wrist"]).joints == ("shoulder",)


def test_a_joint_that_an_equality_moves_follows(load):
    line = '<equality><joint joint1="wrist" joint2="elbow" polycoef=".2 -.5 0 0 0"/></equality>'
    model = load(arm(actuator="", more=line))
    assert model.leaders == ("shoulder", "elbow") and model.followers == ("wrist",)
    assert np.allclose(model.coupling.ratio, [[1, 0], [0, 1], [0, -0.5]])
    assert model.passive == ("wrist",)
    turned = line.replace('"wrist" joint2="elbow"', '"elbow" joint2="wrist"')
    model = load(arm(actuator="", more=turned))
    assert np.allclose(model.coupling.ratio[2], [0, -2.0])
    assert model.coupling.offset[2] == pytest.approx(0.4)
    kept = load(arm(actuator="", more=line), joints=["elbow"])
    assert kept.joints == ("elbow", "wrist")
    locked = load(arm(actuator="", more=line), lock=["wrist"])
    assert locked.coupling is None and "mimic_joint" in {f.code for f in locked.findings}
    curved = line.replace(".2 -.5 0", ".2 -.5 .1")
    with pytest.raises(BadRobot, match="equality"):
        load(arm(actuator="", more=curved))


def test_a_tendon_that_only_limits_is_ignored_with_a_word(load):
    tendon = '<tendon><fixed name="t" limited="true" range="-1 1"><joint joint="elbow" coef="1"/>'
    tendon += '<joint joint="wrist" coef="1"/></fixed></tendon>'
    model = load(arm(more=tendon))
    assert len(model.joints) == 3
    assert "limit_tendon" in {f.code for f in model.findings}


def test_a_measuring_tendon_and_an_inactive_constraint_do_no_harm(load):
    tendon = '<tendon><fixed><joint joint="wrist" coef="1"/></fixed></tendon>'
    off = '<equality><joint joint1="wrist" active="false"/></equality>'
    assert len(load(arm(more=tendon + off)).joints) == 3


def test_a_ball_joint_is_refused_until_it_is_locked(load):
    ball = '<body name="b"><joint name="ball" type="ball"/><geom size="0.1"/></body>'
    with pytest.raises(BadRobot, match="--lock ball"):
        load(arm(inside=ball))
    assert len(load(arm(inside=ball), lock=["ball"]).joints) == 3


def test_a_floating_base_is_held_as_it_is_drawn(load):
    model = load(
        '<mujoco><worldbody><body name="base" euler="90 0 0"><freejoint/><geom size="0.2"/>'
        '<body name="leg"><joint name="hip" axis="0 0 1"/><geom size="0.1" pos="0.3 0 0"/></body>'
        "</body></worldbody></mujoco>"
    )
    assert model.joints == ("hip",)
    assert "base_held" in found(model)
    gravity = pin.computeGeneralizedGravity(model.model, model.model.createData(), np.zeros(1))
    assert gravity[0] == pytest.approx(9.81 * 0.3 * model.model.inertias[1].mass)


def test_missing_meshes_are_noted(load):
    text = arm(inside='<geom type="mesh" mesh="m" mass="0"/>')
    model = load(
        text.replace("<default>", '<asset><mesh name="m" file="m.stl"/></asset><default>', 1)
    )
    assert found(model)["mesh_missing"].data["files"] == ["m.stl"]
    assert len(model.visuals.visuals()) == 3


def test_forces_outside_the_structure_are_told(load):
    text = arm().replace('axis="1 0 0"', 'axis="1 0 0" stiffness="3"')
    text = text.replace('name="upper"', 'name="upper" gravcomp="1"')
    text = text.replace('damping="0.5"', 'damping="0.5 0.1"')
    text = text.replace("<default>", '<option density="1.2"/><default>', 1)
    codes = {"spring", "gravity_compensation", "damping_curve", "fluid"}
    assert codes <= set(found(load(text)))


def test_a_body_of_several_joints_gets_links_with_a_little_mass(load):
    text = arm().replace("<geom type", '<joint name="roll" axis="0 0 1"/><geom type')
    model = load(text)
    assert model.joints == ("shoulder", "elbow", "wrist", "roll")
    assert found(model)["inertia_moved"].level == "warning"


@pytest.mark.parametrize(
    "inertia",
    [
        'diaginertia="1 3 1" euler="10 20 30"',
        'fullinertia="1 3 1 0.1 0 0.2"',
        'diaginertia="0 0 0"',
    ],
)
def test_an_inertia_that_mujoco_would_reject_is_moved_inside_the_cone(load, inertia):
    text = arm(inside=f'<inertial pos="0 0 0.1" mass="2" {inertia}/>')
    finding = found(load(text))["inertia_moved"]
    assert (finding.level, finding.where) == ("warning", "link hand")


def test_what_mujoco_rejects_is_refused(load):
    with pytest.raises(BadRobot, match="MuJoCo rejects it"):
        load(arm().replace('size="0.1"', ""))
    with pytest.raises(BadRobot, match="no joint moves"):
        load("<mujoco/>")


def test_a_latin_1_file_is_refused(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_bytes(arm().replace("hand", "Händ").encode("latin-1"))
    with pytest.raises(BadRobot, match="Save it as UTF-8"):
        load_robot_model(str(path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('damping="0.5"', 'damping="inf"', "joint shoulder: its damping is inf"),
        ('armature="0.1"', 'armature="nan"', "joint shoulder: its armature is nan"),
        ('gear="50"', 'gear="1e300"', "actuator m1: its gear is 1e\\+300"),
        ('range="-1 1"', 'range="nan 1"', "joint wrist: its range is nan 1"),
        ("<geom size", '<geom mass="inf" size', "body upper: its mass is inf"),
        ("<geom size", '<inertial pos="0 0 0" mass="inf" diaginertia="1 1 1"/><geom size', "inf"),
        (
            "<geom size",
            '<inertial pos="0 0 0" mass="1" diaginertia="inf 1 1"/><geom size',
            "inertia",
        ),
    ],
)
def test_numbers_that_no_robot_has_are_refused_though_mujoco_accepts_them(load, old, new, message):
    with pytest.raises(BadRobot, match=message):
        load(arm().replace(old, new, 1))
