"""The page of identified servos: verdict, servos, and the replay of a log."""

import re

import numpy as np

from nsaid_mj.clinic.servos.logs import ServoLog
from nsaid_mj.clinic.servos.page import servo_page
from nsaid_mj.clinic.servos.result import Replayed
from nsaid_mj.report.page import render_html
from tests.support.servos import NAMES, identified_servos


def test_it_has_a_line_and_a_replay_for_every_servo():
    t = np.arange(100) / 50
    q = np.column_stack([np.sin(t), np.cos(t)])
    log = ServoLog("motion_1.csv", t, q, q, q, 0 * q, np.zeros((*q.shape, q.shape[1])))
    used = np.r_[np.ones(60), np.zeros(40)]
    result, replayed = identified_servos(used), Replayed((log,), (q + 0.01,), used)
    text = render_html(servo_page(result, ["nsaid identify"], replayed))
    assert "Replay of motion_1.csv" in text and "explains the motion" in text
    assert text.count("<svg") >= len(NAMES)
    assert re.search(r"16\.[23]\s±20", text)  # kp = 1.3 / 0.08
    assert "the load of 0.2 kg" in text
    assert "q [rad]" in text and "rad or m" not in text
    assert "Shaded: left out of the fit" in text
    assert "Replay" not in render_html(servo_page(result))
