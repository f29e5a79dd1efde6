"""Where contacts act, and W without their forces: against Pinocchio's Jacobians and dynamics."""

from __future__ import annotations

import numpy as np
import pytest

from nsaid_mj.base import pin
from nsaid_mj.core import ContactPoint, Elimination, contact_jacobians
from nsaid_mj.robots import links_of, load_robot

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
    return model, contacts, links_of(model)


def states(system, count=20):
    rng = np.random.default_rng(1)
    return np.array([system.random_state(rng)[0] for _ in range(count)])


def test_jacobians_are_pinocchios_at_the_lowest_point_of_a_round_foot(walker):
    model, contacts, system = walker
    data = model.createData()
    q = states(system)
    J, _ = contact_jacobians(system.structure, contacts, q)
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
    J, _ = contact_jacobians(system.structure, flat, q)
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
    J, _ = contact_jacobians(system.structure, contacts, q)
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
