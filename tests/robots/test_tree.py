"""The rigid tree of MuJoCo's model: the same mass matrix and bias forces."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.lab.plants.world.coordinates import JointMap
from nsaid_mj.robots import quiet
from nsaid_mj.robots.loading import load_robot, robot_file
from nsaid_mj.robots.tree import rigid_tree, tree_spec

TURNED = """
<mujoco model="turned">
  <option gravity="1 -2 -9"/>
  <compiler angle="degree" eulerseq="zyx"/>
  <worldbody>
    <body name="stand" pos="0.1 0.2 0.3" euler="10 20 30">
      <geom size="0.1" mass="3"/>
      <body name="one" pos="0.2 0 0.1" euler="-40 5 60">
        <joint name="a" axis="1 2 -1" pos="0.05 -0.1 0.02" armature="0.3" ref="25"/>
        <inertial pos="0.1 0.2 -0.3" mass="2" diaginertia="0.1 0.15 0.2" euler="30 40 50"/>
        <body name="welded" pos="0.3 0 0" euler="0 90 10">
          <inertial pos="0 0.1 0" mass="0.7" fullinertia="0.02 0.03 0.025 0.002 -0.003 0.001"/>
          <body name="two" pos="0 0 0.4" quat="0.5 0.5 -0.5 0.5">
            <joint name="b" type="slide" axis="0 1 1" pos="1 2 3" ref="0.2"/>
            <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0" euler="3 4 5" density="500"/>
            <body name="three" pos="0 0.3 0">
              <joint name="c" axis="0 0 1" pos="0.1 0 0"/>
              <joint name="d" type="slide" axis="1 0 0" armature="0.1"/>
              <joint name="e" axis="0 1 0.5" pos="0 0.2 0.1"/>
              <geom type="capsule" size="0.05 0.3" pos="0 0.1 0.1"/>
            </body>
          </body>
          <body name="branch" pos="0 -0.2 0"><joint axis="0 1 0"/><geom size="0.1"/></body>
        </body>
      </body>
    </body>
    <body name="other"><joint axis="1 0 0"/><geom size="0.2" pos="0 0 -0.4"/></body>
  </worldbody>
  <actuator><motor joint="a" gear="3" armature="0.02"/></actuator>
</mujoco>
"""
FLOATING = """
<mujoco>
  <worldbody>
    <body name="base" pos="0 0 1" euler="20 0 10">
      <freejoint name="root"/><geom type="box" size="0.2 0.1 0.05" pos="0.02 0 0.01"/>
      <body name="leg" pos="0.2 0 0">
        <joint name="hip" axis="0 1 0"/><geom type="capsule" size="0.03 0.2" pos="0 0 -0.2"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def difference(mj, seed=0):
    """The largest relative difference of M and bias at random states."""
    tree = rigid_tree(mj, "")
    data, theirs = tree.createData(), mujoco.MjData(mj)
    rng, worst = np.random.default_rng(seed), 0.0
    names = list(tree.names)[1:]
    for j, name in enumerate(names):  # nameless joints are found by their order
        assert mj.joint(j).name in {name, ""}
    free = mj.njnt and mj.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    for _ in range(4):
        v = rng.uniform(-2, 2, mj.nv)
        if free:
            joints = JointMap(mj, names)
            numbers = rng.uniform(-1, 1, mj.nv)
            joints.write(theirs, numbers, v)
            q = np.r_[numbers[:3], pin.Quaternion(pin.exp3(numbers[3:6])).coeffs(), numbers[6:]]
        else:
            q = theirs.qpos[:] = rng.uniform(-2, 2, mj.nq)
            theirs.qvel[:] = v
        mujoco.mj_forward(mj, theirs)
        if free:
            M, bias = joints.mass_matrix(mj, theirs), joints.bias(mj, theirs)
        else:
            M, bias = np.zeros((mj.nv, mj.nv)), theirs.qfrc_bias
            mujoco.mj_fullM(mj, theirs, M)
        ours = pin.crba(tree, data, q)
        ours = np.triu(ours) + np.triu(ours, 1).T
        worst = max(worst, np.abs(ours - M).max() / np.abs(M).max())
        nonlinear = pin.nonLinearEffects(tree, data, q, v)
        force = max(np.abs(bias).max(), np.abs(M).max())  # a balanced robot has no bias
        worst = max(worst, np.abs(nonlinear - bias).max() / force)
    return worst


@pytest.mark.parametrize("text", [TURNED, FLOATING], ids=["turned", "floating"])
def test_mass_matrix_and_bias_are_mujocos(text):
    assert difference(mujoco.MjModel.from_xml_string(text)) < 1e-10


@pytest.mark.parametrize("robot", ["ur5", "panda", "kinova"])
def test_a_tree_that_went_to_mujoco_comes_back(robot):
    there = load_robot(robot).model
    assert difference(tree_spec(there, 1e-3).compile()) < 1e-10


vectors = st.tuples(*[st.floats(-1, 1)] * 3)


@st.composite
def bodies(draw, depth=3):
    """A body with 0 … 2 joints and up to 2 children, as MJCF."""
    joints = ""
    for _ in range(draw(st.integers(1 if depth == 3 else 0, 2))):
        axis = [round(x, 3) for x in draw(vectors)]
        kind = draw(st.sampled_from(["hinge", "slide"]))
        joints += (
            f'<joint type="{kind}" axis="{axis[0]} {axis[1]} {axis[2] + 2}" '
            f'pos="{" ".join(f"{x:.3f}" for x in draw(vectors))}" '
            f'ref="{draw(st.floats(-1, 1)):.3f}" armature="{draw(st.floats(0, 0.2)):.3f}"/>'
        )
    children = ""
    if depth:
        children = "".join(draw(st.lists(bodies(depth=depth - 1), max_size=2)))
    place = " ".join(f"{x:.3f}" for x in draw(vectors))
    euler, centre = (" ".join(f"{x:.3f}" for x in draw(vectors)) for _ in range(2))
    return (
        f'<body pos="{place}" euler="{euler}">{joints}<geom type="box" size="0.1 0.2 0.3" '
        f'pos="{centre}" euler="{euler}" mass="{draw(st.floats(0.1, 5)):.3f}"/>{children}</body>'
    )


@settings(max_examples=40, deadline=None)
@given(bodies(), st.integers(0, 9))
def test_any_tree_is_the_same_in_both_engines(body, seed):
    text = f'<mujoco><compiler angle="radian"/><worldbody>{body}</worldbody></mujoco>'
    with quiet():  # light bodies: no MUJOCO_LOG.TXT
        assert difference(mujoco.MjModel.from_xml_string(text), seed) < 1e-10


@pytest.mark.parametrize(("name", "end"), [("so101", ".xml"), ("tx40", ".urdf"), ("ur5", ".urdf")])
def test_a_packed_robot_is_found_without_example_robot_data(name, end, monkeypatch):
    monkeypatch.setattr("nsaid_mj.robots.files.example_robots", dict)
    assert robot_file(name).path.suffix == end
