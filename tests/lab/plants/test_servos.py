"""Arms of position servos: the command is a target, the torque is kp (u − q)."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.core.structure.joints import JointTree
from nsaid_mj.lab.library import load
from nsaid_mj.lab.plants.arm import arm_spec, true_model
from nsaid_mj.lab.plants.jointed import ArmPlant
from nsaid_mj.lab.plants.world.faults.kinds import Loss
from nsaid_mj.lab.plants.world.mismatch import Mismatch
from nsaid_mj.lab.setup import Setup
from nsaid_mj.robots.errors import RobotChanged
from nsaid_mj.robots.loading import load_robot
from tests.support.vehicles import acceleration

ARM = load("servo_arm").plant


def test_a_servo_pulls_as_mujocos_own_position_actuator():
    """MuJoCo's `position` with the true kp on the same bodies, where nothing slides."""
    assert isinstance(ARM, ArmPlant)
    plant, rng = ARM.build(2e-3, 5), np.random.default_rng(0)
    assert isinstance(plant.system, JointTree)
    model = true_model(load_robot(ARM.robot).model, plant.truth)
    spec = arm_spec(model, plant.system, plant.truth, 2e-3)
    for actuator, kp in zip(spec.actuators, plant.truth[plant.system.space.actuators], strict=True):
        actuator.set_to_position(kp=kp)
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(20):
        q, u = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
        data.qpos[:], data.qvel[:], data.ctrl[:] = q, 0.0, u
        mujoco.mj_forward(model, data)
        found = acceleration(plant, q, np.zeros(3), u)
        assert np.abs(found - data.qacc).max() <= 1e-12 * np.abs(data.qacc).max()


@pytest.mark.parametrize("backend", ["compiled", "pinocchio"])
def test_w_theta_is_zero_with_either_backend(backend):
    plant = ArmPlant("servo_arm", actuator="servo", gain=8.0, backend=backend).build(2e-3, 1)
    system, rng = plant.system, np.random.default_rng(3)
    for _ in range(10):
        q, v, u = system.random_state(rng)
        a = acceleration(plant, q, v, u)
        W = system.regressor(0.0, np.r_[q, v], v, a, u)
        assert np.abs(W @ plant.truth).max() <= 1e-12 * np.abs(W * plant.truth).max()


def test_a_servos_loss_weakens_its_stiffness():
    config = ArmPlant("servo_arm", actuator="servo", gain=8.0)
    plant = config.build(2e-3, 1)
    q, u, still = np.array([0.3, -0.2, 0.4]), np.array([0.9, 0.1, -0.5]), np.zeros(3)
    before = acceleration(plant, q, still, u)
    lost = plant.failing([Loss(share=0.4, actuator=2, time=0.0)], config)
    after = acceleration(lost, q, still, u, as_at=1.0)
    M = plant.system.mass_matrix(np.r_[q, still], plant.truth)
    kp = plant.truth[plant.system.space.actuators]
    missing = M @ (before - after)
    assert missing == pytest.approx([0, 0.4 * kp[1] * (u - q)[1], 0], abs=1e-9)


@pytest.fixture
def file(tmp_path):
    """An arm as `nsaid identify` exports it, whose servos differ and one of which saturates."""
    path = tmp_path / "calibrated.xml"
    path.write_text("""<mujoco><worldbody>
<body><joint name="lift" axis="0 1 0" armature=".02" frictionloss=".1"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
<body pos=".3 0 0"><joint name="elbow" axis="0 1 0" armature=".01" frictionloss=".05"/>
<geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/></body></body></worldbody><actuator>
<position joint="lift" kp="12" kv=".6"/>
<position joint="elbow" kp="8" kv=".3" forcerange="-2 2"/></actuator></mujoco>""")
    return path


def test_servos_are_those_of_the_file(file):
    plant = ArmPlant(str(file), spread=0.0).build(1e-3, 0)
    theta, space = plant.truth, plant.system.space
    for block, numbers in {
        "servo gain": [12, 8],
        "viscous friction": [0.6, 0.3],
        "Coulomb friction": [0.1, 0.05],
        "rotor inertia": [0.02, 0.01],
    }.items():
        assert theta[space[block]] == pytest.approx(numbers)
    q, still = np.zeros(2), np.zeros(2)
    near, limit, beyond = (
        acceleration(plant, q, still, np.array([0, u])) for u in (0.2, 0.25, 1.0)
    )
    assert beyond == pytest.approx(limit, rel=1e-12) and np.abs(beyond - near).max() > 1
    motors = ArmPlant(str(file), actuator="motor").build(1e-3, 0)
    assert "motor gain" in {block.name for block, _ in motors.system.space}


@pytest.mark.parametrize("backend", ["compiled", "pinocchio"])
def test_w_theta_is_zero_where_a_servo_saturates(file, backend):
    plant = ArmPlant(str(file), backend=backend).build(1e-3, 0)
    q, v, u = np.array([0.3, 0.2]), np.array([0.5, -1.0]), np.array([0.1, 2.0])
    a = acceleration(plant, q, v, u)
    W = plant.system.regressor(0.0, np.r_[q, v], v, a, u)
    assert np.abs(W @ plant.truth).max() <= 1e-12 * np.abs(W * plant.truth).max()


def test_tracking_gives_servos_the_series_as_targets(file):
    """`nsaid run arm --robot calibrated.xml --law efficient`."""
    from dataclasses import replace

    scenario = replace(load("arm"), plant=ArmPlant(str(file)))
    driver = Setup.of(scenario).driver()
    t = np.linspace(0, 3, 7)
    targets = np.array(driver.compiled(t))
    q, v = driver.start()
    np.testing.assert_array_equal(targets[0], q)
    np.testing.assert_array_equal(targets[4], driver.command(t[4], q + 1, v))
    assert np.ptp(targets, axis=0).min() > 0.1


def test_targets_that_are_delayed_move_the_arm_later(file):
    """The servos hold the first target until then; a queue of zeros would pull them to 0."""
    from dataclasses import replace

    at = []
    for delay in (0.0, 0.05):
        plant = ArmPlant(str(file), mismatch=Mismatch(delay=delay))
        setup = Setup.of(replace(load("arm"), plant=plant, duration=2.0))
        with setup.plant.running():
            at.append(setup.simulate())
    steps = round(0.05 / setup.scenario.dt)
    np.testing.assert_allclose(at[1].u, at[0].u, atol=1e-12)
    assert np.abs(at[1].q[: steps + 1] - at[1].q[0]).max() < 0.05
    half = len(at[0].t) // 2  # after the motion has settled
    same = np.abs(at[1].q[half:] - at[0].q[half:]).max()
    later = np.abs(at[1].q[half:] - at[0].q[half - steps : -steps]).max()
    assert later < 0.2 * same


DELAYS = '<mujoco><custom><numeric name="target_delay" data=".012 .03"/></custom>'


def test_delays_of_a_file_are_simulated_and_identified(file, tmp_path):
    """The record's u is what acts; read as a log, its targets are as early as they were issued."""
    from dataclasses import replace

    from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
    from nsaid_mj.lab.loop import run

    scenario = replace(load("arm"), plant=ArmPlant(str(file), spread=0.0), duration=12.0, dt=2e-3)
    driver = Setup.of(replace(scenario, duration=1.0)).driver()
    issued = np.array([driver.command(t, np.zeros(2), np.zeros(2)) for t in 2e-3 * np.arange(6001)])
    file.write_text(file.read_text().replace("<mujoco>", DELAYS))
    law = replace(scenario.identifier, law="paper")
    done = run(replace(scenario, identifier=law), tmp_path / "run")
    every = scenario.record_every
    for k, steps in enumerate((6, 15)):
        late = np.r_[np.repeat(issued[:1, k], steps), issued[:-steps, k]]
        np.testing.assert_allclose(done.record["u"][:, k], late[::every], atol=1e-12)
    log = servo_logs(file, [tmp_path / "run"])
    assert log is not None
    found = identify_servos(log)
    assert [s.delay for s in found.servos] == pytest.approx([0.012, 0.03], abs=1e-3)
    assert [s.kp for s in found.servos] == pytest.approx([12, 8], rel=0.05)


def test_a_profile_of_a_file_is_simulated_and_applied_once(file, tmp_path):
    """The elbow's targets move at .4 rad/s at most, the lift's are smoothed over .05 s."""
    from dataclasses import replace

    from nsaid_mj.clinic.servos.export import write_servo_mjcf
    from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
    from nsaid_mj.lab.loop import run

    scenario = replace(load("arm"), plant=ArmPlant(str(file), spread=0.0), duration=12.0, dt=2e-3)
    profile = '<numeric name="target_profile" data="0 .4 0 0 .05 0"/></custom>'
    file.write_text(file.read_text().replace("<mujoco>", DELAYS.replace("</custom>", profile)))
    law = replace(scenario.identifier, law="paper")
    done = run(replace(scenario, identifier=law), tmp_path / "run")
    speed = np.abs(np.gradient(done.record["u"], done.record["t"], axis=0)).max(axis=0)
    assert speed[0] > 0.6 and speed[1] <= 0.4 + 1e-9
    log = servo_logs(file, [tmp_path / "run"])
    assert log is not None
    np.testing.assert_array_equal(log.logs[0].issued, log.logs[0].target)  # what acted
    found = identify_servos(log)
    assert [s.delay for s in found.servos] == pytest.approx([0.012, 0.03], abs=1e-3)
    assert [s.kp for s in found.servos] == pytest.approx([12, 8], rel=0.05)
    write_servo_mjcf(found, tmp_path / "again.xml")
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "again.xml"))
    np.testing.assert_allclose(mj.numeric("target_profile").data, [0, 0.4, 0, 0, 0.05, 0])


@pytest.mark.parametrize("delays", [".01", ".01 -.02", ".01 2"])
def test_delays_that_a_file_cannot_have_are_refused(file, delays):
    file.write_text(file.read_text().replace("<mujoco>", DELAYS.replace(".012 .03", delays)))
    with pytest.raises(InvalidInput, match="a delay from 0 to 1 s for each of 2 actuators"):
        ArmPlant(str(file)).build(1e-3, 0)


def test_an_arm_with_servos_on_some_joints_says_that_it_gets_motors(file):
    file.write_text(
        file.read_text().replace(
            '<position joint="lift" kp="12" kv=".6"/>', '<motor joint="lift"/>'
        )
    )
    with pytest.warns(RobotChanged, match="position or velocity servos"):
        plant = ArmPlant(str(file)).build(1e-3, 0)
    assert "motor gain" in {block.name for block, _ in plant.system.space}


def test_stiffnesses_are_found_from_targets_and_encoders(tmp_path):
    """Within 20 s, by the law `efficient` under noise: ratios of kp to one in a thousand."""
    from dataclasses import replace

    from nsaid_mj.lab.evaluation.truth import Truth
    from nsaid_mj.lab.loop import run
    from tests.support.summaries import summarize

    scenario = load("servo_arm")
    scenario = replace(
        scenario,
        duration=20.0,
        sensors="noisy",
        identifier=replace(scenario.identifier, law="efficient", gamma="scale"),
    )
    done = run(scenario, tmp_path)
    summary = summarize(done, Truth.of(done))
    assert summary["status"] == "completed" and summary["misfit"] == "none"
    assert summary["actuator_ratio_error"] <= 1e-3
    assert summary["confidence"]["covered"] >= 0.8
