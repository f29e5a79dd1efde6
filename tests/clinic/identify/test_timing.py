"""Delays, friction and cut-offs, which a log tells together."""

import numpy as np
import pytest
from scipy.signal import lfilter

from nsaid_mj.clinic.identify.choose.clocks import clock_offset
from nsaid_mj.clinic.identify.choose.columns import BASIC, BROAD, FALLEN, Choice
from nsaid_mj.clinic.identify.choose.cutoff import flat_range, middle_of, trials
from nsaid_mj.clinic.identify.choose.held_out import Contest, FrictionShape, held_out_errors, shapes
from nsaid_mj.clinic.identify.choose.joint_search import _without_holding
from nsaid_mj.clinic.identify.choose.timing import Timing, search
from nsaid_mj.clinic.identify.identify import identify_forces
from nsaid_mj.clinic.identify.result import Identification
from tests.clinic.identify.test_residuals import rows_of
from tests.court.field_timing import draw, identified, judge
from tests.support.robot_logs import Flaw, arm_log, two_joints, write_csv

NAMES = ("left", "right")

# -- arms ------------------------------------------------------------------------------------------


def assert_true(seeds: range, least: float) -> None:
    """Delays are within a millisecond, intervals hold, of a share `least` of identified numbers."""
    held = []
    covered = []
    for seed in seeds:
        drawn = draw(seed)
        told = judge(identified(drawn), drawn)
        assert np.abs(told.delays - drawn.delay).max() < 1e-3, seed
        covered.append(told.covered)
        held += told.numbers.values()
    assert np.mean(covered) >= 0.9 and np.mean(held) >= least


def test_an_arm_with_a_delay_and_stribeck_friction_is_told():
    """Its speeds of friction are none of those that are tried."""
    assert_true(range(10, 11), 0.85)


@pytest.mark.slow
def test_forty_arms_with_a_delay_and_stribeck_friction_are_told():
    assert_true(range(200, 240), 0.93)


@pytest.mark.slow
def test_the_delay_costs_nothing():
    for seed in range(300, 310):
        drawn = draw(seed)
        found = identified(drawn)
        # in one band, as errors in different ones cannot be compared
        given = identified(drawn, drawn.delay, found.cutoff)
        assert judge(found, drawn).held_out < judge(given, drawn).held_out + np.log(1.1), seed


def late(values: dict[str, np.ndarray], seconds: float) -> dict[str, np.ndarray]:
    """A log whose commands carry stamps that are too late by some seconds."""
    t = values["time"]
    moved = {k: np.interp(t - seconds, t, x) for k, x in values.items() if "current" in k}
    return values | moved


def told(values: dict[str, np.ndarray], path) -> Identification:
    return identify_forces(two_joints(), write_csv(path / "log.csv", values))


def test_no_command_acts_before_it_was_recorded(tmp_path):
    """Stamps that are late are an offset of clocks; a delay of 0 is no negative one."""
    values, _ = arm_log(two_joints(), 3, duration=10.0)
    found = told(late(values, 0.03), tmp_path)
    (offset,) = [f for f in found.findings if f.code == "clock_offset"]
    assert "offset between the clocks" in offset.text and "`offset = -0.03" in offset.remedy
    low, high = found.joints[0].delay_interval
    assert low < -0.03 < high < 0
    found = told(values, tmp_path)
    assert "clock_offset" not in {f.code for f in found.findings}
    low, high = found.joints[0].delay_interval
    assert 0 <= found.joints[0].delay < 1e-3 and low == 0 and high < 2e-3


@pytest.mark.parametrize("seconds", [0.7, pytest.param(-1.5, marks=pytest.mark.slow)])
def test_clocks_that_are_far_apart_are_told_and_the_remedy_helps(tmp_path, seconds):
    values, _ = arm_log(two_joints(), 5, duration=8.0, rate=100.0)
    apart = late(values, -seconds)
    found = told(apart, tmp_path)
    (offset,) = [f for f in found.findings if f.code == "clock_offset"]
    assert offset.data["seconds"] == pytest.approx(seconds, abs=0.06)
    assert found.explains == "no" and found.joints[0].delay_interval is None
    assert told(late(apart, offset.data["seconds"]), tmp_path).explains != "no"


def test_forces_that_have_nothing_in_common_tell_no_offset():
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(1000)
    noise = rng.standard_normal((2, 1000, 3))
    assert clock_offset(noise[0], noise[1], t, np.zeros(1000, dtype=int)) is None
    assert clock_offset(noise[0], np.roll(noise[0], -25, axis=0), t, np.zeros(1000, dtype=int)) == (
        pytest.approx(0.5, abs=0.01)
    )


def test_a_contest_has_the_errors_of_regression():
    """Those of one structure after another."""
    rows = rows_of(arm_log(two_joints(), 1, Flaw(delay=0.01, stiction=0.5), duration=10.0)[0])
    choice = Choice((BASIC, BASIC), (BROAD, BROAD), np.full(2, 0.01))
    u = np.stack([rows.commands(np.full(2, d))[:, 1] for d in (0.0, 0.01)], axis=1)
    names = [BASIC, BASIC | {"stribeck"}, BASIC | {"load", "quadratic", "cubic"}]
    contest = Contest(rows, choice, 1, u)
    for own in names:
        shape = FrictionShape(own - {"rotor", "viscous"}, 4, FALLEN)
        found = contest.errors([shape])[0]
        used = choice.with_joint(1, own, 4, FALLEN)
        for d in (0, 1):
            expected = held_out_errors(rows, used, u[:, d], 1)
            if np.isfinite(found[d]).all():
                np.testing.assert_allclose(found[d], expected, rtol=2e-3)


def test_friction_that_its_load_alone_would_hold_is_no_friction():
    """Of a log with load friction of .4, whose column is then made a hundredth of what it is."""
    rows = rows_of(arm_log(two_joints(), 1, duration=10.0)[0])
    choice = Choice((BASIC | {"load"}, BASIC), (BROAD, BROAD), np.zeros(2))
    shape = FrictionShape(frozenset({"coulomb", "load"}), BROAD, FALLEN)
    commands = rows.commands(choice.delay)
    commands[:, 0] += 0.4 * rows.column("load", 0, choice) / rows.gain[0]
    rows.commands = lambda delay: commands
    u = commands[:, [0]]
    assert _without_holding(rows, choice)[0] is choice
    assert np.isfinite(Contest(rows, choice, 0, u).errors([shape])).all()
    rows.diagonal["load"] = rows.diagonal["load"] / 100
    left, (said,) = _without_holding(rows, choice)
    assert left.columns == (BASIC, BASIC) and "left out" in said.text
    assert np.isinf(Contest(rows, choice, 0, u).errors([shape])).all()


def test_stribeck_friction_falls_above_the_speed_of_dry_friction():
    tried = shapes(frozenset({"coulomb", "stribeck"}), FrictionShape(frozenset(), BROAD, FALLEN))
    assert len(tried) == len(set(tried)) > 20
    assert len(shapes(frozenset(), tried[0])) == 1


# -- cut-offs --------------------------------------------------------------------------------------


def test_the_flat_range_ends_where_errors_rise():
    errors = np.array([1.3, 1.0, 0.99, 1.005, 1.2, 1.0])[:, None] * np.ones(5)
    assert list(flat_range(errors)) == [1, 2, 3]
    assert middle_of(range(1, 4), 3) == 3 and middle_of(range(3), 4) == 0
    assert middle_of(range(5, 6), 4) == 4


def swinging(seed: int, size: float) -> dict[str, np.ndarray]:
    """A pendulum's log at 300 Hz, whose encoder's noise is coloured."""
    values, _ = arm_log(
        two_joints(("shoulder",)), seed, rate=300.0, duration=30.0, fastest=1.0, noise=0.0
    )
    rng = np.random.default_rng(seed)
    kept = np.exp(-2 * np.pi * 15 / 300)
    white = rng.standard_normal((2, len(values["time"])))
    noise = lfilter([np.sqrt(1 - kept**2)], [1, -kept], white[0])
    values["shoulder_position"] = values["shoulder_position"] + size * (
        0.8 * noise + 0.2 * white[1]
    )
    return values


@pytest.mark.parametrize("seed", [0, 1])
def test_coloured_noise_of_an_encoder_does_not_shrink_the_inertia(tmp_path, seed):
    """At a cut-off of 20 Hz, at which all such logs were filtered, a tenth of it is left."""
    robot = two_joints(("shoulder",))
    _, true = arm_log(robot, seed, rate=300.0, duration=30.0, fastest=1.0, noise=0.0)
    log = write_csv(tmp_path / "log.csv", swinging(seed, 2e-3))
    found = identify_forces(robot, log, known={"gain_1": true["gain_1"]})
    value = {p.name: p.value for p in found.parameters}
    inertia = 2.0 * 0.2**2 + 0.02 + true["rotor_1"]
    assert found.cutoff < 8 and value["Izz_1"] + value["rotor_1"] == pytest.approx(inertia, rel=0.1)
    assert found.joints[0].delay_interval[0] < 1e-3


def test_trials_begin_at_the_motion_and_end_above_the_usual():
    recordings = rows_of(arm_log(two_joints(), 1, duration=10.0)[0]).recordings
    found = trials(recordings)
    assert found == sorted(found) and found[0] >= 2.0 and found[-1] <= 30.0 and len(found) >= 2


# -- vehicles --------------------------------------------------------------------------------------


def timed(cost, free=(0, 1), **more):
    return search(cost, NAMES, list(free), lambda _: None, 0.01, **more)


def bowl(delay: float, lag: float, deep: float = 1e5):
    """A cost with its least at a delay and a lag [s], and a valley along their sum."""

    def cost(x: Timing) -> float:
        return deep * ((x.delay + x.lag - delay - lag) ** 2 + 0.1 * (x.lag - lag) ** 2)

    return cost


def test_a_delay_and_a_lag_have_intervals():
    found = timed(bowl(0.05, 0.08, 1e7))
    assert found.timing.delay == pytest.approx(0.05, abs=2e-3)
    assert found.timing.lag == pytest.approx(0.08, abs=2e-3)
    assert found.delay[0] < 0.05 < found.delay[1] and found.delay[1] - found.delay[0] < 0.01
    (lag,) = [f for f in found.findings if f.code == "lag"]
    assert lag.data["interval"][0] < 0.08 < lag.data["interval"][1] and "95 %" in lag.text


def test_a_dead_zone_of_rotors_is_sought_with_their_curve_and_told():
    def cost(x: Timing) -> float:
        return 1e4 * ((x.dead - 0.12) ** 2 + (x.mix - 0.4) ** 2 + x.delay**2 + x.lag**2)

    found = timed(cost, (0, 1, 2, 3))
    assert found.timing.dead == pytest.approx(0.12, abs=0.01)
    assert any(abs(other.dead - found.timing.dead) > 0.003 for other in found.others)
    (curve,) = [f for f in found.findings if f.code == "curve"]
    assert "with x = (u − 0.12)/0.88 of the command u" in curve.text
    assert timed(cost, (0, 1, 2, 3), turning=0.05).timing.dead <= 0.05  # where rotors turn
    plain = timed(lambda x: 1e4 * (x.delay**2 + x.lag**2 + (x.mix - 1) ** 2), (0, 1, 2, 3))
    assert plain.timing.dead == 0


def test_a_lag_makes_no_delay_negative():
    """A cost that would be least at a lag of .1 s and a delay of −60 ms."""
    found = timed(bowl(-0.06, 0.1, 1e6))
    assert found.timing.delay >= 0 and found.timing.lag <= 0.1
    assert not {"clock_offset"} & {f.code for f in found.findings}


def test_commands_that_act_too_early_are_an_offset_of_clocks():
    found = timed(bowl(-0.055, 0.0), (0,))
    (offset,) = [f for f in found.findings if f.code == "clock_offset"]
    assert (
        found.timing.delay == pytest.approx(-0.055, abs=1e-3) and "`offset = -0.05" in offset.remedy
    )


def test_what_lies_at_the_edge_is_no_delay():
    found = timed(lambda x: -1e4 * x.delay, (0,))
    assert found.timing == Timing() and found.delay is None
    assert [f.code for f in found.findings] == ["delay_at_edge"]
    assert "no delay of the command is identified" in found.findings[0].text
