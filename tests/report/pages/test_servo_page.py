"""The page of identified servos: verdict, servos, and the replay of a log."""

import re

import numpy as np

from nsaid_mj.clinic.servos.logs import ServoLog
from nsaid_mj.clinic.servos.page import compared, servo_page
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
    assert re.search(r"16\.[23] N·m/rad ±20", text)  # kp = 1.3 / 0.08
    assert "the load of 0.2 kg" in text
    assert "q [rad]" in text and "rad or m" not in text
    assert "Shaded: left out of the fit" in text
    assert "Replay" not in render_html(servo_page(result))


def test_the_files_values_stand_beside_the_identified_ones():
    result = identified_servos(np.ones(10))
    before = np.tile([[998.0], [3.33], [0.028], [0.052]], (1, len(NAMES)))
    changed, intervals = compared(result, before)
    table, _ = changed.panels
    for line, servo in zip(table.lines, result.servos, strict=True):
        assert line[0] == servo.name
        assert line[1].startswith("998 → ") and f"{servo.kp:.3g}" in line[1]
    figures, _ = intervals.panels
    assert [figure.title for figure in figures.figures][:2] == [
        "Damping over kp",
        "Friction over kp",
    ]
    assert all(name in figures.figures[0].drawing for name in NAMES)
