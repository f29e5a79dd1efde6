"""Where contacts act, and W without their forces: against Pinocchio's Jacobians and dynamics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nsaid_mj.base import InvalidInput, pin
from nsaid_mj.core import ContactPoint, Elimination, JointTree, Log
from nsaid_mj.core.nullspace.ground import random_states
from nsaid_mj.core.structure.contacts import balanced_rows, contact_accelerations
from nsaid_mj.robots import load_robot

RADIUS = 0.02


@pytest.fixture(scope="module")
def walker():
    """A quadruped of 12 joints on a floating base, its feet, its system and its model."""
    model = load_robot("solo12", "free").model
    feet = [frame for frame in model.frames if frame.name.endswith("_FOOT")]
    contacts = [
        ContactPoint(foot.parentJoint - 1, foot.placement.translation, RADIUS, name=foot.name)
        for foot in feet
    ]
    return model, contacts, JointTree.links(model)


def on_the_ground(system, contacts):
    return system.rebuilt(replace(system.structure, contacts=tuple(contacts)), system.space)


def physical(system):
    """(p,) 1 for the masses and moments of inertia of links, a little for all else."""
    return np.array(
        [
            1.0 if name[:3] in ("Ixx", "Iyy", "Izz") or name[0] == "m" else 0.05
            for name in system.space.names
        ]
    )


def states(system, count=20):
    rng = np.random.default_rng(1)
    return np.array([system.random_state(rng)[0] for _ in range(count)])


def test_jacobians_are_pinocchios_at_the_lowest_point_of_a_round_foot(walker):
    model, contacts, system = walker
    data = model.createData()
    q = states(system)
    J, _ = system.contact_jacobians(contacts, q)
    for k, row in enumerate(q):
        pin.computeJointJacobians(model, data, row)
        pin.updateFramePlacements(model, data)
        turn = pin.XYZQUATToSE3(row[:7]).rotation
        for i, contact in enumerate(contacts):
            frame = model.getFrameId(contact.name)
            whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            lowest = whole[:3] - pin.skew(np.array([0.0, 0.0, -RADIUS])) @ whole[3:]
            np.testing.assert_allclose(J[k, 3 * i : 3 * i + 3], turn.T @ lowest, atol=1e-12)


def test_a_flat_foot_adds_the_rows_of_its_rotation(walker):
    model, contacts, system = walker
    flat = [ContactPoint(contacts[0].body, contacts[0].centre, flat=True)]
    q = states(system, 1)
    J, _ = system.contact_jacobians(flat, q)
    data = model.createData()
    pin.computeJointJacobians(model, data, q[0])
    pin.updateFramePlacements(model, data)
    frame = model.getFrameId(contacts[0].name)
    whole = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
    turn = pin.XYZQUATToSE3(q[0, :7]).rotation
    np.testing.assert_allclose(
        J[0], np.vstack([turn.T @ whole[:3], turn.T @ whole[3:]]), atol=1e-12
    )


def test_no_contact_force_is_left_and_the_estimate_is_that_force(walker):
    _, contacts, system = walker
    rng = np.random.default_rng(2)
    q = states(system)
    touching = rng.random((len(q), len(contacts))) < 0.5
    found = Elimination(system.structure, contacts, q, touching)
    J, _ = system.contact_jacobians(contacts, q)
    force = rng.standard_normal((len(q), 12, 1)) * np.repeat(touching, 3, axis=1)[:, :, None]
    effect = np.swapaxes(J, 1, 2) @ force
    np.testing.assert_allclose(found.E @ effect, 0.0, atol=1e-8)
    np.testing.assert_allclose(found.to_force @ effect, force, atol=1e-6)


def test_rows_of_a_leg_in_the_air_are_kept(walker):
    _, contacts, system = walker
    q = states(system)
    touching = np.ones((len(q), 4), dtype=bool)
    touching[:, 0] = False
    E = Elimination(system.structure, contacts, q, touching).E
    np.testing.assert_allclose(E[:, 6:9], np.eye(18)[None, 6:9].repeat(len(q), 0), atol=1e-12)


def test_the_rate_of_the_elimination_is_that_along_the_velocity(walker):
    _, contacts, system = walker
    contacts = [*contacts[:2], ContactPoint(contacts[2].body, contacts[2].centre, flat=True)]
    rng = np.random.default_rng(3)
    q = states(system, 5)
    v = rng.standard_normal((5, system.n))
    level = np.ones(system.n)
    step = 1e-6

    def moved(sign):
        return np.array([system.integrate(*pair) for pair in zip(q, sign * step * v, strict=True)])

    def E(positions):
        return Elimination(system.structure, contacts, positions, weights=level).E

    rate = Elimination(system.structure, contacts, q, weights=level, v=v).rate
    differences = (E(moved(1)) - E(moved(-1))) / (2 * step)
    np.testing.assert_allclose(rate, differences, atol=1e-7 * np.abs(rate).max())


def test_a_contacts_acceleration_is_the_rate_of_its_velocity(walker):
    _, contacts, system = walker
    point = [ContactPoint(contacts[0].body, contacts[0].centre)]  # a round foot's point rolls on
    rng = np.random.default_rng(4)
    q = states(system, 1)
    v, a = rng.standard_normal((2, system.n))
    step = 1e-6

    def velocity(sign):  # in the world's axes
        there = system.integrate(q[0], sign * step * v)
        J, _ = system.contact_jacobians(point, there[None])
        return pin.XYZQUATToSE3(there[:7]).rotation @ (J[0] @ (v + sign * step * a))

    J, _ = system.contact_jacobians(point, q)
    drift = contact_accelerations(system.structure, point, q, v[None])
    world = pin.XYZQUATToSE3(q[0, :7]).rotation @ (J[0] @ a + drift[0])
    np.testing.assert_allclose(world, (velocity(1) - velocity(-1)) / (2 * step), atol=1e-7)


def test_the_balance_of_momentum_does_not_see_the_contacts(walker):
    """d/dt (E W_M θ) = (Ė W_M + E Ψ) θ under any λ, and at rest and in flight alike."""
    _, contacts, links = walker
    system = on_the_ground(links, contacts)
    rng = np.random.default_rng(5)
    theta = system.space.scale * rng.uniform(0.5, 1.0, system.p) * physical(system)
    touching = np.ones((6, len(contacts)), dtype=bool)
    here = random_states(system, theta, rng, touching, standing=False)
    step = 1e-6
    momenta = []
    for sign in (1, -1):
        q = [system.integrate(*pair) for pair in zip(here.q, sign * step * here.v, strict=True)]
        v = here.v + sign * step * here.a
        pairs = zip(q, v, strict=True)
        momenta.append(np.array([system.momentum(*pair) @ theta for pair in pairs]))
    t = np.arange(7.0)
    q, v, u = (np.concatenate([part, part[-1:]]) for part in here[:3])
    terms = system.momentum_balance(0.0, Log.unchecked(t, q, v, u), here.q, here.v)
    rate = (momenta[0] - momenta[1]) / (2 * step)
    size = np.abs(rate).max()
    for drive in terms[1:3]:
        np.testing.assert_allclose(drive @ theta, rate, atol=1e-6 * size)
    assert np.abs(rate[:, :6]).max() == size and not terms[0][:, 6:].any()
    with_forces = links.momentum_balance(0.0, Log.unchecked(t, q, v, u), here.q, here.v)[1]
    assert np.abs(with_forces @ theta - rate).max() > 0.1 * size


def test_only_rows_of_limbs_that_the_contacts_determine_hold_no_balance(walker):
    _, contacts, links = walker
    three = on_the_ground(links, contacts[1:])
    np.testing.assert_array_equal(np.flatnonzero(~balanced_rows(three.structure)), range(9, 18))
    flat = on_the_ground(links, [ContactPoint(contacts[0].body, contacts[0].centre, flat=True)])
    assert balanced_rows(flat.structure).all()


def test_a_contact_on_a_body_that_does_not_exist_is_refused(walker):
    _, _, links = walker
    with pytest.raises(InvalidInput, match=r"contacts\[0\].body"):
        on_the_ground(links, [ContactPoint(99, (0.0, 0.0, 0.0))])
