"""What is said of servos: every doubt is told where it is due, and only there."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.identify.loads import Load
from nsaid_mj.clinic.servos.estimate import JointEstimate, MassScale
from nsaid_mj.clinic.servos.export import write_servo_mjcf
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.clinic.servos.result import (
    gravity_notes,
    masses,
    parameters,
    servo,
    verdict,
    weighed,
)
from tests.support.servos import identified_servos

from .simulated import ARMATURE, DELAY, KP, MODEL, T, log, write

THETA = np.array([0.06, 0.02, 0.08, 2e-3, 0.015])


def joint(
    deviations=(0.05,) * 5, *, name="elbow", gravity=True, offset=0.0, error=2e-3, simple=20e-3
):
    """A servo of kp 12.5 N·m/rad whose ln θ have the given standard deviations."""
    covariance = np.diag(np.square(deviations))
    return JointEstimate(
        name, np.log(THETA), covariance, np.full(6, 2.0), gravity, offset, error, simple
    )


def status(joint, name, scale=None):
    (found,) = [p for p in parameters(1, joint, scale) if p.name == f"{name}_1"]
    return found.status


def test_a_slide_has_units_of_force_and_length():
    hinge, slide = (
        {p.name: p.unit for p in parameters(1, joint()._replace(slides=kind), None)}
        for kind in (False, True)
    )
    assert hinge["kp_1"] == "N·m/rad" and hinge["f_1"] == "rad" and hinge["armature_1"] == "kg·m²"
    assert slide["kp_1"] == "N/m" and slide["f_1"] == "m" and slide["armature_1"] == "kg"
    one = joint(error=15e-3)._replace(slides=True)
    _, sentence, _ = verdict([one])
    assert "error is 15.0 mm on" in sentence


def test_kp_is_a_convention_where_no_gravity_acts_and_only_there():
    known, free = joint(name="lift"), joint(name="pan", gravity=False)
    assert status(known, "kp") == "identified"
    assert status(free, "kp") == "only in combination"
    assert status(free, "f") == "identified"  # f/kp needs no gravity
    (note,) = gravity_notes([known, free])
    assert note.code == "kp_convention" and note.where == "pan"
    assert gravity_notes([known]) == ()


@pytest.mark.parametrize("offset,told", [(0.05, True), (-0.05, True), (0.01, False)])
def test_an_offset_that_kp_could_be_is_told_if_it_matters(offset, told):
    one = joint(offset=offset)
    notes = gravity_notes([one])
    assert [n.code for n in notes] == ["offset_trade"] * told


@pytest.mark.parametrize("name,at", [("T", 0), ("a", 3), ("d", 4)])
def test_damping_armature_and_delay_are_a_lag_where_the_motion_is_slow(name, at):
    wide = np.full(5, 0.05)
    wide[at] = 0.6
    found = {p.name: p for p in parameters(1, joint(wide), None)}
    assert found[f"{name}_1"].status == "only in combination"
    assert "kv/kp + delay: 75 ms" in found[f"{name}_1"].combination
    traded = {f"{name}_1"} | ({"armature_1"} if name == "a" else set())
    others = [p for p in found.values() if p.name not in traded]
    assert {p.status for p in others} == {"identified"} and not any(p.combination for p in others)


def test_a_rotor_that_may_be_nothing_may_be_delay():
    deviations = np.full(5, 0.05)
    deviations[3] = 0.3  # its square is not told from 0
    one = joint(deviations)
    T_, _, _, a, delay, _ = parameters(1, one, None)
    sure, _, _, _, plain, _ = parameters(1, joint(np.full(5, 0.05)), None)
    assert a.low == 0.0
    assert delay.high > plain.high and T_.low < sure.low


def test_the_lag_is_as_sure_as_the_sum_of_its_parts():
    one = joint()
    T_, d = THETA[0], THETA[4]
    covariance = one.covariance.copy()
    slope = np.array([1 / T_, -1 / d])  # a shorter damping for a longer delay
    covariance[np.ix_([0, 4], [0, 4])] += (0.02**2) * np.outer(slope, slope)
    (own, *_) = parameters(1, one._replace(covariance=covariance), None)
    assert own.status == "only in combination"
    assert own.combination.endswith("75 ms ± 6")


@pytest.mark.parametrize(
    "errors,explains", [((0.5, 0.5), "yes"), ((0.5, 0.9), "partly"), ((0.9, 0.9), "no")]
)
def test_a_model_that_a_late_target_equals_explains_nothing(errors, explains):
    joints = [joint(name=n, error=20e-3 * e) for n, e in zip("ab", errors, strict=True)]
    found, sentence, findings = verdict(joints)
    assert found == explains
    poor = [name for name, e in zip("ab", errors, strict=True) if e > 0.8]
    assert [f.where for f in findings if f.code == "no_better_than_simple"] == poor
    assert ("does not explain" in sentence) == (explains == "no")


def test_numbers_of_a_joint_that_stands_still_or_is_not_explained_mean_nothing():
    for own in (joint(error=18e-3), joint()._replace(travel=1e-3)):
        found = parameters(1, own, None)
        assert {p.status for p in found} == {"only in combination"}
        assert all(1e3 * p.low < p.value < 1e-3 * p.high for p in found)
    assert status(joint(), "T") == status(joint(), "kp") == "identified"


def test_a_joint_that_hardly_moves_is_not_judged():
    found, _, findings = verdict([joint(), joint(name="b", error=0.9e-3, simple=0.9e-3)])
    assert found == "yes" and [(f.code, f.where) for f in findings] == [("hardly_moved", "b")]


@pytest.mark.parametrize("deviation,level", [(0.03, "note"), (0.4, "warning")])
def test_a_load_that_hardly_shows_is_told(deviation, level):
    scale = MassScale(np.log(1.3), deviation, 2.0, np.array([0.01, 0, -0.09]), np.full(3, 0.01))
    finding = weighed(Load("a.csv", 0.2), "wrist_roll", scale)
    assert finding.level == level and "10 ± 20, 0 ± 20, -90 ± 20" in finding.text
    (one,) = masses(scale)
    assert (one.status == "identified") == (level == "note")
    assert one.low < 1.3 < one.high and masses(None) == ()


def test_a_scale_multiplies_forces_and_leaves_times_alone():
    scale = MassScale(np.log(1.3), 0.03, 2.0, np.zeros(3), np.zeros(3))
    plain, heavy = servo(joint(), None), servo(joint(), scale)
    for name in ("kp", "kv", "armature", "friction"):
        assert getattr(heavy, name) == pytest.approx(1.3 * getattr(plain, name))
    assert heavy.delay == plain.delay
    kp = parameters(1, joint((0.05, 0.05, 0.1, 0.05, 0.05)), scale)[2]
    assert kp.value == pytest.approx(1.3 * 12.5)
    assert np.log(kp.high / kp.value) == pytest.approx(0.2)


@pytest.mark.usefixtures("no_profile_search")
def test_a_slow_motion_tells_the_lag_and_no_delay(tmp_path):
    path = write(tmp_path / "slow.csv", *log(5, 24.0, speed=0.3))
    given = servo_logs(MODEL, [path])
    assert given is not None
    result = identify_servos(given)
    for k in (1, 2, 3):
        _, _, _, a, d, _ = result.parameters[6 * k : 6 * k + 6]
        assert d.status == "only in combination"
        assert a.low < ARMATURE / KP[k] < a.high
        text = d.combination.partition("delay: ")[2]
        lag, half = (float(x.replace("ms", "")) for x in text.split("±"))
        assert abs(lag - 1e3 * (T[k] + DELAY)) < max(half, 5.0)


def test_an_arm_in_an_included_file_is_exported_in_one(tmp_path):
    (tmp_path / "body.xml").write_text(
        """<mujoco><worldbody><body><joint name="lift" axis="0 1 0"/>
        <geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/><body pos=".3 0 0">
        <joint name="elbow" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/>
        </body></body></worldbody></mujoco>"""
    )
    (tmp_path / "arm.xml").write_text(
        """<mujoco><include file="body.xml"/><actuator><position joint="lift" kp="10"/>
        <position joint="elbow" kp="10"/></actuator></mujoco>"""
    )
    result = identified_servos(np.ones(10), tmp_path / "arm.xml")
    write_servo_mjcf(result, tmp_path / "identified.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "identified.xml"))
    kp = [servo.kp for servo in result.servos]
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], kp, rtol=1e-5)
    armature = [servo.armature for servo in result.servos]
    np.testing.assert_allclose(model.dof_armature, armature, rtol=1e-5)


def test_the_headline_names_the_one_thing_to_do_next():
    _, sentence, _ = verdict([joint()])
    assert "Next: log one more motion with a weighed load" in sentence
    assert "Next" not in verdict([joint()], loaded=True)[1]
    slow = joint(np.array([0.6, 0.05, 0.05, 0.05, 0.6]))
    assert "Next: record fast motion with sudden stops of elbow" in verdict([slow])[1]
    poor = joint(name="pan", error=18e-3)
    assert "Next: for pan: record faster motions" in verdict([poor, slow])[1]


def test_damping_and_delay_are_no_longer_than_their_sum():
    one = joint(np.array([1.2, 0.05, 0.05, 0.05, 1.2]))
    T_, d = one.theta[[0, 4]]
    against = np.array([1 / T_, -1 / d]) * 0.02  # a shorter damping for a longer delay
    one.covariance[np.ix_([0, 4], [0, 4])] = np.outer(against, against) + 1e-3 * np.eye(2)
    found = {p.name: p for p in parameters(1, one, None)}
    for name in ("T_1", "d_1"):
        assert found[name].low <= found[name].value < found[name].high < 1.3 * (T_ + d)


def test_where_gravity_does_not_tell_kp_ratios_are_said():
    found = {p.name: p for p in parameters(1, joint(gravity=False), None)}
    assert found["kp_1"].combination.startswith("gravity does not determine kp, but kv/kp = ")
