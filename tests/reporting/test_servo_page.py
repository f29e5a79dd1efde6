"""The page of identified servos: verdict, servos, and the replay of a log."""

import re

import numpy as np

from nsaid_mj.calibration.data import RobotModel
from nsaid_mj.calibration.payloads import Load
from nsaid_mj.calibration.servos import ServoIdentification, ServoLog
from nsaid_mj.calibration.servos.estimate import JointEstimate, MassScale
from nsaid_mj.calibration.servos.words import masses, parameters, servo, weighed
from nsaid_mj.reporting.identification.servos import write_servos

NAMES = ("lift", "elbow")


def result():
    none = np.zeros(2)
    robot = RobotModel("arm", None, "mjcf", None, NAMES, none, none, none, none + 1, none + np.inf)
    joint = JointEstimate(
        np.log([0.06, 0.02, 0.08, 2e-3, 0.015]), 0.01 * np.eye(5), 2.0, True, 0.0, 2e-3, 2e-2, 0.1
    )
    scale = MassScale(np.log(1.3), 0.03, 2.0, np.zeros(3), np.full(3, 0.01))
    return ServoIdentification(
        explains="yes", verdict="The servo model explains the motion.", robot=robot,
        servos=tuple(servo(name, joint, scale) for name in NAMES),
        parameters=tuple(
            p for k, name in enumerate(NAMES, 1) for p in parameters(name, k, joint, scale)
        ),
        scale=masses(scale), masked=0.0,
        findings=(weighed(Load("b.csv", 0.2), "elbow", scale),), seconds=1.0,
    )  # fmt: skip


def test_it_has_a_line_and_a_replay_for_every_servo(tmp_path):
    t = np.arange(100) / 50
    q = np.column_stack([np.sin(t), np.cos(t)])
    log = ServoLog("motion_1.csv", t, q, q, 0 * q, 0 * q)
    path = write_servos(result(), tmp_path, "nsaid identify --model arm.xml", (log, q + 0.01))
    text = path.read_text(encoding="utf-8")
    assert "Replay of motion_1.csv" in text and "explains the motion" in text
    assert text.count("<svg") >= len(NAMES)
    assert re.search(r"16\.[23]\s±20", text)  # kp = 1.3 / 0.08
    assert "the load of 0.2 kg" in text
    without = write_servos(result(), tmp_path).read_text(encoding="utf-8")
    assert "Replay" not in without
