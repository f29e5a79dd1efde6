from dataclasses import replace
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.identified import Identified, SharedFriction
from nsaid_mj.robots.mjcf_export import write_mjcf
from nsaid_mj.robots.urdf import write_urdf

from .test_mjcf import SERVO, arm
from .test_tree import TURNED
from .urdfs import chain, joint, link, robot
from .values import identified, same_inertias


def exported(tmp_path, robot, values):
    out = tmp_path / "out" / "calibrated.xml"
    out.parent.mkdir(exist_ok=True)
    write_mjcf(robot, values, out)
    return out, mujoco.MjModel.from_xml_path(str(out))


def difference(mj, robot, values):
    """The largest relative difference of M and bias between MuJoCo's model and Pinocchio's."""
    model, data, theirs = values.model, values.model.createData(), mujoco.MjData(mj)
    assert [mj.joint(j).name for j in range(mj.njnt)] == list(robot.joints)
    rng, worst = np.random.default_rng(1), 0.0
    for _ in range(4):
        angles, v = rng.uniform(-2, 2, (2, mj.nv))
        theirs.qpos[:], theirs.qvel[:] = angles, v
        q = pin.integrate(model, pin.neutral(model), angles)
        mujoco.mj_forward(mj, theirs)
        M = np.zeros((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, theirs, M)
        ours = pin.crba(model, data, q)
        ours = np.triu(ours) + np.triu(ours, 1).T
        bias = pin.nonLinearEffects(model, data, q, v)
        force = max(np.abs(bias).max(), np.abs(M).max())
        worst = max(worst, np.abs(ours - M).max() / np.abs(M).max())
        worst = max(worst, np.abs(bias - theirs.qfrc_bias).max() / force)
    return worst


FRAMES = """
<mujoco><worldbody><frame pos="0.1 0.2 0.3" euler="10 20 30"><body name="a">
  <joint name="j" axis="0 1 1"/><geom size="0.1" pos="0.2 0 0"/>
  <frame pos="0.4 0 0"><body name="b" pos="0.1 0 0"><joint name="k" pos="0 0.1 0"/>
    <geom size="0.1"/></body></frame>
</body></frame></worldbody></mujoco>
"""
CASES = {
    "arm": (arm(), {}),
    "locked": (arm(), {"lock": ["elbow"]}),
    "locked last": (arm(), {"lock": ["wrist"]}),
    "several joints": (TURNED, {}),
    "several, locked": (TURNED, {"lock": ["b", "d", "branch_joint"]}),
    "several, last locked": (TURNED, {"lock": ["a", "c", "e"]}),
    "welded": (arm(inside='<body name="tool" pos="0 0 1"><geom size="0.1"/></body>'), {}),
    "frames": (FRAMES, {}),
    "keyframe": (arm(more='<keyframe><key qpos="1 2 3" ctrl="1 2 3"/></keyframe>'), {}),
    "keyframe, one motor less": (
        arm(actuator="", more='<keyframe><key qpos="1 2 3" ctrl="1 2"/></keyframe>'),
        {},
    ),
    "settotalmass": (arm().replace("<default>", '<compiler settotalmass="9"/><default>', 1), {}),
    "tendon": (
        arm(
            more='<tendon><fixed name="t" stiffness="1"><joint joint="elbow" coef="1"/></fixed>'
            '</tendon><sensor><tendonpos tendon="t"/><jointpos joint="wrist"/></sensor>'
            '<keyframe><key qpos="1 2 3"/></keyframe>'
        ),
        {"lock": ["elbow"]},
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_an_edited_mjcf_has_the_identified_dynamics(tmp_path, case):
    text, options = CASES[case]
    path = tmp_path / "arm.xml"
    path.write_text(text)
    robot = load_robot_model(str(path), **options)
    values = identified(robot)
    out, mj = exported(tmp_path, robot, values)
    assert difference(mj, robot, values) < 1e-10
    again = load_robot_model(str(out))
    assert same_inertias(values.model, again.model)
    assert np.allclose(again.damping, values.damping, rtol=1e-12)
    assert np.allclose(again.friction, values.friction, rtol=1e-12)
    assert np.allclose(again.rotor, values.rotor, rtol=1e-12)
    assert np.allclose(again.gain, values.gain, rtol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("inertia", "damping"), [(0.03, 0.4), (-0.03, 0.4), (0.03, -0.4)])
def test_a_motor_that_two_joints_share_is_a_tendon(tmp_path, sign, inertia, damping):
    """Mass matrix and friction get what two joints share off the diagonal, and nothing on it."""
    path = tmp_path / "arm.xml"
    path.write_text(arm())
    robot = load_robot_model(str(path))
    plain = identified(robot)
    shared = SharedFriction((1, 2), sign, inertia, damping, 0.3)
    forces, matrices = [], []
    for values in (plain, replace(plain, couplings=(shared,))):
        out, mj = exported(tmp_path, robot, values)
        mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        data = mujoco.MjData(mj)
        data.qpos[:], data.qvel[:] = [0.3, -0.5, 0.8], [0.2, -1.0, 0.7]
        mujoco.mj_forward(mj, data)
        forces.append(data.qfrc_damper.copy())
        matrices.append(np.zeros((3, 3)))
        mujoco.mj_fullM(mj, data, matrices[-1])
    i, j = (mj.joint(name).id for name in robot.joints[1:])
    off = np.zeros((3, 3))
    off[i, j] = off[j, i] = 1.0
    np.testing.assert_allclose(matrices[1] - matrices[0], inertia * off, atol=1e-12)
    np.testing.assert_allclose(forces[1] - forces[0], -damping * off @ data.qvel, atol=1e-12)
    loss = {mj.tendon(t).name: mj.tendon_frictionloss[t] for t in range(mj.ntendon)}
    assert loss[f"{robot.joints[1]} {'+' if sign > 0 else '-'} {robot.joints[2]}"] == 0.3
    again = load_robot_model(str(out))
    assert [f.code for f in again.findings if f.level == "warning"].count("tendon") == mj.ntendon
    out = tmp_path / "again.xml"
    write_mjcf(again, Identified.nominal(again), out)
    kept = mujoco.MjModel.from_xml_path(str(out))
    np.testing.assert_allclose(kept.tendon_armature, mj.tendon_armature)
    write_mjcf(again, plain, out)
    assert mujoco.MjModel.from_xml_path(str(out)).ntendon == 0


def test_a_tendon_without_a_name_is_left_out_of_what_was_identified_without_it(tmp_path):
    path = tmp_path / "arm.xml"
    tendon = '<tendon><fixed armature="0.1"><joint joint="elbow" coef="1"/>'
    path.write_text(arm(more=f'{tendon}<joint joint="wrist" coef="1"/></fixed></tendon>'))
    robot = load_robot_model(str(path))
    assert "elbow, wrist" in next(f.text for f in robot.findings if f.code == "tendon")
    assert exported(tmp_path, robot, identified(robot))[1].ntendon == 0


@pytest.mark.parametrize("name", ["ur5", "panda", "kinova"])
def test_the_mjcf_of_a_urdf_has_the_identified_dynamics(tmp_path, name):
    robot = load_robot_model(name)
    robot = load_robot_model(name, joints=[j for j in robot.joints if "finger" not in j])
    values = identified(robot)
    out, mj = exported(tmp_path, robot, values)
    assert difference(mj, robot, values) < 1e-10
    assert same_inertias(values.model, load_robot_model(str(out)).model)


def test_the_motors_take_the_logs_command(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(arm())
    robot = load_robot_model(str(path))
    values = identified(robot)
    _, mj = exported(tmp_path, robot, values)
    assert mj.nu == 3
    data = mujoco.MjData(mj)
    data.ctrl[:] = u = np.array([0.1, -0.2, 0.3])
    mujoco.mj_forward(mj, data)
    order = [mj.actuator_trnid[i, 0] for i in range(3)]
    assert np.allclose(data.qfrc_actuator[order], (values.gain[order] * u))


def test_nominal_values_give_back_the_file(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(arm())
    robot = load_robot_model(str(path))
    _, mj = exported(tmp_path, robot, Identified.nominal(robot))
    theirs = mujoco.MjModel.from_xml_string(arm())
    for field in ("body_mass", "dof_armature", "dof_frictionloss", "dof_damping"):
        assert np.allclose(getattr(mj, field), getattr(theirs, field), rtol=1e-12)


def test_meshes_are_found_from_the_new_folder(tmp_path):
    (tmp_path / "shapes").mkdir()
    (tmp_path / "shapes" / "part.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    path = tmp_path / "arm.xml"
    text = arm(inside='<geom type="mesh" mesh="part" mass="0"/>')
    assets = '<compiler meshdir="shapes"/><asset><mesh file="part.obj"/></asset><default>'
    path.write_text(text.replace("<default>", assets, 1))
    robot = load_robot_model(str(path))
    assert len(robot.visuals.visuals()) == 4
    out, mj = exported(tmp_path, robot, identified(robot))
    assert mj.nmesh == 1
    assert len(load_robot_model(str(out)).visuals.visuals()) == 4


MENAGERIE = """
<mujoco model="arm"><compiler angle="radian" meshdir="assets" autolimits="true"/>
  <option integrator="implicitfast"/>
  <default><default class="arm">
    <joint armature="0.1" damping="1" axis="0 0 1" range="-2.9 2.9"/>
    <general dyntype="none" biastype="affine" ctrlrange="-2.9 2.9" forcerange="-87 87"/>
    <default class="finger"><joint axis="0 1 0" type="slide" range="0 0.04"/></default>
    <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>
  </default></default>
  <asset><material class="arm" name="white" rgba="1 1 1 1"/><mesh file="link1.obj"/></asset>
  <worldbody><light pos="0 0 2" mode="trackcom"/>
    <body name="link0" childclass="arm">
      <inertial mass="0.6" pos="0 0 0.05" fullinertia="0.003 0.004 0.004 1e-7 1e-4 8e-6"/>
      <geom mesh="link1" material="white" class="visual"/>
      <body name="link1" pos="0 0 0.3" quat="1 -1 0 0">
        <inertial mass="5" pos="0 0 -0.05" fullinertia="0.70 0.71 0.02 -1e-4 7e-3 2e-2"/>
        <joint name="joint1"/><geom mesh="link1" class="visual"/>
        <body name="hand" quat="0.92 0 0 -0.38">
          <inertial mass="0.7" pos="0 0 0.03" diaginertia="0.001 0.0025 0.0017"/>
          <body name="left"><inertial mass="0.015" pos="0 0 0" diaginertia="2e-6 2e-6 7e-7"/>
            <joint name="finger1" class="finger"/></body>
          <body name="right" quat="0 0 0 1">
            <inertial mass="0.015" pos="0 0 0" diaginertia="2e-6 2e-6 7e-7"/>
            <joint name="finger2" class="finger"/></body>
        </body></body></body>
  </worldbody>
  <contact><exclude body1="link1" body2="hand"/></contact>
  <tendon><fixed name="split"><joint joint="finger1" coef="0.5"/>
    <joint joint="finger2" coef="0.5"/></fixed></tendon>
  <equality><joint joint1="finger1" joint2="finger2"/></equality>
  <actuator>
    <general class="arm" name="actuator1" joint="joint1" gainprm="4500" biasprm="0 -4500 -450"/>
    <general class="arm" name="actuator8" tendon="split" ctrlrange="0 255" gainprm="0.0157 0 0"
      biasprm="0 -100 -10"/>
  </actuator>
  <keyframe><key name="home" qpos="0 0.04 0.04" ctrl="0 255"/></keyframe>
</mujoco>
"""


def test_a_file_in_the_style_of_the_menagerie(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(MENAGERIE)
    with pytest.raises(BadRobot, match="--lock finger1,finger2"):
        load_robot_model(str(path))
    robot = load_robot_model(str(path), joints=["joint1"])
    assert {f.code for f in robot.findings} == {"mesh_missing", "servo"}
    assert robot.limits.tolist() == [87]
    values = identified(robot)
    out, mj = exported(tmp_path, robot, values)
    assert (mj.nu, mj.ntendon, mj.neq, mj.nkey) == (1, 0, 0, 0)
    assert difference(mj, robot, values) < 1e-10
    assert "Joints fixed: finger1, finger2." in out.read_text()


def test_names_of_the_engines_own_do_no_harm(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(
        robot(
            link("base", mass=""),
            link("universe"),
            link("world"),
            joint("world", "base", "universe"),
            joint("base", "universe", "world"),
        )
    )
    model = load_robot_model(str(path))
    values = identified(model)
    _, mj = exported(tmp_path, model, values)
    assert difference(mj, model, values) < 1e-10


NAMES = ["universe", "world", "a---b", "a---><link name='evil'/>", 'a"<&>--']


@pytest.mark.parametrize("name", NAMES)
def test_names_are_data_in_an_mjcf(tmp_path, name):
    path, quoted = tmp_path / "arm.xml", quoteattr(name)
    sensor = f"<sensor><jointpos joint={quoted}/></sensor>"
    path.write_text(arm(more=sensor).replace('"elbow"', quoted))
    model = load_robot_model(str(path))
    out, mj = exported(tmp_path, model, identified(model))
    assert difference(mj, model, identified(model)) < 1e-10
    assert mj.sensor_objid.tolist() == [1]
    assert sorted(mj.actuator_trnid[:, 0]) == [0, 1, 2]
    assert not list(ElementTree.parse(out).iter("link"))


@pytest.mark.parametrize("name", NAMES[1:])
def test_names_are_data_in_a_urdf(tmp_path, name):
    path, out = tmp_path / "arm.urdf", tmp_path / "calibrated.urdf"
    path.write_text(chain().replace('"joint_2"', quoteattr(name)))
    model = load_robot_model(str(path))
    write_urdf(model, identified(model), out)
    again = load_robot_model(str(out))
    assert again.joints == model.joints == ("joint_1", name, "joint_3")
    assert len(ElementTree.parse(out).findall("link")) == len(
        ElementTree.parse(path).findall("link")
    )


def test_limits_of_a_urdf_are_kept(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(chain())
    model = load_robot_model(str(path))
    _, mj = exported(tmp_path, model, identified(model))
    assert mj.jnt_range.tolist() == [[-2, 2]] * 3
    assert mj.actuator_ctrlrange.tolist() == [[-30, 30]] * 3


def test_a_replaced_servo_is_told(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(arm(actuator=SERVO))
    robot = load_robot_model(str(path))
    out, _ = exported(tmp_path, robot, identified(robot))
    text = out.read_text()
    assert "Servos replaced by motors: wrist." in text
    assert "mass of link_2" in text


def test_the_users_own_file_stays(tmp_path):
    inside = '<!-- a tool --><site name="tool0" pos="0 0 .1" euler="10 20 30"/>'
    second = '<motor name="second" joint="elbow" ctrlrange="-1 1"/>'
    (tmp_path / "arm.xml").write_text(arm(inside=inside, actuator=SERVO + second))
    (tmp_path / "scene.xml").write_text(
        '<!-- above --><mujoco model="scene"><!-- within --><include file="arm.xml"/>'
        '<worldbody><light pos="0 0 2"/></worldbody></mujoco>'
    )
    robot = load_robot_model(str(tmp_path / "scene.xml"))
    values = identified(robot)
    out, mj = exported(tmp_path, robot, values)
    assert difference(mj, robot, values) < 1e-10
    assert {mj.actuator(i).name for i in range(mj.nu)} == {"m1", "m2", "second", "wrist"}
    assert mj.actuator("second").gainprm[0] == 1
    text = out.read_text()
    for kept in ("<!-- above -->", "<!-- within -->", inside, '<light pos="0 0 2"/>', "<default"):
        assert kept in text
    assert "six digits" not in text


def test_elements_for_several_bodies_are_written_out(tmp_path):
    path = tmp_path / "arm.xml"
    copies = '<replicate count="2" offset="0 0 .1"><geom name="g" size="0.02"/></replicate>'
    path.write_text(
        arm(inside=f'<replicate count="2" offset="0 .1 0"><body>{copies}</body></replicate>')
    )
    robot = load_robot_model(str(path))
    values = identified(robot)
    out, mj = exported(tmp_path, robot, values)
    assert mj.nbody == 6
    assert difference(mj, robot, values) < 1e-5
    assert "six digits" in out.read_text()
