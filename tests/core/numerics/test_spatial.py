"""Poses and twists agree with Pinocchio's free flyer and satisfy their identities."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nsaid_mj.core.numerics import spatial
from tests.support import poses
from tests.support.strategies import seeds

FEW = settings(deadline=None, max_examples=60)
SIZES = [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 9.99e-3, 1e-2, 1.001e-2, 0.1, 1.0, 2.0, 3.0, np.pi - 1e-6]
sizes = st.sampled_from(SIZES) | st.floats(0, 3.1)
GROUPS = {3: 3, 6: 6, 0: 4, -6: 9}  # group → n; −6 stands for a twist with three joints
groups = st.sampled_from(list(GROUPS))
FLYER = pin.Model()
FLYER.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")


def unit(rng, n=3):
    vector = rng.standard_normal(n)
    return vector / np.linalg.norm(vector)


def pose(rng):
    return np.r_[rng.uniform(-5, 5, 3), unit(rng, 4)]


def twist(rng, angle):
    """(6,) tangent step that turns by `angle` [rad]."""
    return np.r_[rng.uniform(-2, 2, 3), angle * unit(rng)]


def near(one, other, tolerance):
    size = max(1.0, np.abs(one).max(), np.abs(other).max())
    assert np.abs(np.asarray(one) - other).max() <= tolerance * size


def same_pose(one, other, tolerance):
    """Equal poses; q and −q are one attitude."""
    near(one[:3], other[:3], tolerance)
    near(one[3:] * np.sign(one[3:] @ other[3:]), other[3:], tolerance)


# -- rotations ---------------------------------------------------------------------------------


@FEW
@given(seeds)
def test_a_quaternion_is_pinocchios_rotation(seed):
    rng = np.random.default_rng(seed)
    q, other, x, y = unit(rng, 4), unit(rng, 4), rng.standard_normal(3), rng.standard_normal(3)
    theirs = pin.Quaternion(q)  # coefficients x, y, z, w
    near(spatial.rotation(q), theirs.toRotationMatrix(), 1e-15)
    near(spatial.rotate(q, x), theirs.toRotationMatrix() @ x, 1e-15)
    near(spatial.unrotate(q, x), theirs.toRotationMatrix().T @ x, 1e-15)
    near(spatial.product(q, other), (theirs * pin.Quaternion(other)).coeffs(), 1e-15)
    near(spatial.cross(x, y), np.cross(x, y), 1e-15)
    assert abs(np.linalg.norm(spatial.product(2 * q, other)) - 1) <= 1e-15  # whatever drifts


@FEW
@given(seeds, sizes)
def test_a_rotation_vector_is_pinocchios_exponential(seed, angle):
    vector = angle * unit(np.random.default_rng(seed))
    q = spatial.quaternion_of(vector)
    assert abs(np.linalg.norm(q) - 1) <= 4e-16
    near(spatial.rotation(q), pin.exp3(vector), 2e-15)
    for sign in (1, -1):
        near(spatial.rotation_vector(sign * q), vector, 4e-15)
    if angle > 1e-300:  # small ones keep their digits
        np.testing.assert_allclose(
            spatial.rotation_vector(q), vector, rtol=1e-9, atol=1e-15 * angle
        )


@pytest.mark.parametrize("angle", [np.pi, np.nextafter(np.pi, 4), np.pi + 1e-9, 3.5, 6.0])
def test_a_turn_beyond_pi_gives_the_shorter_rotation_vector(angle):
    axis = np.array([0.6, 0.0, -0.8])
    short = spatial.rotation_vector(spatial.quaternion_of(angle * axis))
    assert np.linalg.norm(short) <= np.nextafter(np.pi, 4)
    near(pin.exp3(short), pin.exp3(angle * axis), 1e-14)
    if angle > np.pi + 1e-12:
        near(short, (angle - 2 * np.pi) * axis, 1e-14)


def test_nonfinite_input_gives_nonfinite_output():
    bad = np.array([np.nan, 0.0, 0.0])
    assert np.isnan(spatial.quaternion_of(bad)).any()
    assert np.isnan(spatial.rotation_vector(np.r_[bad, 1.0])).any()
    assert np.isnan(poses.pose_integrate(np.r_[0, 0, 0, 0, 0, 0, 1.0], np.r_[bad, bad])).any()
    assert np.isnan(poses.planar_difference(bad, np.zeros(3))).any()


# -- poses in space ----------------------------------------------------------------------------


@FEW
@given(seeds, sizes)
def test_integrate_and_difference_are_pinocchios_free_flyer(seed, angle):
    rng = np.random.default_rng(seed)
    q, step = pose(rng), twist(rng, angle)
    there = poses.pose_integrate(q, step)
    assert abs(np.linalg.norm(there[3:]) - 1) <= 4e-16
    # against 40 digits, ours is within 2e-15 and Pinocchio's within 8e-13, near 2e-4 rad
    same_pose(there, pin.integrate(FLYER, q, step), 2e-12)
    if angle < 3.1:  # Pinocchio's logarithm loses digits near π
        near(poses.pose_difference(q, there), pin.difference(FLYER, q, there), 1e-9)


@FEW
@given(seeds, sizes)
def test_integrate_inverts_difference(seed, angle):
    rng = np.random.default_rng(seed)
    q, step = pose(rng), twist(rng, angle)
    there = poses.pose_integrate(q, step)
    near(poses.pose_difference(q, there), step, 2e-14)
    near(poses.pose_difference(there, q), -step, 2e-14)
    same_pose(poses.pose_integrate(there, -step), q, 1e-14)
    halves = poses.pose_integrate(poses.pose_integrate(q, 0.5 * step), 0.5 * step)
    same_pose(halves, there, 1e-14)


@pytest.mark.parametrize("size", [1e-300, 1e-15, 1e-8, 1e-5, 1e-3])
def test_a_small_step_keeps_its_digits(size):
    """About the origin nothing is lost by cancellation: differences are right relative to size."""
    q = np.r_[np.zeros(3), unit(np.random.default_rng(1), 4)]
    step = size * np.array([1.0, -2.0, 0.5, 0.3, -0.7, 0.2])
    found = poses.pose_difference(q, poses.pose_integrate(q, step))
    np.testing.assert_allclose(found[:3], step[:3], rtol=1e-9 if size < 1e-9 else 1e-14)
    np.testing.assert_allclose(found[3:], step[3:], atol=3e-16)


@FEW
@given(seeds)
def test_difference_is_the_short_way_for_either_sign_of_the_quaternion(seed):
    rng = np.random.default_rng(seed)
    q0, q1 = pose(rng), pose(rng)
    step = poses.pose_difference(q0, q1)
    assert np.linalg.norm(step[3:]) <= np.pi * (1 + 1e-15)
    same_pose(poses.pose_integrate(q0, step), q1, 2e-14)
    flipped = [
        poses.pose_difference(np.r_[q0[:3], a * q0[3:]], np.r_[q1[:3], b * q1[3:]])
        for a, b in ((1, -1), (-1, 1), (-1, -1))
    ]
    for other in flipped:
        near(other, step, 1e-13)


@FEW
@given(seeds)
def test_a_zero_step_changes_nothing(seed):
    q = pose(np.random.default_rng(seed))
    near(poses.pose_integrate(q, np.zeros(6)), q, 4e-16)
    near(poses.pose_difference(q, q), np.zeros(6), 4e-16)


@FEW
@given(seeds)
def test_the_jacobian_is_the_rate_of_integrate(seed):
    rng, h = np.random.default_rng(seed), 1e-5
    q, v = pose(rng), rng.standard_normal(6)
    slope = (poses.pose_integrate(q, h * v) - poses.pose_integrate(q, -h * v)) / (2 * h)
    near(spatial.pose_jacobian(q) @ v, slope, 1e-9)
    assert abs(q[3:] @ (spatial.pose_jacobian(q) @ v)[3:]) <= 1e-15  # the quaternion stays unit


# -- poses in the plane ------------------------------------------------------------------------


def in_space(q):
    """The pose in space of one in the plane."""
    return np.r_[q[:2], 0, 0, 0, np.sin(q[2] / 2), np.cos(q[2] / 2)]


def flat(v):
    """The twist in space of one in the plane."""
    return np.r_[v[:2], 0, 0, 0, v[2]]


@FEW
@given(seeds, sizes, st.sampled_from([1, -1]))
def test_the_plane_is_a_part_of_space(seed, angle, sign):
    rng = np.random.default_rng(seed)
    q, step = rng.uniform(-3, 3, 3), np.r_[rng.uniform(-2, 2, 2), sign * angle]
    there = poses.planar_integrate(q, step)
    same_pose(in_space(there), poses.pose_integrate(in_space(q), flat(step)), 1e-14)
    assert there[2] == q[2] + step[2]  # the heading counts turns
    near(poses.planar_difference(q, there), step, 2e-14)
    near(poses.planar_difference(there, q), -step, 2e-14)


@FEW
@given(seeds, st.integers(-1000, 1000))
def test_a_heading_wraps_at_pi(seed, turns):
    rng = np.random.default_rng(seed)
    q0, q1 = rng.uniform(-3, 3, (2, 3))
    step = poses.planar_difference(q0, q1)
    assert abs(step[2]) <= np.pi
    near(poses.planar_difference(q0, q1 + np.array([0, 0, 2 * np.pi * turns])), step, 1e-11)
    near(poses.planar_integrate(q0, step)[:2], q1[:2], 1e-14)


def test_headings_across_pi_differ_by_the_short_way():
    q0, q1 = np.array([0, 0, np.pi - 0.01]), np.array([0, 0, -np.pi + 0.01])
    near(poses.planar_difference(q0, q1), [0, 0, 0.02], 1e-15)
    near(poses.planar_difference(q1, q0), [0, 0, -0.02], 1e-15)


@pytest.mark.parametrize("angle", [np.pi, -np.pi, np.pi - 1e-13])
def test_half_a_turn_in_the_plane_is_no_singularity(angle):
    q = np.array([1.0, 2.0, 0.3])
    there = poses.planar_integrate(q, np.array([0.5, -0.2, angle]))
    step = poses.planar_difference(q, there)
    near(poses.planar_integrate(q, step)[:2], there[:2], 1e-14)


# -- brackets ----------------------------------------------------------------------------------


def drawn(group, seed, count):
    """|group| and `count` velocities (n,)."""
    return abs(group), np.random.default_rng(seed).standard_normal((count, GROUPS[group]))


@FEW
@given(seeds)
def test_the_bracket_is_pinocchios(seed):
    a, b = np.random.default_rng(seed).standard_normal((2, 6))
    near(spatial.bracket(6, a, b), pin.Motion(a).cross(pin.Motion(b)).vector, 1e-15)


@FEW
@given(seeds)
def test_the_planar_bracket_is_the_spatial_one_in_the_plane(seed):
    a, b = np.random.default_rng(seed).standard_normal((2, 3))
    near(flat(spatial.bracket(3, a, b)), spatial.bracket(6, flat(a), flat(b)), 1e-15)


@FEW
@given(seeds, groups)
def test_the_bracket_is_antisymmetric_and_obeys_jacobi(seed, group):
    g, (a, b, c) = drawn(group, seed, 3)

    def bracket(x, y):
        return spatial.bracket(g, x, y)

    near(bracket(a, b), -bracket(b, a), 1e-15)
    near(
        bracket(a, bracket(b, c)) + bracket(b, bracket(c, a)) + bracket(c, bracket(a, b)),
        np.zeros(len(a)),
        1e-14,
    )
    assert (bracket(a, b)[g:] == 0).all()


@FEW
@given(seeds, st.sampled_from([3, 6]))
def test_the_bracket_is_what_two_steps_do_not_commute_by(seed, group):
    """a, b, −a, −b of size ε end [a, b] ε² away: the group that integrates is the bracket's."""
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((2, group))
    integrate, difference = (
        (poses.pose_integrate, poses.pose_difference)
        if group == 6
        else (poses.planar_integrate, poses.planar_difference)
    )
    start = np.r_[np.zeros(group // 2 if group == 6 else 3), [0, 0, 0, 1.0] if group == 6 else []]
    errors = []
    for size in (2e-2, 1e-2):
        q = start
        for step in (a, b, -a, -b):
            q = integrate(q, size * step)
        errors.append(difference(start, q) / size**2 - spatial.bracket(group, a, b))
    assert np.abs(errors[1]).max() <= 0.15 * (1 + np.abs(np.r_[a, b]).max()) ** 3
    near(2 * errors[1], errors[0], 0.02 * (1 + np.abs(np.r_[a, b]).max()) ** 4)  # of first order
