"""Legs that swing, simulated along the motion of their base."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from nsaid_mj.clinic.identify.ground.trial import _Leg, _of_legs, _windows
from nsaid_mj.clinic.identify.models import floating, load_robot_model
from nsaid_mj.clinic.identify.smoothing import Smooth

from .walking import model_text

LEG = [3, 4, 5]
STIFF = 5.0
"""Of a PD law [N·m/rad]."""


def _thrown(mj: mujoco.MjModel, targets: np.ndarray) -> Smooth:
    """A robot that tumbles through the air while its joints are driven to targets (M, 9)."""
    data = mujoco.MjData(mj)
    data.qvel[3:6] = [0.5, -0.4, 0.8]
    q, v, a = (np.zeros((len(targets), n)) for n in (16, 15, 15))
    for k, target in enumerate(targets):
        data.qfrc_applied[6:] = target - STIFF * data.qpos[7:]
        mujoco.mj_forward(mj, data)
        q[k] = np.r_[np.zeros(3), data.qpos[[4, 5, 6, 3]], data.qpos[7:]]
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        v[k, 3:] = data.qvel[3:]
        a[k] = np.r_[turn.reshape(3, 3).T @ data.qacc[:3], data.qacc[3:]]
        mujoco.mj_step(mj, data)
    t = np.arange(len(targets)) * mj.opt.timestep
    return Smooth(t, q, v, a, np.ones((len(t), 15), dtype=bool))


def test_a_swinging_leg_follows_its_commands_on_a_base_that_moves(tmp_path: Path) -> None:
    path = tmp_path / "tripod.xml"
    path.write_text(model_text())
    robot = floating(load_robot_model(str(path)))
    spec = mujoco.MjSpec.from_string(model_text())
    spec.option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mj = spec.compile()
    phase = np.arange(400)[:, None] * 0.02 + np.arange(9)
    targets = 1.5 * np.sin(phase)
    motion = _thrown(mj, targets)
    windows = _windows(np.ones(400, dtype=bool), 150)
    assert windows[:, 0].tolist() == [0, 150]
    moved = np.ptp(motion.q[:, 10:13], axis=0).max()
    right = _Leg(robot, mj, LEG, np.full(9, STIFF)).departures(motion, targets, windows)
    assert np.abs(right).max() < 0.01 * moved
    wrong = _Leg(robot, mj, LEG, np.zeros(9)).departures(motion, targets, windows)
    assert np.abs(wrong).max() > 0.1 * moved


def test_windows_lie_where_a_leg_swings_throughout() -> None:
    free = np.ones(100, dtype=bool)
    free[[10, 40, 41]] = False
    assert _windows(free, 20)[:, [0, -1]].tolist() == [[11, 31], [42, 62], [62, 82]]


def test_the_error_of_swinging_legs_is_over_their_size_and_of_legs_that_swing_enough() -> None:
    acting = np.random.default_rng(0).standard_normal((50, 3))
    acting -= acting.mean(axis=0)
    half, right = ([(acting, leg), (c * acting, leg)] for c, leg in ((0.5, LEG), (1.0, [6, 7, 8])))
    seldom = [(acting[:10], [9, 10, 11]), (9 * acting[:10], [9, 10, 11])]
    assert _of_legs([half]) == pytest.approx(0.5)
    assert _of_legs([half, right, seldom]) == pytest.approx(0.5 / np.sqrt(2))
    assert np.isnan(_of_legs([seldom]))
