"""Controllers that limit or smooth targets: told in a map or a file, it is what servos follow."""

import mujoco
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.comparison import compare_servos
from nsaid_mj.clinic.logs.mapping import map_of
from nsaid_mj.clinic.servos.export import write_servo_mjcf
from nsaid_mj.clinic.servos.identify import identify_servos, servo_logs
from nsaid_mj.lab.target_profile import followed_targets

from .simulated import DELAY, JOINTS, KP, MODEL, SKEW, F, T, limited, log, smoothed, write

PROFILES = {"speed": (limited(1.0), {"speed": 1.0}), "lag": (smoothed(0.1), {"lag": 0.1})}


def test_a_profile_is_the_fastest_motion_within_its_limits():
    """A trapezoid of speed: .5 s to 1 rad/s at 2 rad/s², then the same to a stop, 2 rad away."""
    t = np.arange(0, 4, 0.01)
    target = np.where(t < 0.1, 0.0, 2.0)[:, None]
    found = followed_targets(t, target, np.array([[1.0, 2.0, 0.0]]))[:, 0]
    since = t + 0.005 - 0.1  # rows are means over the time to the next
    up, down = np.clip(since, 0, 0.5), np.clip(since - 2.0, 0, 0.5)
    exact = up**2 + np.clip(since - 0.5, 0, 1.5) + down - down**2
    np.testing.assert_allclose(found, exact, atol=3e-3)
    smooth = followed_targets(t, target, np.array([[0.0, 0.0, 0.2]]))[:, 0]
    exact = 2 - 2 * np.exp(-np.clip(since, 0, None) / 0.2)
    np.testing.assert_allclose(smooth, exact, atol=2e-3)
    assert followed_targets(t, target, np.zeros((1, 3))) is target


@pytest.fixture(scope="module", params=["speed", pytest.param("lag", marks=pytest.mark.slow)])
def case(request, tmp_path_factory):
    follow, told = PROFILES[request.param]
    folder = tmp_path_factory.mktemp(request.param)
    files = [write(folder / f"motion_{k}.csv", *log(60 + k, 20.0, follow=follow)) for k in range(2)]
    return folder, files, told


def test_servos_are_those_behind_a_profile_that_is_told(case):
    folder, files, told = case
    given = servo_logs(MODEL, files, map_of({"profile": told}))
    assert given is not None
    found = identify_servos(given)
    held = []
    for k, servo in enumerate(found.servos):
        true = T[k], F[k], DELAY - SKEW * k
        assert (servo.kv / servo.kp, servo.friction / servo.kp) == pytest.approx(true[:2], rel=0.15)
        assert servo.delay == pytest.approx(true[2], abs=2e-3)
        own = found.parameters[6 * k : 6 * k + 6]
        held += [own[i].low <= x <= own[i].high for i, x in zip((0, 1, 4), true, strict=True)]
    assert np.mean(held) >= 0.9
    path = folder / "identified.xml"
    write_servo_mjcf(found, path)
    plain = servo_logs(MODEL, files)  # the exported file states the profile for its own rollouts
    assert plain is not None
    for logs in (given, plain):
        own, before, _ = compare_servos(logs, [path, MODEL])
        assert np.mean(own.errors[-1]) < 1.5e-3 and np.mean(before.errors[-1]) > 5e-3
    again = servo_logs(path, files)
    assert again is not None
    np.testing.assert_allclose(again.logs[0].target, given.logs[0].target, atol=1e-9)


def test_a_profile_that_is_not_told_is_found_and_used(case):
    """Without it kv/kp is two to six times too large, in intervals of a few per cent."""
    _, files, told = case
    given = servo_logs(MODEL, files)
    assert given is not None
    result = identify_servos(given)
    (finding,) = [f for f in result.findings if f.code == "hidden_profile"]
    (name,) = told
    assert finding.level == "warning" and f"`{name} = " in finding.remedy
    assert finding.data[name] == pytest.approx(told[name], rel=0.03)
    held = []
    for k, servo in enumerate(result.servos):
        true = T[k], F[k], DELAY - SKEW * k
        assert servo.kv / servo.kp == pytest.approx(T[k], rel=0.05)
        assert servo.delay == pytest.approx(true[2], abs=2.5e-3)
        own = result.parameters[6 * k : 6 * k + 6]
        held += [own[i].low <= x <= own[i].high for i, x in zip((0, 1, 4), true, strict=True)]
    assert np.mean(held) >= 0.9


def test_a_joint_s_own_profile_replaces_that_of_all(tmp_path):
    t, u, q = log(70, 12.0)
    path = write(tmp_path / "log.csv", t, u, q)
    joints: dict[str, dict[str, object]] = {
        joint: {
            "position": {"column": f"position_{joint}"},
            "command": {"column": f"target_{joint}", "unit": "rad"},
        }
        for joint in JOINTS
    }
    joints["gripper"]["profile"] = {"speed": 0.5}
    given = servo_logs(MODEL, [path], map_of({"joints": joints, "profile": {"speed": 0.8}}))
    assert given is not None
    (one,) = given.logs
    speeds = np.abs(np.diff(one.target, axis=0)).max(axis=0) / 0.02
    np.testing.assert_allclose(speeds[:5], 0.8, rtol=0.25)
    np.testing.assert_allclose(speeds[5], 0.5, rtol=0.25)
    np.testing.assert_allclose(one.issued, u, atol=1e-6)
    with pytest.raises(InvalidInput, match="profile"):
        map_of({"profile": {"speed": -1.0}})


@pytest.mark.usefixtures("no_profile_search")
def test_logs_with_other_stiffness_registers_are_fitted_together(tmp_path):
    """The second log was recorded with twice the register's P; kp is that of the first."""
    files = [write(tmp_path / f"p{p}.csv", *log(80 + p, 25.0, stiffer=p / 16)) for p in (16, 32)]
    told = {file.name: {"p": p} for file, p in zip(files, (16, 32), strict=True)}
    given = servo_logs(MODEL, files, map_of({"files": told}))
    assert given is not None and [one.stiffer for one in given.logs] == [1, 2]
    result = identify_servos(given)
    for k, servo in enumerate(result.servos):
        assert servo.error < 0.6e-3
        assert servo.kv / servo.kp == pytest.approx(T[k], rel=0.05)
        assert servo.kp == pytest.approx(KP[k], rel=0.05) or not servo.gravity
    write_servo_mjcf(result, tmp_path / "identified.xml")
    own, *_ = compare_servos(given, [tmp_path / "identified.xml"])
    assert np.mean(own.errors[-1]) < 1.5e-3
    del told["p32.csv"]
    with pytest.raises(InvalidInput, match="p of every log"):
        servo_logs(MODEL, files, map_of({"files": told}))


def test_a_filter_of_the_model_file_is_the_targets_lag(tmp_path):
    path = tmp_path / "arm.xml"
    text = MODEL.read_text().replace("<position ", '<position timeconst=".1" ')
    path.write_text(text)
    assert mujoco.MjModel.from_xml_path(str(path)).na == 6
    file = write(tmp_path / "log.csv", *log(71, 12.0))
    given, told = (
        servo_logs(path, [file]),
        servo_logs(MODEL, [file], map_of({"profile": {"lag": 0.1}})),
    )
    assert given is not None and told is not None
    np.testing.assert_array_equal(given.logs[0].target, told.logs[0].target)
