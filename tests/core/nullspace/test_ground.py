"""What contacts with unknown forces hide of θ, and what they reveal: ranks at random states."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import scipy

from nsaid_mj.core import ContactPoint
from nsaid_mj.core.nullspace.ground import ground_stack, random_states
from nsaid_mj.core.nullspace.subspace import Nullspace
from nsaid_mj.core.structure.contacts import contact_accelerations, contact_jacobians
from nsaid_mj.robots import load_robot
from tests.support.walkers import SOLE, biped, pushing_arm, quadruped

COUNT = 60  # states
LEGS = ("FL", "FR", "HL", "HR")


@cache
def on_ground(robot, touching="always", standing=False):
    """P_s of E W."""
    system, theta = robot()
    rng = np.random.default_rng(0)
    mask = np.ones((COUNT, len(system.structure.contacts)), dtype=bool)
    if touching == "at times":
        mask = rng.random(mask.shape) < 0.5
    elif touching == "never":
        mask[:] = False
    return Nullspace.of(ground_stack(system, theta, rng, mask, standing))


def scales(nullspace, space):
    """In how many independent ways the gains move inside P_s."""
    return np.linalg.matrix_rank(nullspace.P[space.actuators], tol=1e-6)


def ranks(robot, *arguments):
    found = on_ground(robot, *arguments)
    system, _ = robot()
    assert found.gap[0] > 1e-4 and found.gap[1] < 1e-12
    return system.p - found.r, scales(found, system.space)


def test_on_a_stand_each_leg_has_a_scale_and_on_the_ground_there_is_one():
    held, theta = quadruped(base="held")
    stand = Nullspace.structural(held, theta, np.random.default_rng(0))
    assert (held.p - stand.r, scales(stand, held.space)) == (104, 4)
    assert ranks(quadruped, "always", True) == (137, 1)
    assert ranks(quadruped, "at times", True) == (141, 1)
    assert ranks(quadruped, "never") == (141, 1)


def round_footed():
    return quadruped(0.02)


def test_a_round_foot_that_rolls_hides_nothing():
    assert ranks(round_footed, "always") == (141, 1)


def test_flat_feet_that_stand_keep_more_hidden_than_feet_that_walk():
    held, theta = biped("held")
    stand = Nullspace.structural(held, theta, np.random.default_rng(0))
    assert (held.p - stand.r, scales(stand, held.space)) == (114, 2)
    assert ranks(biped, "always", True) == (109, 1)
    assert ranks(biped, "at times", True) == (141, 1)
    assert ranks(biped, "always") == (121, 1)


def test_an_arm_that_pushes_a_wall_loses_the_mass_at_its_tip_alone():
    free, theta = pushing_arm(held=False)
    assert free.p - Nullspace.structural(free, theta, np.random.default_rng(0)).r == 57
    assert ranks(pushing_arm) == (56, 1)


def test_the_law_s_system_has_this_nullspace():
    system, theta = quadruped()
    found = Nullspace.structural(system, theta, np.random.default_rng(1))
    np.testing.assert_allclose(found.ratio(theta / system.space.scale), 0.0, atol=1e-10)
    assert system.p - found.r == 137


def within(nullspace, change, space):
    scaled = change / space.scale
    return np.linalg.norm(nullspace.P_perp.T @ scaled) / np.linalg.norm(scaled)


def test_a_point_foot_hides_a_mass_at_the_contact():
    system, _ = quadruped()
    found = on_ground(quadruped)
    for contact in system.structure.contacts:
        x, y, z = contact.centre
        change = np.zeros(system.p)
        start = 10 * contact.body
        moments = [y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y]
        change[start : start + 10] = [1.0, x, y, z, *moments]
        assert within(found, change, system.space) < 1e-10
        assert within(on_ground(quadruped, "at times"), change, system.space) > 0.1


@pytest.mark.parametrize("foot", (0, 1))
def test_a_flat_foot_hides_its_whole_link(foot):
    system, _ = biped()
    assert SOLE > 0
    found = on_ground(biped)
    start = 10 * system.structure.contacts[foot].body
    for change in np.eye(system.p)[start : start + 10]:
        assert within(found, change, system.space) < 1e-10
        assert within(on_ground(biped, "at times"), change, system.space) > 1e-3


def test_words_name_a_scale_for_each_leg_on_a_stand_and_one_on_the_ground():
    held, theta = quadruped(base="held")
    found = Nullspace.structural(held, theta, np.random.default_rng(0)).directions(held.space)
    words = [each.words for each in found if each.words.startswith("common scale")]
    legs = [f"of {leg}_HAA, {leg}_HFE and {leg}_KFE: " for leg in LEGS]
    assert len(words) == 4 and all(map(str.__contains__, words, legs))
    system, theta = quadruped()
    found = Nullspace.structural(system, theta, np.random.default_rng(0)).directions(system.space)
    words = [each.words for each in found if each.words.startswith("common scale")]
    assert len(words) == 1 and words[0].startswith("common scale of everything: ")


@pytest.mark.parametrize("standing", (False, True))
def test_random_states_obey_dynamics_and_contacts(standing):
    system, theta = quadruped()
    rng = np.random.default_rng(2)
    touching = rng.random((10, 4)) < 0.7
    q, v, u, a, force = random_states(system, theta, rng, touching, standing)
    structure = system.structure
    J, _ = contact_jacobians(structure, structure.contacts, q)
    W = system.regressor(np.zeros(10), np.hstack([q, v]), v, a, u)
    pushed = (np.swapaxes(J, 1, 2) @ force[:, :, None])[:, :, 0]
    np.testing.assert_allclose(W @ theta, pushed, atol=1e-8 * np.abs(pushed).max())
    mask = np.repeat(touching, 3, axis=1)
    assert not force[~mask].any() and force[mask].all()
    if standing:
        moving = (J @ v[:, :, None])[:, :, 0]
        drift = contact_accelerations(structure, structure.contacts, q, v)
        np.testing.assert_allclose(moving[mask], 0.0, atol=1e-9)
        accelerating = (J @ a[:, :, None])[:, :, 0] + drift
        np.testing.assert_allclose(accelerating[mask], 0.0, atol=1e-7)


# -- the theorem on scales, and Theorem 1 --------------------------------------------------------


def test_the_base_compares_its_legs():
    """Σ α_k s_k = 0 at all times only for equal α, of the base and of the legs."""
    system, theta = quadruped()
    rng = np.random.default_rng(3)
    touching = np.ones((COUNT, 4), dtype=bool)
    rows = ground_stack(system, theta, rng, touching, standing=True) / system.space.scale
    parts = np.zeros((5, system.p))
    for i, label in enumerate(system.space.labels):
        owner = label.partition(" of ")[2]
        leg = next((k for k, leg in enumerate(LEGS) if owner.startswith(leg)), -1)
        parts[leg + 1, i] = theta[i]
    found = Nullspace.of(rows @ parts.T)
    assert found.r == 1
    np.testing.assert_allclose(found.P[:, 0] / found.P[0, 0], 1.0, atol=1e-9)
    assert found.gap[0] > 1e-3


def test_theorem_1_holds_if_the_contacts_move_as_measured():
    system, theta = quadruped()
    rng = np.random.default_rng(4)
    touching = np.ones((1, 4), dtype=bool)
    q, v, u, a, _ = (part[0] for part in random_states(system, theta, rng, touching, False))
    estimate = theta * rng.uniform(0.9, 1.1, system.p)
    structure = system.structure
    J = contact_jacobians(structure, structure.contacts, q[None])[0][0]
    dv = (np.eye(system.n) - np.linalg.pinv(J) @ J) @ rng.standard_normal(system.n)
    x = np.r_[q, v]
    K = 20.0
    pushed = J.T @ rng.standard_normal(len(J))
    ahead = system.acceleration(0.0, x, v + dv, u, estimate)
    ahead = ahead + np.linalg.solve(system.mass_matrix(x, estimate), pushed)
    W = system.regressor(0.0, x, v + dv, ahead, u)
    M = system.mass_matrix(x, theta)
    forces = M @ (ahead - K * dv - a) + system.coriolis_matrix(x, theta) @ dv
    rate = dv @ (forces + W @ (estimate - theta))  # Ṁ − 2C is skew
    assert rate == pytest.approx(-K * dv @ M @ dv, rel=1e-9)
    assert abs(estimate @ W.T @ dv) < 1e-9 * np.abs(W * estimate).max()


def test_wheels_leave_the_balances_of_the_steering_axes_alone(tmp_path):
    inertial = '<inertial><mass value="1"/><inertia ixx="1e-3" iyy="2e-3" izz="1e-3" ixy="0" '
    inertial += 'ixz="0" iyz="0"/></inertial>'
    joint = '<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{0}_link"/>'
    joint += '<origin xyz="{2} {3} 0"/><axis xyz="{4}"/></joint><link name="{0}_link">{5}</link>'
    parts = f'<link name="car">{inertial}</link>'
    for k, (x, y) in enumerate([(0.15, 0.12), (0.15, -0.12), (-0.15, 0.12), (-0.15, -0.12)]):
        parent, at = "car", (x, y)
        if x > 0:
            parts += joint.format(f"steer{k}", "car", x, y, "0 0 1", inertial)
            parent, at = f"steer{k}_link", (0, 0)
        parts += joint.format(f"wheel{k}", parent, *at, "0 1 0", inertial)
    file = tmp_path / "car.urdf"
    file.write_text(f'<robot name="car">{parts}</robot>')
    robot = load_robot(str(file), "free")
    names = list(robot.model.names)[1:]
    wheels = [ContactPoint(names.index(f"wheel{k}"), np.zeros(3), 0.05) for k in range(4)]
    q = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 6 + len(robot.joints)))
    q[:, 3:5] = 0.0  # on level ground
    J = robot.system.contact_jacobians(wheels, robot.system.position(q))[0]
    left = scipy.linalg.null_space(J[0])
    assert np.linalg.matrix_rank(J).tolist() == 20 * [10]
    steering = [6 + k for k, name in enumerate(robot.joints) if name.startswith("steer")]
    assert np.abs(np.delete(left, steering, axis=0)).max() < 1e-9
