"""MuJoCo's frames and quaternion order are converted correctly.

The reference is MuJoCo's own kinematics (xpos, xquat, object velocities, its steps), the rotation
matrices built here, and the systems' own `difference`.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings

from nsaid_mj.core.numerics.spatial import quaternion_of, rotation
from nsaid_mj.lab.plants.world.coordinates import JointMap, LevelMap
from tests.support.poses import planar_difference, pose_difference
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=25)
DT = 1e-3

BODY = """<mujoco><option timestep="{dt}" integrator="RK4" gravity="0.3 -0.2 -9.81"/>
<worldbody><body name="other"><joint name="other" axis="1 1 0"/><geom size="0.2" mass="1"/></body>
<body name="body" pos="1 2 3"><freejoint name="pose"/>
<inertial pos="0.1 -0.2 0.05" mass="2" fullinertia="0.3 0.4 0.5 0.03 -0.02 0.04"/>
<body name="arm" pos="0.3 0 0.1"><joint name="far" axis="0 1 0.2"/>
<inertial pos="0.1 0 0" mass="0.7" diaginertia="0.01 0.02 0.02"/>
<body name="hand" pos="0.3 0 0"><joint name="slide" type="slide" axis="1 0 1"/>
<inertial pos="0 0.1 0" mass="0.4" diaginertia="0.01 0.02 0.02"/></body></body>
<body name="leg" pos="-0.3 0 0"><joint name="near" axis="0 0 1"/>
<inertial pos="0 0 -0.2" mass="0.5" diaginertia="0.01 0.02 0.015"/></body></body>
</worldbody></mujoco>"""
PLANE = """<mujoco><option timestep="{dt}" integrator="RK4"/><worldbody>
<body name="other"><joint name="other"/><geom size="0.2" mass="1"/></body>
<body name="body"><joint name="yaw_first" type="slide" axis="0 1 0"/>
<joint name="first" type="slide" axis="1 0 0"/><joint name="turn"/>
<inertial pos="0.3 0 0" mass="3" diaginertia="1 1 1.3"/></body></worldbody></mujoco>"""


@dataclass(frozen=True)
class Case:
    """A map, the model it reads, and the difference of the group its position numbers are of."""

    model: Any
    data: Any
    map: Any
    n: int

    def draw(self, seed: int):
        """(n,) position numbers, within the range where they are unique, and (n,) velocities."""
        rng = np.random.default_rng(seed)
        numbers, velocity = rng.uniform(-2, 2, (2, self.n))
        if self.n != 3:
            numbers[3:6] *= rng.uniform(0.1, np.pi - 1e-3) / np.linalg.norm(numbers[3:6])
        return numbers, velocity

    def difference(self, one, other):
        """(n,) the system's tangent step between position numbers."""
        if self.n == 3:
            return planar_difference(one, other)
        step = pose_difference(pose(one), pose(other))
        return np.r_[step, (other - one)[6:]]

    def put(self, numbers, velocity, push: float = 0.0):
        """Resets, writes and evaluates MuJoCo, under a constant force on every joint."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qfrc_applied[:] = push * np.sin(1 + np.arange(self.model.nv))
        self.map.write(self.data, numbers, velocity)
        mujoco.mj_forward(self.model, self.data)


def pose(numbers):
    return np.r_[numbers[:3], quaternion_of(np.ascontiguousarray(numbers[3:6]))]


@cache
def case(name: str) -> Case:
    model = mujoco.MjModel.from_xml_string((PLANE if name == "plane" else BODY).format(dt=DT))
    data = mujoco.MjData(model)
    if name == "plane":
        return Case(model, data, JointMap(model, ("first", "yaw_first", "turn"), planar=True), 3)
    if name == "pose":
        return Case(model, data, JointMap(model, ["pose"]), 6)
    return Case(model, data, JointMap(model, ["pose", "near", "slide", "far"]), 9)


maps = pytest.mark.parametrize("name", ["pose", "plane", "floating"])
spatial_maps = pytest.mark.parametrize("name", ["pose", "floating"])


# -- there and back ----------------------------------------------------------------------------


@maps
@FEW
@given(seeds)
def test_data_written_is_read_back_unchanged(name, seed):
    c = case(name)
    numbers, velocity = c.draw(seed)
    c.put(numbers, velocity)
    for given_, read in zip((numbers, velocity), c.map.read(c.data), strict=True):
        np.testing.assert_allclose(read, given_, rtol=0, atol=3e-15 * (1 + np.abs(given_).max()))


@maps
def test_writing_touches_nothing_else_and_reading_gives_copies(name):
    c = case(name)
    numbers, velocity = c.draw(1)
    kept = numbers.copy(), velocity.copy()
    c.put(numbers, velocity)
    assert c.data.qpos[0] == c.data.qvel[0] == 0  # the joint "other"
    first = [part.copy() for part in c.map.read(c.data)]
    for part in c.map.read(c.data):
        part[:] = 99.0
    c.map.acceleration(c.data)[:] = 99.0
    for part, same in zip(c.map.read(c.data), first, strict=True):
        assert (part == same).all()
    assert (numbers == kept[0]).all() and (velocity == kept[1]).all()


@spatial_maps
@pytest.mark.parametrize("angle", [np.pi, 4.0, 6.2])
def test_a_rotation_beyond_half_a_turn_is_read_as_the_same_attitude(name, angle):
    c = case(name)
    numbers, velocity = c.draw(2)
    numbers[3:6] *= angle / np.linalg.norm(numbers[3:6])
    c.put(numbers, velocity)
    read, v = c.map.read(c.data)
    assert np.abs(rotation(pose(read)[3:]) - rotation(pose(numbers)[3:])).max() <= 1e-14
    assert np.linalg.norm(read[3:6]) <= np.pi + 1e-12 and np.abs(v - velocity).max() <= 1e-14


@spatial_maps
def test_the_quaternions_sign_does_not_matter(name):
    c = case(name)
    numbers, velocity = c.draw(3)
    c.put(numbers, velocity, 1.0)
    before = [*c.map.read(c.data), c.map.acceleration(c.data)]
    at = c.model.joint("pose").qposadr[0]
    c.data.qpos[at + 3 : at + 7] *= -1
    mujoco.mj_forward(c.model, c.data)
    for one, other in zip(before, [*c.map.read(c.data), c.map.acceleration(c.data)], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


# -- frames ------------------------------------------------------------------------------------


def matrix(axis: int, angle: float):
    """A rotation about an axis of the world, written out."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i], R[i, j], R[j, i], R[j, j] = c, -s, s, c
    return R


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("angle", [0.4, -2.0])
def test_a_turn_about_one_axis_has_its_rotation_matrix(axis, angle):
    c = case("pose")
    numbers = np.r_[1.0, 2.0, 3.0, angle * np.eye(3)[axis]]
    c.put(numbers, np.r_[1.0, 0, 0, 0, 0, 0])
    R = matrix(axis, angle)
    body = c.data.body("body")
    np.testing.assert_allclose(body.xmat.reshape(3, 3), R, atol=1e-15)
    np.testing.assert_allclose(body.xpos, [1, 2, 3], atol=0)
    joint = c.data.joint("pose")
    np.testing.assert_allclose(joint.qvel[:3], R[:, 0], atol=1e-15)  # MuJoCo's is the world's
    half = np.r_[np.cos(angle / 2), np.sin(angle / 2) * np.eye(3)[axis]]
    np.testing.assert_allclose(joint.qpos[3:], half, atol=1e-15)  # w first
    c.map.place(c.data, np.r_[4, 5, 6, half[1:], half[0]])  # a system's pose, w last
    np.testing.assert_allclose(c.data.joint("pose").qpos, np.r_[4, 5, 6, half], atol=1e-15)


@maps
@FEW
@given(seeds)
def test_the_pose_and_twist_are_mujocos_body(name, seed):
    """MuJoCo's own xpos, xmat and object velocity, of the body's frame and not of its centre."""
    c = case(name)
    numbers, velocity = c.draw(seed)
    c.put(numbers, velocity)
    body, seen = c.data.body("body"), np.zeros(6)
    mujoco.mj_objectVelocity(
        c.model, c.data, mujoco.mjtObj.mjOBJ_XBODY, c.model.body("body").id, seen, 1
    )
    omega, v = seen[:3], seen[3:]
    R = body.xmat.reshape(3, 3)
    if name == "plane":
        np.testing.assert_allclose(R, matrix(2, numbers[2]), atol=1e-14)
        np.testing.assert_allclose(body.xpos[:2], numbers[:2], atol=1e-14)
        np.testing.assert_allclose([v[0], v[1], omega[2]], velocity, atol=1e-13)
    else:
        np.testing.assert_allclose(R, rotation(pose(numbers)[3:]), atol=1e-14)
        np.testing.assert_allclose(body.xpos, numbers[:3], atol=1e-14)
        np.testing.assert_allclose(np.r_[v, omega], velocity[:6], atol=1e-13)


def test_joints_are_mapped_by_name_not_by_order():
    c = case("floating")
    numbers, velocity = c.draw(4)
    c.put(numbers, velocity)
    for k, name in enumerate(["near", "slide", "far"], start=6):
        joint = c.data.joint(name)
        assert (joint.qpos[0], joint.qvel[0]) == (numbers[k], velocity[k])
        assert c.map.motors[k - 6] == c.model.joint(name).dofadr[0]
    assert c.map.reading.group == 6
    assert JointMap(c.model, ["near", "far"]).reading.group == 0


# -- rates -------------------------------------------------------------------------------------


@maps
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_the_velocity_is_the_rate_of_the_position(name, seed):
    """Over two of MuJoCo's steps q moves by Simpson's rule of v, on the group; order 4 in dt."""
    c, errors = case(name), []
    numbers, velocity = c.draw(seed)
    for dt in (4e-3, 2e-3):
        c.model.opt.timestep = dt
        c.put(numbers, velocity, 2.0)
        seen = [c.map.read(c.data)]
        for _ in range(2):
            mujoco.mj_step(c.model, c.data)
            seen.append(c.map.read(c.data))
        c.model.opt.timestep = DT
        q, v = zip(*seen, strict=True)
        rate = c.difference(q[0], q[2]) / (2 * dt)
        errors.append(np.abs(rate - (v[0] + 4 * v[1] + v[2]) / 6).max())
    # Simpson's rule takes the twists as commuting: [ξ, ξ̇] costs h², so 2 is what halving shows
    assert errors[0] < 1e-3 and errors[0] / errors[1] > 3.5, errors


@maps
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_the_acceleration_is_the_rate_of_the_velocity(name, seed):
    """v̇ of the system, not MuJoCo's qacc: central differences of what `read` gives, order 2."""
    c, errors = case(name), []
    numbers, velocity = c.draw(seed)
    for dt in (4e-3, 2e-3):
        c.put(numbers, velocity, 2.0)
        now = c.map.acceleration(c.data)
        ends = []
        for sign in (1, -1):  # backwards in time, too: MuJoCo integrates a step < 0 as well
            c.put(numbers, velocity, 2.0)
            c.model.opt.timestep = sign * dt
            mujoco.mj_step(c.model, c.data)
            c.model.opt.timestep = DT
            ends.append(c.map.read(c.data)[1])
        errors.append(np.abs((ends[0] - ends[1]) / (2 * dt) - now).max())
    assert np.abs(now).max() > 1
    assert errors[0] < 1e-2 * np.abs(now).max() and errors[0] / errors[1] > 3.5, errors


# -- M and bias of a floating tree ---------------------------------------------------------------


@pytest.mark.parametrize("seed", [8, 9])
def test_energy_and_power_are_the_same_in_both_coordinates(seed):
    """½ vᵀ M v is MuJoCo's kinetic energy, and M v̇ + bias does the work of the applied forces."""
    c = case("floating")
    numbers, velocity = c.draw(seed)
    c.put(numbers, velocity, 2.0)
    M, bias = c.map.mass_matrix(c.model, c.data), c.map.bias(c.model, c.data)
    mujoco.mj_energyVel(c.model, c.data)
    assert 0.5 * velocity @ M @ velocity == pytest.approx(c.data.energy[1], rel=1e-12)
    power = c.data.qfrc_applied[c.map.dof] @ c.data.qvel[c.map.dof]
    a = c.map.acceleration(c.data)
    assert velocity @ (M @ a + bias) == pytest.approx(power, rel=1e-10)
    np.testing.assert_allclose(M, M.T, rtol=1e-13, atol=1e-15)


# -- from above ----------------------------------------------------------------------------------


def level() -> Case:
    """A body seen from above; nothing can accelerate in these coordinates alone."""
    model = mujoco.MjModel.from_xml_string(BODY.format(dt=DT))
    return Case(model, mujoco.MjData(model), LevelMap(model, "pose"), 3)


@FEW
@given(seeds)
def test_the_planar_map_reads_what_it_writes_and_keeps_the_height(seed):
    c = level()
    numbers, velocity = c.draw(seed)
    c.put(numbers, velocity)
    for given_, read in zip((numbers, velocity), c.map.read(c.data), strict=True):
        np.testing.assert_allclose(read, given_, atol=1e-14)
    body = c.data.body("body")
    assert body.xpos[2] == 3.0
    np.testing.assert_allclose(body.xmat.reshape(3, 3), matrix(2, numbers[2]), atol=1e-14)


@FEW
@given(seeds)
def test_the_planar_velocity_is_the_rate_of_position_at_any_tilt(seed):
    rng = np.random.default_rng(seed)
    c, lean = level(), JointMap(level().model, ["pose"])
    numbers, twist = rng.uniform(-1, 1, (2, 6))
    ends = []
    for sign in (1, -1):
        mujoco.mj_resetData(c.model, c.data)
        lean.write(c.data, numbers, twist)
        found = c.map.read(c.data)[1]
        mujoco.mj_integratePos(c.model, c.data.qpos, c.data.qvel, sign * 1e-5)
        ends.append(c.map.read(c.data)[0])
    np.testing.assert_allclose(planar_difference(ends[1], ends[0]) / 2e-5, found, atol=1e-7)
