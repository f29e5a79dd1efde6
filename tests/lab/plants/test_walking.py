"""Robots that stand on feet: the ground's forces in MuJoCo, and what the structure knows."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from nsaid_mj import ArmPlant, Walk, WalkingPlant
from nsaid_mj.base import InvalidInput
from nsaid_mj.core import Nullspace
from nsaid_mj.lab.contacts import contact_forces, rows_along
from nsaid_mj.lab.library import load
from nsaid_mj.lab.loop import run
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots import BadRobot

SECONDS = 1.5


def steps_of(setup, seconds=SECONDS):
    """A log of the plant, and MuJoCo's upward force on every foot at each sample."""
    plant, driver = setup.plant, setup.driver()
    feet = [plant.model.geom(contact.name).id for contact in plant.system.structure.contacts]
    forces = []
    with plant.running():
        last = plant.begin(driver)
        rows = [last]
        for _ in range(round(seconds / setup.scenario.dt)):
            plant.step(last.u)
            t, coordinates, v = plant.t, *plant.coordinates()
            q = plant.position(coordinates)
            last = type(last)(t, q, v, driver.command(t, q, v))
            rows.append(last)
            plant.data.ctrl[:] = last.u
            mujoco.mj_forward(plant.model, plant.data)
            forces.append([upwards(plant, foot) for foot in feet])
    return rows, np.array(forces)


def upwards(plant, foot):
    wrench = np.zeros(6)
    total = 0.0
    for number in range(plant.data.ncon):
        contact = plant.data.contact[number]
        if foot in (contact.geom1, contact.geom2):
            mujoco.mj_contactForce(plant.model, plant.data, number, wrench)
            total += wrench[0]  # along the normal, which is vertical
    return total


@pytest.fixture(scope="module")
def setup():
    return Setup.of(load("quadruped"))


@pytest.fixture(scope="module")
def walked(setup):
    from nsaid_mj.core import Log

    rows, forces = steps_of(setup)
    return Log.unchecked_of(rows), forces


def test_the_structure_knows_the_feet_and_the_plant_stands_on_them(setup, walked):
    names = [contact.name for contact in setup.system.structure.contacts]
    assert names == ["FL_foot", "FR_foot", "RL_foot", "RR_foot"]
    weight = 9.81 * sum(setup.plant.truth[10 * b] for b in range(13))
    assert walked[1][50:].sum(axis=1).mean() == pytest.approx(weight, rel=0.03)


def test_the_true_parameters_balance_what_is_left_without_the_contacts(setup, walked):
    log, _ = walked
    theta = setup.plant.truth
    rows = np.arange(100, len(log.t) - 1)
    W = rows_along(setup.system, log, rows, log.v[rows], np.broadcast_to(theta, (len(rows), 178)))
    effort = W[:, :, setup.system.space.actuators] @ theta[setup.system.space.actuators]
    residual = np.sqrt(np.mean((W @ theta) ** 2) / np.mean(effort**2))
    assert residual < 0.01
    wrong = setup.prior
    assert np.sqrt(np.mean((W @ wrong) ** 2) / np.mean(effort**2)) > 5 * residual


def test_implied_forces_are_those_of_the_simulation(setup, walked):
    log, forces = walked
    rows = np.arange(100, len(log.t) - 1)
    implied = contact_forces(setup.system, log, rows, setup.plant.truth).upwards
    error = np.median(np.abs(implied - forces[rows - 1]), axis=0)
    assert (error < 0.02 * forces.mean(axis=0)).all()


def scales(name):
    """The common scales among the unobservable directions of a scenario."""
    setup = Setup.of(load(name))
    found = Nullspace.structural(setup.system, setup.plant.truth, np.random.default_rng(0))
    words = [direction.words for direction in found.directions(setup.system.space)]
    return [each for each in words if each.startswith("common scale")]


def test_on_a_stand_every_leg_has_a_scale_and_on_the_ground_there_is_one():
    assert len(scales("quadruped_stand")) == 4
    assert len(scales("quadruped")) == 1


def test_other_robots_walk_too():
    plant = WalkingPlant("solo12", feet="_FOOT", foot_radius=0.012).build(2e-3, 1)
    assert len(plant.system.structure.contacts) == 4


def test_a_biped_stands_on_flat_feet_whose_wrenches_nobody_measures():
    setup = Setup.of(load("biped"))
    rows, forces = steps_of(setup, 0.3)
    assert [contact.rows for contact in setup.system.structure.contacts] == [6, 6]
    weight = 9.81 * sum(setup.plant.truth[10 * b] for b in range(13))
    assert forces[50:].sum(axis=1).mean() == pytest.approx(weight, rel=0.05)
    assert rows[-1].q[2] > 0.95 * rows[0].q[2]
    assert len(scales("biped")) == 1


def test_a_robot_without_such_feet_is_refused():
    with pytest.raises(BadRobot, match="no moving link's name ends in '_paw'"):
        WalkingPlant(feet="_paw").build(2e-3, 0)


def test_nothing_walks_without_feet():
    plant = ArmPlant("double_pendulum").build(1e-3, 0)
    with pytest.raises(InvalidInput, match="a robot that stands on feet"):
        Walk(stance=(0.0,)).build(plant.system, plant.truth, np.random.default_rng(0))


def test_a_stance_has_as_many_joints_as_a_leg(setup):
    with pytest.raises(InvalidInput, match="positions of all 12 joints, or of those of one leg"):
        Walk(stance=(0.0,) * 5).build(setup.system, setup.prior, np.random.default_rng(0))


def fallen(seed, prior, error, name="quadruped"):
    """Whether the base of a scenario's robot tilts by more than 35° in a minute."""
    setup = Setup.of(replace(load(name), seed=seed, prior=prior, initial_error=error))
    with setup.plant.running():
        log = setup.simulate()
    upright = 1 - 2 * (log.q[:, 3] ** 2 + log.q[:, 4] ** 2)
    return len(log.t) <= setup.scenario.steps or upright.min() < np.cos(np.radians(35))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_it_never_falls_with_masses_that_nobody_told_its_controller(seed):
    assert not fallen(seed, "nominal", 0.2)
    assert not fallen(seed, "drawn", 0.3)
    assert not fallen(seed, "drawn", 0.3, "biped")


@pytest.mark.slow
@pytest.mark.parametrize("sensors", ["ideal", "noisy"])
def test_gains_are_found_while_it_walks(sensors, tmp_path):
    from nsaid_mj.lab.evaluation.run_evaluation import evaluate
    from nsaid_mj.lab.evaluation.truth import Truth

    finished = run(replace(load("quadruped"), sensors=sensors, seed=7), tmp_path / "run")
    result = evaluate(finished, Truth.of(finished))
    assert result.accuracy.actuator_ratio_error < 2e-3
    assert result.accuracy.force_residual_ratio < 5e-3
    assert result.accuracy.theta_perp_ratio < result.accuracy.theta_perp_ratio_initial
    assert result.confidence.covered >= 0.9
