"""What a verdict compares errors with: the command's variation, its noise, and the motor."""

import numpy as np
import pytest

from nsaid_mj.base import Finding
from nsaid_mj.clinic.identify import wording
from nsaid_mj.clinic.identify.calibrate import _command_noise, unphysical
from nsaid_mj.clinic.identify.identifiability import _positive
from nsaid_mj.clinic.identify.result import JointStructure
from nsaid_mj.clinic.identify.verdict import JudgedPart, graded, verdict
from nsaid_mj.clinic.logs.recordings import LogSegment, Recordings
from nsaid_mj.core import Log
from nsaid_mj.core.parameters import Block, ParameterSpace


def joint(name="elbow", held_out=0.1, **more):
    return JointStructure(name, held_out=held_out, force=2.0, **more)


@pytest.mark.parametrize(
    ("errors", "explains"),
    [((0.1, 0.1), "yes"), ((0.1, 0.3), "partly"), ((0.1, 0.9), "partly"), ((0.9, np.nan), "no")],
)
def test_a_structure_explains_as_much_as_its_parts(errors, explains):
    assert graded([JudgedPart("a", error, 0.2, 0.5) for error in errors])[0] == explains


def test_the_error_is_told_in_the_unit_of_the_force_and_the_next_step_is_named():
    explains, sentence = verdict([joint("a", 0.05), joint("b", 0.15)])
    assert explains == "yes" and "largest at b: 0.3 N·m" in sentence
    assert "Next: confirm it on a log of another motion" in sentence


def test_an_error_that_is_the_commands_own_noise_is_explained():
    assert verdict([joint(held_out=0.4)])[0] == "partly"
    explains, sentence = verdict([joint(held_out=0.4, noise=0.35)])
    assert explains == "yes" and "noise of the command itself" in sentence
    assert verdict([joint(held_out=0.9, noise=0.9)])[0] == "no"  # a command of noise alone


def test_what_only_impossible_masses_predict_is_not_explained():
    """A hand moves the joint, and its motor compensates the weight."""
    moved = joint("pan", 0.18, least_squares=0.01)
    findings = unphysical([joint("lift", 0.18, least_squares=0.1), moved])
    assert [finding.where for finding in findings] == ["pan"]
    explains, sentence = verdict([moved], findings)
    assert explains == "partly" and "explains 0 of 1" in sentence
    assert "pan: no possible masses and frictions" in sentence
    assert "Next: record a motion that its motor makes" in sentence


def test_an_error_of_most_of_a_motors_force_does_not_explain():
    """0.3 N·m of a motor that has 0.4: the scale of the forces cannot be right either."""
    assert verdict([joint(held_out=0.15, limit=0.4)])[0] == "partly"
    assert verdict([joint(held_out=0.15, limit=4.0)])[0] == "yes"


def test_feet_that_are_elsewhere_are_part_of_the_verdict():
    """The fit allows for feet that are off, but legs of other lengths are not what was modelled."""
    remedy = "Measure the legs."
    feet = [Finding("warning", "offset_foot", f"{leg}_foot", "off", remedy) for leg in ("FL", "RR")]
    explains, sentence = verdict([joint()], feet)
    assert explains == "partly" and "by FL_foot, RR_foot. Next: measure the legs." in sentence
    imu = Finding("warning", "offset_turn", "IMU", "turned", "Correct it.")
    assert verdict([joint()], [imu])[0] == "yes"


def test_a_leg_in_swing_shows_nothing_where_only_stance_makes_its_error_small():
    small = joint("knee", 0.05, alone=0.27)
    assert wording.quality(small.held_out, small.alone).kind == "weak"
    assert wording.quality(0.05, 0.1).kind == wording.quality(0.05).kind != "weak"
    explains, sentence = verdict([joint("a", 0.3), joint("b", 0.1), small])
    assert explains == "partly" and "1 of 2" in sentence


def test_only_white_noise_of_a_command_counts():
    t = np.arange(4000) / 200
    smooth = np.sin(2 * np.pi * 0.5 * t)
    edges = np.sign(np.sin(2 * np.pi * 15 * t))  # fast, but no noise
    noisy = smooth + 0.5 * np.random.default_rng(0).standard_normal(len(t))
    u = np.column_stack([smooth, smooth + edges, noisy])
    log = Log(t, 0 * u, 0 * u, u)
    segment = LogSegment(log, np.ones(u.shape, dtype=bool), "log.csv", np.arange(len(t)))
    found = _command_noise(Recordings((segment,), 200.0, ("A",) * 3), 5.0)
    assert found[0] < 1e-3 and found[1] == 0
    assert found[2] == pytest.approx(0.5 * np.sqrt(2) * np.sqrt(0.05), rel=0.1)


def test_only_what_cannot_be_negative_has_the_interval_of_a_factor():
    """An entry of a mass matrix off its diagonal has either sign, though its unit is kg."""
    one = np.ones(3)
    matrix = Block("M", ("M_11", "M_12", "M_22"), ("kg",) * 3, one, "spd")
    entries = ((0, 0, 0, 1.0), (1, 0, 1, 1.0), (1, 1, 0, 1.0))
    tied = Block("added", ("x", "yr"), ("kg", "kg"), one[:2], "tied", entries=entries)
    link = Block("link", tuple("mnopqrstuv"), ("kg",) * 10, np.ones(10), "pseudo_inertia")
    gain = Block("gain", ("g",), ("N",), one[:1], "positive")
    found = _positive(ParameterSpace((matrix, tied, link, gain)))
    assert found.tolist() == [True, False, True, True, False, True, *9 * [False], True]
