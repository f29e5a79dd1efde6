from dataclasses import replace

import mujoco
import mujoco.sysid
import numpy as np
import pytest

from nsaid_mj.base.errors import InvalidInput
from nsaid_mj.clinic.identify.comparison import by_toolbox, compare_arms
from nsaid_mj.clinic.identify.export import replay
from nsaid_mj.clinic.identify.models import load_robot_model
from nsaid_mj.clinic.logs.recordings import LogSegment, Recordings
from nsaid_mj.core.log import Log
from nsaid_mj.robots.errors import BadRobot
from nsaid_mj.robots.identified import Identified
from nsaid_mj.robots.mjcf_export import write_mjcf
from tests.robots.test_mjcf import arm
from tests.robots.urdfs import chain
from tests.robots.values import identified


def recorded(robot, values, path, rate=100, seconds=2.0, law=(0.0, 0.0)):
    """A log of the calibrated model itself, driven by sines.

    `law` is kp and kd of motors that follow the sines as targets, if not 0.
    """
    write_mjcf(robot, values, path)
    mj = mujoco.MjModel.from_xml_path(str(path))
    substeps = 5
    mj.opt.timestep = 1 / (rate * substeps)
    mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
    data, n = mujoco.MjData(mj), len(robot.joints)
    order = [list(mj.actuator_trnid[:, 0]).index(mj.joint(j).id) for j in robot.joints]
    t = np.arange(round(rate * seconds)) / rate
    targets = 0.3 * np.sin(2 * np.pi * t[:, None] * (0.5 + np.arange(n)))
    q, v, u = np.zeros((3, len(t), n))

    def commands(target):
        return law[0] * (target - data.qpos) - law[1] * data.qvel if any(law) else target

    for k in range(len(t)):
        q[k], v[k], u[k] = data.qpos, data.qvel, commands(targets[k])
        for _ in range(substeps):
            data.ctrl[order] = commands(targets[k])
            mujoco.mj_step(mj, data)
    segment = LogSegment(Log(t, q, v, u), np.ones((len(t), n), dtype=bool), "log", (1, len(t)))
    feedback = np.multiply.outer(law, np.ones(n)) if any(law) else None
    return Recordings((segment,), rate, ("",) * n, feedback=feedback)


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_the_model_that_made_a_log_follows_it(tmp_path, name):
    path = tmp_path / name
    path.write_text(chain() if name.endswith("urdf") else arm())
    robot = load_robot_model(str(path))
    values = identified(robot)
    log = recorded(robot, values, tmp_path / "calibrated.xml")
    exported, nominal = (replay(robot, own, log) for own in (values, Identified.nominal(robot)))
    assert exported.shape == (3,)
    assert (exported < 1e-3).all()  # MuJoCo keeps the solver's last state, a log does not
    assert (nominal > 5 * exported).all()


def test_motors_under_a_pd_law_follow_their_targets_in_the_replay(tmp_path):
    """Their torques at the measured motion would let every error of the model grow unchecked."""
    path = tmp_path / "arm.xml"
    path.write_text(arm())
    robot = load_robot_model(str(path))
    values = identified(robot)
    log = recorded(robot, values, tmp_path / "calibrated.xml", law=(4.0, 0.2))
    open_loop = replace(log, feedback=None)
    assert (replay(robot, values, log) < 2e-3).all()
    assert (replay(robot, values, open_loop) > 5 * replay(robot, values, log)).all()


def test_a_part_of_a_long_logs_windows_has_the_error_of_all(tmp_path, monkeypatch):
    path = tmp_path / "arm.urdf"
    path.write_text(chain())
    robot = load_robot_model(str(path))
    values = identified(robot)
    log = recorded(robot, values, tmp_path / "calibrated.xml", seconds=20.0)
    nominal = Identified.nominal(robot)
    all_of_them = replay(robot, nominal, log)
    monkeypatch.setattr("nsaid_mj.clinic.identify.export._MOST", 25)
    some = replay(robot, nominal, log)
    assert not np.array_equal(some, all_of_them)
    assert some == pytest.approx(all_of_them, rel=0.3)


def test_a_log_without_a_long_enough_segment_is_refused(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(chain())
    robot = load_robot_model(str(path))
    values = identified(robot)
    short = recorded(robot, values, tmp_path / "calibrated.xml", seconds=0.1)
    with pytest.raises(InvalidInput, match=r"0\.2 s"):
        replay(robot, values, short)


@pytest.mark.skipif(not hasattr(mujoco.sysid, "optimize"), reason="needs mujoco[sysid]")
@pytest.mark.slow
def test_mujocos_toolbox_fits_an_arm_by_force(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(arm())
    robot = load_robot_model(str(path))
    recordings = recorded(robot, identified(robot), tmp_path / "true.xml", seconds=3.0)
    values, delays = by_toolbox(robot, recordings, budget=3.0)
    found, nominal = (replay(robot, x, recordings) for x in (values, Identified.nominal(robot)))
    assert (found < 0.5 * nominal).all() and np.abs(delays).max() < 0.01


def test_models_by_force_are_compared(tmp_path):
    """The model that made a log scores best; a wrong one and a constant velocity are far off."""
    path = tmp_path / "arm.xml"
    path.write_text(arm())
    robot = load_robot_model(str(path))
    values, true, heavy = identified(robot), tmp_path / "true.xml", tmp_path / "heavy.xml"
    recordings = recorded(robot, values, true, seconds=4.0)
    wrong = replace(values, damping=3 * values.damping)
    write_mjcf(robot, wrong, heavy)
    best, worse, constant = compare_arms(robot, recordings, [true, heavy])
    assert (best.errors[:2] < 1e-2).all() and (best.one_step < 0.05).all()
    assert (worse.errors[:2].sum(axis=1) > 5 * best.errors[:2].sum(axis=1)).all()
    assert (constant.errors[0] > best.errors[0]).all()
    assert np.isfinite(best.errors).all()
    short = recorded(robot, values, true, seconds=1.0)
    with pytest.raises(InvalidInput, match="2 s"):
        compare_arms(robot, short, [true])
    other = tmp_path / "other.urdf"
    other.write_text(chain())
    with pytest.raises(BadRobot, match="other joints"):
        compare_arms(robot, recordings, [other])
