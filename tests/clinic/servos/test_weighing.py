"""A load of 200 g tells a servo arm's masses, stiffness and friction, whatever the file has."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.links import with_mass
from nsaid_mj.clinic.identify.loads import Load
from nsaid_mj.clinic.servos.export import write_servo_mjcf
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.joint_fits import Arm
from nsaid_mj.clinic.servos.logs import weighed, without_armature
from tests.support import menagerie
from tests.support.menagerie import HEAVY_ARM

from .simulated import KP, MODEL, PLACE, arm, log, write

HEAVIER, MASS = 1.3, 0.2
GRAVITY = (1, 2, 3)


def test_the_simulated_arm_is_heavier_and_carries_the_load():
    plain, heavy = arm(), arm(HEAVIER, MASS)
    assert heavy.body_subtreemass[0] == pytest.approx(HEAVIER * plain.body_subtreemass[0] + MASS)
    moments = heavy.body_inertia[1:7] / plain.body_inertia[1:7]
    np.testing.assert_allclose(moments[moments < 2], HEAVIER, rtol=1e-6)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("load")
    loads = {"free_0.csv": 0.0, "free_1.csv": 0.0, "loaded_0.csv": MASS, "loaded_1.csv": MASS}
    return [
        write(folder / name, *log(20 + k, 25.0, heavier=HEAVIER, load=load))
        for k, (name, load) in enumerate(loads.items())
    ]


LOADS = [Load("loaded_0.csv", MASS, "gripper"), Load("loaded_1.csv", MASS, "gripper")]


@pytest.fixture(scope="module")
def result(files):
    given = servo_logs(MODEL, files, loads=LOADS)
    assert given is not None
    return identify_servos(given)


def test_the_scale_is_found_and_covered(result):
    (scale,) = result.scale
    assert scale.value == pytest.approx(HEAVIER, rel=0.03)
    assert scale.low <= HEAVIER <= scale.high and scale.high / scale.low < 1.15


def test_stiffness_is_that_of_the_servos_and_not_of_the_file_s_masses(result):
    for k in GRAVITY:
        kp = result.parameters[6 * k + 2]
        assert result.servos[k].kp == pytest.approx(KP[k], rel=0.05)
        assert kp.low <= KP[k] <= kp.high and kp.status == "identified"


def test_the_place_of_the_load_is_told(result):
    (found,) = [f for f in result.findings if f.code == "weighed"]
    np.testing.assert_allclose(found.data["place"], PLACE, atol=0.015)


def test_a_load_anywhere_is_a_combination_of_those_at_ten_places(files):
    given = servo_logs(MODEL, files, loads=LOADS)
    assert given is not None
    parts = ("t", "position", "load", "mass")
    logs = [one._replace(**{k: getattr(one, k)[:50] for k in parts}) for one in given.logs]
    arm = Arm(given.robot, logs, LOADS[0], np.ones(6), np.ones(200))
    for mass, place in ((0.2, PLACE), (1.5, (-0.4, 0.3, 0.2))):
        heavy = with_mass(without_armature(given.robot.model), arm.joint, mass, np.array(place))
        for one, found in zip(logs, arm.logs(np.array([np.log(mass), *place])), strict=True):
            expected = weighed(heavy, one) if one.loaded else one
            np.testing.assert_allclose(found.load, expected.load, atol=1e-12)
            np.testing.assert_allclose(found.mass, expected.mass, atol=1e-12)


def test_the_exported_file_has_the_true_masses(result, tmp_path):
    write_servo_mjcf(result, tmp_path / "identified.xml")
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "identified.xml"))
    true = arm(HEAVIER).body_mass
    np.testing.assert_allclose(mj.body_mass, true, rtol=0.03)
    assert "by a weighed load" in (tmp_path / "identified.xml").read_text()


@pytest.mark.usefixtures("no_profile_search")
def test_without_a_load_the_file_s_masses_are_the_scale(files):
    given = servo_logs(MODEL, files[:2])
    assert given is not None
    found = identify_servos(given)
    assert found.scale == ()
    for k in GRAVITY:
        assert found.servos[k].kp == pytest.approx(KP[k] / HEAVIER, rel=0.05)


def test_two_different_loads_are_refused(files):
    loads = [LOADS[0], Load("loaded_1.csv", 0.3, "gripper")]
    with pytest.raises(InvalidInput, match="one load"):
        servo_logs(MODEL, files, loads=loads)


@pytest.mark.slow  # a load of a stiffer arm is weighed above
@pytest.mark.usefixtures("no_profile_search")
def test_joints_of_a_heavy_arm_that_shake_each_other_are_weighed(tmp_path):
    """250 g on soft servos: simulated one by one, the joints drive each other apart."""
    spec = mujoco.MjSpec.from_file(str(HEAVY_ARM.path))
    ball = {"mass": 0.25, "inertia": [9e-5] * 3, "explicitinertial": True}
    spec.bodies[-1].add_body(pos=[0.05, 0, 0.02], ipos=[0, 0, 0], **ball)
    spec.compile()
    carrying = tmp_path / "carrying.xml"
    carrying.write_text(spec.to_xml())
    robots = {"free": HEAVY_ARM, "loaded": HEAVY_ARM._replace(file=str(carrying))}
    files = [
        menagerie.write(tmp_path / f"{name}_{k}.csv", robot, *menagerie.log(robot, seed, 20.0))
        for seed, (name, k, robot) in enumerate(
            (name, k, robot) for name, robot in robots.items() for k in range(2)
        )
    ]
    loads = [Load(file.name, 0.25) for file in files[2:]]
    given = servo_logs(HEAVY_ARM.path, files, loads=loads)
    assert given is not None
    found = identify_servos(given)
    (scale,) = found.scale
    assert scale.value == pytest.approx(1.0, rel=0.03) and scale.low <= 1.0 <= scale.high
    assert max(servo.error for servo in found.servos) < HEAVY_ARM.tick
    for k, servo in enumerate(found.servos):
        *_, kp, _, _, rotor = found.parameters[6 * k : 6 * k + 6]
        if servo.gravity:
            assert kp.low <= HEAVY_ARM.kp[k] <= kp.high
            assert rotor.low <= HEAVY_ARM.armature[k] <= rotor.high
            assert rotor.high / rotor.low > 1.02  # its deviation is not that of a mere difference
