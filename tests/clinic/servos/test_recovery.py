"""Known servos are found from logs of a simulated SO-101."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.servos.export import rollout, write_servo_mjcf
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs

from .simulated import ARMATURE, DELAY, JOINTS, KP, MODEL, SKEW, F, T, log, write

GRAVITY = (1, 2, 3)  # joints that lift the arm


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("servos")
    pushes = (None, (10.0, 14.0, 3.0), None)
    return [write(folder / f"motion_{k}.csv", *log(k, push=push)) for k, push in enumerate(pushes)]


@pytest.fixture(scope="module")
def given(files):
    found = servo_logs(MODEL, files)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def result(given):
    return identify_servos(given)


def truth(name, k):
    """The true value of a parameter of joint k; a joint read later sees a shorter delay."""
    return {
        "T": T[k],
        "f": F[k],
        "kp": KP[k],
        "a": ARMATURE / KP[k],
        "d": DELAY - SKEW * k,
        "armature": ARMATURE,
    }[name]


def test_servos_are_found(result):
    assert result.explains == "yes"
    assert not {"hidden_profile", "beyond_the_equation"} & {f.code for f in result.findings}
    for k, servo in enumerate(result.servos):
        assert servo.kv / servo.kp == pytest.approx(T[k], rel=0.15)
        assert servo.friction / servo.kp == pytest.approx(F[k], rel=0.1)
        assert servo.delay == pytest.approx(DELAY - SKEW * k, abs=2e-3)
    for k in GRAVITY:
        assert result.servos[k].gravity
        assert result.servos[k].kp == pytest.approx(KP[k], rel=0.05)


def test_intervals_hold(result):
    held = []
    for k in range(6):
        for p in result.parameters[6 * k : 6 * k + 6]:
            short = p.name.partition("_")[0]
            if short not in {"kp", "armature"} or result.servos[k].gravity:
                held.append(p.low <= truth(short, k) <= p.high)
    assert np.mean(held) >= 0.9


def test_a_joint_without_gravity_has_a_conventional_kp_and_says_so(result):
    roll = result.servos[4]
    told = [servo.kp for servo in result.servos if servo.gravity]
    assert not roll.gravity
    assert roll.kp == pytest.approx(np.exp(np.mean(np.log(told))))
    (note,) = [f for f in result.findings if f.code == "kp_convention"]
    assert "wrist_roll" in note.where and "shoulder_lift" not in note.where


@pytest.mark.usefixtures("no_profile_search")
def test_a_push_is_masked_and_nothing_else(result, files):
    assert 0.02 < result.masked < 0.08  # 4 of 120 s
    (finding,) = [f for f in result.findings if f.code == "foreign_force"]
    assert "motion_1" in finding.text and "motion_0" not in finding.text
    quiet = servo_logs(MODEL, [files[0], files[2]])
    assert quiet is not None
    assert identify_servos(quiet).masked == 0


@pytest.mark.usefixtures("no_profile_search")
def test_the_file_s_own_kp_does_not_matter(result, files, tmp_path):
    other = tmp_path / "arm.xml"
    other.write_text(MODEL.read_text().replace('kp="998.22"', 'kp="5"'))
    again = servo_logs(other, files)
    assert again is not None
    for a, b in zip(result.parameters, identify_servos(again).parameters, strict=True):
        assert a.value == pytest.approx(b.value, rel=0.03)


def by_hand(path, log, delays):
    """(N, 6) positions as the comment in the file asks for: plain MuJoCo, with late targets."""
    mj = mujoco.MjModel.from_xml_path(str(path))
    data, found, late = mujoco.MjData(mj), [log.position[0]], np.array(delays)
    data.qpos[:] = log.position[0]
    while data.time < log.t[-1] - log.t[0]:
        row = np.searchsorted(log.t, log.t[0] + data.time - late, side="right") - 1
        data.ctrl[:] = log.target[np.maximum(row, 0), np.arange(6)]
        mujoco.mj_step(mj, data)
        found.append(data.qpos.copy())
    steps = log.t[0] + np.arange(len(found)) * mj.opt.timestep
    return np.column_stack([np.interp(log.t, steps, q) for q in np.array(found).T])


def test_the_exported_file_follows_a_new_motion(result, given, tmp_path):
    path = tmp_path / "identified.xml"
    write_servo_mjcf(result, path)
    new = servo_logs(MODEL, [write(tmp_path / "new.csv", *log(9, 20.0))])
    assert new is not None
    delays = [servo.delay for servo in result.servos]
    own, before = (
        np.abs(rollout(file, JOINTS, new.logs[0]) - new.logs[0].position).mean()
        for file in (path, MODEL)
    )
    assert own < 1e-3
    assert before > 10e-3
    apart = np.abs(by_hand(path, new.logs[0], delays) - new.logs[0].position).mean()
    assert apart == pytest.approx(own, abs=0.5e-3)
    ours, theirs = (mujoco.MjModel.from_xml_path(str(p)) for p in (path, MODEL))
    for field in ("body_mass", "body_inertia", "body_pos", "jnt_range", "actuator_ctrlrange"):
        np.testing.assert_array_equal(getattr(ours, field), getattr(theirs, field))
    assert not ours.dof_damping.any()
    assert "shoulder_lift: delay 1" in path.read_text()


@pytest.mark.usefixtures("no_profile_search")
def test_targets_of_other_joints_explain_nothing(files, tmp_path):
    text = files[0].read_text().split("\n", 1)
    names = text[0].split(",")
    names[1:7] = names[2:7] + names[1:2]
    path = tmp_path / "swapped.csv"
    path.write_text(",".join(names) + "\n" + text[1])
    swapped = servo_logs(MODEL, [path])
    assert swapped is not None
    found = identify_servos(swapped)
    assert found.explains == "no"
    assert any(f.code == "no_better_than_simple" for f in found.findings)
